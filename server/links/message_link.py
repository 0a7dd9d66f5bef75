"""Base of links that receive messages with a schema instead of bytes: foxglove://, ros2://.

    library's thread ─> MessageLink.deliver: now_ns(), a record (protocols/messages/records.py) ─> ChunkQueue ─> session

Each message is one chunk, so a recording and the decoder have its arrival. Definitions of channels come before the
first message of each, again every two seconds, for a decoder that starts later, and as `preamble` for a recording.

Such a source has no bytes, counters or status of a device, and nothing can be sent to it.
"""

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass

from imuscope.protocols.messages.family import NAME
from imuscope.protocols.messages.records import COUNTED, MAX_RECORD, MessageChannel, definition, message_record
from imuscope.server.links.base import Chunk, LinkError, LinkSettings
from imuscope.server.links.reader_thread import ChunkQueue, ThreadedLink
from imuscope.server.links.source_url import SourceUrl, bad
from imuscope.server.links.text import place_of

DESCRIBE_NS = 2_000_000_000
MOST_CHANNELS = 1024
MOST_COUNTED = 64  # whose publisher's messages are counted; a node that is started again is another publisher
TOPICS_LISTED = 6
MOST_TOPICS = 64  # in one source

NO_NUMBERS = frozenset(
    f"{package}{name}"
    for package, names in (
        ("sensor_msgs/msg/", ("Image", "CompressedImage", "PointCloud2", "LaserScan", "CameraInfo")),
        ("foxglove.", ("RawImage", "CompressedImage", "CompressedVideo", "PointCloud", "SceneUpdate", "Log", "Grid")),
        ("", ("rcl_interfaces/msg/Log", "nav_msgs/msg/OccupancyGrid", "visualization_msgs/msg/MarkerArray")),
    )
    for name in names
)
"""Types left out of a source without topics: much data, and hardly a number to plot."""


@dataclass(frozen=True, slots=True)
class TopicSource:
    """Address of a source of messages: scheme://host:port/topic,/topic?type=sensor_msgs/msg/Imu.

    Args:
        topics: with their first slash; () for all.
        type: of the topics; "" for any.
    """

    host: str
    port: int
    topics: tuple[str, ...]
    type: str

    @property
    def place(self) -> str:
        """Host and port for display."""
        return place_of(self.host, self.port)

    @classmethod
    def parse(cls, parsed: SourceUrl, default_port: int) -> "TopicSource":
        """Read the address.

        Raises:
            LinkError: "bad-source".
        """
        host, _, path = parsed.place.partition("/")
        if (host and not host.endswith("]") and ":" not in host) or host.endswith("]"):
            host = f"{host}:{default_port}"
        address = SourceUrl(parsed.text, parsed.kind, host, parsed.options).address(listening=False)
        topics = tuple(dict.fromkeys(f"/{one.strip().strip('/')}" for one in path.split(",") if one.strip("/ ")))
        if len(topics) > MOST_TOPICS:
            raise bad(parsed.text, f"it names {len(topics)} topics", f"Give up to {MOST_TOPICS}, or none for all.")
        return cls(*address, topics, parsed.options.get("type", "").strip())


@dataclass(frozen=True, slots=True)
class SeenTopic:
    """A topic that the other side has: its name and the name of its type."""

    name: str
    type: str


