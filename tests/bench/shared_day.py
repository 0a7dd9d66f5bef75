"""A day of a shared port, accelerated: clients come, go, stall, flood and die while a driver reads every byte.

    device ── numbered frames ──> pty ──> holder ──┬── driver: reads all, compares every byte; sends numbered requests
                                                   ├── server's connection: comes and goes
                                                   └── others: read slowly, stop reading, flood, kill -9, hang up

    python tests/bench/shared_day.py [--rate 1000] [--minutes 5] [--save]

Fails if the driver misses a byte, a request of it does not arrive whole, the holder's memory or descriptors grow, or
the holder ends.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import select
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

from imuscope.server.extensions.shares.holder.messages import MessageKind, MessageReader
from imuscope.server.extensions.shares.holder.settings import HolderSettings
from imuscope.server.extensions.shares.holder.shares import ShareAddress
from tests.bench.shared_port import Terminal
from tests.bench.support.report import options_of, report
from tests.support.free_ports import free_port
from tests.support.processes import resident_mb, seconds_of
from tests.support.server_process import ROOT

FRAME = struct.Struct("<IQ48x")  # a mark, and a number
MARK = 0x5AA5C33C
REQUEST = struct.Struct("<4sI")
WARM_S = 20.0  # after which memory and descriptors must not grow
MOST_GROWTH_MB = 2.0

CLIENT = """
import socket, sys, time
connection = socket.create_connection(("127.0.0.1", int(sys.argv[1])))
how = sys.argv[2]
until = time.monotonic() + float(sys.argv[3])
connection.settimeout(1.0)
while time.monotonic() < until:
    try:
        if how == "stall":
            time.sleep(0.1)
        elif how == "flood":
            connection.sendall(b"F" * 4096)
        else:
            if not connection.recv(4096):
                break
            if how == "slow":
                time.sleep(0.05)
    except TimeoutError:
        pass
"""


class Device:
    """The device's end: sends numbered frames, and gathers what it is sent."""

    def __init__(self, terminal: Terminal, rate: float) -> None:
        self._terminal, self._rate = terminal, rate
        self.silent, self.ended = threading.Event(), threading.Event()
        self.sent = 0
        self.received = bytearray()
        self._threads = [threading.Thread(target=one) for one in (self._send, self._receive)]

    def start(self) -> None:
        for one in self._threads:
            one.start()

    def stop(self) -> None:
        self.silent.set()
        self.ended.set()
        for one in self._threads:
            one.join()

    def _send(self) -> None:
        due = time.monotonic()
        while not self.silent.is_set():
            due += 1 / self._rate
            time.sleep(max(0.0, due - time.monotonic()))
            view = memoryview(FRAME.pack(MARK, self.sent))
            while view:
                view = view[os.write(self._terminal.master, view) :]
            self.sent += 1

    def _receive(self) -> None:
        while not self.ended.is_set():
            if select.select((self._terminal.master,), (), (), 0.1)[0]:
                self.received += os.read(self._terminal.master, 4096)


class WellBehaved:
    """The robot's driver: reads without a pause, checks every byte, and asks something once in a while."""

    def __init__(self, path: Path) -> None:
        self.fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self.ended = threading.Event()
        self.is_requesting = True
        self.frames = self.requests = 0
        self.fault = ""
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        data, expected, next_request = b"", -1, time.monotonic()
        while not self.ended.is_set() and not self.fault:
            if select.select((self.fd,), (), (), 0.05)[0]:
                try:
                    data += os.read(self.fd, 1 << 16)
                except OSError as error:
                    self.fault = f"its port was gone: {error}"
                    return
            while len(data) >= FRAME.size:
                mark, number = FRAME.unpack_from(data)
                if mark != MARK or (expected >= 0 and number != expected):
                    self.fault = f"frame {number:#x} after {expected - 1}"
                    return
                expected, data = number + 1, data[FRAME.size :]
                self.frames += 1
            if self.is_requesting and time.monotonic() > next_request:
                try:
                    self.requests += os.write(self.fd, REQUEST.pack(b"\x00ASK", self.requests)) // REQUEST.size
                except BlockingIOError:
                    pass
                except OSError as error:
                    self.fault = f"its port was gone: {error}"
                next_request = time.monotonic() + 0.2

    def stop(self) -> None:
        self.ended.set()
        self._thread.join()
        os.close(self.fd)


