"""`python -m server.views.foxglove_aside`: the process that speaks the Foxglove WebSocket protocol.

    told:  {"op": "serve", "port": …,        begin, on a loopback port (0: any free one)
            "secret": …, "rules": {…}}       who says the secret comes through our own port and was let in there; others
                                             are judged here, by the same rules (server/auth.py): settings of Config
    says:  {"op": "served", "port": …} or {"op": "failed", "why": …}

Every channel becomes a topic of JSON messages (server/views/topics.py), every attitude a foxglove.FrameTransform from
ENU to the device, every latitude and longitude a foxglove.LocationFix, and what happens a foxglove.Log. A channel is
asked for and encoded only while somebody has subscribed to it. The messages are written by Foxglove's SDK, the protocol
is spoken by server/views/foxglove_server.py.
"""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
from foxglove import messages
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import MultipleValuesError
from websockets.http11 import Request, Response

from recordings.names import device_names
from server.auth import Access, RefusedError
from server.codec import Samples
from server.config import Config
from server.version import VERSION
from server.views.door import knows
from server.views.foxglove_server import FoxgloveServer
from server.views.poses import ENU_FROM, READ, Look, looks_of, multiply
from server.views.told import Told
from server.views.topics import Encoder, schema_of, stamps, topic_of

WORLD = "ENU"
LISTS = ("allowed_hosts", "allowed_origins")  # JSON has no tuples
PATH = "/foxglove"  # of our own port: the same rules hold


@dataclass(slots=True)
class Topics:
    """What one channel of ours goes out as."""

    device: str  # its name; a device is known by another once it has told who it is
    encoder: Encoder
    plain: int  # ids of what is advertised; 0 for what is not
    transform: int = 0
    fix: int = 0
    look: Look | None = None
    topics: list[str] = field(default_factory=list)

    @property
    def all(self) -> list[int]:
        return [id for id in (self.plain, self.transform, self.fix) if id]


class Porter:
    """Who is let in.

    Args:
        secret: said by who was let in already, at our own port.
        rules: settings of `Config` by which all others are judged, tokens among them.
    """

    def __init__(self, secret: str, rules: Mapping[str, Any]) -> None:
        self._secret = secret
        self._access = Access(Config(**{**rules, **{name: tuple(rules[name]) for name in LISTS}}))

    def admit(self, connection: ServerConnection, request: Request) -> Response | None:
        """A refusal, or None."""
        try:
            headers = {name.lower(): request.headers[name] for name in request.headers}
        except MultipleValuesError:
            return connection.respond(HTTPStatus.BAD_REQUEST, "A header came twice.\n")
        if knows(headers, self._secret):
            return None
        if urlsplit(headers.get("origin", "")).scheme not in ("", "http", "https"):
            del headers["origin"]  # a program with a page of its own (file://, app://): no page of the web can say so
        token = parse_qs(urlsplit(request.path).query).get("token", [""])[0]
        client = str((connection.remote_address or ("",))[0])
        try:
            self._access.check(PATH, "GET", headers, client=client, query_token=token, websocket=True)
        except RefusedError as refused:
            problem = refused.problem
            answer = connection.respond(
                HTTPStatus(refused.status),
                json.dumps({"kind": problem.kind, "message": problem.message, "hint": problem.hint}),
            )
            del answer.headers["content-type"]
            answer.headers["content-type"] = "application/json"
            if refused.retry_s:
                answer.headers["retry-after"] = str(refused.retry_s)
            return answer
        return None


