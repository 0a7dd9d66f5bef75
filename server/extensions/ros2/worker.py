"""`python -m imuscope.server.extensions.ros2.worker`: the process in which devices are nodes of ROS 2.

    input:   {"op": "serve", settings of Ros2WorkerSettings}     open the session and announce the devices
             {"op": "device", "id": …, "frame": …, "noise": values of SensorNoise}    announce a device: its topics are
                                                           below its own (DeviceInfo.topic), and stay there
             {"op": "switch", "topic": …, "enabled": …}    announce or withdraw a topic
    output:  {"op": "state", "routers": […], "peers": …, "topics": […]}     once a second, and when topics change
             {"op": "router", "state": "reached" | "lost" | "absent" | "foreign"}
             {"op": "reopen"}: restart this process
             {"op": "failed", "why": …}

What a device sends becomes messages in messages.py, its figures in diagnostics.py. A channel is
requested, and a message made, only while its topic has a subscriber.
"""

import socket
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from imuscope.server.extensions.ros2.covariances import SensorNoise
from imuscope.server.extensions.ros2.diagnostics import DiagnosticCounts, diagnostics
from imuscope.server.extensions.ros2.graph import RosGraph, TopicPublisher
from imuscope.server.extensions.ros2.key_expressions import QosProfile, RosNode
from imuscope.server.extensions.ros2.message_builder import FrameNames, MessageBuilder
from imuscope.server.extensions.ros2.messages import DIAGNOSTICS, builders_of
from imuscope.server.extensions.ros2.quantities import DeviceQuantities, quantities_of
from imuscope.server.extensions.ros2.session import ZenohSessionError, is_elsewhere, open_session, router_host
from imuscope.server.integrations.viewer_client import ViewerClient
from imuscope.server.wire.codec import SampleFrame

TICK_S = 1.0
ROUTER_S = 4.0  # time for a router to answer, before it is reported as absent
PROBE_S = 0.5
DIAGNOSTICS_TOPIC, TRANSFORM_TOPIC = "/diagnostics", "/tf"


@dataclass(frozen=True, slots=True)
class Ros2WorkerSettings:
    """Settings of the publisher (server/settings/config.py)."""

    router: str
    domain: int = 0
    namespace: str = ""
    reliability: str = "reliable"
    depth: int = 10
    axes: str = "rep103"
    map_frame: str = "map"
    tf: bool = False
    disabled: Sequence[str] = ()


@dataclass(slots=True)
class DeviceNode:
    """A device as a node: its topics that can be published, and the publishers of those that are enabled."""

    node: RosNode
    about: tuple[str, SensorNoise]
    quantities: DeviceQuantities = field(default_factory=DeviceQuantities)
    builders: dict[str, MessageBuilder] = field(default_factory=dict)
    types: dict[str, str] = field(default_factory=dict)  # of all topics, by full name
    publishers: dict[str, TopicPublisher] = field(default_factory=dict)
    counts: DiagnosticCounts = field(default_factory=DiagnosticCounts)
    dropped: int = 0


