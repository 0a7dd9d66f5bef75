"""Devices as nodes of ROS 2, over Zenoh as rmw_zenoh does it (`--ros2`, off by default). No ROS installation is needed.

    robot's nodes (rmw_zenoh) ──┐
                                ├── Zenoh router (rmw_zenohd or zenohd, tcp/localhost:7447)
    ros2_worker (subprocess) ───┘

The session runs in a subprocess (server/extensions/ros2/worker.py), which is started after the server and restarted
after a crash with growing delays. An absent router is not an error: Zenoh tries again, and the events say so.
"""

import asyncio
import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from imuscope.protocols.family.sensor_properties import SensorProperties
from imuscope.recordings.system import atomic_write
from imuscope.recordings.system.regular_file import read_object
from imuscope.server import wire
from imuscope.server.concurrency.backoff import Backoff
from imuscope.server.devices.decode.protocol_set import sensors_of
from imuscope.server.devices.device.device_names import DeviceNames
from imuscope.server.errors import DomainError
from imuscope.server.extensions.ros2.contract import Contract, read_contract
from imuscope.server.extensions.ros2.covariances import SensorNoise, noise_of
from imuscope.server.extensions.ros2.settings import Ros2Settings
from imuscope.server.integrations.viewer_process import KeptProcess, ViewerProcess
from imuscope.server.services.parts import ServicePart
from imuscope.server.services.services import Services
from imuscope.server.settings.config import Config
from imuscope.server.streaming.telemetry import Telemetry

FILE = "ros2.json"
MAX_TOPICS = 10_000  # names of devices that are gone stay, and are bounded


