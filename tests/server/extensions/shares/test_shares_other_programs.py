"""Clients of a shared port that nobody here wrote: socat and pyserial's miniterm."""

import asyncio
import contextlib
import os
import pty
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from imuscope.protocols.xbus.frames import build
from tests.server.extensions.shares.shared_port import DevicePort, clients, eventually, read_exactly, received, shared
from tests.support.timeouts import PATIENCE_S

pytestmark = pytest.mark.usefixtures("runtime")
REQUEST = build(0x00)
STREAM = b"".join(build(0x36, bytes([number % 256, number // 256])) for number in range(2000))


def log_of(path: Path) -> bytes:
    return path.read_bytes() if path.exists() else b""


@pytest.mark.skipif(shutil.which("socat") is None, reason="socat is not installed")
async def test_the_log_of_socat_is_what_the_device_sent(port: DevicePort, tmp_path: Path) -> None:
    async with shared(port, str(tmp_path / "imu0")) as link:
        log, commands = tmp_path / "log", tmp_path / "commands"
        commands.write_bytes(REQUEST)
        words = [f"{tmp_path / 'imu0'},raw,echo=0", f"OPEN:{commands},rdonly!!CREATE:{log}"]
        with subprocess.Popen(["socat", "-t", "60", *words]) as program:
            try:
                await eventually(lambda: clients(link), link)
                assert await asyncio.to_thread(port.receive, len(REQUEST)) == REQUEST
                await asyncio.to_thread(port.send, STREAM)
                assert await received(link, len(STREAM)) == STREAM
                await eventually(lambda: len(log_of(log)) >= len(STREAM), link)
                assert log_of(log) == STREAM
            finally:
                program.terminate()
        await eventually(lambda: not clients(link), link)


async def test_miniterm_shows_what_the_device_sends_and_sends_what_is_typed(port: DevicePort, tmp_path: Path) -> None:
    async with shared(port, str(tmp_path / "imu0")) as link:
        keyboard, terminal = pty.openpty()
        words = ["-m", "serial.tools.miniterm", "--raw", "--quiet", str(tmp_path / "imu0"), "57600"]
        with subprocess.Popen([sys.executable, *words], stdin=terminal, stdout=terminal, stderr=terminal) as program:
            os.close(terminal)
            try:
                await eventually(lambda: clients(link) and clients(link)[0]["baud"] == 57_600, link)
                assert link.baud == 115_200, "the rate that it sets when it opens the port changes nothing"
                port.send(b"hello from the device")
                shown = await asyncio.to_thread(read_exactly, keyboard, 21)
                assert shown == b"hello from the device"
                os.write(keyboard, b"version?")
                assert await asyncio.to_thread(port.receive, 8) == b"version?"
                os.write(keyboard, b"\x1d")  # Ctrl ]: it ends
                assert await asyncio.to_thread(program.wait, PATIENCE_S) == 0
            finally:
                with contextlib.suppress(ProcessLookupError):
                    program.send_signal(signal.SIGKILL)
                os.close(keyboard)
        await eventually(lambda: not clients(link), link)
