"""A shared port with a real holder process, real pseudo-terminals and sockets."""

from __future__ import annotations

import asyncio
import os
import re
import signal
import socket
import termios
import threading
import time
from pathlib import Path

import pytest

from imuscope.server.extensions.shares.holder.arbiter import QUIET_S
from imuscope.server.extensions.shares.holder.process import Holder
from imuscope.server.extensions.shares.holder.shares import ShareError
from imuscope.server.extensions.shares.holder.socket_paths import port_link, socket_of
from imuscope.server.extensions.shares.shared_port_link import ClientData, SharedPortLink, holder_settings, is_held
from imuscope.server.links.base import LinkError
from tests.server.extensions.shares.shared_port import (
    DevicePort,
    clients,
    driven,
    eventually,
    hung_up,
    joined,
    link_to,
    locks,
    opened,
    read_exactly,
    received,
    set_rate,
    shared,
)
from tests.support.each_row import each_row
from tests.support.free_ports import free_port
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until

FRAME = bytes.fromhex("faff3600cb")
pytestmark = pytest.mark.usefixtures("runtime")


async def reopen(link: SharedPortLink) -> None:
    """Close a link and open it as a session does: again and again."""
    await link.close()
    deadline = time.monotonic() + PATIENCE_S
    while not link.is_connected:
        try:
            await link.open()
        except LinkError:
            assert time.monotonic() < deadline
            await asyncio.sleep(0.05)


async def test_every_client_gets_every_byte_and_one_of_each_share_may_write(port: DevicePort, tmp_path: Path) -> None:
    number = free_port()

    async with shared(port, str(tmp_path / "imu0"), f"tcp://127.0.0.1:{number}") as link:
        driver = opened(tmp_path / "imu0")
        first = socket.create_connection(("127.0.0.1", number), PATIENCE_S)
        await eventually(lambda: len(clients(link)) == 2, link)
        second = socket.create_connection(("127.0.0.1", number), PATIENCE_S)
        await eventually(lambda: len(clients(link)) == 3, link)
        rights = [one["may_write"] for one in sorted(clients(link), key=lambda one: one["number"])]
        assert sorted(rights) == [False, True, True]
        data = bytes(range(256)) * 40
        port.send(data)
        assert await received(link, len(data)) == data
        for fd in (driver, first.fileno(), second.fileno()):
            assert read_exactly(fd, len(data)) == data
        second.sendall(b"nobody listens to this")
        os.write(driver, b"to the device")
        assert port.receive(13) == b"to the device"
        await eventually(lambda: sum(one["refused"] for one in clients(link)) == 22, link)
        assert port.is_quiet()
        os.close(driver)
        first.close()
        await eventually(lambda: len(clients(link)) == 1, link)
        second.close()


async def test_a_program_reads_nothing_of_what_came_before_it(port: DevicePort, tmp_path: Path) -> None:
    async with shared(port, str(tmp_path / "imu0")) as link:
        for _ in range(3):
            driver = await joined(link, tmp_path / "imu0")
            port.send(b"left unread")
            assert await received(link, 11) == b"left unread"
            os.close(driver)
            await eventually(lambda: not clients(link), link)
            driver = await joined(link, tmp_path / "imu0")
            port.send(b"new")
            assert await received(link, 3) == b"new"
            assert read_exactly(driver, 3) == b"new"
            os.close(driver)
            await eventually(lambda: not clients(link), link)


async def test_a_program_that_opens_its_terminal_again_misses_nothing_after_its_first_byte(
    port: DevicePort, tmp_path: Path
) -> None:
    number, ended = 0, threading.Event()

    def speak() -> None:
        nonlocal number
        while not ended.wait(0.0005):
            port.send(b"%d\n" % number)
            number += 1

    async with shared(port, str(tmp_path / "imu0")) as link:
        listener = asyncio.create_task(drained(link))
        speaker = threading.Thread(target=speak)
        speaker.start()
        try:
            for _ in range(60):
                driver = opened(tmp_path / "imu0")
                lines = (await asyncio.to_thread(read_exactly, driver, 200)).split(b"\n")[1:-1]
                os.close(driver)
                outcome = [int(line) for line in lines]
                assert outcome == list(range(outcome[0], outcome[0] + len(outcome)))
        finally:
            ended.set()
            speaker.join()
            listener.cancel()


