"""Benchmark of a shared port: what the holder adds to the time from the device to its driver, and what it costs.

    feed ── write, stamp ──> pty ──> holder ──> pty ──> driver, which reads without a pause
                                       └──────> a server's connection, which reads too

    python tests/bench/shared_port.py [--rate 2000] [--seconds 10] [--busy 5] [--save]

The yardsticks, in the same run on the same machine: socat between the same two terminals, and no program at all (the
driver reads the device's own terminal), i.e. what the kernel and this machine's scheduling alone cost. All three run
beside as many busy loops as `--busy` says.

Budget: p99 at most 1 ms added at 2 kHz; the holder at most 1.5 times the processor time of socat. Beside five busy
loops p99 is at most 1.5 times that without any program.
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import os
import select
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from imuscope.recordings.system.priority import raise_priority
from imuscope.server.extensions.shares.holder.settings import MODULE, HolderSettings
from imuscope.server.extensions.shares.holder.shares import ShareAddress
from imuscope.server.extensions.shares.relay_kernel import place
from tests.bench.support.report import options_of, report
from tests.support.processes import resident_mb, seconds_of
from tests.support.server_process import ROOT

SIZE = 60  # bytes of a frame
STAMP = struct.Struct("<q")


class Terminal:
    """A pseudo-terminal in place of the device's port."""

    def __init__(self) -> None:
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)


def feed(master: int, rate: float, count: int, *, busy: bool) -> None:
    """Write frames with the time of the write; beside busy loops, which delay no device, with a higher priority."""
    if busy:
        raise_priority()
    due = time.monotonic()
    for _ in range(count):
        due += 1 / rate
        time.sleep(max(0.0, due - time.monotonic()))
        os.write(master, STAMP.pack(time.monotonic_ns()) + bytes(SIZE - STAMP.size))


def measured(device: Terminal, driver: int, options: argparse.Namespace) -> list[float]:
    """Milliseconds from the write of a frame until the driver has read it, sorted."""
    delays: list[float] = []
    count = round(options.rate * options.seconds)
    feeding = multiprocessing.get_context("fork").Process(
        target=feed, args=(device.master, options.rate, count), kwargs={"busy": options.busy > 0}
    )
    feeding.start()
    data = b""
    while select.select((driver,), (), (), 0.2)[0] or feeding.is_alive():
        data += os.read(driver, 4096)
        now = time.monotonic_ns()
        while len(data) >= SIZE:
            delays.append((now - STAMP.unpack_from(data)[0]) / 1e6)
            data = data[SIZE:]
    feeding.join()
    return sorted(delays)


@contextlib.contextmanager
def held(terminal: str, folder: Path) -> Iterator[tuple[int, int]]:
    """The holder's process and a driver's descriptor; a server's connection reads along."""
    path = folder / "imu0"
    port = {"kind": "serial", "place": terminal, "baud": 2_000_000}
    settings = HolderSettings(port, str(folder / "holder.sock"), (ShareAddress.parse(str(path)),), True, place() or ())
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    subprocess.run([sys.executable, "-c", f"import {MODULE}.process"], cwd=ROOT, env=environment, check=True)
    process = subprocess.Popen(settings.command, cwd=ROOT, env=environment)  # with byte code, as it is installed
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as server, driven(process, path) as result:
        server.connect(settings.socket)
        threading.Thread(target=lambda: [None for _ in iter(lambda: server.recv(65_536), b"")], daemon=True).start()
        yield result


@contextlib.contextmanager
def relayed(terminal: str, folder: Path) -> Iterator[tuple[int, int]]:
    """Socat's process and a driver's descriptor."""
    path = folder / "socat"
    with driven(subprocess.Popen(["socat", f"{terminal},raw,echo=0", f"PTY,link={path},raw,echo=0"]), path) as result:
        yield result


@contextlib.contextmanager
def driven(process: subprocess.Popen[bytes], path: Path) -> Iterator[tuple[int, int]]:
    """A process that offers a terminal at the path, and the descriptor of a driver on it; both end with the block."""
    while not path.exists():
        time.sleep(0.01)
    driver = os.open(path, os.O_RDWR | os.O_NOCTTY)
    time.sleep(0.3)
    yield process.pid, driver
    os.close(driver)
    process.terminate()
    process.wait()


@contextlib.contextmanager
def beside(count: int) -> Iterator[None]:
    """So many busy loops, until the end of the block."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for one in loops:
            one.kill()
            one.wait()


def figures(device: Terminal, pid: int, driver: int, options: argparse.Namespace) -> dict[str, float]:
    """The figures of one relay between the device and the driver."""
    before, began = seconds_of(pid), time.monotonic()
    delays = measured(device, driver, options)
    share = (seconds_of(pid) - before) / (time.monotonic() - began)
    return {
        "lost": round(options.rate * options.seconds) - len(delays),
        "p50_ms": delays[len(delays) // 2],
        "p99_ms": delays[int(0.99 * len(delays))],
        "cpu_percent": 100 * share,
        "memory_mb": resident_mb(pid),
    }


def main() -> None:
    """The command line."""
    parser = options_of(__doc__.partition("\n")[0])
    parser.add_argument("--rate", type=float, default=2000.0)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--busy", type=int, default=0, help="busy loops beside it")
    options = parser.parse_args()
    results: dict[str, Any] = {"rate": options.rate, "busy": options.busy}
    with tempfile.TemporaryDirectory() as folder, beside(options.busy):
        device = Terminal()
        with held(device.path, Path(folder)) as (pid, driver):
            results |= figures(device, pid, driver, options)
        if shutil.which("socat"):
            with relayed(device.path, Path(folder)) as (pid, driver):
                results |= {f"socat_{name}": value for name, value in figures(device, pid, driver, options).items()}
        direct = measured(device, os.open(device.path, os.O_RDWR | os.O_NOCTTY), options)
        results["direct_p99_ms"] = direct[int(0.99 * len(direct))]
    results["p99_ratio"] = results["p99_ms"] / results["direct_p99_ms"]
    results["added_p99_ms"] = results["p99_ms"] - results["direct_p99_ms"]
    report("shared-port", results)


if __name__ == "__main__":
    main()