class MessageLink(ThreadedLink):
    """A link that receives messages.

    Attributes:
        where: its address.
    """

    datagrams = True

    def __init__(self, source: str, settings: LinkSettings, where: TopicSource) -> None:
        super().__init__(source, settings)
        self.where = where
        self.protocol = NAME
        self._numbers: dict[tuple[MessageChannel, str], int] = {}  # a channel without its id, and its publisher
        self._lock = threading.Lock()
        self._described_ns = 0
        self._flusher: _Flusher | None = None

    def begin(self) -> None:
        """Begin to take messages; called by `open`."""
        self._described_ns = 0
        self._queue = ChunkQueue(self)
        self._flusher = _Flusher(self._queue)
        self._flusher.start()

    def channel(
        self, topic: str, encoding: str, schema: str, schema_encoding: str, schema_data: bytes, *, publisher: str = ""
    ) -> int:
        """Id of a channel, defined on first use; 0 beyond the maximum number, which is smaller with a publisher.

        Args:
            publisher: name of the publisher, if its messages are counted.
        """
        metadata = {COUNTED: "publisher", "publisher": publisher} if publisher else {}
        new = MessageChannel(0, topic, encoding, schema, schema_encoding, schema_data, metadata)
        with self._lock:
            number = self._numbers.get((new, publisher), 0)
            if number or len(self._numbers) >= (MOST_COUNTED if publisher else MOST_CHANNELS):
                return number
            number = self._numbers[new, publisher] = len(self._numbers) + 1
            made = MessageChannel(number, topic, encoding, schema, schema_encoding, schema_data, metadata)
            self.preamble += definition(made)
            self._described_ns = 0
        return number

    def deliver(self, channel: int, data: bytes, arrival_ns: int, *, sequence: int = 0, publish_ns: int = 0) -> None:
        """Take a message that has just arrived; from any thread."""
        queue, flusher = self._queue, self._flusher
        if queue is None or flusher is None or not channel or len(data) >= MAX_RECORD - 64:
            return
        record = message_record(channel, data, sequence=sequence, publish_ns=publish_ns)
        with self._lock:
            if arrival_ns - self._described_ns >= DESCRIBE_NS:
                self._described_ns = arrival_ns
                record = self.preamble + record
        queue.put(Chunk(record, arrival_ns))
        flusher.flush()

    async def write(self, data: bytes) -> None:
        hint = "Configure the device with the program that publishes them, or connect it to this host."
        raise LinkError("refused", f"{self.source} gives messages; nothing can be sent to its device.", hint)

    async def close(self) -> None:
        await super().close()
        if self._flusher is not None:
            self._flusher.stop()
            self._flusher = None


class _Flusher(threading.Thread):
    """Wakes the event loop for messages that arrived right after it was woken.

    A library's callback must not wait for that, and the loop would otherwise learn of them with the next message.
    """

    def __init__(self, queue: ChunkQueue) -> None:
        super().__init__(name="link messages", daemon=True)
        self._queue = queue
        self._due = threading.Event()
        self._stopped = False
        self._wait_s = 0.0

    def flush(self) -> None:
        """Wake the loop, now or as soon as it is due."""
        if self._due.is_set():
            return
        wait_s = self._queue.flush()
        if wait_s is not None:
            self._wait_s = wait_s
            self._due.set()

    def run(self) -> None:
        while not self._stopped:
            self._due.wait()
            time.sleep(self._wait_s)
            self._due.clear()  # before `_stopped` is read, which `stop` sets first
            if not self._stopped:
                self.flush()

    def stop(self) -> None:
        self._stopped = True
        self._due.set()
        self.join()


def listed(topics: Sequence[SeenTopic]) -> str:
    """Topics in words: "/imu/data (sensor_msgs/msg/Imu), /fix (…) and 3 more"."""
    some = ", ".join(f"{one.name} ({one.type})" if one.type else one.name for one in topics[:TOPICS_LISTED])
    more = len(topics) - TOPICS_LISTED
    return f"{some} and {more} more" if more > 0 else some


def missing_topic(topics: Sequence[str], available: Sequence[SeenTopic], place: str) -> str:
    """A sentence about topics without a publisher, and the existing ones."""
    names = " or ".join(topics)
    if not available:
        return f"No publisher of {names} at {place} yet; no topics are seen there."
    return f"No publisher of {names}; topics seen: {listed(available)}."


def other_type(topic: SeenTopic, expected: str) -> str:
    """A sentence about a topic of another type than requested."""
    return f"{topic.name} is {topic.type}, not {expected}: leave type out of the source, or set it to {topic.type}."


def nameless(topics: Sequence[SeenTopic]) -> str:
    """A sentence for a source without a topic, where none can be shown."""
    return f"No topic there has numbers that can be shown: {listed(topics)}." if topics else "No topics there yet."
