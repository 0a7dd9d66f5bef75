"""Parts of the holder of a shared port: addresses, queues of slow clients, the voice, messages, sizes of frames."""

import errno
import math
import socket
import subprocess
import sys
import termios
from importlib import import_module
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.isb.client_frames import SETTINGS
from imuscope.protocols.isb.stored_settings import STORED
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.server.concurrency.limiters import TokenBucket
from imuscope.server.extensions.shares.holder.arbiter import MOST_TURN_S, QUIET_S, SERVER, Arbiter
from imuscope.server.extensions.shares.holder.client_frames import ClientFrames, FrameRules
from imuscope.server.extensions.shares.holder.clients import LEAST_BURST, sendable
from imuscope.server.extensions.shares.holder.messages import (
    HEADER,
    MOST_BODY,
    STAMP,
    MessageError,
    MessageKind,
    MessageReader,
    json_message,
    message,
)
from imuscope.server.extensions.shares.holder.port import Port, PortError
from imuscope.server.extensions.shares.holder.queues import ClientQueue, FrameSize, frame_bounds
from imuscope.server.extensions.shares.holder.server_connection import ServerConnection
from imuscope.server.extensions.shares.holder.settings import MODULE
from imuscope.server.extensions.shares.holder.shares import ShareAddress, ShareError
from tests.support.each_row import each_row
from tests.support.source_files import ROOT

# ── addresses ────────────────────────────────────────────────────────────────────────────────────────────────────────


@each_row(
    ("text", "expected"),
    [
        ("/run/imuscope/imu0", ("pty", "/run/imuscope/imu0", "", 0, False)),
        ("/run/imu0?mode=read", ("pty", "/run/imu0", "", 0, True)),
        ("tcp://127.0.0.1:4001", ("tcp", "", "127.0.0.1", 4001, False)),
        ("tcp://:4001", ("tcp", "", "127.0.0.1", 4001, False)),
        ("tcp://[::1]:4001?mode=read", ("tcp", "", "::1", 4001, True)),
        ("udp://10.0.0.7:4002", ("udp", "", "10.0.0.7", 4002, False)),
    ],
)
def test_addresses(text: str, expected: tuple[object, ...]) -> None:
    address = ShareAddress.parse(text)
    assert (address.kind, address.path, address.host, address.port, address.read_only) == expected
    assert ShareAddress.from_json(address.to_json()) == address
    assert ShareAddress.parse(address.text).text == address.text


def test_a_terminal_may_have_an_owner_and_permissions() -> None:
    address = ShareAddress.parse("/run/imu0?permissions=0660&owner=imu&group=dialout")
    assert (address.permissions, address.owner, address.group) == (0o660, "imu", "dialout")


@each_row(
    ("text", "words"),
    [
        ("imu0", "absolute path"),
        ("tcp://host", "HOST:PORT"),
        ("tcp://host:0", "HOST:PORT"),
        ("tcp://host:70000", "HOST:PORT"),
        ("udp://host:4001/x", "HOST:PORT"),
        ("ftp://host:1", "tcp://HOST:PORT"),
        ("/run/imu0?mode=both", "write, read"),
        ("/run/imu0?permissions=rw", "octal"),
        ("/run/imu0?speed=1", "permissions"),
        ("tcp://:4001?group=x", "no option 'group'"),
    ],
)
def test_a_wrong_address_states_what_is_allowed(text: str, words: str) -> None:
    with pytest.raises(ShareError, match=words):
        ShareAddress.parse(text)


# ── a slow client ────────────────────────────────────────────────────────────────────────────────────────────────────


def numbered(number: int, size: int) -> bytes:
    """A frame of a made-up protocol: a preamble, its size, its number, and bytes that look like a preamble."""
    return b"\xaa" + bytes([size + 4]) + number.to_bytes(2, "little") + b"\xaa" * size


def size_of(data: bytes, at: int) -> int:
    if data[at] != 0xAA:
        return -1
    if at + 1 >= len(data):
        return 0
    return data[at + 1] if data[at + 1] >= 4 else -1


class Reader:
    """A client that takes so many bytes at a time."""

    def __init__(self) -> None:
        self.written = b""
        self.room = 0

    def write(self, data: bytes) -> int:
        if not self.room:
            raise BlockingIOError
        n = min(self.room, len(data))
        self.room -= n
        self.written += data[:n]
        return n


