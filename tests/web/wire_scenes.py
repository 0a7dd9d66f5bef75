"""Servers whose pages are recorded for component tests (tests/web/record_wire.py), beside one of each family.

attitude-…   a file of a device at a known attitude
secure       Secure frames without a key, which are rejected
unverified   Secure frames without a key, shown all the same
shared-link  three IDTP devices that send to one UDP port, one of them payloads of its vendor's own types
waiting      a device that nobody connects to, and one that is not there
two-senders  datagrams of two senders at one port
library      a library of one recording
recordings   two short recordings, to be opened
"""

import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from imuscope.protocols.idtp.frames import build as idtp_frame
from imuscope.protocols.idtp.simulator import IdtpSimulator
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.recordings.mcap.compaction import compact
from imuscope.recordings.mcap.writer import McapWriter
from tests.bench.support.serial_device import frame
from tests.support.faulty_line import FaultyLine
from tests.support.server_process import ServerProcess
from tests.web import known_attitude

TITLE, RATE, SECONDS, START = "Yard loop", 400, 8, 1_760_000_000_000_000_000


def free_port() -> int:
    """An unused UDP port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Sensors(threading.Thread):
    """Two IDTP devices that send to one UDP port, and a third that sends payloads of its vendor's own types."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self.port = port
        self.devices = {7: IdtpSimulator(device_id=7), 102: IdtpSimulator(device_id=102, mode=0, rate=50)}
        self.stopped = threading.Event()

    def run(self) -> None:
        began, k = time.monotonic_ns(), 0
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
            while not self.stopped.wait(0.02):
                now = time.monotonic_ns() - began
                for device in self.devices.values():
                    for part in device.advance(now).split(b"IDTP")[1:]:
                        link.sendto(b"IDTP" + part, ("127.0.0.1", self.port))
                k += 1
                payload = struct.pack("<hh", 1000 + k % 100, -250)
                stamp = now // 1000 & 0xFFFF_FFFF
                link.sendto(
                    idtp_frame(0x80, payload, sequence=k, timestamp=stamp, mode=1, device=9), ("127.0.0.1", self.port)
                )

    def stop(self) -> None:
        self.stopped.set()
        self.join()


def yard_loop(
    path: Path, title: str = TITLE, *, rate: int = RATE, seconds: int = SECONDS, start: int = START, seed: int = 1
) -> None:
    """A recording made by a server without delays: each chunk arrives when it was sent. Two devices, one of which loses
    frames, and a marker.
    """
    devices = {
        "1": FaultyLine(
            "xbus", XbusSimulator(start_ns=0, rate=rate, seed=seed, measuring=True, baud=921_600), drop=0.003, seed=seed
        ),
        "2": IsbSimulator(start_ns=0),
    }
    writer = McapWriter(path, {"title": title})
    for number, protocol in (("1", "xbus"), ("2", "isb")):
        writer.device(
            number, {"source": f"/dev/ttyUSB{number}", "link": "serial", "baud": 921_600, "protocol": protocol}
        )
    for step in range(1, seconds * 100):
        for number, device in devices.items():
            if sent := device.advance(step * 10_000_000):
                writer.chunk(number, "rx", sent, start + step * 10_000_000)
    writer.write_note("marker", "kerb", start + seconds * 500_000_000)
    writer.close()
    compact(path)


@contextmanager
def _attitude(folder: Path, name: str) -> Iterator[ServerProcess]:
    path = folder / f"{name}.bin"
    path.write_bytes(known_attitude.MAKERS[name]())
    with ServerProcess(f"{path}?loop=1", data=folder) as server:
        yield server


@contextmanager
def _shared_link(folder: Path) -> Iterator[ServerProcess]:
    port = free_port()
    with ServerProcess(f"udp://:{port}", data=folder) as server:
        sensors = Sensors(port)
        sensors.start()
        yield server
        sensors.stop()


@contextmanager
def _two_senders(folder: Path) -> Iterator[ServerProcess]:
    port, ended = free_port(), threading.Event()

    def send() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one, socket.socket(type=socket.SOCK_DGRAM) as other:
            index = 0
            while not ended.wait(0.01):
                for sender in (one, other):
                    sender.sendto(frame(index, 100.0), ("127.0.0.1", port))
                index += 1

    with ServerProcess(f"udp://127.0.0.1:{port}", data=folder) as server:
        thread = threading.Thread(target=send)
        thread.start()
        yield server
        ended.set()
        thread.join()


@contextmanager
def _library(folder: Path) -> Iterator[ServerProcess]:
    (folder / "recordings").mkdir()
    yard_loop(folder / "recordings" / "yard.mcap")
    with ServerProcess("udp://127.0.0.1:0", data=folder) as server:
        yield server


@contextmanager
def _recordings(folder: Path) -> Iterator[ServerProcess]:
    (folder / "recordings").mkdir()
    yard_loop(folder / "recordings" / "yard.mcap", rate=100, seconds=6)
    hour_later = START + 3600 * 1_000_000_000
    yard_loop(folder / "recordings" / "harbour.mcap", "Harbour", rate=100, seconds=4, start=hour_later, seed=2)
    with ServerProcess("udp://127.0.0.1:0", data=folder) as server:
        yield server


def _of(*sources: str) -> Callable[[Path], Iterator[ServerProcess]]:
    def serve(folder: Path) -> Iterator[ServerProcess]:
        with ServerProcess(*sources, data=folder) as server:
            yield server

    return serve


SCENES = {
    **{f"attitude-{name}": lambda folder, name=name: _attitude(folder, name) for name in known_attitude.MAKERS},
    "secure": contextmanager(_of("sim:idtp?mode=secure")),
    "unverified": contextmanager(_of("sim:idtp?mode=secure&unverified=1")),
    "shared-link": _shared_link,
    "waiting": contextmanager(_of("tcp-listen://127.0.0.1:0", "/dev/ttyNOTHERE")),
    "two-senders": _two_senders,
    "library": _library,
    "recordings": _recordings,
}
"""Name of a scene → its server, running."""
