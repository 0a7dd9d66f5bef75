"""Source of messages: topics of ROS 2, over Zenoh as rmw_zenoh does it. No ROS installation is needed.

    ros2://robot.local:7447/imu/data,/fix                the router of the robot, and topics
    ros2://robot.local:7447/imu/data?type=sensor_msgs/msg/Imu&domain=3

    liveliness tokens ─> publishers of each topic and their types ─> subscriptions
    sample ─> its attachment: sequence number, time, publisher ─> MessageLink.deliver

The type of a topic is that of its publishers, unless `type` says otherwise. In the graph this source is a node
"imuscope" with its subscribers. Publishers number their messages, so that lost ones are counted, for each publisher.

A router that stops is reported; nodes that are known then go on to send directly, and Zenoh finds the router again by
itself.

Source: rmw_zenoh, docs/design.md (server/extensions/ros2/).
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
from typing import TYPE_CHECKING, Any

from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.extensions.ros2.attachment import Attachment, AttachmentError, gid_of
from imuscope.server.extensions.ros2.key_expressions import (
    ANY_HASH,
    KeyExpressionError,
    QosProfile,
    RosEndpoint,
    RosNode,
    graph_pattern,
    parse_token,
    parse_topic_key,
    topic_key,
)
from imuscope.server.extensions.ros2.session import ZenohSessionError, open_session
from imuscope.server.extensions.ros2.settings import MAX_DOMAIN, is_name, usual_domain
from imuscope.server.extensions.ros2.type_support import TypeSupportError, definition, is_known, type_hash
from imuscope.server.links.base import Link, LinkError, LinkSettings, Progress
from imuscope.server.links.message_link import MessageLink, SeenTopic, TopicSource, listed, missing_topic, other_type
from imuscope.server.links.registry import LinkDefinition, register_link
from imuscope.server.links.source_url import SourceUrl, bad
from imuscope.server.links.text import progress_line

if TYPE_CHECKING:
    import zenoh

DEFAULT_PORT = 7447
NODE = "imuscope"
MOST_KNOWN = 4096  # publishers
POLL_S = 0.02  # between two checks whether the router is reached
HASHED = "RIHS01_"
ROUTER_HINT = "Start it: ros2 run rmw_zenoh_cpp rmw_zenohd, or zenohd. Check address and port."


class Ros2Link(MessageLink):
    """Subscribers of topics, behind one router.

    Args:
        domain: ROS_DOMAIN_ID.
    """

    kind = "ros2"

    def __init__(self, source: str, settings: LinkSettings, where: TopicSource, domain: int) -> None:
        super().__init__(source, settings, where)
        self.domain = domain
        self._session: zenoh.Session | None = None
        self._declared: list[Any] = []  # tokens and subscribers
        self._node = RosNode(domain, "", 0, "", NODE)
        self._has_router = False  # another node may be at that address instead
        self._publishers: dict[str, RosEndpoint] = {}  # by token
        self._graph_lock = threading.Lock()
        self._subscribed: dict[str, str] = {}  # topic → type
        self._channels: dict[tuple[str, bytes], int] = {}  # by key expression and publisher
        self._unusable: set[str] = set()  # key expressions of other definitions of a type
        self._changed = asyncio.Event()
        self._watcher: asyncio.Task[None] | None = None

    async def open(self, progress: Progress | None = None) -> None:
        await self.close()
        self._has_router = False
        self._publishers.clear()
        self._subscribed.clear()
        self._channels.clear()
        self._unusable.clear()
        address = f"[{self.where.host}]" if ":" in self.where.host else self.where.host
        try:
            session = self._session = await asyncio.to_thread(open_session, f"tcp/{address}:{self.where.port}")
        except ZenohSessionError as failure:
            raise LinkError("refused", str(failure), "Check the address.") from None
        try:
            async with asyncio.timeout(self.settings.connect_timeout_s):
                while not _is_reached(session):
                    await asyncio.sleep(POLL_S)
        except TimeoutError:
            error = LinkError("refused", f"No Zenoh router answers at {self.where.place}.", ROUTER_HINT)
            await self.close()
            progress_line(progress, self.where.place, error.message)
            raise error from None
        except BaseException:
            await self.close()
            raise
        self.begin()
        self._changed = asyncio.Event()
        loop = asyncio.get_running_loop()

        def changed() -> None:
            with contextlib.suppress(RuntimeError):  # the loop is closed already
                loop.call_soon_threadsafe(self._changed.set)

        await asyncio.to_thread(self._join, session, changed)
        self._watcher = loop.create_task(self._follow(session), name=f"topics of {self.source}")
        progress_line(progress, self.where.place, "connected to the Zenoh router")

    def _join(self, session: zenoh.Session, changed: Any) -> None:
        """Announce the node, subscribe to topics whose type is given, and follow the graph."""
        is_known("")  # loads the definitions, here and not in the event loop
        self._node = RosNode(self.domain, str(session.zid()), 0, "", NODE)
        self._declared.append(session.liveliness().declare_token(self._node.token))
        if self.where.type:
            self._subscribe(session, dict.fromkeys(self.where.topics, self.where.type))

        def on_token(sample: zenoh.Sample) -> None:
            self._on_token(sample)
            changed()

        pattern = graph_pattern(self.domain)
        self._declared.append(session.liveliness().declare_subscriber(pattern, on_token, history=True))

    async def _follow(self, session: zenoh.Session) -> None:
        """Subscribe to topics as soon as their publishers say of which type they are."""
        while True:
            await self._changed.wait()
            self._changed.clear()
            types: dict[str, str] = {}
            for topic in self._available:
                if topic.name in self.where.topics and topic.name not in self._subscribed:
                    types.setdefault(topic.name, topic.type)
            if types and not self.where.type:
                await asyncio.to_thread(self._subscribe, session, types)

    @property
    def _available(self) -> list[SeenTopic]:
        """Topics with a publisher, by name."""
        with self._graph_lock:
            topics = {SeenTopic(one.topic, one.type) for one in self._publishers.values()}
        return sorted(topics, key=lambda one: (one.name, one.type))

    @property
    def notices(self) -> list[str]:
        """Reasons why topics are not shown, by what the graph has at present."""
        session = self._session
        if session is None or self._queue is None:
            return []
        available = self._available
        reasons = []
        routers = bool(list(session.info.routers_zid()))
        self._has_router = self._has_router or routers
        if self._has_router and not routers:
            words = (
                f"The Zenoh router at {self.where.place} has gone: nodes that were known go on, new ones are not found."
            )
            reasons.append(words)
        if not self.where.topics:
            topics = f"Topics seen: {listed(available)}." if available else "No topics are seen yet."
            reasons.append(f"No topic is given. {topics}")
        by_name = {one.name: one for one in available}
        absent = [topic for topic in self.where.topics if topic not in by_name]
        if absent:
            reasons.append(missing_topic(absent, available, self.where.place))
        for topic, type_name in list(self._subscribed.items()):  # a thread adds to it
            types = {one.type for one in available if one.name == topic}
            if types and type_name not in types:
                reasons.append(other_type(by_name[topic], type_name))
        for one in available:
            if one.name in self.where.topics and not is_known(one.type):
                reasons.append(f"{one.name} is {one.type}, whose definition is not known here.")
        reasons += [f"{key} has another definition of its type than this program." for key in sorted(self._unusable)]
        return reasons

    @notices.setter
    def notices(self, notices: list[str]) -> None:
        """Ignore notices: they are made on request."""

    # -- from threads of Zenoh -----------------------------------------------------------------------------------------

    def _subscribe(self, session: zenoh.Session, topics: dict[str, str]) -> None:
        for n, (topic, type_name) in enumerate(topics.items(), start=len(self._subscribed) + 1):
            self._subscribed[topic] = type_name
            if not is_known(type_name):
                continue
            endpoint = RosEndpoint(self._node, n, "subscriber", topic, type_name, type_hash(type_name), QosProfile())
            key = topic_key(self.domain, topic, type_name, ANY_HASH)
            self._declared.append(session.declare_subscriber(key, self._on_sample))
            self._declared.append(session.liveliness().declare_token(endpoint.token))

    def _on_token(self, sample: zenoh.Sample) -> None:
        import zenoh

        text = str(sample.key_expr)
        try:
            endpoint = parse_token(text)
        except KeyExpressionError:
            return
        if not isinstance(endpoint, RosEndpoint) or endpoint.kind != "publisher":
            return
        with self._graph_lock:
            if sample.kind == zenoh.SampleKind.PUT:
                self._publishers[text] = endpoint
            else:
                self._publishers.pop(text, None)

    def _on_sample(self, sample: zenoh.Sample) -> None:
        arrival_ns = self.settings.now_ns()
        sequence, time_ns, gid = 0, 0, b""
        if sample.attachment is not None:
            with contextlib.suppress(AttachmentError):
                attachment = Attachment.decode(sample.attachment.to_bytes())
                sequence, time_ns, gid = attachment.sequence, attachment.time_ns, attachment.gid
        key = str(sample.key_expr)
        channel = self._channels.get((key, gid), -1)
        if channel < 0:
            if len(self._channels) >= MOST_KNOWN:  # each start of a node is another publisher
                self._channels.clear()
            channel = self._channels[key, gid] = self._channel_of(key, gid)
        self.deliver(channel, sample.payload.to_bytes(), arrival_ns, sequence=sequence, publish_ns=time_ns)

    def _channel_of(self, key: str, gid: bytes) -> int:
        """The channel of a publisher; 0 for messages that cannot be decoded."""
        try:
            _, topic, type_name, rihs = parse_topic_key(key)
            if rihs.startswith(HASHED) and rihs != type_hash(type_name):
                self._unusable.add(topic)
                return 0
            about = (topic, "cdr", type_name, "ros2msg", definition(type_name).encode())
        except (KeyExpressionError, TypeSupportError):
            return 0
        return self.channel(*about, publisher=self._name_of(gid)) or self.channel(*about)

    def _name_of(self, gid: bytes) -> str:
        """Name of a publisher: its GID, and its node if it is in the graph; "" if its messages are not numbered."""
        if not gid:
            return ""
        with self._graph_lock:
            publishers = dict(self._publishers)
        node = next((one.node.full_name for token, one in publishers.items() if gid_of(token) == gid), "")
        return f"{gid.hex()} {node}".strip()

    async def _release(self) -> None:
        if self._watcher is not None:
            await end_tasks(self._watcher)
            self._watcher = None
        session, self._session = self._session, None
        if session is not None:
            declared, self._declared = self._declared, []
            await asyncio.to_thread(_leave, session, declared)


def _leave(session: zenoh.Session, declared: list[Any]) -> None:
    """Leave the graph and close the session."""
    import zenoh

    for one in reversed(declared):
        with contextlib.suppress(zenoh.ZError):
            one.undeclare()
    with contextlib.suppress(zenoh.ZError):
        session.close()  # type: ignore[no-untyped-call]


def _is_reached(session: zenoh.Session) -> bool:
    """Whether a router, or the node at its address, is reached."""
    return bool(list(session.info.routers_zid()) or list(session.info.peers_zid()))


def _open(source: str, settings: LinkSettings, parsed: SourceUrl) -> Link:
    parsed.allow(("type", "domain"))
    where = TopicSource.parse(parsed, DEFAULT_PORT)
    for topic in where.topics:
        if not is_name(topic):
            raise bad(source, f"{topic!r:.60} is not a name of a topic", "Write it as ros2 topic list does: /imu/data.")
    if where.type:
        try:
            topic_key(0, "/x", where.type)
        except KeyExpressionError as error:
            raise bad(source, str(error), "Give type as package/msg/Name, or leave it out.") from None
    try:
        usual = usual_domain()
    except ValueError as error:
        raise bad(source, str(error), "Set it to the domain of the robot, or leave it unset.") from None
    return Ros2Link(source, settings, where, parsed.whole("domain", usual, 0, MAX_DOMAIN))


register_link(
    LinkDefinition(
        "ros2",
        "ROS 2",
        _open,
        "ros2://host:port/topic",
        usage=(
            ("ros2://host:7447/topic", "messages of ROS 2 through a Zenoh router (rmw_zenohd); also domain=, type="),
        ),
        examples=lambda: [("ros2://robot.local:7447/imu/data", "a topic of ROS 2 (rmw_zenoh)")],
        order=35,
        network=True,
        counts_messages=True,
    )
)
