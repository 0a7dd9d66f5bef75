"""The loop of a holder as machine code: as plain Python, byte for byte, also to who takes less; its priority."""

import os
import select
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from imuscope.protocols.native.kernels import plain
from imuscope.recordings.system import priority
from imuscope.server.extensions.shares import relay_kernel
from imuscope.server.extensions.shares.hold import findings
from imuscope.server.extensions.shares.holder.event_loop import RELAYED
from imuscope.server.extensions.shares.holder.messages import STAMP, MessageKind, MessageReader
from imuscope.server.extensions.shares.holder.process import LEFT_OVER, OTHERS, PORT_FAILED, TIME_IS_OVER, Relay
from imuscope.server.extensions.shares.holder.settings import MODULE
from imuscope.server.extensions.shares.relay_kernel import READ_BYTES, relay
from imuscope.server.settings.config import load
from tests.support.each_row import each_row

FUNCTIONS = {"machine": relay, "plain": plain(relay)}


class Ends:
    """A device, two clients and a server; each with the descriptor that the loop has, and the other end."""

    def __init__(self) -> None:
        self.pairs = [socket.socketpair() for _ in range(4)]
        for pair in self.pairs:
            for one in pair:
                one.setblocking(False)
        self.epoll = select.epoll()
        self.left_over, self.spill = os.pipe()
        self.epoll.register(self.pairs[0][0], RELAYED)
        self.device, self.first, self.second, self.server = (pair[1] for pair in self.pairs)

    def run(self, function: Callable[..., Any], seconds: float = 0.0, *, has_server: bool = True) -> tuple[int, ...]:
        port, first, second, server = (pair[0].fileno() for pair in self.pairs)
        until = time.monotonic_ns() + int(seconds * 1e9)
        numbers: tuple[int, ...] = function(
            port, self.epoll.fileno(), (first, second, -1, -1), server if has_server else -1, self.spill, until
        )
        return numbers

    def received(self) -> bytes:
        """What the server has received, without the times, which have to ascend."""
        stamps, data = [0], b""
        for kind, body in MessageReader().feed(self.server.recv(1 << 20)):
            assert kind == MessageKind.DATA
            stamps.append(STAMP.unpack_from(body)[0])
            data += body[STAMP.size :]
        assert stamps == sorted(stamps)
        assert stamps[-1] <= time.monotonic_ns()
        return data

    def close(self) -> None:
        for one in (end for pair in self.pairs for end in pair):
            one.close()
        self.epoll.close()
        os.close(self.left_over)
        os.close(self.spill)


def test_it_is_machine_code_without_numpy() -> None:
    place = relay_kernel.place()
    assert place is not None
    Relay(*place).close()


@each_row("name", FUNCTIONS)
def test_every_byte_goes_to_clients_and_with_its_time_to_the_server(name: str) -> None:
    ends = Ends()
    data = os.urandom(3 * READ_BYTES + 100)
    ends.device.sendall(data[:READ_BYTES])
    ends.device.sendall(data[READ_BYTES:])
    state, total, size, first, second, *_ = ends.run(FUNCTIONS[name], 0.05)
    assert (state, total, first, second) == (TIME_IS_OVER, len(data), size, size)
    assert ends.first.recv(1 << 20) == ends.second.recv(1 << 20) == ends.received() == data
    ends.close()


@each_row("name", FUNCTIONS)
def test_what_a_client_or_the_server_does_not_take_is_left_over(name: str) -> None:
    ends = Ends()
    while True:  # the first client takes nothing any more
        try:
            ends.pairs[1][0].send(b"x" * 512)
        except BlockingIOError:
            break
    ends.device.send(b"y" * 1000)
    state, total, size, first, second, _, _, unsent = ends.run(FUNCTIONS[name], 60.0)
    assert (state, total, size, first, second, unsent) == (LEFT_OVER, 1000, 1000, -1, 1000, 0)
    assert os.read(ends.left_over, size) == b"y" * 1000
    assert (ends.second.recv(2000), ends.received()) == (b"y" * 1000,) * 2
    while True:
        try:
            ends.pairs[3][0].send(b"z" * 512)
        except BlockingIOError:
            break
    while True:
        try:
            ends.first.recv(1 << 16)
        except BlockingIOError:
            break
    ends.device.send(b"w" * 10)
    state, _, size, first, _, _, _, unsent = ends.run(FUNCTIONS[name], 60.0)
    assert (state, size, first, unsent) == (LEFT_OVER, 10, 10, 23)
    (((_, body)),) = list(MessageReader().feed(os.read(ends.left_over, unsent)))
    assert body[STAMP.size :] == b"w" * 10
    ends.close()


@each_row("name", FUNCTIONS)
def test_another_descriptor_and_the_end_of_the_port_end_it(name: str) -> None:
    ends = Ends()
    ends.epoll.register(ends.left_over, select.EPOLLIN)
    os.write(ends.spill, b"!")
    assert ends.run(FUNCTIONS[name], 60.0)[0] == OTHERS
    os.read(ends.left_over, 1)
    ends.device.send(b"last")
    ends.device.close()
    state, total, *_ = ends.run(FUNCTIONS[name], 60.0)
    assert (state, total) == (PORT_FAILED, 4)
    assert ends.first.recv(10) == ends.received() == b"last"
    ends.close()


def test_a_port_also_wakes_the_loop_by_the_bit_of_older_kernels() -> None:
    """Regression: terminals of older kernels wake a reader that waits for EPOLLIN, not for EPOLLRDNORM alone."""
    assert RELAYED & select.EPOLLIN
    assert RELAYED & select.EPOLLRDNORM


def test_a_holder_takes_the_priority_that_it_may_have(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(priority.SAME, raising=False)
    calls: list[tuple[Any, ...]] = []

    def refuse(*arguments: Any) -> None:
        calls.append(arguments)
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", lambda *arguments: calls.append(arguments))
    assert priority.raise_priority()
    assert calls.pop()[1] == os.SCHED_RR | os.SCHED_RESET_ON_FORK
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "setpriority", lambda *arguments: calls.append(arguments))
    assert priority.raise_priority()
    assert calls.pop() == (os.PRIO_PROCESS, 0, priority.RAISED_NICENESS)
    monkeypatch.setattr(os, "setpriority", refuse)
    assert not priority.raise_priority()


def test_doctor_names_a_holder_without_priority(tmp_path: Path) -> None:
    folder = tmp_path / "proc" / str(os.getpid())
    folder.mkdir(parents=True)
    (folder / "cmdline").write_bytes(f"python\0-m\0{MODULE}\0{{}}".encode())
    (finding,) = findings(load(data=tmp_path), tmp_path)
    assert f"process {os.getpid()}) has no priority" in finding.message
    assert "LimitRTPRIO" in finding.todo[0]
    (folder / "cmdline").write_bytes(b"python\0-m\0other")
    assert list(findings(load(data=tmp_path), tmp_path)) == []