async def drained(link: SharedPortLink) -> None:
    while True:
        await link.read()


async def test_datagrams_go_both_ways(port: DevicePort) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(PATIENCE_S)
        async with shared(port, f"udp://127.0.0.1:{receiver.getsockname()[1]}") as link:
            await eventually(lambda: clients(link), link)
            port.send(FRAME)
            data, sender = await asyncio.to_thread(receiver.recvfrom, 2048)
            assert data == FRAME
            receiver.sendto(b"answer", sender)
            assert await asyncio.to_thread(port.receive, 6) == b"answer"


async def test_nothing_is_written_through_a_read_only_share(port: DevicePort, tmp_path: Path) -> None:
    async with driven(port, tmp_path / "imu0", "?mode=read") as (link, driver):
        os.write(driver, b"refused")
        await eventually(lambda: clients(link)[0]["refused"] == 7, link)
        assert port.is_quiet()


async def test_the_end_of_the_server_costs_its_clients_no_byte(port: DevicePort, tmp_path: Path) -> None:
    link = link_to(port, str(tmp_path / "imu0"))
    await link.open()
    driver = await joined(link, tmp_path / "imu0")
    port.send(b"before")
    assert read_exactly(driver, 6) == b"before"
    await link.close()  # without a word to the holder, as by kill -9
    port.send(b"meanwhile")
    assert read_exactly(driver, 9) == b"meanwhile"
    os.write(driver, b"still heard")
    assert port.receive(11) == b"still heard"
    async with shared(port, str(tmp_path / "imu0")) as again:
        assert len(clients(again)) == 1, "the holder was found again"
        port.send(b"after")
        assert await received(again, 5) == b"after"
        assert read_exactly(driver, 5) == b"after"
    os.close(driver)


async def test_a_second_server_is_refused_and_the_first_goes_on(port: DevicePort, tmp_path: Path) -> None:
    async with shared(port, str(tmp_path / "imu0")) as link:
        second = link_to(port)
        with pytest.raises(LinkError, match=rf"held for another imuscope \(process {os.getpid()}\)") as raised:
            await second.open()
        assert raised.value.kind == "busy"
        assert is_held(second.inner)
        port.send(FRAME)
        assert await received(link, len(FRAME)) == FRAME
    await eventually(lambda: not is_held(second.inner), link)


async def test_what_a_client_sends_is_reported_with_its_time_and_name(port: DevicePort, tmp_path: Path) -> None:
    async with driven(port, tmp_path / "imu0") as (link, driver):
        messages: list[ClientData] = []
        link.on_client_data.add(messages.append)
        before = link.settings.now_ns()
        os.write(driver, FRAME)
        await eventually(lambda: messages, link)
        assert (messages[0].data, messages[0].peer) == (FRAME, str(tmp_path / "imu0"))
        assert before <= messages[0].arrival_ns <= link.settings.now_ns()


async def test_the_server_waits_for_a_client_that_talks_and_clients_for_the_server(
    port: DevicePort, tmp_path: Path
) -> None:
    async with driven(port, tmp_path / "imu0") as (link, driver):
        os.write(driver, b"client")
        assert port.receive(6) == b"client"
        began = time.monotonic()
        await link.write(b"server")
        assert time.monotonic() - began > QUIET_S / 2
        assert port.receive(6) == b"server"
        link.hold_clients(True)
        await eventually(lambda: link.state["speaker"] == 0, link)
        os.write(driver, b"later")
        await eventually(lambda: clients(link)[0]["paused"], link)
        await link.write(b"transaction")
        assert port.receive(11) == b"transaction"
        assert port.is_quiet()
        link.hold_clients(False)
        assert await asyncio.to_thread(port.receive, 5) == b"later"


async def test_a_write_that_waited_has_the_time_at_which_it_was_written(port: DevicePort, tmp_path: Path) -> None:
    """It had that of the request, before what another program sent meanwhile: the log named the wrong order."""
    async with driven(port, tmp_path / "imu0") as (link, driver):
        os.write(driver, b"client")
        assert port.receive(6) == b"client"
        requested_ns = link.settings.now_ns()
        written_ns = await link.write(b"server")
        assert written_ns is not None
        assert requested_ns + QUIET_S * 1e9 / 2 < written_ns <= link.settings.now_ns()


