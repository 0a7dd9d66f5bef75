"""A day of a robot's driver on a shared port, at speed: it configures, logs, pauses and reconnects at random, while
recordings start and stop, pages open and the server is killed. Nothing reaches the device that the driver did not send.
"""

from __future__ import annotations

import os
import random
import select
import socket
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.events import Batch, RejectedFrame, Reply, SampleGap
from imuscope.protocols.xbus.decoder import XbusDecoder
from imuscope.protocols.xbus.driver import XbusDriver
from imuscope.protocols.xbus.frames import build
from imuscope.server.links.simulated_device import SimulatorOptions
from imuscope.server.links.simulated_line import LineFaults
from imuscope.server.links.simulator import SimulatorThread
from tests.fault_injection.busy_page import ListeningDevice, open_a_page, received_by, record
from tests.server.extensions.shares.shared_port import opened
from tests.support.free_ports import free_port
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until

pytestmark = pytest.mark.usefixtures("runtime")

GO_TO_CONFIG, GO_TO_MEASUREMENT, REQ_DID = build(0x30), build(0x10), build(0x00)


class BusyDriver(threading.Thread):
    """The robot's driver; it takes one random action after the other until it is stopped.

    Attributes:
        written: all that it has sent.
        faults: samples that it lacks while it measures, and damaged frames.
    """

    def __init__(self, path: Path, seed: int) -> None:
        super().__init__(daemon=True)
        self.written = b""
        self.faults: list[object] = []
        self.samples = self.configurations = self.connections = 0
        self._path = path
        self._random = random.Random(seed)
        self._stopped = threading.Event()
        self._fd, self._decoder = -1, XbusDecoder()

    def run(self) -> None:
        self._connect()
        while not self._stopped.is_set():
            action = self._random.choice((self._log, self._log, self._pause, self._configure, self._connect))
            action()
        os.close(self._fd)

    def stop(self) -> None:
        self._stopped.set()
        self.join(PATIENCE_S)
        assert not self.is_alive()

    def _connect(self) -> None:
        if self._fd >= 0:
            os.close(self._fd)
        self._fd, self._decoder = opened(self._path), XbusDecoder()
        self.connections += 1

    def _log(self) -> None:
        expected = self.samples + self._random.randrange(5, 30)
        self._read(lambda events: self.samples >= expected)

    def _pause(self) -> None:
        self._stopped.wait(self._random.uniform(0.0, 0.1))  # the terminal keeps half a second

    def _configure(self) -> None:
        self._send(GO_TO_CONFIG, "GoToConfigAck")
        self._pause()
        rate = self._random.choice((50, 100))
        outputs = [{"data_identifier": 0x1020, "output_frequency": 0xFFFF}]
        outputs += [{"data_identifier": one, "output_frequency": rate} for one in (0x2010, 0x4020)]
        frame = XbusDriver().frame("SetOutputConfiguration", {"outputs": outputs}, DeviceContext())
        self._send(frame, "SetOutputConfigurationAck")
        self._send(GO_TO_MEASUREMENT, "GoToMeasurementAck")
        self.configurations += 1

    def _send(self, frame: bytes, answer: str) -> None:
        os.write(self._fd, frame)
        self.written += frame
        self._read(lambda events: any(isinstance(one, Reply) and one.message.name == answer for one in events))

    def _read(self, is_done: object) -> None:
        assert callable(is_done)
        events: list[object] = []
        while not is_done(events) and not (self._stopped.is_set() and not events):
            if not select.select((self._fd,), (), (), 0.05)[0]:
                if self._stopped.is_set():
                    return
                continue
            self._decoder.feed(os.read(self._fd, 4096), 0)
            events = list(self._decoder.drain())
            self.samples += sum(len(one) for one in events if isinstance(one, Batch))
            self.faults += [one for one in events if isinstance(one, RejectedFrame | SampleGap)]


@pytest.fixture
def device() -> Iterator[SimulatorThread]:
    options = SimulatorOptions("xbus", faults=LineFaults(baud=115_200))
    thread = SimulatorThread(lambda start_ns: ListeningDevice(start_ns=start_ns, rate=100, measuring=True), options)
    thread.start()
    yield thread
    thread.stop()


@pytest.mark.parametrize(
    ("recordings", "kills"), [(12, 1), pytest.param(200, 5, marks=pytest.mark.slow)], ids=["an hour", "a day"]
)
def test_a_driver_alone_talks_to_its_device(
    device: SimulatorThread, tmp_path: Path, recordings: int, kills: int
) -> None:
    path, logging = tmp_path / "imu0", free_port()
    shares = ("--share", str(path), "--share", f"tcp://127.0.0.1:{logging}?mode=read")
    source = f"{device.slave}?baud=115200"
    driver = BusyDriver(path, seed=recordings)
    logger: socket.socket | None = None
    before = 0
    for run in range(kills + 1):
        more = ("--record",) if run else ()
        with ServerProcess(source, data=tmp_path / "data", arguments=(*shares, *more)) as server:
            if logger is None:
                block_until(path.exists, "the share")
                logger = socket.create_connection(("127.0.0.1", logging), PATIENCE_S)  # somebody is always there
                before = len(received_by(device))
                driver.start()
            since = driver.configurations, driver.connections
            for number in range(recordings // (kills + 1)):
                record(server)
                if number % 5 == 0:
                    open_a_page(server)
            block_until(partial(is_past, driver, since), "the driver is busy")
            server.process.kill()
            server.process.wait(PATIENCE_S)
    assert logger is not None
    driver.stop()
    block_until(lambda: len(received_by(device)) - before >= len(driver.written), "the last frames are at the device")
    logger.close()
    assert driver.faults == []
    received = received_by(device)[before:]
    pairs = enumerate(zip(received, driver.written, strict=False))
    same = next((at for at, (one, two) in pairs if one != two), len(received))
    assert received == driver.written, f"from byte {same} of {len(received)}: {received[same - 5 : same + 20].hex(' ')}"


def is_past(driver: BusyDriver, since: tuple[int, int]) -> bool:
    """Whether it has configured the device and connected again since."""
    return driver.configurations > since[0] and driver.connections > since[1]
