"""Corrections reach the receiver intact from any caster, and every loss is reported.

Casters are real ones on a socket of this host; receivers are simulators, or stand in for one by counting what they get.
"""

from __future__ import annotations

import asyncio
import base64
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from imuscope.protocols.embedded.rtcm import RtcmFramer, epoch_ms
from imuscope.protocols.events import Event
from imuscope.protocols.family.info import PositionFix
from imuscope.protocols.isb.decoder import IsbDecoder
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.protocols.xbus.decoder import XbusDecoder
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.server.configuration.api_models import Corrections
from imuscope.server.extensions.corrections import stream as correction_stream
from imuscope.server.extensions.corrections.log import CorrectionLog
from imuscope.server.extensions.corrections.ntrip import Caster, CorrectionError, mounts
from imuscope.server.extensions.corrections.stream import RATE_S, CorrectionForwarder, gga, source_of, without_password
from imuscope.server.links.base import LinkError
from imuscope.server.wire import DeviceInfo
from tests.server.extensions.corrections.correction_messages import NUMBERS, STREAM, message
from tests.support.each_row import each_row
from tests.support.manual_clock import ManualClock
from tests.support.waiting import PATIENCE_S, until

S = 10**9


class Receiver:
    """A device as CorrectionForwarder sees one; `got` is what reached it."""

    def __init__(self, protocol: str, sim: Any = None) -> None:
        self.info = DeviceInfo("1", "device", "simulator", "simulator", "live", protocol=protocol)
        self.address = None
        self.got = bytearray()
        self.listeners: list[Callable[[Event], None]] = []
        self.broken = False
        self._simulator = sim
        self._now = 2 * S
        self._decoder = (XbusDecoder if protocol == "xbus" else IsbDecoder)()

    async def wait_idle(self) -> None:
        return

    async def send(self, data: bytes) -> None:
        if self.broken:
            raise LinkError("gone", "It is unplugged.")
        self.got += data
        if self._simulator is not None:
            self._now += 10_000_000
            self.forward(self._simulator.receive(data, self._now))

    def forward(self, data: bytes) -> None:
        """Bytes from the device."""
        self._decoder.feed(data, self._now)
        for event in self._decoder.drain():
            for callback in self.listeners:
                callback(event)

    def listen(self, callback: Callable[[Event], None]) -> Callable[[], None]:
        self.listeners.append(callback)
        return lambda: self.listeners.remove(callback)


