"""`imuscope replay`: the original bytes, at their pace, over real sockets and a real pseudo-terminal."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import fcntl
import io
import os
import select
import signal
import socket
import subprocess
import sys
import termios
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar, NoReturn

import pytest

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.replay import ReplayClock
from imuscope.server.cli import main
from imuscope.server.commands.replay import UdpSink, _play, address
from imuscope.server.errors import UsageError
from tests.server.links.replayed import of, recording
from tests.support import virtual_time
from tests.support.each_row import each_row
from tests.support.forking.fork_server import Child
from tests.support.free_ports import free_port
from tests.support.server_process import begun
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until

MOST_UNREAD = 4000  # bytes that a terminal has for its reader, nearly: Linux, N_TTY_BUF_SIZE is 4096


@contextmanager
def replaying(path: Path, *arguments: str) -> Iterator[tuple[subprocess.Popen[str] | Child, str]]:
    """The command, and the address that it prints."""
    process = begun("replay", str(path), *arguments, apart=True)
    try:
        assert process.stdout is not None
        yield process, process.stdout.readline().strip()
    finally:
        process.kill()
        process.communicate()


def all_of(connection: socket.socket) -> bytes:
    connection.settimeout(PATIENCE_S)
    received = b""
    while data := connection.recv(65536):
        received += data
    return received


def test_over_tcp_the_original_bytes(tmp_path: Path) -> None:
    with replaying(recording(tmp_path, devices=1), "--tcp", "127.0.0.1:0", "--speed", "5") as (process, place):
        host, port = place.removeprefix("tcp://").split(":")
        with socket.create_connection((host, int(port))) as connection:
            result = all_of(connection)
        assert result == of(1)
        assert process.wait(PATIENCE_S) == 0


class LateSink:
    """Has its first reader after a minute, and notes when it gets what."""

    place = "nowhere"

    def __init__(self) -> None:
        self.sent: list[tuple[float, bytes]] = []

    async def wait_ready(self) -> None:
        await asyncio.sleep(60)

    async def send(self, data: bytes) -> None:
        self.sent.append((asyncio.get_running_loop().time(), data))


def test_it_waits_for_a_reader_and_sends_at_the_pace_of_the_recording(tmp_path: Path) -> None:
    sink = LateSink()

    async def check() -> None:
        loop = asyncio.get_running_loop()
        replay = ReplayClock(open_file(recording(tmp_path, devices=1)), lambda: round(loop.time() * 1e9))
        await _play(replay, sink, io.StringIO())  # type: ignore[arg-type]

    virtual_time.run(check())
    assert [at for at, _ in sink.sent] == pytest.approx([60 + n / 100 for n in range(100)], abs=1e-3)
    assert [data for _, data in sink.sent] == [of(1, n, n + 1) for n in range(100)]


def test_two_clients_one_device_of_two_and_a_stretch(tmp_path: Path) -> None:
    arguments = ("--tcp", ":0", "--device", "2", "--from", "0.2", "--to", "0.5", "--speed", "0.5")
    with replaying(recording(tmp_path), *arguments) as (_, place):
        port = int(place.rpartition(":")[2])
        with socket.create_connection(("127.0.0.1", port)) as first:
            with socket.create_connection(("127.0.0.1", port)) as second:
                second.sendall(b"what comes back is thrown away")
                late = all_of(second)
            assert all_of(first) == of(2, 20, 50)
        assert of(2, 20, 50).endswith(late)
        assert late


def test_over_udp_a_datagram_for_each_chunk(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(PATIENCE_S)
        place = f"127.0.0.1:{receiver.getsockname()[1]}"
        with replaying(recording(tmp_path, devices=1), "--udp", place, "--speed", "5") as (process, printed):
            assert printed == f"udp://:{receiver.getsockname()[1]}"
            datagrams = [receiver.recv(65536) for _ in range(100)]
            assert process.wait(PATIENCE_S) == 0
    assert datagrams == [of(1, n, n + 1) for n in range(100)]


async def test_over_udp_it_goes_on_while_the_network_is_away() -> None:
    """A cable that was pulled out ended it with a traceback."""

    class Away(socket.socket):
        """A socket whose network comes back after a while."""

        sent: ClassVar[list[bytes]] = []

        def send(self, data: Any, flags: int = 0) -> int:
            self.sent.append(bytes(data))
            if len(self.sent) < 3:
                raise OSError(errno.ENETUNREACH, os.strerror(errno.ENETUNREACH))
            return len(data)

    sink = UdpSink("127.0.0.1", free_port())
    sink._socket.close()
    sink._socket = Away(socket.AF_INET, socket.SOCK_DGRAM)
    sink._socket.setblocking(False)
    for data in (b"one", b"two", b"three"):
        await sink.send(data)
    await sink.close()
    assert Away.sent == [b"one", b"two", b"three"]


def received_at(port: int) -> bytes:
    """Bytes received within a time; b"" if there are none or the other end has closed."""
    if not select.select([port], [], [], PATIENCE_S)[0]:
        return b""
    with contextlib.suppress(OSError):
        return os.read(port, 65536)
    return b""


def test_on_a_pseudo_terminal_every_byte_from_the_first(tmp_path: Path) -> None:
    with replaying(recording(tmp_path, devices=1, frames=600), "--pty", "--speed", "20") as (process, place):
        port = os.open(place, os.O_RDWR | os.O_NOCTTY)
        try:
            results, expected = b"", of(1, 0, 600)
            while len(results) < len(expected) and (piece := received_at(port)):
                results += piece
        finally:
            os.close(port)
        assert results == expected
        assert process.wait(PATIENCE_S) == 0


def unread(port: int) -> int:
    """Bytes that wait at a terminal: FIONREAD, ioctl_tty(2)."""
    return int.from_bytes(fcntl.ioctl(port, termios.FIONREAD, bytes(4)), sys.byteorder)


def test_a_reader_that_does_not_read_holds_it_up_and_loses_nothing(tmp_path: Path) -> None:
    with replaying(recording(tmp_path, devices=1, frames=600), "--pty", "--speed", "50") as (_, place):
        port = os.open(place, os.O_RDWR | os.O_NOCTTY)
        try:
            block_until(lambda: unread(port) >= MOST_UNREAD, "the terminal takes no more")
            results, expected = b"", of(1, 0, 600)
            while len(results) < len(expected) and (piece := received_at(port)):
                results += piece
        finally:
            os.close(port)
        assert results == expected


def test_a_loop_goes_on_until_it_is_stopped(tmp_path: Path) -> None:
    path = recording(tmp_path, devices=1, frames=5)
    with replaying(path, "--tcp", ":0", "--loop") as (process, place):
        with socket.create_connection(("127.0.0.1", int(place.rpartition(":")[2]))) as connection:
            connection.settimeout(PATIENCE_S)
            data = b""
            while len(data) < 3 * len(of(1, 0, 5)):
                data += connection.recv(65536)
        assert data.startswith(of(1, 0, 5) * 3)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 0


def test_unplayable_files_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(recording(tmp_path))
    wrong = [
        ((str(tmp_path / "none.mcap"),), "file not found"),
        ((path,), "name one with --device: 1 (xbus), 2 (xbus)"),
        ((path, "--device", "7"), "has no device '7'"),
        ((path, "--device", "1", "--speed", "0"), "--speed 0 is outside"),
        ((path, "--device", "1", "--from", "5"), "lasts 0.990 s"),
        ((path, "--device", "1", "--tcp", "nowhere"), "is not a valid address"),
        ((path, "--device", "1", "--tcp", "203.0.113.1:80"), "cannot be used"),
        ((path, "--tcp", ":1", "--pty"), "not allowed with"),
    ]
    for arguments, words in wrong:
        try:
            status: int | str | None = main(["replay", *arguments])
        except SystemExit as end:
            status = end.code
        assert status == 1, arguments
        printed = capsys.readouterr()
        assert words in printed.err
        assert printed.err.count("\n") == 1
        assert printed.out == ""


@each_row(
    ("problem", "words"),
    [
        (FileNotFoundError(errno.ENOENT, "No such file or directory"), "cannot be read any more: no such file"),
        (RecordingError("drive.db3 is damaged.", "Copy it again."), "drive.db3 is damaged. Copy it again."),
    ],
)
def test_a_file_that_goes_while_it_is_played_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, problem: Exception, words: str
) -> None:
    def due_chunks(replay: ReplayClock, most: int = 0) -> NoReturn:
        raise problem

    monkeypatch.setattr(ReplayClock, "due_chunks", due_chunks)
    assert main(["replay", str(recording(tmp_path, devices=1)), "--udp", f"127.0.0.1:{free_port()}"]) == 1
    assert words in capsys.readouterr().err


@each_row("text", ["", "x", "x:", "x:70000", "x:-1", "1:2:x"])
def test_addresses(text: str) -> None:
    with pytest.raises(UsageError):
        address(text)
    assert address(":40") == ("", 40)
    assert address("[::1]:40") == ("::1", 40)
