"""The Rerun viewer: streamed recordings and live data.

    recording ──Columns──> rrd_stream_worker.py ──.rrd on its standard output──> the browser
    bus ──viewer_process.py──> rerun_worker.py ──batches, base64 in JSON lines──> RerunFeed
    ──> WebSocket of each

A batch is an `.rrd` in itself, so a viewer can begin with any of them after the static data. A RerunFeed stores the
static data and the newest `KEPT_BYTES`; a new viewer gets static data, live data, and between them the stored batches,
newest first. A browser acknowledges the batches that its viewer has taken; one that does not keep up loses the oldest
batches and is sent their number, so that it shows live data however slow it is. No viewer slows a device, and the feed
ends after `IDLE_S` without viewers.
"""

import asyncio
import base64
import contextlib
import logging
from collections import deque
from collections.abc import AsyncIterator, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from imuscope.server import wire
from imuscope.server.concurrency.backoff import Backoff
from imuscope.server.errors import DomainError
from imuscope.server.extensions.rerun.settings import RerunSettings
from imuscope.server.integrations.viewer_process import KeptProcess, ViewerProcess, ViewError
from imuscope.server.services.parts import ServicePart
from imuscope.server.services.services import Services
from imuscope.server.streaming.telemetry import Telemetry
from imuscope.server.system.workers import Worker

log = logging.getLogger("imuscope.views")

STREAM, FEED = "imuscope.server.extensions.rerun.stream_worker", "imuscope.server.extensions.rerun.worker"
PIECE_BYTES = 1 << 16
MAX_STREAMS = 4  # at once: each is a process of a hundred MB
MAX_FEEDS = 4
KEPT_BYTES = 32 << 20  # of a feed: about half a minute of three devices
MAX_LIVE = 20  # live batches queued for a browser: one second
PAST_BYTES = 16 << 20  # stored batches queued for a browser
MAX_UNACKNOWLEDGED = 4  # batches sent to a browser before it acknowledges them; more would only become stale in it
IDLE_S = 10.0


async def recording_stream(request: Mapping[str, Any], slots: asyncio.Semaphore) -> AsyncIterator[bytes]:
    """A recording as `.rrd`, piece by piece; its process is ended if the stream is not read completely.

    Args:
        request: see rrd_stream_worker.py.
        slots: limits the number of concurrent streams.
    """
    async with slots:
        worker = await Worker.start(STREAM, capture_stderr=True)
        words = asyncio.create_task(worker.errors.read(), name="rerun stream: errors")
        try:
            worker.request(request)
            while piece := await worker.output.read(PIECE_BYTES):
                yield piece
            if await worker.wait() != 0:
                log.warning("a stream for the Rerun viewer ended: %s", (await words).decode(errors="replace")[-500:])
        finally:
            await worker.end()
            words.cancel()


@dataclass(slots=True, eq=False)
class RerunViewer:
    """Data queued for one browser: static data first, then live batches, then stored ones."""

    wake_event: asyncio.Event = field(default_factory=asyncio.Event)
    is_idle: deque[bytes] = field(default_factory=deque)  # never dropped
    live: deque[tuple[float, bytes]] = field(default_factory=deque)  # arrival of the newest sample in it, batch
    past: deque[bytes] = field(default_factory=deque)
    dropped: int = 0
    sent: int = 0
    is_taken: int = 0  # acknowledged by the browser
    lost: str = ""  # why the stream ended

    def offer(self, newest: float, batch: bytes) -> None:
        """Queue a live batch; if too many are queued, the oldest are dropped."""
        self.live.append((newest, batch))
        while len(self.live) > MAX_LIVE:
            self.live.popleft()
            self.dropped += 1
        self.wake_event.set()

    def remember(self, batch: bytes) -> None:
        """Queue a stored batch, unless the queue is full."""
        if sum(map(len, self.past)) + len(batch) <= PAST_BYTES:
            self.past.append(batch)
            self.wake_event.set()

    def acknowledge(self, size: int) -> None:
        """Set the number of batches that the browser has passed to its viewer."""
        self.is_taken = size
        self.wake_event.set()

    async def take(self) -> tuple[float, bytes]:
        """The next batch, once the browser is not too far behind, with the arrival of its newest sample (0: not live).

        Raises:
            ViewError: the stream has ended.
        """
        while True:
            if self.lost:
                raise ViewError(self.lost)
            if self.sent - self.is_taken < MAX_UNACKNOWLEDGED:
                self.sent += 1
                if self.is_idle:
                    return 0.0, self.is_idle.popleft()
                if self.live:
                    return self.live.popleft()
                if self.past:
                    return 0.0, self.past.popleft()
                self.sent -= 1
            self.wake_event.clear()
            await self.wake_event.wait()


