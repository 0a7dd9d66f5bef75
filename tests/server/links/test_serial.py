"""The serial link on real pseudo-terminals: bytes, arrival times, unplugging, refusals, clean-up."""

import asyncio
import errno
import os
import termios
import threading
import time
from pathlib import Path
from typing import Any

import pytest
import serial

from imuscope.server.links.base import LinkError
from imuscope.server.links.serial import SerialSettings, cannot_open, holder, latency_notices, lock_of, open_port
from imuscope.server.links.source_url import open_link
from imuscope.server.system.terminals import may_be_terminal
from tests.server.links.link_fixtures import (
    dies,
    fails,
    gather,
    joined,
    left_behind,
    opened,
    program_with,
    pty,
    settings,
)
from tests.support.each_row import each_row
from tests.support.timeouts import PATIENCE_S


async def test_bytes_arrive_whole_in_order_and_stamped() -> None:
    with pty() as port:
        link = open_link(f"serial://{port.path}?baud=921600", settings())
        async with opened(link):
            assert (link.kind, link.baud, link.capacity) == ("serial", 921_600, 92_160)
            before = time.time_ns()
            sent = bytes(range(256)) * 40
            writer = threading.Thread(target=lambda: [port.write(sent[i : i + 512]) for i in range(0, len(sent), 512)])
            writer.start()
            chunks = await gather(link, len(sent))
            writer.join()
            assert joined(chunks) == sent
            stamps = [chunk.arrival_ns for chunk in chunks]
            assert stamps == sorted(stamps)
            assert before - 1_000_000 <= stamps[0] <= stamps[-1] <= time.time_ns() + 1_000_000


async def test_timestamps_are_taken_in_the_reading_thread() -> None:
    with pty() as port:
        source = settings()
        async with opened(open_link(f"{port.path}?baud=115200", source)) as link:
            arrived = threading.Event()
            link.flow.arrivals.add(lambda chunks: arrived.set())
            before_ns = source.now_ns()
            port.write(b"a")
            assert arrived.wait(PATIENCE_S)  # the event loop is busy with this
            after_ns = source.now_ns()
            (chunk,) = await link.read()
            assert chunk.data == b"a"
            assert before_ns - 1_000_000 <= chunk.arrival_ns <= after_ns + 1_000_000


async def test_a_burst_is_one_wake_up() -> None:
    with pty() as port:
        async with opened(open_link(f"{port.path}?baud=115200", settings())) as link:
            results, attempts = b"", 0
            while results != b"x" * 1000:  # a busy machine may not have read all of it yet
                attempts += 1
                assert attempts < 10, len(results)
                for _ in range(50):
                    port.write(b"x" * 20)
                await asyncio.sleep(0.05 * attempts)
                results = joined(await link.read())
                if len(results) < 1000:
                    await gather(link, 1000 - len(results))


async def test_write_reaches_the_device() -> None:
    with pty() as port:
        async with opened(open_link(f"{port.path}?baud=115200", settings())) as link:
            await link.write(b"\xfa\xff\x30\x00\xd1")
            assert os.read(port.master, 100) == b"\xfa\xff\x30\x00\xd1"


async def test_an_unplugged_device_is_detected_after_its_last_bytes() -> None:
    with pty() as port:
        link = open_link(f"{port.path}?baud=115200", settings())
        async with opened(link):
            port.let_go()
            port.write(b"last words")
            assert joined(await gather(link, 10)) == b"last words"
            port.pull()
            error = await dies(link)
            assert error.kind == "gone"
            assert port.path in error.message
            assert (await fails(link.read())).kind == "gone"
            assert (await fails(link.write(b"x"))).kind == "gone"


async def test_opening_again_after_closing_and_closing_twice() -> None:
    with pty() as port:
        link = open_link(f"{port.path}?baud=115200", settings())
        for word in (b"one", b"two"):
            await link.open()
            port.write(word)
            assert joined(await gather(link, 3)) == word
            await link.close()
            await link.close()
        assert (await fails(link.read())).kind == "gone"


async def test_close_ends_a_read_that_waits() -> None:
    with pty() as port:
        link = open_link(f"{port.path}?baud=115200", settings())
        await link.open()
        reading = asyncio.create_task(fails(link.read()))
        await asyncio.sleep(0.01)
        await link.close()
        assert (await reading).kind == "gone"


async def test_no_threads_or_descriptors_are_left() -> None:
    with pty() as port:
        warm = open_link(f"{port.path}?baud=115200", settings())
        async with opened(warm):
            pass
        before = left_behind()
        for _ in range(5):
            link = open_link(f"{port.path}?baud=115200", settings())
            async with opened(link):
                port.write(b"x")
                await link.read()
            assert (await fails(open_link("/dev/no-such-port?baud=9600", settings()).open())).kind == "not-found"
        assert left_behind() == before


def test_a_missing_port_lists_the_available_ports() -> None:
    error = asyncio.run(fails(open_link("/dev/ttyNope?baud=9600", settings()).open()))
    assert error.kind == "not-found"
    assert "/dev/ttyNope" in error.message
    assert "plugged in" in error.hint


def test_a_path_that_is_not_a_port_is_refused() -> None:
    error = asyncio.run(fails(open_link("/dev/null?baud=9600", settings()).open()))
    assert error.kind == "refused"
    assert "not a serial port" in error.message


async def test_a_port_in_use_names_its_owner() -> None:
    with pty() as port:
        async with opened(open_link(f"{port.path}?baud=115200", settings())):
            error = await fails(open_link(f"{port.path}?baud=115200", settings()).open())
            assert error.kind == "busy"
            assert "this server" in error.message