async def test_a_client_that_sets_another_rate_takes_the_port_with_it(port: DevicePort, tmp_path: Path) -> None:
    async with driven(port, tmp_path / "imu0") as (link, driver):
        set_rate(driver, termios.B57600)
        await eventually(lambda: clients(link)[0]["baud"] == 57_600, link)
        assert link.state["baud"] == 115_200, "that alone changes nothing for the others"
        os.write(driver, b"SetBaudrate")
        assert port.receive(11) == b"SetBaudrate"
        set_rate(driver, termios.B460800)
        await eventually(lambda: link.baud == 460_800, link)
        assert link.capacity == 46_080


async def test_a_port_that_is_gone_hangs_up_its_clients_and_comes_back(port: DevicePort, tmp_path: Path) -> None:
    """The path of the port is a link, as udev makes it, so that another device can be plugged in."""
    plugged = tmp_path / "ttyIMU"
    plugged.symlink_to(port.path)
    port.path = str(plugged)
    number = free_port()

    link = link_to(port, str(tmp_path / "imu0"), f"tcp://127.0.0.1:{number}")
    await link.open()
    driver = opened(tmp_path / "imu0")
    connection = socket.create_connection(("127.0.0.1", number), PATIENCE_S)
    await eventually(lambda: len(clients(link)) == 2, link)
    port.unplug()
    with pytest.raises(LinkError) as raised:
        await received(link, 1)
    assert raised.value.kind in ("gone", "not-found", "refused")
    assert connection.recv(1) == b""
    connection.close()
    await eventually(lambda: hung_up(driver), link)
    assert not os.path.lexists(tmp_path / "imu0")
    os.close(driver)
    other = DevicePort()
    plugged.unlink()
    plugged.symlink_to(other.path)
    await reopen(link)
    driver = await joined(link, tmp_path / "imu0")
    other.send(b"back")
    assert await received(link, 4) == b"back"
    assert read_exactly(driver, 4) == b"back"
    os.close(driver)
    await link.request("end")
    await link.close()
    other.unplug()


async def test_a_holder_is_found_by_every_path_of_its_port(port: DevicePort, tmp_path: Path) -> None:
    """Given a path that udev makes; the adapter comes back under another number, and another gets the former one."""
    plugged = tmp_path / "by-id"
    plugged.symlink_to(port.path)
    numbered, number = port.path, os.path.realpath(port.path)
    port.path = str(plugged)
    first = link_to(port, str(tmp_path / "imu0"))
    await first.open()
    await first.close()

    port.path = numbered
    by_number = link_to(port, str(tmp_path / "imu0"))
    await by_number.open()
    assert by_number.holder_pid == first.holder_pid
    assert is_held(by_number.inner)
    await by_number.close()
    with pytest.raises(ShareError, match="another holder has this port"):
        Holder(holder_settings(by_number.inner, ())).run(lambda: None, print)

    other = DevicePort()
    port.unplug()
    plugged.unlink()
    plugged.symlink_to(other.path)
    # A link that is opened before the holder has met the end of the port is open to the former one.
    block_until(lambda: not os.path.lexists(port_link(number, first._holder_socket)), "the former number leads nowhere")
    await reopen(first)
    assert first.holder_pid == by_number.holder_pid, "the holder went on"
    assert Path(port_link(other.path, first._holder_socket)).exists()
    await first.request("end")
    await first.close()
    block_until(lambda: not os.path.lexists(port_link(other.path, first._holder_socket)), "the links are gone")
    other.unplug()


async def test_a_share_is_added_and_ended_while_the_port_is_read(port: DevicePort, tmp_path: Path) -> None:
    async with shared(port, str(tmp_path / "imu0")) as link:
        second = link_to(port, f"{tmp_path / 'imu1'}?mode=read").shares[0]
        await link.request("share", share=second.to_json())
        reader = opened(tmp_path / "imu1")
        await eventually(lambda: [one for one in clients(link) if one["share"].endswith("imu1")], link)
        port.send(FRAME)
        assert read_exactly(reader, len(FRAME)) == FRAME
        await link.request("unshare", name=second.text)
        assert not os.path.lexists(tmp_path / "imu1")
        assert os.path.lexists(tmp_path / "imu0")
        with pytest.raises(LinkError, match="is shared already"):
            await link.request("share", share=link.shares[0].to_json())
        os.close(reader)


