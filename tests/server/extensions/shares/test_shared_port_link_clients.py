"""Clients of a shared port that configure the device, flood it, wait or set rates, and a holder that fails."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
import termios
import threading
import time
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from imuscope.protocols.xbus.frames import build
from imuscope.server.extensions.shares import shared_port_link
from imuscope.server.extensions.shares.holder import server_session, sharing
from imuscope.server.extensions.shares.holder.arbiter import QUIET_S
from imuscope.server.extensions.shares.holder.messages import MessageKind, MessageReader, message
from imuscope.server.extensions.shares.holder.process import Holder
from imuscope.server.extensions.shares.holder.share_kinds import MOST_TCP_CLIENTS, UNREAD
from imuscope.server.extensions.shares.holder.shares import ShareError
from imuscope.server.extensions.shares.holder.socket_paths import log_of, socket_of
from imuscope.server.extensions.shares.shared_port_link import ROOT, SharedPortLink, holder_settings, is_held
from imuscope.server.links.base import LinkError
from imuscope.server.system.open_files import programs_with
from tests.server.extensions.shares.shared_port import (
    DevicePort,
    clients,
    driven,
    eventually,
    hung_up,
    joined,
    link_to,
    read_exactly,
    received,
    set_rate,
    shared,
    write_and_close,
)
from tests.support.free_ports import free_port
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until

GO_TO_CONFIG, GO_TO_MEASUREMENT = build(0x30), build(0x10)
XBUS = ("imuscope.protocols.xbus.client_frames", "imuscope.protocols.xbus.client_frames")
pytestmark = pytest.mark.usefixtures("runtime")
LINE = 11_520  # bytes/s at 115 200 Bd


@contextlib.asynccontextmanager
async def in_process(port: DevicePort, *shares: str) -> AsyncIterator[SharedPortLink]:
    """As `shared`, with a holder in a thread: its times can be replaced."""
    link = link_to(port, *shares)
    holder = Holder(holder_settings(link.inner, link.shares, stay=True))
    ready = threading.Event()
    failures: list[Exception] = []
    thread = threading.Thread(target=holder.run, args=(ready.set, failures.append))
    thread.start()
    try:
        assert await asyncio.to_thread(ready.wait, PATIENCE_S)
        await link.open()
        yield link
    finally:
        holder.end()
        await asyncio.to_thread(thread.join, PATIENCE_S)
        await link.close()
    assert not failures


@pytest.fixture
def short_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sharing, "MOST_WAIT_S", 0.3)
    monkeypatch.setattr(server_session, "MOST_WAIT_S", 0.3)


async def configuring(link: SharedPortLink, share: Path) -> int:
    """A client of the share, which has begun to configure the device."""
    link.use_frames(*XBUS)
    driver = await joined(link, share)
    os.write(driver, GO_TO_CONFIG)
    await eventually(lambda: link.state["configuring"], link)
    return driver


async def test_the_server_waits_until_a_client_has_configured_the_device(port: DevicePort, tmp_path: Path) -> None:
    async with shared(port, str(tmp_path / "imu0")) as link:
        driver = await configuring(link, tmp_path / "imu0")
        assert port.receive(len(GO_TO_CONFIG)) == GO_TO_CONFIG
        await eventually(lambda: link.state["configuring"] == clients(link)[0]["number"], link)
        began = time.monotonic()
        write = asyncio.create_task(link.write(b"server"))
        await eventually(lambda: time.monotonic() - began > 2 * QUIET_S, link)
        assert not write.done()
        assert port.is_quiet()
        os.write(driver, GO_TO_MEASUREMENT)
        assert await asyncio.to_thread(port.receive, len(GO_TO_MEASUREMENT)) == GO_TO_MEASUREMENT
        assert await asyncio.to_thread(port.receive, 6) == b"server"
        await write
        assert link.state["configuring"] is None
        os.close(driver)


async def test_what_a_program_writes_before_it_closes_reaches_the_device_at_once(
    port: DevicePort, tmp_path: Path
) -> None:
    """A program that opened, wrote and closed between two looks was heard when the next one came, as that one's."""
    async with shared(port, str(tmp_path / "imu0")) as link:
        for number in range(5):
            write_and_close(tmp_path / "imu0", b"hello")
            assert await asyncio.to_thread(port.receive, 5) == b"hello", number
            await eventually(lambda: not clients(link), link)