def trouble(
    ports: tuple[int, int], socket_path: str, ended: threading.Event, observed: Counter[str], seed: int
) -> None:
    """Clients that come, go, stall, flood and die, and a server that comes and goes, until the end.

    Args:
        ports: of most of them, and of those that flood, so that one of these may write.
    """
    chance = random.Random(seed)
    running: list[subprocess.Popen[bytes]] = []
    server: socket.socket | None = None
    while not ended.is_set():
        how = chance.choice(("read", "slow", "stall", "flood", "kill", "server", "reset"))
        observed[how] += 1
        if how == "kill" and running:
            chance.choice(running).send_signal(signal.SIGKILL)
        elif how == "server":
            if server is not None:
                server.close()
            server = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            server.connect(socket_path)
            threading.Thread(target=_drain, args=(server,), daemon=True).start()
        elif how == "reset":
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", ports[0]), 5) as one:
                one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                one.sendall(b"R" * 64)
        elif how != "kill" and len(running) < 8:
            port = ports[how == "flood"]
            words = [sys.executable, "-S", "-c", CLIENT, str(port), how, str(chance.uniform(1, 8))]
            running.append(subprocess.Popen(words, stderr=subprocess.DEVNULL))
        running = [one for one in running if one.poll() is None]
        ended.wait(chance.uniform(0.05, 0.5))
    for program in running:
        program.kill()
        program.wait()
    if server is not None:
        server.close()


def _drain(server: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while server.recv(1 << 16):
            pass


def refused(socket_path: str) -> int:
    """Bytes of the driver that the holder refused."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as server:
        server.connect(socket_path)
        reader = MessageReader()
        while data := server.recv(1 << 16):
            for kind, body in reader.feed(data):
                if kind == MessageKind.STATE:
                    return sum(int(one["refused"]) for one in json.loads(body)["clients"] if one["terminal"])
    return 0


def descriptors(pid: int) -> int:
    return len(os.listdir(f"/proc/{pid}/fd"))


def main() -> int:
    """The command line; exit status 1 if something was lost or has grown."""
    parser = options_of(__doc__.partition("\n")[0])
    parser.add_argument("--rate", type=float, default=1000.0)
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    counts: Counter[str] = Counter()
    faults: list[str] = []
    with tempfile.TemporaryDirectory() as text:
        folder, numbers, terminal = Path(text), (free_port(), free_port()), Terminal()
        path = folder / "imu0"
        shares = [ShareAddress.parse(one) for one in (str(path), *(f"tcp://127.0.0.1:{one}" for one in numbers))]
        port = {"kind": "serial", "place": terminal.path, "baud": 921_600}
        settings = HolderSettings(port, str(folder / "holder.sock"), tuple(shares), stay=True)
        holder = subprocess.Popen(settings.command, cwd=ROOT)
        while not path.exists():
            time.sleep(0.01)
        device, driver = Device(terminal, options.rate), WellBehaved(path)
        time.sleep(0.2)
        first_fds = descriptors(holder.pid)
        device.start()
        ended = threading.Event()
        others = threading.Thread(target=trouble, args=(numbers, settings.socket, ended, counts, options.seed))
        others.start()
        began, cpu = time.monotonic(), seconds_of(holder.pid)
        time.sleep(WARM_S)
        memory, most_fds = resident_mb(holder.pid), 0
        while time.monotonic() - began < options.minutes * 60 and not driver.fault and holder.poll() is None:
            time.sleep(1.0)
            most_fds = max(most_fds, descriptors(holder.pid))
        ended.set()
        others.join()
        elapsed = time.monotonic() - began
        cpu_percent = 100 * (seconds_of(holder.pid) - cpu) / elapsed
        device.silent.set()
        driver.is_requesting = False
        time.sleep(15.0)  # what is on its way arrives, and those who left are forgotten
        device.stop()
        last_memory, last_fds = resident_mb(holder.pid), descriptors(holder.pid)
        refused_bytes = refused(settings.socket)
        driver.stop()
        request = bytes(device.received).count(b"\x00ASK")
        if driver.fault:
            faults.append(f"the driver: {driver.fault}")
        if driver.frames != device.sent:
            faults.append(f"the driver got {driver.frames} of {device.sent} frames")
        if request != driver.requests:
            faults.append(f"{request} of {driver.requests} requests arrived")
        if last_fds > first_fds:
            faults.append(f"descriptors grew from {first_fds} to {last_fds}")
        if last_memory - memory > MOST_GROWTH_MB:
            faults.append(f"memory grew from {memory:.1f} to {last_memory:.1f} MB")
        if holder.poll() is not None:
            faults.append(f"the holder ended with {holder.returncode}")
        else:
            holder.terminate()
            holder.wait()
    figures = {
        "rate": options.rate,
        "seconds": round(elapsed, 1),
        "frames": driver.frames,
        "lost": device.sent - driver.frames,
        "requests": driver.requests,
        "lost_requests": driver.requests - request,
        "refused_request_bytes": refused_bytes,
        "flooded_bytes": bytes(device.received).count(b"F"),
        "memory_mb": memory,
        "memory_growth_mb": last_memory - memory,
        "descriptors": last_fds,
        "most_descriptors": most_fds,
        "cpu_percent": cpu_percent,
        "events": dict(counts),
        "faults": faults,
    }
    report("shared-day", figures)
    return 1 if faults else 0


if __name__ == "__main__":
    raise SystemExit(main())