class Bridge:
    """Devices and channels as told, to whoever has subscribed."""

    def __init__(self, told: Told) -> None:
        self._told = told
        self._lock = threading.RLock()
        self._server = FoxgloveServer(f"imuscope {VERSION}", self._subscribe)
        self._topics: dict[int, Topics] = {}
        self._taken: set[str] = set()
        self._asked: list[int] = []
        self._log = self._well_known("/events", messages.Log)
        self._next_event = 0
        self._heights: dict[int, Samples | None] = {}  # of places that come without; None: not heard yet

    def serve(self, port: int, porter: Porter) -> None:
        """Begin to listen, and say where."""
        try:
            served = self._server.start(port, porter.admit)
        except OSError as error:
            self._told.say(op="failed", why=(error.strerror or str(error))[:200])
            return
        self._told.say(op="served", port=served)

    def arrange(self) -> None:
        """Advertise what is new, take back what is gone."""
        with self._lock:
            unique = device_names(self._told.devices)
            devices = {one["id"]: {**one, "name": unique[one["id"]]} for one in self._told.devices}
            infos = {id: info for id, info in self._told.channels.items() if info["device"] in devices}
            names = {id: str(devices[info["device"]]["name"]) for id, info in infos.items()}
            for id in [id for id, topics in self._topics.items() if names.get(id) != topics.device]:
                topics = self._topics.pop(id)
                self._taken -= set(topics.topics)
                self._server.withdraw(topics.all)
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
        if samples.channel in self._heights:
            self._heights[samples.channel] = samples
        server = self._server
        if server.is_wanted(topics.plain):
            for time, body in topics.encoder.messages(samples):
                server.send(topics.plain, time, body)
        if server.is_wanted(topics.transform):
            self._transforms(topics, samples)
        if server.is_wanted(topics.fix):
            self._fixes(topics, samples)

    def events(self, told: list[Mapping[str, Any]]) -> None:
        """What happened, once each."""
        levels = messages.LogLevel
        names = {one["id"]: one["name"] for one in self._told.devices}
        for event in told:
            if event["seq"] < self._next_event:
                continue
            self._next_event = event["seq"] + 1
            if self._server.is_wanted(self._log):
                level = {"caution": levels.Warning, "fault": levels.Error}.get(event["level"], levels.Info)
                words = messages.Log(
                    timestamp=_stamp(int(event["time"] * 1e9)),
                    level=level,
                    message=event["text"],
                    name=names.get(event["device"], "imuscope"),
                )
                self._server.send(self._log, int(event["time"] * 1e9), words.encode())

    # ── topics ───────────────────────────────────────────────────────────────────────────────────────────────────────

    def _advertise(self, device: Mapping[str, Any], info: Mapping[str, Any]) -> Topics:
        topic = topic_of(device, info, self._taken)
        self._taken.add(topic)
        schema = schema_of(info)
        plain = self._server.advertise(topic, "json", schema["title"], json.dumps(schema).encode(), "jsonschema")
        return Topics(str(device["name"]), Encoder(info), plain, topics=[topic])

    def _also(self, topics: Topics, device: Mapping[str, Any], info: Mapping[str, Any], look: Look | None) -> None:
        """The well-known form of an attitude and of a position."""
        topics.look = look
        if look is None:
            return
        if look.attitude and look.attitude.channel == info["id"] and not topics.transform:
            name = self._name(device, "attitude")
            topics.topics.append(name)
            topics.transform = self._well_known(name, messages.FrameTransform)
        place = look.position and look.position.kind == "place" and look.position.channel == info["id"]
        if place and not topics.fix:
            name = self._name(device, "position")
            topics.topics.append(name)
            topics.fix = self._well_known(name, messages.LocationFix)

    def _well_known(self, topic: str, message: Any) -> int:
        schema = message.get_schema()
        return self._server.advertise(topic, "protobuf", schema.name, schema.data, schema.encoding)

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
                child_frame_id=look.name,
                translation=messages.Vector3(x=0.0, y=0.0, z=0.0),
                rotation=messages.Quaternion(x=x, y=y, z=z, w=w),
            )
            self._server.send(topics.transform, time, message.encode())

    def _fixes(self, topics: Topics, samples: Samples) -> None:
        look = topics.look
        if look is None or look.position is None:
            return
        own = samples.columns[2:]
        lat, lon = own[look.position.columns[0]].tolist(), own[look.position.columns[1]].tolist()
        at = look.position.columns[2]
        height = own[at].tolist() if at >= 0 else self._heights_at(look.position.height, samples)
        for time, a, b, c in zip(stamps(samples), lat, lon, height, strict=True):
            if -90 <= a <= 90 and -360 <= b <= 360 and (a or b):
                message = messages.LocationFix(
                    timestamp=_stamp(time), frame_id=look.name, latitude=a, longitude=b, altitude=c
                )
                self._server.send(topics.fix, time, message.encode())

    def _heights_at(self, channel: int, samples: Samples) -> list[float]:
        """Heights that come in a channel of their own: of the same moment, else the last ones before; 0 before any."""
        told = self._heights.get(channel)
        if told is None:
            return [0.0] * samples.n
        at = np.searchsorted(stamps(told), stamps(samples), "right") - 1
        heights: list[float] = told.columns[2][np.maximum(at, 0)].tolist()
        return heights

    def _subscribe(self) -> None:
        """Ask for what somebody wants, and for nothing else."""
        with self._lock:
            asked = {id for id, topics in self._topics.items() if any(map(self._server.is_wanted, topics.all))}
            fixes = [topics.look for topics in self._topics.values() if self._server.is_wanted(topics.fix)]
            heights = {look.position.height for look in fixes if look and look.position and look.position.height}
            self._heights = {id: self._heights.get(id) for id in heights}
            wanted = sorted(asked | heights)
            if wanted != self._asked:
                self._asked = wanted
                self._told.subscribe(wanted)


def _stamp(time: int) -> messages.Timestamp:
    return messages.Timestamp(time // 1_000_000_000, time % 1_000_000_000)


def main() -> None:
    """Until standard input ends."""
    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # whoever is refused: server/auth.py's words are enough
    told = Told()
    bridge = Bridge(told)
    told.heard_events = bridge.events
    for message in told.messages():
        if isinstance(message, Mapping):
            bridge.serve(int(message["port"]), Porter(str(message["secret"]), message["rules"]))
            continue
        if told.changed:
            told.changed = False
            bridge.arrange()
        for samples in message:
            bridge.hear(samples)


if __name__ == "__main__":
    main()
