"""Third-party host programs on a shared port, beside a server that shows, records and configures the same device.

simulated device ── pty ──> holder ──┬── imu0 (--share) ──> the host program, unchanged
└── server: page, recording, settings
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from imuscope.protocols.isb.client_frames import frame_size
from imuscope.recordings.importers.open_file import open_file
from tests.interop.hosts import MTDEVICE, remote_folder
from tests.interop.running import HERE, DiffersError, expect, owned, run, simulated
from tests.support.free_ports import free_port
from tests.support.recorder_harness import chunks
from tests.support.server_process import ServerProcess

LASTS_S = 60.0
MTDATA2 = bytes((0xFA, 0xFF, 0x36))


@dataclass(frozen=True, slots=True)
class SharedPort:
    """A device that a server has opened, and shares.

    Attributes:
        path: where host programs open it.
    """

    server: ServerProcess
    path: Path

    def request(self, method: str, path: str, body: Any = None) -> Any:
        """A request to the server's HTTP API."""
        data = None if body is None else json.dumps(body).encode()
        headers = {"content-type": "application/json"}
        request = urllib.request.Request(f"{self.server.url}/api{path}", data, headers, method=method)
        with urllib.request.urlopen(request, timeout=LASTS_S) as answer:
            return json.load(answer)

    def device(self) -> dict[str, Any]:
        """The device as the page has it."""
        result: dict[str, Any] = self.request("GET", "/devices")[0]
        return result

    def job(self, action: str, body: Any) -> None:
        """Carry out a job, as the page does.

        Raises:
            DiffersError: it failed.
        """
        number = self.request("POST", f"/devices/1/{action}", body)["id"]
        done: list[dict[str, Any]] = []

        def is_done() -> bool:
            done[:] = [one for one in self.request("GET", "/devices/1/jobs")["done"] if one["id"] == number]
            return bool(done)

        wait_for(is_done, f"the end of {action}")
        if done[0]["state"] != "done":
            raise DiffersError(f"the server's {action} failed: {done[0]['message']}")

    def recorded(self) -> tuple[bytes, bytes]:
        """Stop recording; the bytes from the device and to it in the file."""
        self.request("POST", "/recordings/stop", {})
        (path,) = (self.server.data / "recordings").glob("*.mcap")
        return chunks(path), chunks(path, "tx/1")


def wait_for(is_true: Callable[[], bool], what: str) -> None:
    """DiffersError: it is not true within a minute."""
    until = time.monotonic() + LASTS_S
    while not is_true():
        if time.monotonic() > until:
            raise DiffersError(f"{what} did not come within {LASTS_S:.0f} s")
        time.sleep(0.1)


@contextmanager
def shared(device: str, baud: int, scratch: Path, path: Path | str) -> Iterator[SharedPort]:
    """A simulated device, opened by a server that records it and shares its port at a path or an address."""
    runtime = scratch / "run"
    runtime.mkdir(mode=0o700)
    os.environ["XDG_RUNTIME_DIR"] = str(runtime)  # of the holder's socket
    arguments = ("--share", str(path), "--record")
    with (
        simulated(f"{device}&baud={baud}", scratch / "device") as port,
        ServerProcess(f"{port}?baud={baud}", data=scratch / "data", arguments=arguments, fresh=True) as server,
    ):
        here = SharedPort(server, Path(path))
        # The server asks a new device who it is. A program that scans the port meanwhile gives up: its bytes wait.
        wait_for(lambda: here.device()["status"] == "live", "a device that sends")
        if not here.device()["serial_number"]:  # one that measures is asked nothing of its own
            here.job("read", {})
        wait_for(lambda: bool(here.device()["serial_number"]) and here.device()["status"] == "live", "a known device")
        yield here


def contains_log(recorded: bytes, log: bytes, frames: Callable[[bytes], list[bytes]]) -> int:
    """Number of frames of a log that stand in a recording, one after the other, byte for byte.

    Raises:
        DiffersError: one is missing, or others stand between them.
    """
    ours, theirs = frames(recorded), frames(log)
    if not theirs:
        raise DiffersError("the log of the program holds no frames")
    known = set(ours)
    if lacking := [n for n, frame in enumerate(theirs) if frame not in known]:
        raise DiffersError(f"{len(lacking)} of {len(theirs)} frames of the log are not in our recording: {lacking[:9]}")
    starts = [n for n, frame in enumerate(ours) if frame == theirs[0]]
    equal = max(_equal_from(ours[start:], theirs) for start in starts)
    if equal < len(theirs):
        raise DiffersError(f"the log lacks frames of our recording before its frame {equal} of {len(theirs)}")
    return len(theirs)


def _equal_from(ours: list[bytes], theirs: list[bytes]) -> int:
    """Number of frames at the beginning that are equal."""
    return next((n for n, (a, b) in enumerate(zip(ours, theirs, strict=False)) if a != b), min(len(ours), len(theirs)))


def measurements(data: bytes) -> list[bytes]:
    """The MTData2 messages of a stream, or of a log."""
    result, at = [], 0
    while (at := data.find(MTDATA2, at)) >= 0:
        end = at + 5 + data[at + 3] if len(data) > at + 3 else len(data) + 1
        if end <= len(data) and not sum(data[at + 1 : end]) & 0xFF:
            result.append(data[at:end])
            at = end
        else:
            at += 1
    return result


