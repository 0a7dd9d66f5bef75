"""`python -m server.views.foxglove_aside`: the process that speaks the Foxglove WebSocket protocol.

    told:  {"op": "serve", "port": …}        begin, on a loopback port (0: any free one)
    says:  {"op": "served", "port": …} or {"op": "failed", "why": …}

Every channel becomes a topic of JSON messages (server/views/topics.py), every attitude a foxglove.FrameTransform from
ENU to the device, every latitude and longitude a foxglove.LocationFix, and what happens a foxglove.Log. A channel is
asked for and encoded only while somebody has subscribed to it. Who does not keep up loses the oldest messages of their
own queue, which the SDK keeps; nobody else notices. Clients can publish and call nothing: no capability says so.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import foxglove
from foxglove import channels, messages

from server.codec import Samples
from server.version import VERSION
from server.views.poses import ENU_FROM, READ, Look, looks_of, multiply
from server.views.told import Told
from server.views.topics import Encoder, schema_of, stamps, topic_of

WORLD = "ENU"
BACKLOG = 4096  # messages that wait for one client: two seconds of 2 kHz


class Subscriptions:
    """Who listens to what; the SDK tells from threads of its own."""

    def __init__(self, changed: Any) -> None:
        self._changed = changed
        self._lock = threading.Lock()
        self._count: Counter[int] = Counter()

    def __contains__(self, channel: int) -> bool:
        return self._count[channel] > 0

    def on_subscribe(self, client: Any, channel: Any) -> None:
        self._count_one(channel.id, 1)

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        self._count_one(channel.id, -1)

    def _count_one(self, channel: int, by: int) -> None:
        with self._lock:
            self._count[channel] = max(0, self._count[channel] + by)
        self._changed()


@dataclass(slots=True)
class Topics:
    """What one channel of ours goes out as."""

    device: str  # its name; a device is known by another once it has told who it is
    encoder: Encoder
    plain: foxglove.Channel
    transform: Any = None
    fix: Any = None
    look: Look | None = None
    topics: list[str] = field(default_factory=list)

    @property
    def all(self) -> list[Any]:
        return [one for one in (self.plain, self.transform, self.fix) if one is not None]


class Bridge:
    """Devices and channels as told, to whoever has subscribed."""

    def __init__(self, told: Told) -> None:
        self._told = told
        self._lock = threading.RLock()
        self._context = foxglove.Context()
        self._listeners = Subscriptions(self._subscribe)
        self._server: Any = None
        self._topics: dict[int, Topics] = {}
        self._taken: set[str] = set()
        self._asked: list[int] = []
        self._log = channels.LogChannel("/events", context=self._context)
        self._next_event = 0

    def serve(self, port: int) -> None:
        """Begin to listen, and say where."""
        try:
            self._server = foxglove.start_server(
                name=f"imuscope {VERSION}",
                host="127.0.0.1",
                port=port,
                server_listener=self._listeners,  # type: ignore[arg-type] # it hears what it wants to hear
                context=self._context,
                message_backlog_size=BACKLOG,
            )
        except Exception as error:  # the SDK's own, of many kinds: a port that is taken
            self._told.say(op="failed", why=str(error)[:200])
            return
        self._told.say(op="served", port=self._server.port)

    def arrange(self) -> None:
        """Advertise what is new, take back what is gone."""
        with self._lock:
            devices = {one["id"]: one for one in self._told.devices}
            infos = {id: info for id, info in self._told.channels.items() if info["device"] in devices}
            names = {id: str(devices[info["device"]]["name"]) for id, info in infos.items()}
            for id in [id for id, topics in self._topics.items() if names.get(id) != topics.device]:
                topics = self._topics.pop(id)
                self._taken -= set(topics.topics)
                for channel in topics.all:
                    channel.close()
            looks = {look.id: look for look in looks_of(self._told.devices, list(infos.values()))}
            for id, info in infos.items():
                if id not in self._topics:
                    self._topics[id] = self._advertise(devices[info["device"]], info)
                self._also(self._topics[id], devices[info["device"]], info, looks.get(info["device"]))
        self._subscribe()

    def hear(self, samples: Samples) -> None:
        """Encode what is subscribed to."""
        topics = self._topics.get(samples.channel)
        if topics is None or samples.n == 0:
            return
        if topics.plain.id() in self._listeners:
            for time, body in topics.encoder.messages(samples):
                topics.plain.log(body, log_time=time)
        if topics.transform is not None and topics.transform.id() in self._listeners:
            self._transforms(topics, samples)
        if topics.fix is not None and topics.fix.id() in self._listeners:
            self._fixes(topics, samples)

    def events(self, told: list[Mapping[str, Any]]) -> None:
        """What happened, once each."""
        levels = messages.LogLevel
        names = {one["id"]: one["name"] for one in self._told.devices}
        for event in told:
            if event["seq"] < self._next_event:
                continue
            self._next_event = event["seq"] + 1
            if self._log.id() in self._listeners:
                level = {"caution": levels.Warning, "fault": levels.Error}.get(event["level"], levels.Info)
                words = messages.Log(
                    timestamp=_stamp(int(event["time"] * 1e9)),
                    level=level,
                    message=event["text"],
                    name=names.get(event["device"], "imuscope"),
                )
                self._log.log(words, log_time=int(event["time"] * 1e9))

    # ── topics ───────────────────────────────────────────────────────────────────────────────────────────────────────

    def _advertise(self, device: Mapping[str, Any], info: Mapping[str, Any]) -> Topics:
        topic = topic_of(device, info, self._taken)
        self._taken.add(topic)
        about = {"message": info["message"], "quantity": info["name"], "unit": info["unit"], "frame": info["frame"]}
        plain = foxglove.Channel(topic, schema=schema_of(info), context=self._context, metadata=about)
        return Topics(str(device["name"]), Encoder(info), plain, topics=[topic])

    def _also(self, topics: Topics, device: Mapping[str, Any], info: Mapping[str, Any], look: Look | None) -> None:
        """The well-known form of an attitude and of a position."""
        topics.look = look
        if look is None:
            return
        if look.attitude and look.attitude.channel == info["id"] and topics.transform is None:
            name = self._name(device, "attitude")
            topics.topics.append(name)
            topics.transform = channels.FrameTransformChannel(name, context=self._context)
        place = look.position and look.position.kind == "place" and look.position.channel == info["id"]
        if place and topics.fix is None:
            name = self._name(device, "position")
            topics.topics.append(name)
            topics.fix = channels.LocationFixChannel(name, context=self._context)

    def _name(self, device: Mapping[str, Any], what: str) -> str:
        name = topic_of(device, {"group": "", "title": what, "name": what, "id": device["id"]}, self._taken)
        self._taken.add(name)
        return name

    def _transforms(self, topics: Topics, samples: Samples) -> None:
        look = topics.look
        if look is None or look.attitude is None:
            return
        read, turn = READ[look.attitude.kind], ENU_FROM[look.frame]
        rows = zip(*(column.tolist() for column in samples.columns[2:]), strict=True)
        for time, row in zip(stamps(samples), rows, strict=True):
            q = read(row)
            if q is None:
                continue
            w, x, y, z = multiply(turn, q)
            message = messages.FrameTransform(
                timestamp=_stamp(time),
                parent_frame_id=WORLD,
                child_frame_id=look.title,
                translation=messages.Vector3(x=0.0, y=0.0, z=0.0),
                rotation=messages.Quaternion(x=x, y=y, z=z, w=w),
            )
            topics.transform.log(message, log_time=time)

    def _fixes(self, topics: Topics, samples: Samples) -> None:
        look = topics.look
        if look is None or look.position is None:
            return
        own = samples.columns[2:]
        lat, lon = own[look.position.columns[0]].tolist(), own[look.position.columns[1]].tolist()
        at = look.position.columns[2]
        height = own[at].tolist() if at >= 0 else [0.0] * samples.n
        for time, a, b, c in zip(stamps(samples), lat, lon, height, strict=True):
            if -90 <= a <= 90 and -360 <= b <= 360 and (a or b):
                message = messages.LocationFix(
                    timestamp=_stamp(time), frame_id=look.title, latitude=a, longitude=b, altitude=c
                )
                topics.fix.log(message, log_time=time)

    def _subscribe(self) -> None:
        """Ask for what somebody wants, and for nothing else."""
        with self._lock:
            wanted = sorted(
                id for id, topics in self._topics.items() if any(one.id() in self._listeners for one in topics.all)
            )
            if wanted != self._asked:
                self._asked = wanted
                self._told.subscribe(wanted)


def _stamp(time: int) -> messages.Timestamp:
    return messages.Timestamp(time // 1_000_000_000, time % 1_000_000_000)


def main() -> None:
    """Until standard input ends."""
    told = Told()
    bridge = Bridge(told)
    told.heard_events = bridge.events
    for message in told.messages():
        if isinstance(message, Mapping):
            bridge.serve(int(message["port"]))
            continue
        if told.changed:
            told.changed = False
            bridge.arrange()
        for samples in message:
            bridge.hear(samples)


if __name__ == "__main__":
    main()
