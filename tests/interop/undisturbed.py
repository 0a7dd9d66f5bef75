"""A vendor's host program alone talks to its device, whatever is done on the page beside it.

    simulated device ── pty ──> holder ──┬── imu0 (--share) ── relay, which keeps what the program writes ── the program
      keeps what it is sent              └── server: recordings start and stop, pages open, it is killed and restarted

The program runs unchanged, again and again. What the device was sent is, byte for byte, what the program has written,
and its samples lack none.
"""

from __future__ import annotations

import os
import select
import socket
import sys
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType

from imuscope.protocols.events import Batch, RejectedFrame, SampleGap
from imuscope.protocols.xbus.decoder import XbusDecoder
from imuscope.server.links.simulated_device import SimulatorOptions
from imuscope.server.links.simulated_line import LineFaults
from imuscope.server.links.simulator import SimulatorThread
from tests.fault_injection.busy_page import ListeningDevice, open_a_page, received_by, record
from tests.interop.hosts import MTDEVICE
from tests.interop.running import HERE, DiffersError, expect, owned, run
from tests.interop.shared_port import LASTS_S, measurements, wait_for
from tests.server.extensions.shares.shared_port import opened
from tests.support.free_ports import free_port
from tests.support.server_process import ServerProcess

BAUD = 115_200
RUNS = 2  # of the server; it is killed after each
RECORDINGS = 8  # in each of them
CHECK_S = 0.05


class Relay(threading.Thread):
    """A pseudo-terminal before the share; a program opens it in place of the share.

    Attributes:
        path: where the program opens it.
        written: all that the program has written so far.
    """

    def __init__(self, share: Path) -> None:
        super().__init__(daemon=True)
        self.written = b""
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        self._share = opened(share)
        os.set_blocking(self._share, True)
        self._stopped = threading.Event()

    def run(self) -> None:
        other = {self._master: self._share, self._share: self._master}
        while not self._stopped.is_set():
            for fd in select.select(tuple(other), (), (), CHECK_S)[0]:
                data = os.read(fd, 4096)
                if fd == self._master:
                    self.written += data
                elif not select.select((), (self._master,), (), 0)[1]:
                    continue  # nobody reads it
                _write_all(other[fd], data)

    def __enter__(self) -> Relay:
        self.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        self._stopped.set()
        self.join()
        for fd in (self._master, self._slave, self._share):
            os.close(fd)


def _write_all(fd: int, data: bytes) -> None:
    view = memoryview(data)
    while view:
        view = view[os.write(fd, view) :]


@contextmanager
def _device(product: str) -> Iterator[SimulatorThread]:
    options = SimulatorOptions("xbus", faults=LineFaults(baud=BAUD))
    made = SimulatorThread(
        lambda start_ns: ListeningDevice(product=product, start_ns=start_ns, rate=100, measuring=True), options
    )
    made.start()
    try:
        yield made
    finally:
        made.stop()


def undisturbed(product: str, scratch: Path, host: Callable[[str, int], None]) -> str:
    """Run a host program beside a busy page; what it came to.

    Args:
        host: runs the program to its end, with the path of its port and a number, and checks its samples.

    Raises:
        DiffersError: the device was sent something else than the program has written, or the program failed.
    """
    runtime, share, logging = scratch / "run", scratch / "imu0", free_port()
    runtime.mkdir(mode=0o700)
    os.environ["XDG_RUNTIME_DIR"] = str(runtime)  # of the holder's socket
    shares = ("--share", str(share), "--share", f"tcp://127.0.0.1:{logging}?mode=read")
    written, before, runs = b"", 0, 0
    logger: socket.socket | None = None
    with _device(product) as device:
        for number in range(RUNS):
            arguments = (*shares, "--record") if number else shares
            source = f"{device.slave}?baud={BAUD}"
            with ServerProcess(source, data=scratch / "data", arguments=arguments, fresh=True) as server:
                if logger is None:
                    wait_for(share.exists, "the share")
                    logger = socket.create_connection(("127.0.0.1", logging), LASTS_S)  # somebody is always there
                    before = len(received_by(device))
                with Relay(share) as relay, _beside(lambda: host(relay.path, runs)) as has_ended:  # noqa: B023
                    runs += 1
                    done = 0
                    while done < RECORDINGS or not has_ended():
                        record(server)
                        open_a_page(server)
                        done += 1
                    server.process.kill()
                    server.process.wait(LASTS_S)
                    expected = len(written) + len(relay.written)
                    wait_for(lambda: len(received_by(device)) - before >= expected, "its last frames")  # noqa: B023
                written += relay.written
    assert logger is not None
    logger.close()
    received = received_by(device)[before:]
    if received != written:
        at = next((n for n, (a, b) in enumerate(zip(received, written, strict=False)) if a != b), len(written))
        raise DiffersError(
            f"the device was sent {len(received)} B, the program wrote {len(written)} B; they differ from byte {at}: "
            f"{received[at : at + 20].hex(' ')} in place of {written[at : at + 20].hex(' ')}"
        )
    return f"{runs} runs, {len(written)} B from the program, 0 B from anybody else, no gap"


@contextmanager
def _beside(work: Callable[[], None]) -> Iterator[Callable[[], bool]]:
    """Do work in a thread; whether it has ended. Its error is raised at the end of the block."""
    errors: list[BaseException] = []

    def run_it() -> None:
        try:
            work()
        except (DiffersError, OSError) as error:
            errors.append(error)

    thread = threading.Thread(target=run_it, daemon=True)
    thread.start()
    yield lambda: not thread.is_alive()
    thread.join()
    if errors:
        raise errors[0]


def xda_undisturbed(_: Path, scratch: Path) -> str:
    """Xsens' own library; no sample is missing in its logs."""
    program = owned("xda_host", "tests/interop/xda_host.cpp; see xda")

    def host(port: str, number: int) -> None:
        log = scratch / f"{number}.mtb"
        expect(run([program, port, str(BAUD), str(log)], scratch), "accelerations 200 or more")
        decoder = XbusDecoder()
        decoder.feed(b"".join(measurements(log.read_bytes())), 0)
        events = list(decoder.drain())
        faults = [one for one in events if isinstance(one, RejectedFrame | SampleGap)]
        samples = sum(len(one) for one in events if isinstance(one, Batch))
        if faults or samples < 200:
            raise DiffersError(f"{samples} samples in its log, with {len(faults)} faults: {faults[:2]}")

    return undisturbed("MTi-630", scratch, host)


def mtdevice_undisturbed(folder: Path, scratch: Path) -> str:
    """Ethzasl's mtdevice.py, whose measurements carry a counter."""
    source = MTDEVICE.fetched(folder) / "src"

    def host(port: str, number: int) -> None:
        words = [sys.executable, str(HERE / "mtdevice_host.py"), port, str(BAUD), "300"]
        expect(run(words, scratch, {"PYTHONPATH": str(source), "PATH": "/usr/bin:/bin"}), "accelerations 300", "gaps 0")

    return undisturbed("MTi-300", scratch, host)