async def test_what_a_program_that_left_could_not_send_is_counted(port: DevicePort, tmp_path: Path) -> None:
    async with in_process(port, str(tmp_path / "imu0"), f"tcp://127.0.0.1:{free_port()}") as link:
        link.use_frames(*XBUS)
        other = socket.create_connection(("127.0.0.1", int(link.shares[1].text.rpartition(":")[2])), PATIENCE_S)
        await eventually(lambda: clients(link), link)
        other.sendall(GO_TO_CONFIG)
        await eventually(lambda: link.state["configuring"], link)
        write_and_close(tmp_path / "imu0", b"hello")
        await eventually(lambda: link.state["unsent"], link)
        assert [one["bytes"] for one in link.state["unsent"]] == [5]
        other.close()
        assert await asyncio.to_thread(port.receive, len(GO_TO_CONFIG)) == GO_TO_CONFIG
        assert port.is_quiet()


@pytest.mark.usefixtures("short_waits")
async def test_a_person_may_take_over_from_a_client_that_does_not_finish(port: DevicePort, tmp_path: Path) -> None:
    async with in_process(port, str(tmp_path / "imu0")) as link:
        driver = await configuring(link, tmp_path / "imu0")
        with pytest.raises(LinkError, match="is configuring the device") as raised:
            await link.write(b"server")
        assert raised.value.hint == "Wait until it has finished, or take over under Share port."
        await link.request("take-over", number=link.state["configuring"])
        await link.write(b"person")
        assert await asyncio.to_thread(port.receive, len(GO_TO_CONFIG) + 6) == GO_TO_CONFIG + b"person"
        os.close(driver)


@pytest.mark.usefixtures("short_waits")
async def test_what_has_waited_too_long_is_refused(port: DevicePort, tmp_path: Path) -> None:
    async with in_process(port, str(tmp_path / "imu0")) as link:
        driver = await configuring(link, tmp_path / "imu0")
        with pytest.raises(LinkError) as raised:
            await link.write(b"server")
        assert raised.value.kind == "busy"
        assert raised.value.message == f"The client {tmp_path / 'imu0'} is configuring the device at {link.source}."
        os.write(driver, GO_TO_MEASUREMENT)
        whole = GO_TO_CONFIG + GO_TO_MEASUREMENT
        assert await asyncio.to_thread(port.receive, len(whole)) == whole, "nothing of the server in between"
        await eventually(lambda: link.state["speaker"] is None, link)
        assert port.is_quiet(), "what was refused is not sent later"
        link.hold_clients(True)
        await eventually(lambda: link.state["speaker"] == 0, link)
        os.write(driver, b"too late")
        await eventually(lambda: clients(link)[0]["refused"] == 8, link)
        assert port.is_quiet()
        os.close(driver)


async def test_a_client_that_floods_is_held_to_the_line_and_takes_turns(port: DevicePort, tmp_path: Path) -> None:
    number = free_port()

    async with shared(port, str(tmp_path / "imu0"), f"tcp://127.0.0.1:{number}") as link:
        driver = await joined(link, tmp_path / "imu0")
        stop, batch = threading.Event(), bytearray()

        def flood() -> None:
            while not stop.is_set():
                with contextlib.suppress(BlockingIOError):
                    os.write(driver, b"f" * 500)
                select.select((), (driver,), (), 0.1)

        def device() -> None:
            while not stop.is_set():
                if not port.is_quiet():
                    batch.extend(port.receive(1))
                else:
                    select.select((), (), (), 0.001)

        threads = [threading.Thread(target=one) for one in (flood, device)]
        for one in threads:
            one.start()
        began = time.monotonic()
        try:
            with socket.create_connection(("127.0.0.1", number), PATIENCE_S) as other:
                await eventually(lambda: any(one["limited"] for one in clients(link)), link)
                other.sendall(b"OTHER")
                await link.write(b"SERVER")
                await eventually(lambda: b"SERVER" in batch and b"OTHER" in batch, link)
            elapsed = time.monotonic() - began
            assert len(batch) < LINE * (elapsed + 1)
            assert clients(link)[0]["limited_s"] > 0
        finally:
            stop.set()
            for one in threads:
                one.join()
        os.close(driver)


async def test_a_quiet_device_that_takes_slowly_what_is_written_is_not_taken_for_gone(
    port: DevicePort, tmp_path: Path
) -> None:
    """Room for more to write is no sign that there is something to read."""
    async with shared(port, str(tmp_path / "imu0")) as link:
        data = bytes(range(256)) * 512
        result = asyncio.create_task(asyncio.to_thread(port.receive, len(data)))
        await link.write(data)
        assert await result == data
        assert link.state["open"]