@each_row(
    ("share", "words"),
    [
        ("{folder}/file", "exists and is not a link of a share"),
        ("{folder}/none/imu0", "there is no folder"),
        ("{folder}/imu0?group=nobody-of-that-name", "imu0 cannot be created: there is no group 'nobody-of-that-name'"),
        ("{folder}/imu0?owner=nobody-of-that-name", "imu0 cannot be created: there is no user 'nobody-of-that-name'"),
        ("/proc/imu0", "/proc/imu0 cannot be created: /proc takes no files; choose a folder such as /run/imuscope"),
        ("tcp://127.0.0.1:{taken}", "address already in use"),
    ],
)
def test_a_share_that_cannot_be_offered_gives_the_reason(tmp_path: Path, share: str, words: str) -> None:
    port = DevicePort()  # of this row alone
    (tmp_path / "file").write_text("mine")
    try:
        with socket.create_server(("127.0.0.1", 0)) as busy:
            address = share.format(folder=tmp_path, taken=busy.getsockname()[1])
            link = link_to(port, address)
            with pytest.raises(LinkError) as raised:
                asyncio.run(link.open())
        assert re.search(words, str(raised.value)), locks()
        assert raised.value.hint
        assert (tmp_path / "file").read_text() == "mine"
        assert not socket_of(port.path).exists(), "no holder stays behind"
    finally:
        port.unplug()


async def test_a_terminal_has_the_permissions_that_were_given(port: DevicePort, tmp_path: Path) -> None:
    async with shared(port, f"{tmp_path / 'imu0'}?permissions=0640&group={os.getgid()}"):
        about = os.stat(tmp_path / "imu0")
        assert about.st_mode & 0o777 == 0o640
        assert about.st_gid == os.getgid()


async def test_a_holder_that_was_killed_is_replaced(port: DevicePort, tmp_path: Path) -> None:
    link = link_to(port, str(tmp_path / "imu0"))
    await link.open()
    os.kill(link.holder_pid, signal.SIGKILL)
    with pytest.raises(LinkError, match="ended"):
        await received(link, 1)
    killed = link.holder_pid
    await reopen(link)
    assert link.holder_pid != killed
    driver = await joined(link, tmp_path / "imu0")
    port.send(FRAME)
    assert read_exactly(driver, len(FRAME)) == FRAME
    os.close(driver)
    await link.request("end")
    await link.close()


async def test_a_request_is_answered_though_the_end_of_its_holder_is_noticed_first(
    port: DevicePort, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Regression: on a busy host the last share of a port could not be ended: "The link is closed."."""
    link = link_to(port, str(tmp_path / "imu0"))
    await link.open()

    async def read_until_gone() -> None:
        with pytest.raises(LinkError, match="ended"):
            await received(link, 1 << 20)
        await link.close()

    async def write_and_delay(fd: int, data: bytes) -> None:
        """Delay the event loop just before the woken reader runs, which finds the answer and the end."""
        port.send(FRAME)
        block_until(lambda: link.backlog, "the bytes of the device")
        await asyncio.sleep(0)  # they wake the reader, which is next
        os.write(fd, data)
        assert link._reader is not None
        link._reader.join(PATIENCE_S)

    reading = asyncio.create_task(read_until_gone())
    await asyncio.sleep(0)  # it waits for bytes
    monkeypatch.setattr("imuscope.server.extensions.shares.shared_port_link.write_all", write_and_delay)
    await link.request("end")
    await reading


def test_a_runtime_folder_with_a_path_that_is_too_long_states_what_to_do(
    port: DevicePort, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / ("long" * 20)))
    with pytest.raises(OSError, match=r"has more than \d+ bytes; set XDG_RUNTIME_DIR to a shorter one"):
        socket_of(port.path)
