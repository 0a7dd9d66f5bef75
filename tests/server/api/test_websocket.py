"""Samples on a real WebSocket: a simulator in a subprocess, slow and stalled browsers."""

from __future__ import annotations

import json
import socket
import time
from collections import defaultdict
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection
from websockets.typing import Subprotocol

from imuscope.server import wire
from imuscope.server.services.services import ViewerTimings
from imuscope.server.settings.config import Config
from imuscope.server.streaming.channel_rows import ChannelRows
from imuscope.server.streaming.telemetry import Telemetry
from imuscope.server.wire import codec as wire_codec
from tests.support.fakes import FakeLink
from tests.support.in_process_server import InProcessServer
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S, connect

PROTOCOLS = [Subprotocol(wire.SUBPROTOCOL)]


class StreamReader:
    """Reads a WebSocket as a page does, and counts received and dropped samples per channel."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.channels: dict[int, dict[str, Any]] = {}
        self.texts: list[dict[str, Any]] = []
        self.live: dict[int, list[wire_codec.SampleFrame]] = defaultdict(list)
        self.history: dict[int, list[wire_codec.SampleFrame]] = defaultdict(list)

    def subscribe(self, history: float = 600) -> None:
        self.connection.send(wire_codec.encode_text(wire.Subscribe(history)))

    def read(self, seconds: float, until: Any = lambda reader: False) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end and not until(self):
            try:
                self._take(self.connection.recv(timeout=0.1))
            except TimeoutError:
                continue

    def _take(self, message: str | bytes) -> None:
        if isinstance(message, str):
            text = json.loads(message)
            self.texts.append(text)
            for channel in text.get("channels", []):
                self.channels[channel["id"]] = channel
            return
        dtypes = {number: [column["dtype"] for column in one["columns"]] for number, one in self.channels.items()}
        for samples in wire_codec.decode_samples(message, dtypes):
            (self.history if samples.history else self.live)[samples.channel].append(samples)

    def messages_of(self, op: str) -> list[dict[str, Any]]:
        return [text for text in self.texts if text["op"] == op]

    def named(self, name: str) -> int:
        return next(number for number, one in self.channels.items() if one["name"] == name)


def assert_whole(reader: StreamReader, channel: int) -> int:
    """History and live join without gap or duplicate; live accounts for every sample. Returns how many were dropped."""
    first = reader.live[channel][0].sequence - reader.live[channel][0].dropped
    at = first
    for samples in reader.history[channel]:
        assert samples.sequence + samples.n == at
        at = samples.sequence
    at, dropped = first, 0
    for samples in reader.live[channel]:
        assert samples.sequence == at + samples.dropped
        at = samples.sequence + samples.n
        dropped += samples.dropped
    return dropped


def test_a_simulator_streams_into_a_browser(server: ServerProcess) -> None:
    url = server.url.rstrip("/").replace("http", "ws", 1) + "/ws"
    with connect(url, subprotocols=PROTOCOLS, max_size=None) as connection:
        reader = StreamReader(connection)
        reader.subscribe()
        reader.read(PATIENCE_S, lambda r: any(len(frames) > 80 for frames in r.live.values()))
        (device,) = reader.messages_of("devices")[-1]["devices"]
        assert (device["status"], device["protocol"], device["link"]) == ("live", "xbus", "simulator")
        acceleration = reader.channels[reader.named("Acceleration")]
        assert (acceleration["kind"], acceleration["unit"]) == ("vector", "m/s²")
        assert [column["axis"] for column in acceleration["columns"]] == ["x", "y", "z"]
        for number in reader.live:
            assert assert_whole(reader, number) == 0
        frames = reader.live[reader.named("Acceleration")]
        arrival, host, x, y, z = (np.concatenate(column) for column in zip(*(f.columns for f in frames), strict=True))
        assert len(arrival) > 50
        assert (np.diff(arrival) >= 0).all()
        assert (np.diff(host) > 0).all()
        assert np.abs(arrival - host).min() < 0.05  # of the sample that was held up least, by whatever else runs here
        assert abs(np.median(np.sqrt(x**2 + y**2 + z**2)) - 9.8) < 3
        hello = reader.messages_of("hello")[0]
        assert abs(hello["server_time"] - time.time()) < 60
        assert 0 <= min(frame.now - frame.columns[0][-1] for frame in frames) < 0.02  # sent at once
    with connect(url, subprotocols=PROTOCOLS, max_size=None) as connection:  # a reload
        late = StreamReader(connection)
        late.subscribe()
        late.read(
            PATIENCE_S, lambda r: r.messages_of("history_end") and all(r.live[n] for n in (late.named("Acceleration"),))
        )
        for number in [number for number in late.live if late.live[number]]:
            assert_whole(late, number)
        number = late.named("Acceleration")
        assert sum(frame.n for frame in late.history[number]) >= len(arrival)


COLUMNS = 10


class ChunkedSource:
    """A channel of ten values, fed from the test."""

    def __init__(self, running: InProcessServer) -> None:
        self.running = running
        self.telemetry: Telemetry = running.services.telemetry
        columns = [wire.ColumnInfo(f"c{k}", "f8") for k in range(COLUMNS)]
        info = wire.ChannelInfo(0, "1", "M", "Fast", "Fast", "vector", "", "", columns)
        self.channel = running.call(self.telemetry.bus.advertise, info)
        self.sent = 0

    def send(self, n: int) -> None:
        numbers = np.arange(self.sent, self.sent + n, dtype="f8")
        self.sent += n
        self.running.call(self._publish, numbers)

    def _publish(self, numbers: Any) -> None:
        self.telemetry.bus.publish(
            [ChannelRows(self.channel, [np.full(len(numbers), self.telemetry.bus.now()), *[numbers] * (1 + COLUMNS)])]
        )
        self.telemetry.bus.event("1", "text", "info", f"{self.sent}")
        self.telemetry.clients.flush()


def small_socket(running: InProcessServer) -> socket.socket:
    """A connection whose receive buffer is small, so that it fills at once."""
    host, port = running.url.removeprefix("http://").split(":")
    plain = socket.socket()
    plain.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8192)
    plain.connect((host, int(port)))
    return plain


def test_a_page_that_draws_seldom_gets_samples_as_seldom_and_all_of_them(server: ServerProcess) -> None:
    with connect(server.url.rstrip("/").replace("http", "ws", 1) + "/ws", subprotocols=PROTOCOLS) as connection:
        reader = StreamReader(connection)
        reader.read(PATIENCE_S, lambda reader: reader.messages_of("channels"))
        connection.send(wire_codec.encode_text(wire.Interval(10.0)))  # a tenth of a second is the longest
        reader.subscribe(0)
        reader.read(PATIENCE_S, lambda reader: any(len(live) > 20 for live in reader.live.values()))
    channel = max(reader.live, key=lambda number: len(reader.live[number]))
    assert assert_whole(reader, channel) == 0
    sent = [samples.now for samples in reader.live[channel]][2:]
    assert np.diff(np.unique(sent)).min() > 0.09  # where a ring wraps, one flush has two frames


def test_a_slow_browser_is_sent_its_losses_and_slows_no_others() -> None:
    with InProcessServer(Config(sources=("/dev/one",)), FakeLink) as running:
        source = ChunkedSource(running)
        slow = connect(running.ws, subprotocols=PROTOCOLS, max_size=None, sock=small_socket(running), max_queue=1)
        quick = connect(running.ws, subprotocols=PROTOCOLS, max_size=None)
        with slow, quick:
            readers = [StreamReader(slow), StreamReader(quick)]
            for reader in readers:
                reader.subscribe(0)
                reader.read(PATIENCE_S, lambda r: r.messages_of("history_end"))
            for _ in range(60):
                source.send(1000)  # 96 kB each
                readers[1].read(0.0)
                readers[1].read(PATIENCE_S, lambda r: sum(f.n for f in r.live[source.channel]) == source.sent)
                assert _end(readers[1], source.channel) == source.sent, "it waited for the one that takes nothing"
            source.send(1)
            for reader in readers:
                reader.read(PATIENCE_S, lambda r: r.live[source.channel] and _end(r, source.channel) == source.sent)
            dropped = [assert_whole(reader, source.channel) for reader in readers]
            assert dropped[1] == 0
            assert dropped[0] > 10_000
            for reader in readers:  # both received all events
                messages = [event["text"] for text in reader.messages_of("events") for event in text["events"]]
                assert [text for text in messages if text.isdigit()] == [str(1000 * k) for k in range(1, 61)] + [
                    "60001"
                ]
            readers[0].read(PATIENCE_S, lambda r: _dropped(r) == dropped[0])
            assert _dropped(readers[0]) == dropped[0]  # and health agrees


def _end(reader: StreamReader, channel: int) -> int:
    return reader.live[channel][-1].sequence + reader.live[channel][-1].n


def _dropped(reader: StreamReader) -> int:
    return sum(device["dropped"] for text in reader.messages_of("health")[-1:] for device in text["devices"])


def test_a_stalled_browser_is_disconnected() -> None:
    with InProcessServer(Config(sources=("/dev/one",)), FakeLink, timings=ViewerTimings(stuck_s=0.5)) as running:
        source = ChunkedSource(running)
        with (
            connect(running.ws, subprotocols=PROTOCOLS, max_size=None, sock=small_socket(running), max_queue=1) as dead,
            connect(running.ws, subprotocols=PROTOCOLS, max_size=None) as alive,
        ):
            reader = StreamReader(alive)
            reader.subscribe(0)
            StreamReader(dead).subscribe(0)
            reader.read(PATIENCE_S, lambda r: r.messages_of("history_end"))
            end = time.monotonic() + PATIENCE_S
            while source.telemetry.clients.browsers > 1 and time.monotonic() < end:
                source.send(2000)
                reader.read(0.05)
            assert source.telemetry.clients.browsers == 1
            reader.read(PATIENCE_S, lambda r: _end(r, source.channel) == source.sent)
            assert assert_whole(reader, source.channel) == 0
            with pytest.raises(ConnectionClosed):
                read_on(dead)


def read_on(connection: ClientConnection) -> None:
    while True:
        connection.recv(timeout=PATIENCE_S)


def test_live_data_do_not_wait_for_history() -> None:
    """While minutes of history are on their way, live samples arrive, and are answered by others that arrive."""
    with InProcessServer(Config(sources=("/dev/one",)), FakeLink) as running:
        source = ChunkedSource(running)
        for _ in range(40):
            source.send(5000)  # 19 MB of history
        with connect(running.ws, subprotocols=PROTOCOLS, max_size=None) as connection:
            reader = StreamReader(connection)
            reader.subscribe()
            reader.read(PATIENCE_S, lambda r: r.history[source.channel])  # the first of many
            rounds = 0  # created and removed while history was being sent
            while not reader.messages_of("history_end") and rounds < 1000:
                source.send(10)
                reader.read(PATIENCE_S, lambda r: r.live[source.channel] and _end(r, source.channel) == source.sent)
                rounds += not reader.messages_of("history_end")
            assert assert_whole(reader, source.channel) == 0
            assert sum(frame.n for frame in reader.history[source.channel]) == 200_000
            assert rounds >= 3


def test_invalid_text_ends_the_connection_without_an_error(server: ServerProcess) -> None:
    """Uvicorn closes with 1007 as RFC 6455 requires. Regression: it logged a traceback."""
    url = server.url.rstrip("/").replace("http", "ws", 1) + "/ws"
    with connect(url, subprotocols=PROTOCOLS, max_size=None) as socket_:
        socket_.send(b'{"op": "subscr\xff', text=True)
        with pytest.raises(ConnectionClosed) as closed:
            StreamReader(socket_).read(PATIENCE_S)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1007
    assert "Traceback" not in server.log
