"""A simulated device is a serial port, or a TCP address, for any other program."""

from __future__ import annotations

import os
import socket
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import serial

from imuscope.protocols.events import Batch
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.xbus.decoder import XbusDecoder
from tests.support.each_row import each_row
from tests.support.server_process import begun, imuscope
from tests.support.timeouts import PATIENCE_S

GO_TO_CONFIG, REQUEST_ID = bytes.fromhex("faff3000d1"), bytes.fromhex("faff000001")


@contextmanager
def simulated(*words: str) -> Iterator[str]:
    """`imuscope simulate WORDS`, until the block ends; the line it printed."""
    process = begun("simulate", *words, apart=True)
    assert process.stdout is not None
    assert process.stderr is not None
    try:
        yield process.stdout.readline()
    finally:
        process.terminate()
        process.wait(PATIENCE_S)
        process.stdout.close()
        process.stderr.close()


class TcpClient:
    """Another program at the port."""

    def __init__(self, port: serial.Serial) -> None:
        self._port = port
        self._listing = PROTOCOLS["xbus"].frames.listing()

    def until(self, message: int, request: bytes = b"") -> None:
        """Send a request, and wait for a frame of this message id."""
        self._port.write(request)
        while True:
            data = self._port.read(max(1, self._port.in_waiting))
            assert data, f"no frame {message:#x} came"
            self._listing.feed(data)
            if any(line["id"] == message for line in self._listing.drain() if "reject" not in line):
                return


def test_another_program_opens_it_as_a_serial_port(tmp_path: Path) -> None:
    path = tmp_path / "imu0"
    with simulated("xbus?product=MTi-680G", "--pty", str(path), "--data", str(tmp_path)) as message:
        assert message.startswith(f"MTi-680G at {path} (/dev/pts/")
        assert stat.S_ISCHR(path.stat().st_mode)
        with serial.Serial(str(path), 115_200, timeout=PATIENCE_S) as port:
            client = TcpClient(port)
            client.until(0x36)
            client.until(0x31, GO_TO_CONFIG)
            client.until(0x01, REQUEST_ID)
    assert not path.is_symlink()


def test_a_program_gets_nothing_of_what_came_before_it(tmp_path: Path) -> None:
    """As at a real port, which has no memory of what nobody read: it would be taken for new, and end in a gap."""
    path = tmp_path / "imu0"
    with simulated("xbus?rate=400", "--pty", str(path), "--data", str(tmp_path)):
        newest = -100  # its first samples come after it has woken up
        for _ in range(3):
            time.sleep(0.2)  # more than a terminal holds
            decoder, numbers = XbusDecoder(), list[int]()
            port = os.open(path, os.O_RDWR | os.O_NOCTTY)
            while len(numbers) < 20:
                decoder.feed(os.read(port, 4096), 0)
                batches = [one for one in decoder.drain() if isinstance(one, Batch)]  # one for each layout
                numbers += sorted(number for one in batches for number in one.columns["PacketCounter"].tolist())
            time.sleep(0.05)  # some are left unread
            os.close(port)
            assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
            assert numbers[0] > newest + 20
            newest = numbers[-1]


def test_another_program_connects_by_tcp(tmp_path: Path) -> None:
    with simulated("isb", "--tcp", ":0", "--data", str(tmp_path)) as message:
        host, _, port = message.split("tcp://")[1].split(",")[0].rpartition(":")
        for _ in range(2):  # one that goes leaves the device to the next
            with socket.create_connection((host, int(port)), PATIENCE_S) as client:
                data = b""
                while data.count(b"\xef\x49") < 20:
                    data += client.recv(4096)


def test_a_file_in_its_place_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "precious"
    path.write_bytes(b"mine")
    done = imuscope("simulate", "xbus", "--pty", str(path), "--data", str(tmp_path))
    assert done.returncode == 1
    assert "is not a link to a port" in done.stderr
    assert path.read_bytes() == b"mine"


@each_row("device", ["xbus?product=MTi-9000", "gyro"])
def test_an_unknown_device_is_refused_in_a_line(tmp_path: Path, device: str) -> None:
    done = imuscope("simulate", device, "--pty", str(tmp_path / "x"), "--data", str(tmp_path))
    assert done.returncode == 1
    assert done.stderr.strip().splitlines()[-1].startswith("imuscope: ")
    assert "Traceback" not in done.stderr
    assert not os.path.lexists(tmp_path / "x")