class Ros2Bridge:
    """Devices and their topics in the ROS graph."""

    def __init__(self, client: ViewerClient) -> None:
        self._client = client
        self._lock = threading.RLock()
        self._graph: RosGraph | None = None
        self._settings = Ros2WorkerSettings("")
        self._nodes: dict[str, DeviceNode] = {}
        self._about: dict[str, tuple[str, SensorNoise]] = {}  # frame and noise of the devices that are announced
        self._disabled: set[str] = set()
        self._requested: list[int] = []
        self._has_changed = threading.Event()
        self._router_state = ""
        self._next_tick = self._opened = time.monotonic()
        self._session: Any = None

    @property
    def next_tick(self) -> float:
        """When `tick` is due, monotonic, s."""
        return self._next_tick

    def serve(self, settings: Mapping[str, Any]) -> None:
        """Open the session."""
        self._settings = Ros2WorkerSettings(**settings)
        self._disabled = set(self._settings.disabled)
        self._opened = time.monotonic()
        threading.Thread(target=self._open, daemon=True).start()

    def _open(self) -> None:
        """Open the session, in a thread, because it may take a while; announce the devices."""
        try:
            self._session = open_session(self._settings.router, patient=True)
        except ZenohSessionError as error:
            self._client.send(op="failed", why=str(error))
            return
        # "reliable" and "best_effort" are checked with the settings
        qos = QosProfile("best_effort" if self._settings.reliability == "best_effort" else "reliable")
        qos = QosProfile(qos.reliability, depth=self._settings.depth)
        with self._lock:
            self._graph = RosGraph(self._session, self._settings.domain, qos, self._has_changed.set)
        threading.Thread(target=self._watch_subscribers, daemon=True).start()
        self.configure()

    def announce(self, device: str, frame: str, noise: Mapping[str, Any]) -> None:
        """Announce a device, or set its frame and its noise."""
        self._about[device] = frame, SensorNoise(**noise)
        self.configure()

    def switch(self, topic: str, *, enabled: bool) -> None:
        """Announce or withdraw a topic."""
        if enabled:
            self._disabled.discard(topic)
        else:
            self._disabled.add(topic)
        self.configure()

    def configure(self) -> None:
        """Bring nodes and topics up to date with devices and channels; report topics that change at once: others see
        them in the graph from then on.
        """
        if self._graph is None:
            return
        with self._lock:
            before = self._announced()
            devices = [one for one in self._client.devices if one["id"] in self._about]
            for device_id in set(self._nodes) - {one["id"] for one in devices}:
                self._remove(device_id)
            for device in devices:
                self._update(device)
            self._subscribe()
            if self._announced() != before:
                self._report()

    def _announced(self) -> set[tuple[str, str]]:
        """Topics in the graph, by device."""
        return {(device_id, topic) for device_id, node in self._nodes.items() for topic in node.publishers}

    def on_samples(self, frames: Sequence[SampleFrame]) -> None:
        """Publish topics that have subscribers."""
        samples: dict[int, list[SampleFrame]] = {}
        for frame in frames:
            if frame.n and not frame.history:
                samples.setdefault(frame.channel, []).append(frame)
        if not samples:
            return
        with self._lock:
            for node in self._nodes.values():
                used = node.quantities.channels
                node.dropped += sum(frame.dropped for frame in frames if frame.channel in used)
                for topic, builder in node.builders.items():
                    publisher = node.publishers.get(topic)
                    if publisher is not None and publisher.has_subscribers and not builder.channels.isdisjoint(samples):
                        publisher.publish(builder.build(samples))

    def tick(self) -> None:
        """Once a second: diagnostics, state, and a check of the router."""
        self._next_tick = time.monotonic() + TICK_S
        if self._graph is None:
            self._watch_router(())
            return
        with self._lock:
            self._diagnose()
            self._report()
        self._watch_router(self._graph.routers)

    def close(self) -> None:
        with self._lock:
            for device_id in list(self._nodes):
                self._remove(device_id)
            if self._graph is not None:
                self._graph.close()
                self._session.close()

    # ── nodes and topics ─────────────────────────────────────────────────────────────────────────────────────────────

    def _update(self, device: Mapping[str, Any]) -> None:
        assert self._graph is not None
        settings, device_id, about = self._settings, device["id"], self._about[device["id"]]
        node = self._nodes.get(device_id)
        if node is None:
            node = self._nodes[device_id] = DeviceNode(self._graph.add_node(settings.namespace, device["topic"]), about)
        channels = [info for info in self._client.channels.values() if info["device"] == device_id]
        quantities = quantities_of(device, channels)
        if quantities != node.quantities or about != node.about or not node.types:
            node.quantities, node.about = quantities, about
            frames = FrameNames(about[0], settings.map_frame, settings.axes == "rep103")
            built = builders_of(quantities, frames, about[1])
            if not settings.tf:
                built.pop(TRANSFORM_TOPIC, None)
            node.builders = {self._full(node, topic): builder for topic, builder in built.items()}
            node.types = {topic: builder.type for topic, builder in node.builders.items()}
            node.types[DIAGNOSTICS_TOPIC] = DIAGNOSTICS
        enabled = {topic for topic in node.types if self._key(device_id, node, topic) not in self._disabled}
        for topic in [topic for topic in node.publishers if topic not in enabled]:
            node.publishers.pop(topic).close()
        for topic in node.types:
            if topic in enabled and topic not in node.publishers:
                node.publishers[topic] = self._graph.add_publisher(node.node, topic, node.types[topic])

    def _remove(self, device_id: str) -> None:
        assert self._graph is not None
        node = self._nodes.pop(device_id)
        for publisher in node.publishers.values():
            publisher.close()
        self._graph.remove_node(node.node)

    @staticmethod
    def _full(node: DeviceNode, topic: str) -> str:
        return topic if topic.startswith("/") else f"{node.node.full_name}/{topic}"

    @staticmethod
    def _key(device_id: str, node: DeviceNode, topic: str) -> str:
        """A topic of a device among all, by its id, which its source has in later runs, too."""
        return f"{device_id} {topic.removeprefix(f'{node.node.full_name}/')}"

    @staticmethod
    def _covariances(node: DeviceNode, topic: str) -> list[str]:
        """The covariances that the messages of a topic have; those that come with each position are not promised."""
        own, fix = topic.removeprefix(f"{node.node.full_name}/"), node.quantities.fix
        if own == "gnss/fix" and fix is not None:
            return ["position"] if fix.horizontal and fix.vertical else []
        motion = {"twist": ["velocity"], "odometry": ["position", "velocity"]}
        return motion.get(own) or node.about[1].known(own)

    # ── subscribers ──────────────────────────────────────────────────────────────────────────────────────────────────

    def _watch_subscribers(self) -> None:
        """Request other channels when subscribers come or go; Zenoh's own threads must not wait for us."""
        while True:
            self._has_changed.wait()
            self._has_changed.clear()
            with self._lock:
                self._subscribe()

    def _subscribe(self) -> None:
        ids = sorted(
            {
                channel
                for node in self._nodes.values()
                for topic, builder in node.builders.items()
                if topic in node.publishers and node.publishers[topic].has_subscribers
                for channel in builder.channels
            }
        )
        if ids != self._requested:
            self._requested = ids
            self._client.subscribe(ids)

    # ── once a second ────────────────────────────────────────────────────────────────────────────────────────────────

    def _diagnose(self) -> None:
        now = time.time_ns()
        for device in self._client.devices:
            node = self._nodes.get(device["id"])
            publisher = node.publishers.get(DIAGNOSTICS_TOPIC) if node else None
            if node is None or publisher is None or not publisher.has_subscribers:
                continue
            health = self._client.health.get(device["id"])
            message, node.counts = diagnostics(node.node.full_name.strip("/"), device, health, node.counts, now)
            publisher.publish([message])

    def _watch_router(self, routers: Sequence[str]) -> None:
        state = "reached" if routers else "lost" if self._router_state == "reached" else self._router_state
        if not state and time.monotonic() - self._opened > ROUTER_S:
            state = "foreign" if self._is_listening() else "absent"
        if state != self._router_state:
            self._router_state = state
            self._client.send(op="router", state=state)
            if state == "lost" and is_elsewhere(self._settings.router):
                self._client.send(op="reopen")  # a client does not always find a router again

    def _is_listening(self) -> bool:
        """Whether another program than our router accepts connections at its address."""
        try:
            socket.create_connection(router_host(self._settings.router), PROBE_S).close()
        except (OSError, ValueError):
            return False
        return self._settings.router.startswith("tcp/")

    def _report(self) -> None:
        graph = self._graph
        if graph is None:
            return
        now = time.monotonic()
        topics = []
        for device_id, node in self._nodes.items():
            rows: list[tuple[str, str, str]] = [(topic, type_name, "") for topic, type_name in node.types.items()]
            for topic, type_name, _ in rows:
                publisher = node.publishers.get(topic)
                state: dict[str, Any] = {"rate": 0.0, "subscribers": 0, "messages": 0, "bytes": 0, "problem": ""}
                rihs = ""
                if publisher is not None:
                    rihs = publisher.endpoint.hash
                    count, others = graph.subscribers(topic, type_name, rihs)
                    state = {
                        "rate": round(publisher.rate.rate(now), 2),
                        "subscribers": max(count, int(publisher.has_subscribers)),
                        "messages": publisher.rate.total,
                        "bytes": publisher.bytes,
                        "problem": _mismatch(type_name, others[0].node.full_name, others[0].type) if others else "",
                    }
                topics.append(
                    {
                        "key": self._key(device_id, node, topic),
                        "device": device_id,
                        "node": node.node.full_name,
                        "name": topic,
                        "type": type_name,
                        "hash": rihs,
                        "enabled": publisher is not None,
                        "frame": node.builders[topic].frame if topic in node.builders else "",
                        "covariances": self._covariances(node, topic),
                        **state,
                    }
                )
        missing = [
            {"device": device_id, "topic": self._full(node, "imu/mag"), "reason": node.quantities.no_field}
            for device_id, node in self._nodes.items()
            if node.quantities.no_field
        ]
        dropped = sum(node.dropped for node in self._nodes.values())
        self._client.send(
            op="state", routers=graph.routers, peers=graph.peers, topics=topics, missing=missing, dropped=dropped
        )


def _mismatch(type_name: str, node: str, expected: str) -> str:
    if expected == type_name:
        return f"{node} subscribes with another definition of {type_name}, and receives nothing."
    return f"{node} subscribes as {expected}, and receives nothing."


def main() -> None:
    """Run until standard input ends."""
    client = ViewerClient(nice=0)  # a robot may depend on it, unlike on a view
    bridge = Ros2Bridge(client)
    for message in client.messages_until(lambda: bridge.next_tick):
        if message is None:
            bridge.tick()
        elif isinstance(message, Mapping):
            if message["op"] == "serve":
                bridge.serve({name: value for name, value in message.items() if name != "op"})
            elif message["op"] == "device":
                bridge.announce(message["id"], message["frame"], message["noise"])
            else:
                bridge.switch(message["topic"], enabled=message["enabled"])
        else:
            if client.changed:
                client.changed = False
                bridge.configure()
            bridge.on_samples(message)
            if time.monotonic() >= bridge.next_tick:  # `due` is not checked while samples keep coming
                bridge.tick()
    bridge.close()


if __name__ == "__main__":
    main()