@given(
    st.lists(st.integers(0, 40), min_size=1, max_size=120),
    st.lists(st.integers(1, 90), min_size=1, max_size=60),
    st.lists(st.integers(0, 400), max_size=60),
)
def test_a_slow_client_loses_whole_frames_and_they_are_counted(
    sizes: list[int], cuts: list[int], rooms: list[int]
) -> None:
    """However the stream is cut by reads and however the client takes it, what it gets are whole frames in order."""
    frames = [numbered(number, size) for number, size in enumerate(sizes)]
    stream, queue, reader = b"".join(frames), ClientQueue(most=300), Reader()
    at = turn = 0
    while at < len(stream):
        cut = cuts[turn % len(cuts)]
        queue.put(stream[at : at + cut], size_of)
        at += cut
        reader.room = rooms[turn % len(rooms)] if rooms else 0
        queue.send(reader.write)
        turn += 1
    reader.room = 1 << 20
    queue.send(reader.write)
    results, stored = reader.written, []
    while results:
        size = size_of(results, 0)
        assert size > 0
        number = int.from_bytes(results[2:4], "little")
        assert results[:size] == frames[number]
        stored.append(number)
        results = results[size:]
    assert stored == sorted(set(stored))
    assert queue.dropped_frames == len(frames) - len(stored)
    assert queue.dropped_bytes == len(stream) - len(reader.written)


def test_while_the_protocol_is_unknown_whole_reads_are_lost() -> None:
    queue, reader = ClientQueue(most=100), Reader()
    for number in range(20):
        queue.put(bytes([number]) * 10, None)
    assert queue.dropped_bytes > 0
    reader.room = 1000
    queue.send(reader.write)
    blocks = [reader.written[at : at + 10] for at in range(0, len(reader.written), 10)]
    assert all(len(set(block)) == 1 for block in blocks)
    assert blocks[-1] == bytes([19]) * 10


@each_row("protocol", sorted(PROTOCOLS))
def test_frames_of_each_family_are_found(protocol: str) -> None:
    family = PROTOCOLS[protocol]
    if not family.frames.frame_size:
        pytest.skip(f"{protocol} does not say how its frames are found")
    size: FrameSize = import_module(family.frames.frame_size).frame_size
    data = family.frames.sample * 3
    listing = family.frames.listing()
    listing.feed(data)
    expected = [line["offset"] for line in listing.drain(stalled=True)]
    assert frame_bounds(data, size) == [*expected, len(data)]
    assert frame_bounds(b"noise" + data, size) == [at + 5 for at in (*expected, len(data))]
    for end in range(len(data)):
        assert (
            frame_bounds(data[:end], size)[:-1]
            == [at for at in expected if at < end][: len(frame_bounds(data[:end], size)) - 1]
        )


@each_row("protocol", sorted(PROTOCOLS))
@given(st.binary(max_size=60), st.integers(0, 59))
def test_any_bytes_have_a_size_or_none(protocol: str, data: bytes, at: int) -> None:
    if PROTOCOLS[protocol].frames.frame_size and at < len(data):
        assert import_module(PROTOCOLS[protocol].frames.frame_size).frame_size(data, at) >= -1


# ── the voice ────────────────────────────────────────────────────────────────────────────────────────────────────────


def test_the_voice_is_kept_until_its_speaker_is_quiet() -> None:
    arbiter = Arbiter()
    assert arbiter.speaker(0.0) is None
    arbiter.spoke(3, 0.0)
    assert not arbiter.may_speak(SERVER, 0.1)
    assert arbiter.may_speak(3, 0.1)
    arbiter.spoke(3, 0.1)
    assert not arbiter.may_speak(4, 0.1 + 0.9 * QUIET_S)
    assert arbiter.may_speak(4, 0.11 + QUIET_S)


def test_a_transaction_begins_when_a_client_is_quiet_and_keeps_the_voice() -> None:
    arbiter = Arbiter()
    arbiter.spoke(3, 0.0)
    arbiter.lock()
    assert arbiter.speaker(0.1) == 3
    assert arbiter.speaker(0.1 + QUIET_S) == SERVER
    assert not arbiter.may_speak(3, 1000.0)
    arbiter.unlock()
    assert arbiter.may_speak(3, 1000.0)
    arbiter.spoke(3, 1000.0)
    arbiter.forget(3)
    assert arbiter.speaker(1000.0) is None