async def test_the_server_has_its_turn_beside_a_client_that_never_pauses(port: DevicePort, tmp_path: Path) -> None:
    """A driver that sends odometry, or polls, is not quiet for as long as the end of a dialogue takes."""
    async with driven(port, tmp_path / "imu0") as (link, driver):
        stop = threading.Event()

        def talk() -> None:
            while not stop.wait(QUIET_S / 3):
                os.write(driver, b"odometry")

        thread = threading.Thread(target=talk)
        thread.start()
        try:
            await eventually(lambda: link.state["speaker"] not in (None, 0), link)
            await link.write(b"SERVER")
        finally:
            stop.set()
            thread.join()
        data = b""
        while b"SERVER" not in data:
            data += await asyncio.to_thread(port.receive, 1)
        assert data.removesuffix(b"SERVER").replace(b"odometry", b"") == b""


async def test_a_rate_that_a_client_sets_while_it_waits_is_followed_after_what_it_sent(
    port: DevicePort, tmp_path: Path
) -> None:
    async with driven(port, tmp_path / "imu0") as (link, driver):
        await eventually(lambda: clients(link)[0]["baud"], link)
        link.hold_clients(True)
        await eventually(lambda: link.state["speaker"] == 0, link)
        os.write(driver, b"SetBaudrate")
        await eventually(lambda: clients(link)[0]["paused"], link)
        set_rate(driver, termios.B460800)
        await eventually(lambda: clients(link)[0]["baud"] == 460_800, link)
        assert link.baud == 115_200
        link.hold_clients(False)
        assert await asyncio.to_thread(port.receive, 11) == b"SetBaudrate"
        await eventually(lambda: link.baud == 460_800, link)


async def test_a_path_that_another_holder_offers_is_left_to_it(port: DevicePort, tmp_path: Path) -> None:
    async with shared(port, str(tmp_path / "imu0")) as link:
        target, other = os.readlink(tmp_path / "imu0"), DevicePort()
        with pytest.raises(LinkError, match=rf"is offered by another holder \(process {link.holder_pid}\)"):
            await link_to(other, str(tmp_path / "imu0")).open()
        assert os.readlink(tmp_path / "imu0") == target
        other.unplug()


async def test_a_link_that_a_killed_holder_left_is_replaced(port: DevicePort, tmp_path: Path) -> None:
    os.symlink("/dev/pts/99999", tmp_path / "imu0")

    async with shared(port, str(tmp_path / "imu0")):
        assert os.path.exists(tmp_path / "imu0")


def test_the_next_terminal_of_a_number_is_not_taken_for_the_port(port: DevicePort, tmp_path: Path) -> None:
    """The kernel gives the number of a closed terminal to the next one, here the share of another port: its client's
    rate was replaced by that of the holder that still waited for its own.
    """

    async def check() -> bool:
        other = DevicePort()
        former, number = link_to(other), other.path
        await former.open()
        try:
            async with shared(port, str(tmp_path / "imu0")) as link:
                other.unplug()
                await eventually(lambda: not former.state["open"], link)
                next_one = DevicePort()
                was_taken = next_one.path == number
                if was_taken:
                    until = time.monotonic() + 3.0
                    await eventually(lambda: time.monotonic() > until, link)
                    assert not [one for one in programs_with(number) if one.pid == former.holder_pid]
                next_one.unplug()
                return was_taken
        finally:
            await former.close()
            os.kill(former.holder_pid, signal.SIGTERM)
            block_until(lambda: not is_held(former.inner), "the next port of this number has a holder of its own")

    # Another test beside this one may get the number first; then there is nothing to see.
    assert any(asyncio.run(check()) for _ in range(20))


FAILING = """
import sys, imuscope.server.extensions.shares.holder.sharing as sharing
look = sharing.Sharing.update
def failing(self, now):
    look(self, now)
    if any(client.received for client in self.clients.values()):
        raise RuntimeError("a defect")
sharing.Sharing.update = failing
from imuscope.server.extensions.shares.holder.__main__ import main
raise SystemExit(main())
"""


async def test_a_holder_that_fails_gives_the_reason_and_its_clients_see_an_unplugged_port(
    port: DevicePort, tmp_path: Path
) -> None:
    link = link_to(port, str(tmp_path / "imu0"))
    words = holder_settings(link.inner, link.shares).to_text()
    subprocess.run([sys.executable, "-c", FAILING, words], cwd=ROOT, check=True, timeout=PATIENCE_S)
    await link.open()
    driver = await joined(link, tmp_path / "imu0")
    os.write(driver, b"x")
    with pytest.raises(LinkError) as raised:
        await received(link, 1)
    assert "ended: RuntimeError: a defect." in raised.value.message
    log = log_of(str(socket_of(port.path)))
    assert log in raised.value.hint
    assert "Traceback" in Path(log).read_text()
    await eventually(lambda: hung_up(driver), link)
    assert not os.path.lexists(tmp_path / "imu0")
    os.close(driver)
    await link.close()


