"""A port that is shared, for tests: a pseudo-terminal in place of the device's, and a link to its holder."""

from __future__ import annotations

import asyncio
import contextlib
import os
import select
import termios
import tty
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

from imuscope.server.extensions.shares.holder.shares import ShareAddress
from imuscope.server.extensions.shares.shared_port_link import SharedPortLink
from imuscope.server.links.base import LinkError, LinkSettings, steady_clock
from imuscope.server.links.serial import SerialLink
from imuscope.server.links.source_url import open_link
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import until


class DevicePort:
    """The device's end of a serial line, and the path of the port at this end."""

    def __init__(self) -> None:
        self._master, self._slave = os.openpty()
        self._open = [self._slave, self._master]
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        os.set_blocking(self._master, False)

    def send(self, data: bytes) -> None:
        """Bytes of the device."""
        view = memoryview(data)
        while view:
            try:
                view = view[os.write(self._master, view) :]
            except BlockingIOError:
                select.select((), (self._master,), (), PATIENCE_S)

    def receive(self, size: int) -> bytes:
        """The next bytes to the device."""
        return read_exactly(self._master, size)

    def is_quiet(self) -> bool:
        """Whether nothing has come for the device."""
        return not select.select((self._master,), (), (), 0)[0]

    def unplug(self) -> None:
        """End the port; its reader finds it gone. Idempotent."""
        while self._open:
            os.close(self._open.pop())


def read_exactly(fd: int, size: int) -> bytes:
    """`size` bytes, or what came within the patience of a test."""
    data = b""
    while len(data) < size and select.select((fd,), (), (), PATIENCE_S)[0]:
        try:
            data += os.read(fd, size - len(data))
        except OSError:
            break
    return data


def locks() -> str:
    """All file locks, with the commands of those that hold them: who has a port."""
    lines = []
    for line in Path("/proc/locks").read_text().splitlines():
        command = Path("/proc", line.split()[-4], "cmdline")
        with contextlib.suppress(OSError):
            line += " " + command.read_text(errors="replace").replace("\0", " ")[:200]
        lines.append(line)
    return "\n".join(lines)


def opened(path: Path) -> int:
    """A program's descriptor of a shared terminal."""
    return os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)


def write_and_close(path: Path, data: bytes) -> None:
    """A program that opens a shared terminal for one message."""
    program = opened(path)
    os.write(program, data)
    os.close(program)


def link_to(port: DevicePort, *shares: str) -> SharedPortLink:
    """A link to a port that is shared; closed."""
    settings = LinkSettings(now_ns=steady_clock())
    inner = open_link(f"{port.path}?baud=115200", settings)
    assert isinstance(inner, SerialLink)
    return SharedPortLink(inner, [ShareAddress.parse(one) for one in shares], settings)


@contextlib.asynccontextmanager
async def shared(port: DevicePort, *shares: str) -> AsyncIterator[SharedPortLink]:
    """An open link to a port that is shared; its holder ends with the block."""
    link = link_to(port, *shares)
    await link.open()
    try:
        yield link
    finally:
        with contextlib.suppress(LinkError):
            if not link.is_connected:
                await link.open()
            await link.request("end")
        await link.close()


@contextlib.asynccontextmanager
async def driven(port: DevicePort, path: Path, mode: str = "") -> AsyncIterator[tuple[SharedPortLink, int]]:
    """A port that is shared at a path, with a program on it until the block ends."""
    async with shared(port, f"{path}{mode}") as link:
        driver = await joined(link, path)
        yield link, driver
        os.close(driver)


async def joined(link: SharedPortLink, path: Path) -> int:
    """The descriptor of a program that has opened a shared terminal, which the holder has noticed."""
    driver = opened(path)
    await eventually(lambda: clients(link), link)
    return driver


def set_rate(terminal: int, rate: int) -> None:
    """Set a rate (a constant of termios), as a program does when it opens a port."""
    settings = termios.tcgetattr(terminal)
    settings[4] = settings[5] = rate
    termios.tcsetattr(terminal, termios.TCSANOW, settings)


async def received(link: SharedPortLink, size: int) -> bytes:
    """Bytes of the device, as the link gives them."""
    result = b""
    while len(result) < size:
        chunks = await asyncio.wait_for(link.read(), PATIENCE_S)
        result += b"".join(chunk.data for chunk in chunks)
    return result


async def eventually(condition: Callable[[], Any], link: SharedPortLink) -> Any:
    """What a condition gives when it is true; the link is read meanwhile by nobody."""
    results: list[Any] = [None]

    def check() -> Any:
        results[0] = condition()
        return results[0]

    try:
        await until(check, "what the link is to have come to")
    except AssertionError as error:
        error.add_note(str(link.state))
        raise
    return results[0]


def clients(link: SharedPortLink) -> list[dict[str, Any]]:
    return list(link.state["clients"])


def hung_up(fd: int) -> bool:
    poll = select.poll()
    poll.register(fd, select.POLLIN)
    return any(event & select.POLLHUP for _, event in poll.poll(0))