def test_a_client_that_configures_keeps_the_voice_until_it_is_done() -> None:
    arbiter = Arbiter()
    arbiter.spoke(3, 0.0)
    arbiter.configures(3, 0.0, until_done=True)
    assert arbiter.configuring(5.0) == 3
    assert not arbiter.may_speak(SERVER, 5.0)
    arbiter.spoke(3, 5.0)
    arbiter.configured(3, 6.0)
    assert arbiter.configuring(6.0) is None
    assert arbiter.may_speak(SERVER, 6.01 + QUIET_S)


def test_silence_does_not_end_a_configuration() -> None:
    """Ten seconds were taken for its end: imuscope read the device, and the program's next frames were refused."""
    arbiter = Arbiter()
    arbiter.spoke(4, 10.0)
    arbiter.configures(4, 10.0, until_done=True)
    for hours in (0.01, 1, 24):
        now = 10.0 + 3600 * hours
        assert arbiter.configuring(now) == 4
        assert not arbiter.may_speak(SERVER, now)
        assert not arbiter.take_turn(4, now)
    arbiter.forget(4)  # it has left, or a person has taken over
    assert arbiter.configuring(90_000.0) is None
    assert arbiter.may_speak(SERVER, 90_000.0)


def test_a_turn_is_taken_from_who_has_had_it_long() -> None:
    arbiter = Arbiter()
    for tenth in range(round(10 * MOST_TURN_S)):
        arbiter.spoke(3, tenth / 10)
        assert not arbiter.take_turn(3, tenth / 10)
    now = MOST_TURN_S + 0.1
    assert arbiter.take_turn(3, now)
    assert arbiter.may_speak(SERVER, now)
    assert not arbiter.may_speak(3, now + 0.5)
    assert arbiter.may_speak(3, now + 1.5)


@given(st.lists(st.tuples(st.floats(0.001, 0.5), st.integers(1, 4000)), max_size=60))
def test_no_more_is_sent_than_the_line_carries(wishes: list[tuple[float, int]]) -> None:
    budget, now, sent = TokenBucket(0.0, math.inf, 0.0), 100.0, 0
    for wait_s, wish in wishes:
        now += wait_s
        size = min(wish, max(0, sendable(budget, now, 1000.0)))
        budget.acquire(now, size)
        sent += size
    assert sent <= LEAST_BURST + 1000.0 * (now - 100.0) + 1


# ── configuration ────────────────────────────────────────────────────────────────────────────────────────────────────


def effects(protocol: str, frames: bytes) -> list[str]:
    """Effects of frames to a device of a family, however the stream is cut."""
    family = PROTOCOLS[protocol]
    rules, one = FrameRules.of(family.frames.frame_size, family.frames.configuration_frames), ClientFrames()
    whole = list(ClientFrames().feed(frames, rules))
    bytewise = [effect for at in range(len(frames)) for effect in one.feed(frames[at : at + 1], rules)]
    assert whole == bytewise
    return list(whole)


def test_an_mti_is_configured_from_go_to_config_to_go_to_measurement() -> None:
    driver = PROTOCOLS["xbus"].configuration.driver
    assert driver is not None
    known = DeviceContext()
    names = ("ReqDID", "GoToConfig", "SetFilterProfile", "GoToMeasurement", "Reset")
    values: dict[str, Any] = {"SetFilterProfile": {"profile": "General"}}
    frames = [driver.frame(name, values.get(name, {}), known) for name in names]
    assert effects("xbus", b"noise" + b"".join(frames)) == ["begin", "end", "end"]


def test_an_imx_is_configured_by_what_it_stores_and_streams() -> None:
    driver = PROTOCOLS["isb"].configuration.driver
    assert driver is not None
    known = DeviceContext(product="IMX-5")
    one = driver.frame("GET_DID_INS_1", {}, known)
    stream = driver.frame("GET_DATA", {"id": 4, "period": 10}, known)
    (write,) = driver.setting_frames("DID_FLASH_CONFIG", {"startupImuDtMs": 4}, known)
    stop = driver.frame("STOP_BROADCASTS_ALL_PORTS", {}, known)
    assert effects("isb", one) == []
    assert effects("isb", stream + write + stop) == ["change"] * 3