class RerunFeed:
    """One live stream and its viewers.

    Args:
        device: id; "" for all.
    """

    def __init__(self, telemetry: Telemetry, device: str = "") -> None:
        self._telemetry = telemetry
        self._device = device
        self._process: ViewerProcess | None = None
        self._is_idle: list[bytes] = []
        self._backlog: deque[tuple[float, bytes]] = deque()
        self._size = 0
        self.viewers: set[RerunViewer] = set()

    async def start(self) -> None:
        self._process = ViewerProcess(self._telemetry.clients, FEED, self._on_report, self._crashed)
        try:
            await self._process.start()
        except OSError as error:
            raise ViewError("The stream for Rerun does not start.", str(error.strerror)) from None
        self._process.send(op="open", device=self._device, connect="")

    async def stop(self) -> None:
        """Stop the stream, and wait until its process has ended."""
        for viewer in self.viewers:
            viewer.lost = viewer.lost or "The stream has ended."
            viewer.wake_event.set()
        if self._process is not None:
            await self._process.stop()

    def join(self) -> RerunViewer:
        """Add a viewer; it gets the static data, then the stored batches, newest first."""
        viewer = RerunViewer(is_idle=deque(self._is_idle))
        for _, batch in sorted(self._backlog, key=lambda one: -one[0]):
            viewer.remember(batch)
        self.viewers.add(viewer)
        return viewer

    def lag_ms(self, newest: float) -> float:
        """Age of the newest sample of a batch."""
        return max(0.0, 1000 * (self._telemetry.bus.now() - newest))

    def _on_report(self, message: Mapping[str, Any]) -> None:
        if message["op"] != "batch":
            return
        batch, newest = base64.b64decode(message["data"]), float(message["newest"])
        if message["still"]:
            if message["restart"]:
                self._is_idle.clear()
            self._is_idle.append(batch)
            for viewer in self.viewers:
                viewer.is_idle.append(batch)
                viewer.wake_event.set()
            return
        self._backlog.append((newest, batch))
        self._size += len(batch)
        while self._size > KEPT_BYTES:
            self._size -= len(self._backlog.popleft()[1])
        for viewer in self.viewers:
            if message["past"]:
                viewer.remember(batch)
            else:
                viewer.offer(newest, batch)

    def _crashed(self, words: str) -> None:
        self._telemetry.bus.event("", "link", "error", f"The stream for Rerun ended unexpectedly: {words:.200}")
        self._process = None
        for viewer in self.viewers:
            viewer.lost = "The stream ended unexpectedly."
            viewer.wake_event.set()

    @property
    def is_running(self) -> bool:
        """False after a crash."""
        return self._process is not None

    @property
    def pid(self) -> int | None:
        return None if self._process is None else self._process.pid


