"""Other people's host programs against imuscope's simulators, one command each, for whoever wants to fetch them.

    python -m tests.interop.run mtdevice          ethzasl's mtdevice.py (Python)
    python -m tests.interop.run xda               Xsens' own library, xspublic of its ROS driver (make, g++)
    python -m tests.interop.run cltool            Inertial Sense's SDK and CLTool 2.7.1 (cmake, g++)
    python -m tests.interop.run mcap              the mcap command line 0.3.0 (cargo), on a recording of ours
    python -m tests.interop.run                   all of them

Each fetches a fixed version into --folder (or takes what lies there already), builds it, starts `imuscope simulate`,
runs the program unchanged, and compares what it printed with what must come out. Exit status 1 when one differs. A
program that cannot be fetched or built is told and fails too. Nothing of theirs is part of the project.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from recordings.importers import open_file

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).parent
STARTS_S = 600.0  # building one of them, on a small machine
LASTS_S = 300.0


class DiffersError(Exception):
    """What a program printed is not what must come out."""


@dataclass(frozen=True)
class Checkout:
    """A public repository at a fixed version."""

    name: str
    url: str
    version: str

    def fetched(self, folder: Path) -> Path:
        """Where it lies, fetched if it is not there yet."""
        place = folder / self.name
        if not place.exists():
            run(["git", "clone", "--quiet", self.url, str(place)], folder)
            run(["git", "checkout", "--quiet", self.version], place)
        return place


MTDEVICE = Checkout("ethzasl", "https://github.com/ethz-asl/ethzasl_xsens_driver", "master")
XDA = Checkout("xsens", "https://github.com/xsenssupport/Xsens_MTi_ROS_Driver_and_Ntrip_Client", "main")
SDK = Checkout("inertial-sense-sdk", "https://github.com/inertialsense/inertial-sense-sdk", "2.7.1")


def run(command: list[str], folder: Path, env: Mapping[str, str] | None = None, limit_s: float = LASTS_S) -> str:
    """Run a command; what it printed.

    Raises:
        DiffersError: it failed, or is not there.
    """
    try:
        done = subprocess.run(
            command, cwd=folder, env=env, capture_output=True, text=True, errors="replace", timeout=limit_s
        )
    except OSError as error:
        raise DiffersError(f"{command[0]} cannot be run: {error.strerror}") from None
    except subprocess.TimeoutExpired:
        raise DiffersError(f"{' '.join(command)} did not end within {limit_s:.0f} s") from None
    if done.returncode:
        tail = (done.stdout + done.stderr)[-1500:]
        raise DiffersError(f"{' '.join(command)} ended with {done.returncode}:\n{tail}")
    return done.stdout


@contextmanager
def simulated(device: str, path: Path) -> Iterator[str]:
    """A simulated device behind a serial port at `path`, as `imuscope simulate` offers it."""
    command = [sys.executable, "-m", "server.cli", "simulate", device, "--pty", str(path)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            said = process.stdout.readline()
            if not path.exists():
                raise DiffersError(f"the simulator did not start: {said}")
            yield str(path)
        finally:
            process.terminate()


def expect(printed: str, *lines: str) -> None:
    """DiffersError: one of these lines is not among those that were printed."""
    found = [line.strip() for line in printed.splitlines()]
    for line in lines:
        if line not in found:
            raise DiffersError(f"{line!r} was expected; printed was:\n{printed[-1500:]}")


def mtdevice(folder: Path, scratch: Path) -> str:
    """Identity, output configuration set and read back, 50 measurements of an MTi-300."""
    source = MTDEVICE.fetched(folder) / "src"
    with simulated("xbus?product=MTi-300&baud=115200", scratch / "imu") as port:
        host = [sys.executable, str(HERE / "mtdevice_host.py"), port, "115200"]
        printed = run(host, scratch, {"PYTHONPATH": str(source), "PATH": "/usr/bin:/bin"})
    outputs = "outputs [('0x1020', 65535), ('0x1060', 65535), ('0x4020', 100)]"
    expect(printed, outputs, "accelerations 50")
    return "identity, outputs set and read back, 50 measurements"


def xda(folder: Path, scratch: Path) -> str:
    """Scan, identity, outputs, measurement and a log by Xsens' own library, for each series of MTi."""
    library = XDA.fetched(folder) / "src/xsens_ros_mti_driver/lib/xspublic"
    if not (library / "xscontroller/libxscontroller.a").exists():
        run(["make", "-s"], library, limit_s=STARTS_S)
    program = scratch / "xda_host"
    names = ("xscontroller", "xscommon", "xstypes")
    objects = [str(library / name / f"lib{name}.a") for name in names]
    build = ["g++", "-std=c++11", f"-I{library}", str(HERE / "xda_host.cpp"), "-o", str(program), *objects]
    run([*build, "-lpthread", "-ldl"], scratch, limit_s=STARTS_S)
    for number, product in enumerate(("MTi-630", "MTi-680G", "MTi-3", "MTi-7", "MTi-300", "MTi-G-710")):
        log = scratch / f"{product}.mtb"
        with simulated(f"xbus?product={product}&baud=115200", scratch / f"imu{number}") as port:
            printed = run([str(program), port, "115200", str(log)], scratch)
        expect(printed, "accelerations 200 or more")
        (device,) = open_file(log).devices.values()
        told = next(line for line in printed.splitlines() if line.startswith("id ")).removeprefix("id ")
        print(f"    {product}: id {told}, log of {log.stat().st_size} bytes, {device.about.get('product', '')}")
    return "six products scanned, configured, measured and logged"