@each_row("how", [("O_RDWR", "lock"), ("O_RDWR",), ("O_RDONLY",)])
async def test_a_port_of_another_program_states_how_both_can_use_it(how: tuple[str, ...]) -> None:
    """Regression: most drivers ask for no lock, and lost half of their bytes to a server that was started later."""
    with pty() as port, program_with(port.path, *how) as program:
        before = termios.tcgetattr(port._slave)
        error = await fails(open_link(f"{port.path}?baud=57600", settings()).open())
        assert error.kind == "busy"
        assert f"(process {program.pid})" in error.message
        assert f"imuscope serve {port.path} --share /run/imuscope/imu0" in error.hint
        assert termios.tcgetattr(port._slave) == before, "the other program's settings stay"


async def test_a_port_can_be_opened_beside_a_program_that_only_writes_to_it() -> None:
    with pty() as port, program_with(port.path, "O_WRONLY"):
        async with opened(open_link(f"{port.path}?baud=115200", settings())) as link:
            port.write(b"x")
            assert joined(await link.read()) == b"x"


@each_row("number", [errno.EACCES, errno.EPERM])
def test_missing_permission_names_the_group_and_the_command(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Root is never denied access, so the refusal comes from a port that refuses."""

    def refuse(*_: object, **__: object) -> None:
        raise serial.SerialException(number, "could not open port")

    monkeypatch.setattr(serial, "Serial", refuse)
    with pty() as port:
        os.chown(port.path, -1, 20)
        os.chmod(port.path, 0o660)
        error = asyncio.run(fails(open_link(port.path, settings()).open()))
    assert error.kind == "denied"
    assert port.path in error.message
    assert "dialout" in error.message
    assert "sudo usermod -aG dialout $USER" in error.hint


@each_row(("group", "mode"), [(0, 0o660), (20, 0o600)])
def test_a_group_without_write_permission_is_not_suggested(group: int, mode: int) -> None:
    """Regression: a port accessible to root alone was reported as belonging to dialout, and joining it did not help."""
    with pty() as port:
        os.chown(port.path, -1, group)
        os.chmod(port.path, mode)
        who, hint, join = lock_of(port.path)
    assert (who, join) == ("only its owner, root, may", "")
    assert f"sudo chgrp dialout {port.path}" in hint
    assert "usermod" not in hint


@each_row(
    ("failure", "kind"),
    [
        (OSError(errno.EBUSY, "busy"), "busy"),
        (serial.SerialException(errno.EAGAIN, "Could not exclusively lock port"), "busy"),
        (OSError(errno.ENODEV, "no device"), "not-found"),
        (OSError(errno.ENOTTY, "no tty"), "refused"),
        (ValueError("Not a valid baudrate"), "refused"),
        (serial.SerialException("Could not configure port"), "refused"),
    ],
)
def test_every_link_error_has_a_message_and_a_hint(failure: Exception, kind: str) -> None:
    error = cannot_open("/dev/ttyX", SerialSettings(baud=7), failure)
    assert error.kind == kind
    assert "/dev/ttyX" in error.message
    assert error.hint


def test_line_settings_reach_the_port() -> None:
    with pty() as port:
        opened_port = open_port(port.path, SerialSettings(baud=57_600, bits=7, parity="odd", stop=2, flow="xonxoff"))
        try:
            settings_there = (opened_port.baudrate, opened_port.bytesize, opened_port.parity, opened_port.stopbits)
            assert settings_there == (57_600, 7, "O", 2)
            assert opened_port.xonxoff
        finally:
            opened_port.close()


def test_a_free_port_has_no_owner() -> None:
    assert holder("/dev/ttyNope") == ""


@each_row(("text", "report"), [("16\n", True), ("2", True), ("1\n", False), ("odd", False), (None, False)])
def test_a_high_latency_timer_is_reported_with_its_fix(tmp_path: Path, text: str | None, report: bool) -> None:
    folder = tmp_path / "bus/usb-serial/devices/ttyUSB7"
    folder.mkdir(parents=True)
    if text is not None:
        (folder / "latency_timer").write_text(text)
    notices = latency_notices("/dev/ttyUSB7", tmp_path)
    assert len(notices) == report
    if report:
        assert f"up to {int(text or 0)} ms" in notices[0]
        assert "echo 1 | sudo tee" in notices[0]
        assert 'ATTR{latency_timer}="1"' in notices[0]


@each_row("name", ["zero", "null", "full", "a pipe", "a file"])
def test_a_device_that_is_no_terminal_is_not_even_opened(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = Path("/dev") / name if " " not in name else tmp_path / name
    if name == "a pipe":
        os.mkfifo(place)
    elif name == "a file":
        place.write_bytes(b"")
    used: list[str] = []
    open_one = os.open

    def noted(path: Any, *more: Any, **words: Any) -> int:
        used.append(str(path))
        return open_one(path, *more, **words)

    monkeypatch.setattr(os, "open", noted)
    with pytest.raises(LinkError, match=f"{place} is not a serial port") as refused:
        open_port(str(place), SerialSettings())
    assert refused.value.kind == "refused"
    assert str(place) not in used


def test_a_terminal_is_recognised_without_opening_it(tmp_path: Path) -> None:
    about = os.stat("/dev/null")
    folder = tmp_path / f"sys/dev/char/{os.major(about.st_rdev)}:{os.minor(about.st_rdev)}"
    assert may_be_terminal("/dev/null", tmp_path), "the system does not tell"
    folder.mkdir(parents=True)
    (folder / "subsystem").symlink_to("../../../../class/tty")
    assert may_be_terminal("/dev/null", tmp_path)
    (folder / "subsystem").unlink()
    (folder / "subsystem").symlink_to("../../../../class/watchdog")
    assert not may_be_terminal("/dev/null", tmp_path)
    assert may_be_terminal("/dev/nothing of that name", tmp_path)