def xda_shared(_: Path, scratch: Path) -> str:
    """Xsens' own library opens the shared port, configures and logs, while a server records and then configures."""
    program = owned("xda_host", "tests/interop/xda_host.cpp; see xda")
    path, log = scratch / "imu0", scratch / "log.mtb"
    with shared("xbus?product=MTi-630", 115_200, scratch, path) as here:
        printed = run([program, str(path), "115200", str(log)], scratch)
        expect(printed, "accelerations 200 or more")
        names = {
            one["text"] for one in here.request("GET", "/devices/1/traffic?limit=2000") if one["direction"] == "tx"
        }
        if not any("xda_host" in name for name in names):
            raise DiffersError(f"the traffic log does not name xda_host: {sorted(names)}")
        here.job("run", {"command": "GoToMeasurement", "values": {}})
        wait_for(lambda: here.device()["status"] == "live", "samples after the dialogue of the library")
        here.job("apply", {"changes": {"LocationID": {"location_id": 7}}})
        again = scratch / "again.mtb"
        expect(run([program, str(path), "115200", str(again)], scratch), "accelerations 200 or more")
        recorded, _ = here.recorded()
        count = [contains_log(recorded, one.read_bytes(), measurements) for one in (log, again)]
        (device,) = open_file(again).devices.values()
    return f"two logs, {count[0]} and {count[1]} messages, equal our recording ({device.identity.get('product', '')})"


def mtdevice_shared(folder: Path, scratch: Path) -> str:
    """The identity, outputs and measurements of an MTi-300 by mtdevice.py, twice, with a change of ours between."""
    source, path = MTDEVICE.fetched(folder) / "src", scratch / "imu0"
    host = [sys.executable, str(HERE / "mtdevice_host.py"), str(path), "115200"]
    outputs = "outputs [('0x1020', 65535), ('0x1060', 65535), ('0x4020', 100)]"
    with shared("xbus?product=MTi-300", 115_200, scratch, path) as here:
        for number in (7, 8):
            printed = run(host, scratch, {"PYTHONPATH": str(source), "PATH": "/usr/bin:/bin"})
            expect(printed, outputs, "accelerations 50")
            here.job("apply", {"changes": {"LocationID": {"location_id": number}}})
        if not measurements(here.recorded()[0]):
            raise DiffersError("our recording holds no measurements")
    return "two dialogues, each followed by a change of ours"


def xsens_go_shared(_: Path, scratch: Path) -> str:
    """Outputs and measurements of an MTi-630 by xsens-go."""
    program, path = owned("xsens", "the command cmd/xsens of einride/xsens-go (Go)"), scratch / "imu0"
    with shared("xbus?product=MTi-630", 115_200, scratch, path) as here:
        place = str(path.resolve())
        expect(run([program, "get-output-config", place], scratch), "Quaternion(EastNorthUp,Float32):")
        here.job("apply", {"changes": {"LocationID": {"location_id": 7}}})
        with subprocess.Popen([program, "read", place], stdout=subprocess.PIPE, text=True) as reading:
            assert reading.stdout is not None
            result = sum(line.strip() == "Acceleration" for line, _ in zip(reading.stdout, range(4000), strict=False))
            reading.terminate()
    if result < 100:
        raise DiffersError(f"{result} accelerations of 100 or more")
    return f"outputs read, {result} accelerations"


def packets(data: bytes) -> list[bytes]:
    """The ISB packets of a stream, or of a raw log."""
    result, at = [], 0
    while at < len(data):
        size = frame_size(data, at)
        if size > 0 and at + size <= len(data):
            result.append(data[at : at + size])
        at += max(1, size)
    return result


def cltool_shared(_: Path, scratch: Path) -> str:
    """A raw log of an IMX-5 by CLTool holds what a server beside it recorded."""
    program = owned("cltool", "CLTool of inertialsense/inertial-sense-sdk 2.7.1, with -DREMOTE_SOCAT_PORTS")
    return _cltool_log(program, remote_folder() / "imuscope", scratch)


def cltool_tcp_shared(_: Path, scratch: Path) -> str:
    """The same by an unchanged CLTool, which takes no path but an address."""
    program = owned("cltool", "CLTool of inertialsense/inertial-sense-sdk 2.7.1")
    return _cltool_log(program, f"tcp://127.0.0.1:{free_port()}", scratch)


def _cltool_log(program: str, place: Path | str, scratch: Path) -> str:
    with shared("isb?product=IMX-5", 921_600, scratch, place) as here:
        time.sleep(2)  # until the server, which has asked the device who it is, has left it the voice: CLTool gives up
        words = ["-c", str(place), "-baud=921600", "-did", "DID_INS_1", "DID_PIMU", "-lon", "-lt=raw", "-dur=10"]
        run([program, *words, "-lp", str(scratch / "log")], scratch)
        here.job("read", {})
        logs = sorted((scratch / "log").rglob("*.raw"))
        log = b"".join(one.read_bytes() for one in logs)
        recorded, sent = here.recorded()
        for request in set(packets(sent)):  # CLTool logs what it sends, too, wherever it has read up to
            log = log.replace(request, b"")
        count = contains_log(recorded, log, packets)
    return f"{count} packets equal our recording"