class TopicSwitches:
    """The topics that are switched off, by their keys, stored in the data folder.

        ros2.json    {"switched_off": ["1 imu/mag", "2 /diagnostics"]}        id of the device, its topic

    The file is replaced atomically; unreadable parts count as absent, so that every topic is published.

    Args:
        folder: the data folder.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / FILE
        self._off = self._read()

    @property
    def off(self) -> frozenset[str]:
        return self._off

    def set(self, topic: str, *, enabled: bool) -> None:
        """Remember whether a topic is published.

        Raises:
            DomainError: "full" or "disk"; nothing has changed then.
        """
        off = self._off - {topic} if enabled else self._off | {topic}
        if len(off) > MAX_TOPICS:
            raise DomainError("full", f"{MAX_TOPICS} topics are switched off.", "Switch one on first.")
        if off == self._off:
            return
        try:
            self._write(off)
        except OSError as error:
            message = f"The switch cannot be stored: {error.strerror or error}."
            raise DomainError("disk", message, "Free some space, or check the rights of the data folder.") from None
        self._off = off

    def _write(self, off: frozenset[str]) -> None:
        atomic_write.write_atomic(self._path, json.dumps({"switched_off": sorted(off)}, indent=1))

    def _read(self) -> frozenset[str]:
        rows = read_object(self._path).get("switched_off")
        return frozenset(row for row in rows if isinstance(row, str)) if isinstance(rows, list) else frozenset()


MODULE = "imuscope.server.extensions.ros2.worker"
PASSES_PER_S = 80.0  # how often samples are passed on: a message is at most 12 ms late
AGAIN_S, LONGEST_S = 1.0, 60.0
NAME_S = 3.0  # for a device to be identified before it is announced, if it never was
STEADY_S = 120.0  # after running this long, the next crash counts as the first


@dataclass(slots=True)
class Ros2State:
    """State of the publisher.

    Attributes:
        routers: ids of the routers that are reached; none: not connected.
        topics, missing: as the worker reports them.
    """

    routers: Sequence[str] = ()
    peers: int = 0
    topics: Sequence[Mapping[str, Any]] = ()
    missing: Sequence[Mapping[str, Any]] = ()
    dropped: int = 0
    problem: str = ""
    hint: str = ""


class Ros2:
    """The publisher of a server. To be used in its event loop.

    Args:
        properties: of the sensors of a product, by protocol and product.
        names: of devices, and what they were when they were identified last.
    """

    def __init__(
        self,
        telemetry: Telemetry,
        config: Config,
        properties: Callable[[str, str], SensorProperties],
        names: DeviceNames,
    ) -> None:
        self._bus = telemetry.bus
        self._own = config.of(Ros2Settings)
        self._properties = properties
        self._names = names
        self._came: dict[str, float] = {}  # devices, monotonic, s
        self._frames: dict[str, str] = {}  # of the devices that are announced: they stay
        self._sent: dict[str, SensorNoise] = {}  # noise of the devices that this process has announced
        self._warned: set[str] = set()
        terms = read_contract(self._own.ros2_contract) if self._own.ros2 and self._own.ros2_contract else []
        self._contract = Contract(terms, time.monotonic())
        self.process = KeptProcess(
            lambda crashed: ViewerProcess(
                telemetry.clients, MODULE, self._on_report, crashed, PASSES_PER_S, draws=False
            ),
            self._serve,
            self._crashed,
            Backoff(AGAIN_S, LONGEST_S),
            end=self._ended,
            steady_s=STEADY_S,
        )
        self._unsubscribe: list[Callable[[], None]] = []
        self._switches = TopicSwitches(config.data)
        self.state = Ros2State()

    @property
    def is_enabled(self) -> bool:
        return self._own.ros2

    def start(self) -> None:
        if self.is_enabled:
            self._unsubscribe = [self._bus.devices.subscribe(self._on_device)]
            self.process.start()

    def switch(self, topic: str, *, enabled: bool) -> None:
        """Publish a topic, or no longer; also after the next start.

        Args:
            topic: its key in the state.

        Raises:
            DomainError: no such topic, not enabled on this server, or the switch cannot be stored.
        """
        if not self.is_enabled:
            raise DomainError("not-now", "ROS 2 is not enabled on this server.", "Start it with --ros2.")
        rows = [dict(row) for row in self.state.topics]
        entry = next((row for row in rows if row["key"] == topic), None)
        if entry is None:
            raise DomainError(
                "not-found", f"There is no topic {topic:.200}.", "The list of topics may be out of date: load it again."
            )
        self._switches.set(topic, enabled=enabled)
        entry["enabled"] = enabled
        self.state.topics = rows
        self.process.send(op="switch", topic=topic, enabled=enabled)

    async def close(self) -> None:
        """Stop publishing."""
        for unsubscribe in self._unsubscribe:
            unsubscribe()
        await self.process.close()

    def _serve(self) -> None:
        self._sent.clear()
        for info in self._bus.devices.latest.values():
            self._on_device(info)
        self.process.send(op="serve", **self._settings())

    def _ended(self) -> None:
        self.state.routers, self.state.topics, self.state.peers = (), (), 0

    def _settings(self) -> dict[str, Any]:
        own = self._own
        return {
            "router": own.ros2_router,
            "domain": own.ros2_domain,
            "namespace": own.ros2_namespace.rstrip("/"),
            "reliability": own.ros2_reliability,
            "depth": own.ros2_depth,
            "axes": own.ros2_axes,
            "map_frame": own.ros2_map_frame,
            "tf": own.ros2_tf,
            "disabled": sorted(self._switches.off),
        }

    def _on_device(self, info: wire.DeviceInfo) -> None:
        """Announce a device when it is known, in earlier runs too, or has had the time to be."""
        latest = self._bus.devices.latest
        self._came = {key: since for key, since in self._came.items() if key in latest}
        self._frames = {key: frame for key, frame in self._frames.items() if key in latest}
        if self.process.pid is None:
            return
        now = time.monotonic()
        left = self._came.setdefault(info.id, now) + NAME_S - now
        protocol, product, name = self._names.former(info.id)
        if info.product:
            protocol, product, name = info.protocol, info.product, info.name
        if info.id not in self._frames and not product and left > 0:
            asyncio.get_running_loop().call_later(left, self._announce_later, info.id)
            return
        self._announce(info, name or info.name, self._properties(protocol or info.protocol, product))

    def _announce_later(self, device: str) -> None:
        if device in self._bus.devices.latest:
            self._on_device(self._bus.devices.latest[device])

    def _announce(self, info: wire.DeviceInfo, name: str, properties: SensorProperties) -> None:
        """Announce a device, once and when its noise is known; its frame stays."""
        own, keys = self._own, (info.source, info.source.partition("?")[0], info.topic, name)
        frame = next((own.ros2_frames[key] for key in keys if key in own.ros2_frames), info.topic)
        noise = noise_of(next((own.ros2_covariances[k] for k in keys if k in own.ros2_covariances), ""), properties)
        known = self._frames.setdefault(info.id, frame)
        if frame != known and info.id not in self._warned:
            self._warned.add(info.id)
            hint = f'ros2_frames = {{ "{info.source.partition("?")[0]}" = "{frame}" }} names its source.'
            text = f"ROS 2: the frame of {info.topic} stays {known} until the next start: {name} was learnt too late."
            self._event("warning", text, {"hint": hint})
        before = self._sent.get(info.id)
        if noise == before:
            return
        if before is not None:
            self._event("warning", f"ROS 2: the covariances of {info.topic} are those of {name} from now on.")
        self._sent[info.id] = noise
        self.process.send(op="device", id=info.id, frame=known, noise=asdict(noise))

    def _on_report(self, words: Mapping[str, Any]) -> None:
        if words["op"] == "state":
            self.state.routers, self.state.peers = words["routers"], int(words["peers"])
            self.state.dropped = int(words["dropped"])
            self._compare(words["topics"], words["missing"])
        elif words["op"] == "router":
            self._on_router(str(words["state"]))
        elif words["op"] == "reopen":
            self.process.restart()
        elif words["op"] == "failed":
            self._problem(str(words["why"]), "Give another address with --ros2-router tcp/HOST:PORT.", "error")
            self.process.restart()

    def _compare(self, topics: Sequence[Mapping[str, Any]], missing: Sequence[Mapping[str, Any]]) -> None:
        """Take over the topics, with what differs from the contract."""
        for text, is_breach in self._contract.check(topics, time.monotonic()):
            self._event("error" if is_breach else "info", f"ROS 2 contract: {text}", {"kind": "contract"})
        broken, names = self._contract.broken, {row["name"] for row in topics}
        self.state.topics = [{**row, "problem": row["problem"] or broken.get(row["name"], "")} for row in topics]
        nodes = {f"{row['node']}/": row["device"] for row in topics}
        absent = [
            {"device": next((nodes[n] for n in nodes if one.startswith(n)), ""), "topic": one, "reason": broken[one]}
            for one in broken.keys() - names
        ]
        self.state.missing = [*missing, *absent]

    def _on_router(self, state: str) -> None:
        address = self._own.ros2_router
        if state == "reached":
            self.state.problem = self.state.hint = ""
            domain = self._own.ros2_domain
            self._event("info", f"ROS 2: devices are published in domain {domain}, through the Zenoh router {address}.")
        elif state == "lost":
            self._problem(
                f"ROS 2: the Zenoh router {address} is gone; imuscope tries again.",
                "Start it again: ros2 run rmw_zenoh_cpp rmw_zenohd, or zenohd.",
            )
        elif state == "foreign":
            self._problem(
                f"ROS 2: the program at {address} is not a Zenoh router of version 1; imuscope tries again.",
                "Check address and port, and that the router is of Zenoh 1.x: rmw_zenohd of ROS Jazzy or newer.",
            )
        else:
            self._problem(
                f"ROS 2: there is no Zenoh router at {address}; imuscope tries again.",
                "Start one: ros2 run rmw_zenoh_cpp rmw_zenohd, or zenohd; or name another with --ros2-router.",
            )

    def _crashed(self, words: str) -> None:
        self._event("warning", "The ROS 2 publisher crashed and is restarted.", {"said": words[-500:]})

    def _problem(self, text: str, hint: str, level: wire.Level = "warning") -> None:
        self.state.problem, self.state.hint = text, hint
        self._event(level, text, {"hint": hint})

    def _event(self, level: wire.Level, text: str, data: dict[str, Any] | None = None) -> None:
        self._bus.event("", "device", level, text, data=data)


def parts(services: Services) -> Iterator[ServicePart]:
    services.sessions.names.give_topics(services.config.of(Ros2Settings).ros2_names)
    service = Ros2(services.telemetry, services.config, sensors_of, services.sessions.names)
    yield ServicePart("ROS 2", service, service.close, service.start)