class Rerun:
    """All Rerun streams of one server."""

    def __init__(self, telemetry: Telemetry, connect: str = "") -> None:
        self._telemetry = telemetry
        self._starting = asyncio.Lock()
        self._remote = RemoteRerun(telemetry, connect) if connect else None
        self.feeds: dict[str, RerunFeed] = {}
        self.slots = asyncio.Semaphore(MAX_STREAMS)

    async def start(self) -> None:
        if self._remote is not None:
            self._remote.process.start()

    @contextlib.asynccontextmanager
    async def open_viewer(self, device: str) -> AsyncIterator[tuple[RerunFeed, RerunViewer]]:
        """A viewer of a device's stream, or of all devices', for as long as the block lasts.

        Raises:
            DomainError: unknown device.
            ViewError: too many streams are running.
        """
        if device and device not in self._telemetry.bus.devices.latest:
            raise DomainError(
                "not-found", f"Device {device:.40} not found.", "Leave the device out to view all devices."
            )
        async with self._starting:
            feed = self.feeds.get(device)
            if feed is None or not feed.is_running:
                if feed is None and len(self.feeds) >= MAX_FEEDS:
                    raise ViewError(f"The maximum of {MAX_FEEDS} streams is running.", "Close one of their pages.")
                feed = RerunFeed(self._telemetry, device)
                await feed.start()
                self.feeds[device] = feed
        viewer = feed.join()
        try:
            yield feed, viewer
        finally:
            feed.viewers.discard(viewer)
            if not feed.viewers:
                asyncio.get_running_loop().call_later(IDLE_S, self._stop_idle_feed, device, feed)

    def _stop_idle_feed(self, device: str, feed: RerunFeed) -> None:
        if not feed.viewers and self.feeds.get(device) is feed:
            del self.feeds[device]
            self._stopping = asyncio.get_running_loop().create_task(feed.stop(), name="rerun feed stops")

    async def close(self) -> None:
        stops = [feed.stop() for feed in self.feeds.values()]
        if self._remote is not None:
            stops.append(self._remote.process.close())
        self.feeds.clear()
        await asyncio.gather(*stops)


def parts(services: Services) -> Iterator[ServicePart]:
    service = Rerun(services.telemetry, services.config.of(RerunSettings).rerun_connect)
    yield ServicePart("Rerun", service, service.close, service.start)


MODULE = "imuscope.server.extensions.rerun.worker"
AGAIN_S, LONGEST_S = 2.0, 60.0
STUCK_S = 5.0


class RemoteRerun:
    """A stream to one viewer on another machine (`--rerun-connect`). To be used in the server's event loop.

    Rerun's SDK neither bounds the data queued for a stalled viewer nor reconnects. So its process sends more only when
    the last data was taken, ends itself if nothing was taken for `STUCK_S`, and is restarted here with growing delays.
    A viewer that was just reached gets the last half minute, newest first; data of the interruption is left out,
    because live data matters more. The process says {"op": "reached"} or {"op": "stuck"}; both are events, once each.

    Attributes:
        process: to be started and closed.

    Args:
        address: in the form of Rerun: rerun+http://HOST:PORT/proxy.
        again_s: first delay before a retry.
        stuck_s: time without accepted data after which the viewer counts as gone.
    """

    def __init__(self, telemetry: Telemetry, address: str, again_s: float = AGAIN_S, stuck_s: float = STUCK_S) -> None:
        self._bus = telemetry.bus
        self._address = address
        self._backoff = Backoff(again_s, LONGEST_S)
        self._reached: bool | None = None  # as last reported
        self.process = KeptProcess(
            lambda crashed: ViewerProcess(telemetry.clients, MODULE, self._on_report, crashed),
            lambda: self.process.send(op="open", device="", connect=address, stuck_s=stuck_s),
            self._crashed,
            self._backoff,
        )

    def _on_report(self, words: Mapping[str, Any]) -> None:
        if words["op"] == "reached":
            self._backoff.reset()
            self._send(True, "info", f"The Rerun viewer at {self._address} receives live data.")
        elif words["op"] == "stuck":
            text = f"The Rerun viewer at {self._address} does not accept data; retrying."
            self._send(False, "warning", text)

    def _crashed(self, words: str) -> None:
        text = f"The stream to the Rerun viewer at {self._address} ended unexpectedly and is restarted."
        self._send(False, "warning", text, said=words[-500:])

    def _send(self, reached: bool, level: wire.Level, text: str, **more: Any) -> None:
        if reached is not self._reached:
            self._reached = reached
            self._bus.event("", "link", level, text, data=more)