def test_an_imx_is_configured_by_sentences_too() -> None:
    driver = PROTOCOLS["isb"].configuration.driver
    assert driver is not None
    known = DeviceContext(product="IMX-5")
    request = driver.frame("INFO", {}, known) + driver.frame("ASCE", {}, known)
    assert effects("isb", request) == []
    messages = {"options": 0, "messages": [{"id": 7, "period": 1}]}
    for name, values in {"STPB": {}, "STPC": {}, "PERS": {}, "SRST": {}, "ASCE": messages}.items():
        assert effects("isb", b"noise" + request + driver.frame(name, values, known) + request) == ["change"], name
    correction = driver.frame("GET_DID_INS_1", {}, known)
    assert effects("isb", b"$STP\x00" + correction + b"$" + b"x" * 600 + driver.frame("STPC", {}, known)) == ["change"]


def test_every_stored_data_set_counts_as_configuration() -> None:
    assert {did for did, row in STORED.items() if row.write} <= SETTINGS


# ── messages ─────────────────────────────────────────────────────────────────────────────────────────────────────────


@given(st.lists(st.tuples(st.sampled_from(MessageKind), st.binary(max_size=50)), max_size=10), st.data())
def test_messages_survive_any_division_of_the_stream(
    messages: list[tuple[MessageKind, bytes]], data: st.DataObject
) -> None:
    stream = b"".join(message(kind, body) for kind, body in messages)
    reader, results = MessageReader(), []
    while stream:
        n = data.draw(st.integers(1, len(stream)))
        results += list(reader.feed(stream[:n]))
        stream = stream[n:]
    assert results == messages


def test_bytes_of_the_device_reach_the_server_at_once_then_together() -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
    connection, late = ServerConnection(ours), 1 << 62
    with theirs:
        assert connection.add(1, b"first")
        connection.pass_on()
        assert connection.due_at == math.inf
        assert not connection.add(2, b"second")
        assert not connection.add(3, b"third")
        assert connection.due_at < math.inf  # and has a wake-up of its own then
        assert connection.add(late, b"fourth")  # unless more arrives, which takes it along
        connection.pass_on()
        results = list(MessageReader().feed(theirs.recv(1 << 16)))
        connection.close()
    parts = [(1, b"first"), (2, b"second"), (3, b"third"), (late, b"fourth")]
    assert results == [(MessageKind.DATA, STAMP.pack(stamp) + data) for stamp, data in parts]


@each_row("head", [HEADER.pack(0x7F, 0), HEADER.pack(MessageKind.DATA, MOST_BODY + 1)])
def test_another_protocol_on_the_socket_is_refused(head: bytes) -> None:
    with pytest.raises(MessageError):
        list(MessageReader().feed(json_message(MessageKind.HELLO, {}) + head))


def test_the_holder_imports_nothing_heavy() -> None:
    modules = [(one.frames.frame_size, one.frames.configuration_frames) for one in PROTOCOLS.values()]
    code = (
        f"import sys, {MODULE}.__main__; from {MODULE}.client_frames import FrameRules; "
        f"[FrameRules.of(*one) for one in {modules!r}]; "
        "heavy = 'numpy', 'asyncio', 'fastapi', 'ssl', 'hashlib', 'secrets', 'tempfile', 'traceback', 'logging', "
        "'typing', 'pathlib', 'urllib', 'socket', 'dataclasses'; "
        "print([name for name in heavy if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@each_row("place", ["/dev/zero", "/dev/null", "/dev/full"])
def test_a_holder_does_not_even_open_a_device_that_is_no_terminal(place: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("serial.Serial", None)
    with pytest.raises(PortError):
        Port({"kind": "serial", "place": place}).open()


def test_a_port_pulled_while_it_is_opened_is_refused_with_the_cause(monkeypatch: pytest.MonkeyPatch) -> None:
    """What pyserial passes on had its number in its text only, and the page said nothing of the cause."""

    def pulled(*_: object, **__: object) -> None:
        raise termios.error(errno.EIO, "Input/output error")

    monkeypatch.setattr("serial.Serial", pulled)
    with pytest.raises(PortError, match=r"^Input/output error$") as caught:
        Port({"kind": "serial", "place": "/dev/nothing"}).open()
    assert caught.value.number == errno.EIO
