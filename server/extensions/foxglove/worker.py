"""`python -m imuscope.server.extensions.foxglove.worker`: the process that serves the Foxglove WebSocket protocol.

    input:   {"op": "serve", "port": …,      start on a loopback port (0: any free one)
              "secret": …, "rules": {…}}     clients with the secret come through our own port and were checked there;
                                             others are checked here by the same rules (server/access/auth.py): settings
                                             of Config
    output:  {"op": "served", "port": …} or {"op": "failed", "why": …}

Every channel becomes a topic of JSON messages (recordings/exporters/topics.py), every attitude a
foxglove.FrameTransform from ENU to the device, every latitude and longitude a foxglove.LocationFix, and every event a
foxglove.Log (recordings/exporters/standard_schemas.py). A channel is requested and encoded only while it has
subscribers. The protocol itself is in server/extensions/foxglove/protocol_server.py.
"""

import json
import logging
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import MultipleValuesError
from websockets.http11 import Request, Response

from imuscope.recordings.exporters import standard_schemas
from imuscope.recordings.exporters.entities import Attitude, DeviceEntity, PositionEntity, devices_of
from imuscope.recordings.exporters.topics import EVENTS, Encoder, named, schema_of, stamps, topic_of
from imuscope.recordings.file_names import device_names
from imuscope.server.access.auth import Access, RefusedError
from imuscope.server.errors import status_of
from imuscope.server.extensions.foxglove.protocol_server import FoxgloveServer
from imuscope.server.integrations.shared_secret import has_secret
from imuscope.server.integrations.viewer_client import ViewerClient
from imuscope.server.settings.config import Config
from imuscope.server.version import VERSION
from imuscope.server.wire.codec import SampleFrame

LISTS = ("allowed_hosts", "allowed_origins")  # JSON has no tuples
PATH = "/foxglove"  # on our own port: the same rules apply


@dataclass(slots=True)
class TopicRegistry:
    """Foxglove topics of one channel."""

    device: str  # its name, which changes when the device is identified
    encoder: Encoder
    plain: int  # ids of advertised topics; 0 if not advertised
    transform: int = 0
    fix: int = 0
    attitude: Attitude | None = None
    position: PositionEntity | None = None
    topics: list[str] = field(default_factory=list)

    @property
    def all(self) -> list[int]:
        return [number for number in (self.plain, self.transform, self.fix) if number]