def cltool(folder: Path, scratch: Path) -> str:
    """A log of an IMX-5 by CLTool holds what the simulator sent."""
    source = SDK.fetched(folder) / "cltool"
    build = source / "build"
    if not (build / "cltool").exists():
        run(["cmake", "-S", str(source), "-B", str(build), "-DCMAKE_BUILD_TYPE=Release"], source, limit_s=STARTS_S)
        run(["cmake", "--build", str(build), "-j", "2"], source, limit_s=STARTS_S)
    with simulated("isb?baud=921600", scratch / "imx") as port:
        place = str(Path(port).resolve())  # it opens what the system calls the port, not a link to it
        words = ["-c", place, "-baud=921600", "-did", "DID_INS_1", "DID_PIMU", "-lon", "-lt=raw", "-dur=10"]
        run([str(build / "cltool"), *words, "-lp", str(scratch / "log")], scratch)
    logs = sorted((scratch / "log").rglob("*.raw"))
    if not logs or not any(log.stat().st_size > 10_000 for log in logs):
        raise DiffersError("CLTool wrote no log of the device")
    return f"{sum(log.stat().st_size for log in logs)} bytes logged"


def mcap(folder: Path, scratch: Path) -> str:
    """The mcap command line finds nothing wrong with a recording of ours, finished or cut off."""
    program = folder / "mcap-cli" / "bin" / "mcap"
    if not program.exists():
        run(["cargo", "install", "mcap-cli", "--root", str(folder / "mcap-cli")], folder, limit_s=STARTS_S)
    made = scratch / "a.mcap"
    record = ["record", "twin:xbus", "-o", str(made), "--duration", "3"]
    run([sys.executable, "-m", "server.cli", *record], ROOT)
    printed = run([str(program), "doctor", str(made)], scratch)
    return printed.strip().splitlines()[-1] if printed.strip() else "nothing wrong"


PROGRAMS: Mapping[str, Callable[[Path, Path], str]] = {
    "mtdevice": mtdevice,
    "xda": xda,
    "cltool": cltool,
    "mcap": mcap,
}


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Run other people's host programs against imuscope's simulators.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{', '.join(PROGRAMS)} (all when left out)")
    parser.add_argument("--folder", type=Path, default=ROOT / "artifacts" / "interop", help="where they are fetched")
    options = parser.parse_args()
    if unknown := set(options.names) - set(PROGRAMS):
        parser.error(f"{', '.join(sorted(unknown))}: not one of {', '.join(PROGRAMS)}")
    options.folder.mkdir(parents=True, exist_ok=True)
    failed = 0
    for name in options.names or PROGRAMS:
        with tempfile.TemporaryDirectory(prefix="imuscope-interop-") as scratch:
            try:
                print(f"ok     {name}: {PROGRAMS[name](options.folder.resolve(), Path(scratch))}", flush=True)
            except DiffersError as error:
                failed += 1
                print(f"FAILED {name}: {error}", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