Answer = Callable[[bytes, asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]


@asynccontextmanager
async def caster(answer: Answer) -> AsyncIterator[tuple[int, list[bytes]]]:
    """A caster on a port of this host: its port, and the requests that it got."""
    requests: list[bytes] = []

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            head = await reader.readuntil(b"\r\n\r\n")
            requests.append(head)
            await answer(head, reader, writer)
            await writer.drain()
        except (asyncio.IncompleteReadError, ConnectionError):
            pass
        finally:
            writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    try:
        yield server.sockets[0].getsockname()[1], requests
    finally:
        server.close()
        await server.wait_closed()


async def forwarded(receiver: Receiver, source: str, enough: Callable[[Corrections], bool]) -> Corrections:
    """Forward until a state is reached."""
    stream = CorrectionForwarder(receiver, source, first_retry_s=0.05)
    try:
        await until(lambda: enough(stream.state()), "enough")
        return stream.state()
    finally:
        await stream.close()


async def _held(reader: asyncio.StreamReader) -> None:
    """Until the other side goes."""
    while await reader.read(100):
        pass


async def _version_1(head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    writer.write(b"ICY 200 OK\r\n\r\n" + STREAM)
    await writer.drain()
    await _held(reader)


async def _version_2(head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    assert b"Ntrip-Version: Ntrip/2.0" in head
    writer.write(b"HTTP/1.1 200 OK\r\nContent-Type: gnss/data\r\nTransfer-Encoding: chunked\r\n\r\n")
    for begin in range(0, len(STREAM), 100):  # chunks cut messages anywhere
        part = STREAM[begin : begin + 100]
        writer.write(f"{len(part):x};x=y\r\n".encode() + part + b"\r\n")
        await writer.drain()
    await _held(reader)


@pytest.mark.parametrize("answer", [_version_1, _version_2])
async def test_an_imx_gets_the_messages_as_they_are(answer: Answer) -> None:
    receiver = Receiver("isb", IsbSimulator())
    async with caster(answer) as (port, requests):
        source = f"ntrip://me:se%40cret@127.0.0.1:{port}/NEAR"
        state = await forwarded(receiver, source, lambda one: sum(one.messages.values()) == 4)
    assert bytes(receiver.got) == STREAM
    assert (state.messages, state.rejected, state.refused) == (NUMBERS, 0, 0)
    assert state.running
    assert state.age_s is not None
    assert state.bytes_per_s == len(STREAM) / 10
    pair = base64.b64encode(b"me:se@cret").decode()
    assert f"Authorization: Basic {pair}".encode() in requests[0]
    assert requests[0].startswith(b"GET /NEAR HTTP/1.1\r\n")
    assert "se" not in state.source.partition("@")[0].replace("me:", "")


async def test_an_mti_680g_gets_each_message_inside_forward_gnss_data() -> None:
    simulator = XbusSimulator(product="MTi-680G")
    simulator.advance(2 * S)
    receiver = Receiver("xbus", simulator)
    acks: list[str] = []
    receiver.listen(lambda event: acks.append(getattr(getattr(event, "message", None), "name", "")))
    async with caster(_version_1) as (port, _):
        source = f"ntrip://127.0.0.1:{port}/NEAR"
        state = await forwarded(receiver, source, lambda one: sum(one.messages.values()) == 4)
    decoder = XbusDecoder(direction="to_device")
    decoder.feed(bytes(receiver.got), 0)
    sent = [event.values["data"] for event in decoder.drain() if hasattr(event, "values")]
    assert b"".join(sent) == STREAM
    assert len(sent) == 4
    assert acks.count("ForwardGnssDataAck") == 4
    assert state.refused == 0


async def test_an_mti_that_refuses_is_counted() -> None:
    simulator = XbusSimulator(product="MTi-680G")
    simulator.advance(2 * S)
    simulator.receive(bytes.fromhex("FAFF3000D1"), 2 * S)  # GoToConfig: it does not forward there
    receiver = Receiver("xbus", simulator)
    async with caster(_version_1) as (port, _):
        state = await forwarded(receiver, f"ntrip://127.0.0.1:{port}/NEAR", lambda one: one.refused == 4)
    assert state.refused == 4


async def test_a_wrong_mount_point_is_reported_with_the_available_ones() -> None:
    table = (
        "STR;BERLIN1;Berlin;RTCM 3.2;1004(1);2;GPS;N;DEU;52.5;13.4;0;0;x;none;B;N;0;\r\n"
        "STR;PARIS;Paris;RTCM 3.1;;2;GPS;N;FRA;48.8;2.3;0;0;x;none;B;N;0;\r\nENDSOURCETABLE\r\n"
    )

    async def version_1(head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(f"SOURCETABLE 200 OK\r\nContent-Type: text/plain\r\n\r\n{table}".encode())

    async def version_2(head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(f"HTTP/1.1 200 OK\r\nContent-Type: gnss/sourcetable\r\n\r\n{table}".encode())

    async def chunked(head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"HTTP/1.1 200 OK\r\nContent-Type: gnss/sourcetable\r\nTransfer-Encoding: chunked\r\n\r\n")
        writer.write(f"{len(table):x}\r\n{table}\r\n0\r\n\r\n".encode())

    for answer in (version_1, version_2, chunked):
        async with caster(answer) as (port, _):
            source = f"ntrip://127.0.0.1:{port}/BERLIN"
            state = await forwarded(Receiver("isb"), source, lambda one: "mount point" in one.message)
        assert state.message == "The caster has no mount point 'BERLIN'."
        assert "BERLIN1 (Berlin, RTCM 3.2)" in state.hint
    assert mounts(table)["PARIS"] == "Paris, RTCM 3.1"


async def test_a_wrong_password_is_reported_without_revealing_the_password() -> None:
    async def refuse(head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"HTTP/1.1 401 Unauthorized\r\nWWW-Authenticate: Basic\r\n\r\n")

    async with caster(refuse) as (port, _):
        source = f"ntrip://me:hunter2@127.0.0.1:{port}/NEAR"
        state = await forwarded(Receiver("isb"), source, lambda one: "password" in one.message)
    assert state.message == "The caster rejects name or password for NEAR."
    assert "hunter2" not in repr(state)


async def test_an_invalid_chunk_is_reported() -> None:
    async def garbled(head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\nno size\r\n")

    async with caster(garbled) as (port, _):
        source = f"ntrip://127.0.0.1:{port}/NEAR"
        state = await forwarded(Receiver("isb"), source, lambda one: "not HTTP" in one.message)
    assert state.message == "The caster's response is not HTTP."


async def test_a_caster_that_only_knows_version_1_is_tried_again() -> None:
    async def old(head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if b"HTTP/1.0" in head:
            writer.write(b"ICY 200 OK\r\n" + STREAM)
            await writer.drain()
            await _held(reader)

    receiver = Receiver("isb")
    async with caster(old) as (port, requests):
        await forwarded(receiver, f"ntrip://127.0.0.1:{port}/NEAR", lambda one: sum(one.messages.values()) == 4)
    assert [request.split(b"\r\n")[0] for request in requests] == [b"GET /NEAR HTTP/1.1", b"GET /NEAR HTTP/1.0"]
    assert bytes(receiver.got) == STREAM


async def test_a_broken_stream_comes_back_and_what_was_damaged_is_counted() -> None:
    times = 0

    async def stumbles(head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        nonlocal times
        times += 1
        damaged = STREAM[:60] + bytes([STREAM[60] ^ 1]) + STREAM[61:]
        writer.write(b"ICY 200 OK\r\n\r\n" + (damaged if times == 1 else STREAM[:-4]))
        await writer.drain()
        if times > 1:
            await _held(reader)

    receiver = Receiver("isb")
    async with caster(stumbles) as (port, _):
        source = f"ntrip://127.0.0.1:{port}/NEAR"
        state = await forwarded(receiver, source, lambda one: sum(one.messages.values()) == 6)
    assert times == 2
    assert state.messages == {"1005": 2, "1077": 1, "1087": 2, "1230": 1}
    assert state.rejected >= 1


async def test_a_caster_receives_the_position() -> None:
    receiver = Receiver("isb")
    simulator = IsbSimulator()
    got: list[bytes] = []

    async def listens(head: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"ICY 200 OK\r\n\r\n")
        got.append(await reader.readline())

    async with caster(listens) as (port, requests):
        stream = CorrectionForwarder(receiver, f"ntrip://127.0.0.1:{port}/VRS", first_retry_s=0.05)
        receiver.forward(simulator.advance(6 * S))  # after its first fix
        await until(lambda: bool(got) and got[-1].startswith(b"$GPGGA"), "a sentence upstream")
        await stream.close()
    words = got[-1].decode().split(",")
    assert words[3] == "N"
    assert float(words[2]) == pytest.approx(4500, abs=1)
    assert any(b"Ntrip-GGA: $GPGGA" in request for request in requests)


async def test_a_stream_that_no_one_watches_keeps_the_last_seconds_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each message of weeks was remembered until a page asked for the state: 100 MB a day."""
    clock = ManualClock(0.0)
    monkeypatch.setattr(correction_stream, "time", SimpleNamespace(monotonic=clock))
    stream = CorrectionForwarder(Receiver("isb"), "tcp://127.0.0.1:9")
    for _ in range(1000):
        clock.now += 0.1
        await stream._forward("1005", bytes(100))
    assert len(stream._recent) <= 10 * RATE_S + 1
    assert stream.state().bytes_per_s == pytest.approx(1000, rel=0.02)
    await stream.close()


def test_the_log_states_where_it_begins_breaks_and_ends_and_not_each_message() -> None:
    messages: list[tuple[bytes, str, str]] = []
    diary = CorrectionLog("tcp://base:1", lambda frame, text, level: messages.append((frame, text, level)))
    diary.stopped("base does not answer.")
    diary.stopped("base does not answer.")  # retried: the same reason is reported once
    for n in range(50):
        diary.forwarded("1077", b"frame %d" % n, 300)
    diary.refused()
    diary.refused()
    diary.stopped("The stream broke.")
    diary.forwarded("1005", b"again", 25)
    diary.log_end()
    assert [(frame, level) for frame, _, level in messages] == [
        *((b"", "warning"), (b"frame 0", "info"), (b"", "warning"), (b"", "warning"), (b"again", "info"), (b"", "info"))
    ]
    assert messages[3][1] == (
        "Corrections stopped: The stream broke. Forwarded so far: 50 messages, 15 kB (1077 × 50), 2 refused."
    )
    assert messages[5][1].endswith("Forwarded: 51 messages, 15 kB (1005 × 1, 1077 × 50), 2 refused.")


def test_a_gga_sentence_with_the_position() -> None:
    when = datetime(2026, 1, 2, 3, 4, 5, 670_000, UTC)
    line = gga(PositionFix(-33.8567844, 151.2152967, 25.0, 9), when)
    assert line.startswith(b"$GPGGA,030405.67,3351.40706,S,15112.91780,E,1,09,1.0,25.00,M,0.0,M,,*")
    assert gga(PositionFix(-0.5, 59.999999999), when).split(b",")[4] == b"06000.00000"


async def test_plain_tcp_and_a_device_that_is_gone() -> None:
    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(STREAM)
        await _held(reader)
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    receiver = Receiver("isb")
    receiver.broken = True
    state = await forwarded(receiver, f"tcp://127.0.0.1:{port}", lambda one: one.refused == 4)
    assert state.message == "Not forwarded: It is unplugged."
    assert state.age_s is None
    server.close()
    await server.wait_closed()


async def test_a_removed_device_ends_its_stream(tmp_path: Path) -> None:
    path = tmp_path / "base.rtcm3"
    path.write_bytes(STREAM)
    stream = CorrectionForwarder(Receiver("isb"), str(path), lambda: False)
    await until(lambda: not stream.state().running, "the end")
    assert stream.state().message == "The device has been removed."
    await stream.close()


async def test_a_file_is_played_at_its_own_pace_and_then_is_over(tmp_path: Path) -> None:
    path = tmp_path / "base.rtcm3"
    path.write_bytes(b"noise" + b"".join(message(1077, 1000 + 100 * k) + message(1005) for k in range(4)))
    receiver = Receiver("isb")
    begin = asyncio.get_running_loop().time()
    state = await forwarded(receiver, str(path), lambda one: not one.running)
    assert asyncio.get_running_loop().time() - begin >= 0.29  # three steps of 0.1 s
    assert state.messages == {"1077": 4, "1005": 4}
    assert state.message == "base.rtcm3 has finished."


async def test_a_stream_ends_although_a_message_arrives_at_that_moment(monkeypatch: pytest.MonkeyPatch) -> None:
    class Source:
        def __init__(self, arrived: asyncio.Queue[bytes]) -> None:
            self._arrived = arrived

        async def open(self, gga: bytes) -> None: ...

        async def chunks(self) -> AsyncIterator[bytes]:
            while True:
                yield await self._arrived.get()

        async def report(self, gga: bytes) -> None: ...

        async def close(self) -> None: ...

    for turns in range(8):
        arrived: asyncio.Queue[bytes] = asyncio.Queue()
        used = Source(arrived)
        monkeypatch.setattr(correction_stream, "source_of", lambda source, used=used: used)
        stream = CorrectionForwarder(Receiver("isb"), "tcp://base:1")
        arrived.put_nowait(STREAM)
        await until(lambda one=stream: sum(one.state().messages.values()) == 4, "the first messages")
        arrived.put_nowait(STREAM)
        for _ in range(turns):  # of the loop: the message is on its way to whoever waits for it
            await asyncio.sleep(0)
        closing = asyncio.ensure_future(stream.close())
        done, _ = await asyncio.wait({closing}, timeout=PATIENCE_S)
        assert done, f"{turns} turns of the loop after the message"


def test_messages_are_whole_however_the_stream_is_cut() -> None:
    for step in (1, 7, 100, 5000):
        splitter = RtcmFramer()
        results = [one for at in range(0, len(STREAM), step) for one in splitter.feed(STREAM[at : at + step])]
        assert b"".join(bytes.fromhex(one.line) for one in results) == STREAM
        assert splitter.rejected == 0
    assert epoch_ms(1077, message(1077, 123_456)) == 123_456
    assert epoch_ms(1005, message(1005)) is None


@each_row("source", ["ftp://x/y", "ntrip://host", "ntrip:///MOUNT", "tcp://host", "", "ntrip://h:99999/M"])
def test_a_source_written_wrongly(source: str) -> None:
    with pytest.raises(CorrectionError) as error:
        source_of(source)
    assert error.value.hint


def test_a_password_is_left_out() -> None:
    assert without_password("ntrip://me:pw@h:1/M") == "ntrip://me:…@h:1/M"
    assert without_password("ntrip://me:p@ss:w@h/M") == "ntrip://me:…@h/M"
    assert without_password("tcp://h:1") == "tcp://h:1"
    assert "pw" not in repr(without_password("ntrips://a:pw@h/M"))
    assert Caster.of("ntrip://a:p%2Fw@h/M").password == "p/w"