class ConnectionGuard:
    """Admission of connections.

    Args:
        secret: sent by clients that were admitted at our own port.
        rules: settings of `Config` for checking all others, including tokens.
    """

    def __init__(self, secret: str, rules: Mapping[str, Any]) -> None:
        self._secret = secret
        self._access = Access(Config(**{**rules, **{name: tuple(rules[name]) for name in LISTS}}))

    def accept(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return a refusal, or None if the connection is admitted."""
        try:
            headers = {name.lower(): request.headers[name] for name in request.headers}
        except MultipleValuesError:
            return connection.respond(HTTPStatus.BAD_REQUEST, "Duplicate header.\n")
        if has_secret(headers, self._secret):
            return None
        if urlsplit(headers.get("origin", "")).scheme not in ("", "http", "https"):
            del headers["origin"]  # a program with its own page (file://, app://); web pages cannot send this
        token = parse_qs(urlsplit(request.path).query).get("token", [""])[0]
        client = str((connection.remote_address or ("",))[0])
        try:
            self._access.check(PATH, "GET", headers, client=client, query_token=token, websocket=True)
        except RefusedError as refused:
            body = {"kind": refused.kind, "message": refused.message, "hint": refused.hint}
            answer = connection.respond(HTTPStatus(status_of(refused.kind)), json.dumps(body))
            del answer.headers["content-type"]
            answer.headers["content-type"] = "application/json"
            if refused.retry_s:
                answer.headers["retry-after"] = str(refused.retry_s)
            return answer
        return None


class FoxgloveBridge:
    """Publishes devices and channels to subscribers."""

    def __init__(self, client: ViewerClient) -> None:
        self._client = client
        self._lock = threading.RLock()
        self._server = FoxgloveServer(f"imuscope {VERSION}", self._subscribe)
        self._topics: dict[int, TopicRegistry] = {}
        self._names_in_use: set[str] = set()
        self._requested: list[int] = []
        self._log = self._well_known(EVENTS, standard_schemas.Log)
        self._next_event = 0
        self._heights: dict[int, SampleFrame | None] = {}  # of positions without height; None: not received yet

    def serve(self, port: int, porter: ConnectionGuard) -> None:
        """Start listening, and report the port."""
        try:
            served = self._server.start(port, porter.accept)
        except OSError as error:
            self._client.send(op="failed", why=(error.strerror or str(error))[:200])
            return
        self._client.send(op="served", port=served)

    def configure(self) -> None:
        """Advertise new channels, remove old ones."""
        with self._lock:
            unique = device_names(self._client.announced)
            infos = {number: info for number, info in self._client.channels.items() if info["device"] in unique}
            names = {number: unique[info["device"]] for number, info in infos.items()}
            for number in [number for number, topics in self._topics.items() if names.get(number) != topics.device]:
                topics = self._topics.pop(number)
                self._names_in_use -= set(topics.topics)
                self._server.withdraw(topics.all)
            entities = {device.id: device for device in devices_of(self._client.announced, list(infos.values()))}
            for number, info in infos.items():
                if number not in self._topics:
                    self._topics[number] = self._advertise(names[number], info)
                self._also(self._topics[number], info, entities[info["device"]])
        self._subscribe()

    def on_message(self, message: Sequence[SampleFrame]) -> None:
        """Encode the subscribed channels of a message with samples."""
        for samples in message:  # a height may follow its position
            if samples.channel in self._heights and samples.n:
                self._heights[samples.channel] = samples
        for samples in message:
            self._send(samples)

    def _send(self, samples: SampleFrame) -> None:
        topics = self._topics.get(samples.channel)
        if topics is None or samples.n == 0:
            return
        server = self._server
        if server.is_wanted(topics.plain):
            for time, body in topics.encoder.messages(samples.columns):
                server.send(topics.plain, time, body)
        if server.is_wanted(topics.transform):
            self._transforms(topics, samples)
        if server.is_wanted(topics.fix):
            self._fixes(topics, samples)

    def events(self, received: list[Mapping[str, Any]]) -> None:
        """Publish each event once."""
        names = device_names(self._client.announced)
        for event in received:
            if event["seq"] < self._next_event:
                continue
            self._next_event = event["seq"] + 1
            if self._server.is_wanted(self._log):
                self._server.send(self._log, *standard_schemas.logged(event, names.get(event["device"], "")))

    # ── topics ───────────────────────────────────────────────────────────────────────────────────────────────────────

    def _advertise(self, device: str, info: Mapping[str, Any]) -> TopicRegistry:
        topic = topic_of(device, info, self._names_in_use)
        self._names_in_use.add(topic)
        schema = schema_of(info)
        plain = self._server.advertise(topic, "json", schema["title"], json.dumps(schema).encode(), "jsonschema")
        return TopicRegistry(device, Encoder(info), plain, topics=[topic])

    def _also(self, topics: TopicRegistry, info: Mapping[str, Any], device: DeviceEntity) -> None:
        """Advertise the well-known forms of an attitude and of a position."""
        topics.attitude, topics.position = device.attitude, device.position
        if device.attitude and device.attitude.channel == info["id"] and not topics.transform:
            topics.transform = self._named(topics, standard_schemas.ATTITUDE, standard_schemas.FrameTransform)
        place = device.position and device.position.kind == "place" and device.position.channel == info["id"]
        if place and not topics.fix:
            topics.fix = self._named(topics, standard_schemas.POSITION, standard_schemas.LocationFix)

    def _well_known(self, topic: str, message: Any) -> int:
        schema = message.get_schema()
        return self._server.advertise(topic, "protobuf", schema.name, schema.data, schema.encoding)

    def _named(self, topics: TopicRegistry, what: str, message: Any) -> int:
        topic = named(topics.device, what, in_use=self._names_in_use)
        self._names_in_use.add(topic)
        topics.topics.append(topic)
        return self._well_known(topic, message)

    def _transforms(self, topics: TopicRegistry, samples: SampleFrame) -> None:
        assert topics.attitude is not None
        times = stamps(samples.columns[0], samples.columns[1])
        for row, body in standard_schemas.transforms(topics.device, topics.attitude, samples.columns[2:], times):
            self._server.send(topics.transform, int(times[row]), body)

    def _fixes(self, topics: TopicRegistry, samples: SampleFrame) -> None:
        assert topics.position is not None
        times = stamps(samples.columns[0], samples.columns[1])
        frame = self._heights.get(topics.position.height)
        height = np.zeros(samples.n)
        if frame is not None:
            height = standard_schemas.heights(stamps(frame.columns[0], frame.columns[1]), frame.columns[2], times)
        for row, body in standard_schemas.fixes(topics.device, topics.position, samples.columns[2:], height, times):
            self._server.send(topics.fix, int(times[row]), body)

    def _subscribe(self) -> None:
        """Request only the channels with subscribers."""
        with self._lock:
            is_wanted = self._server.is_wanted
            subscribed = {number for number, topics in self._topics.items() if any(map(is_wanted, topics.all))}
            places = [topics.position for topics in self._topics.values() if is_wanted(topics.fix)]
            heights = {place.height for place in places if place and place.height}
            self._heights = {number: self._heights.get(number) for number in heights}
            ids = sorted(subscribed | heights)
            if ids != self._requested:
                self._requested = ids
                self._client.subscribe(ids)


def main() -> None:
    """Run until standard input ends."""
    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # server/access/auth.py logs refusals
    client = ViewerClient()
    bridge = FoxgloveBridge(client)
    client.on_events = bridge.events
    for message in client.messages():
        if isinstance(message, Mapping):
            bridge.serve(int(message["port"]), ConnectionGuard(str(message["secret"]), message["rules"]))
            continue
        if client.changed:
            client.changed = False
            bridge.configure()
        bridge.on_message(message)


if __name__ == "__main__":
    main()