NONSENSE = [
    *(b"[]", b"null", b"{", b"\xff", b"[" * 200_000, b'{"id": [], "do": "lock"}', b'{"id": null}', b'{"do": "lock"}'),
    *(b'{"id": 1, "do": "baud", "baud": %s}' % one for one in (b"null", b"1e400", b"{}", b'"x"')),
    *(b'{"id": 1, "do": "share", "share": %s}' % one for one in (b"null", b'{"kind": 7}', b"3", b"[1]")),
    *(b'{"id": 1, "do": "drop", "number": []}', b'{"id": 1, "do": 1}'),
    *(b'{"id": 1, "do": "frames", "module": %s}' % one for one in (b"7", b'"os.nothing"')),
]


async def test_whatever_a_server_sends_its_holder_keeps_the_port_open_for_others(
    port: DevicePort, tmp_path: Path
) -> None:
    """One defect of the server, or a server of another version, took the port from the robot's driver."""
    async with driven(port, tmp_path / "imu0") as (link, driver):
        await link.close()
        for body in NONSENSE:
            await asyncio.to_thread(refused_by_holder, port, body)
            port.send(b"on")
            assert read_exactly(driver, 2) == b"on", body[:60]


def refused_by_holder(port: DevicePort, body: bytes) -> None:
    """Be a server that sends one request, until the holder refuses it or ends the connection."""
    block_until(lambda: is_refused(port, body), "the holder has seen the end of the server before")


def is_refused(port: DevicePort, body: bytes) -> bool:
    """Whether the request was refused; not if the holder has another server."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as server:
        server.settimeout(PATIENCE_S)
        server.connect(str(socket_of(port.path)))
        with contextlib.suppress(OSError):  # it has ended the connection already
            server.sendall(message(MessageKind.REQUEST, body))
        reader = MessageReader()
        with contextlib.suppress(ConnectionError):
            while data := server.recv(1 << 16):
                for kind, text in reader.feed(data):
                    if kind == MessageKind.HELLO and json.loads(text)["busy"]:
                        return False
                    if kind == MessageKind.DONE:
                        assert "error" in json.loads(text), body[:60]
                        return True
        return True


async def test_a_holder_that_is_stuck_is_reported(
    port: DevicePort, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shared_port_link, "SILENT_S", 2.0)

    async with shared(port, str(tmp_path / "imu0")) as link:
        os.kill(link.holder_pid, signal.SIGSTOP)
        try:
            with pytest.raises(LinkError, match="does not answer") as raised:
                await received(link, 1)
            assert f"kill -9 {link.holder_pid}" in raised.value.hint
        finally:
            os.kill(link.holder_pid, signal.SIGCONT)


async def test_clients_that_neither_send_nor_read_give_way_to_those_that_come(port: DevicePort) -> None:
    number = free_port()

    def connected() -> socket.socket:
        line = socket.socket()
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)  # little of what it does not read waits there
        line.connect(("127.0.0.1", number))
        return line

    async with shared(port, f"tcp://127.0.0.1:{number}") as link:
        with contextlib.ExitStack() as stack:
            sender, reader, *idle = [stack.enter_context(connected()) for _ in range(MOST_TCP_CLIENTS)]
            sender.sendall(b"hello")
            await eventually(lambda: [one["received"] for one in clients(link)] == [5, *[0] * 15], link)
            size = 2 * UNREAD + 40_000
            sending = asyncio.create_task(asyncio.to_thread(port.send, bytes(size)))
            await asyncio.to_thread(read_exactly, reader.fileno(), size)
            await sending
            await received(link, size)
            driver = stack.enter_context(connected())
            driver.sendall(b"driver")
            await eventually(lambda: any(one["received"] == 6 for one in clients(link)), link)
            assert link.state["displaced"] == [3]
            assert await asyncio.to_thread(idle[0].recv, 1 << 20)  # what was on its way
            numbers = [one["number"] for one in clients(link)]
            assert numbers == [1, 2, *range(4, 18)]
            for one in [stack.enter_context(connected()) for _ in range(13)]:
                one.sendall(b"more")
            await eventually(lambda: sum(one["received"] == 4 for one in clients(link)) == 13, link)
            late = stack.enter_context(connected())
            assert await asyncio.to_thread(late.recv, 1) == b""
            await eventually(lambda: link.state["turned_away"] == 1, link)
            assert {1, 2, 17} <= {one["number"] for one in clients(link)}


async def test_a_second_holder_of_a_port_states_it_without_a_number_of_an_error(
    port: DevicePort, tmp_path: Path
) -> None:
    async with in_process(port, str(tmp_path / "imu0")) as link:
        second = Holder(holder_settings(link.inner, [], stay=True))
        with pytest.raises(ShareError, match=r"^another holder has this port; end it first, or use its shares$"):
            await asyncio.to_thread(second.server.listen)
