"""Third-party host programs with simulated devices."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

from imuscope.recordings.importers.open_file import open_file
from tests.interop.running import HERE, Checkout, DiffersError, expect, owned, run, simulated

REMOTE = Path("/dev/remote")

MTDEVICE = Checkout("ethzasl", "https://github.com/ethz-asl/ethzasl_xsens_driver", "8abe90f3c55c")


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
    library = "xspublic of xsenssupport/Xsens_MTi_ROS_Driver_and_Ntrip_Client, built as that says"
    program = owned("xda_host", f"tests/interop/xda_host.cpp, compiled against {library}")
    for number, product in enumerate(("MTi-630", "MTi-680G", "MTi-3", "MTi-7", "MTi-300", "MTi-G-710")):
        log = scratch / f"{product}.mtb"
        with simulated(f"xbus?product={product}&baud=115200", scratch / f"imu{number}") as port:
            printed = run([program, port, "115200", str(log)], scratch)
        expect(printed, "accelerations 200 or more")
        (device,) = open_file(log).devices.values()
        report = next(line for line in printed.splitlines() if line.startswith("id ")).removeprefix("id ")
        print(f"    {product}: id {report}, log of {log.stat().st_size} bytes, {device.identity.get('product', '')}")
    return "six products scanned, configured, measured and logged"


def cltool(folder: Path, scratch: Path) -> str:
    """A log of an IMX-5 by CLTool holds what the simulator sent.

    CLTool opens ports that have a driver, and, with its option REMOTE_SOCAT_PORTS, those in /dev/remote.
    """
    program = owned("cltool", "CLTool of inertialsense/inertial-sense-sdk 2.7.1, with -DREMOTE_SOCAT_PORTS")
    with simulated("isb?baud=921600", remote_folder() / "imuscope") as port:
        words = ["-c", port, "-baud=921600", "-did", "DID_INS_1", "DID_PIMU", "-lon", "-lt=raw", "-dur=10"]
        run([program, *words, "-lp", str(scratch / "log")], scratch)
    logs = sorted((scratch / "log").rglob("*.raw"))
    if not logs or not any(log.stat().st_size > 10_000 for log in logs):
        raise DiffersError("CLTool wrote no log of the device")
    return f"{sum(log.stat().st_size for log in logs)} bytes logged"


def remote_folder() -> Path:
    """The folder that CLTool takes serial ports from.

    Raises:
        DiffersError: it cannot be made.
    """
    try:
        REMOTE.mkdir(exist_ok=True)
    except PermissionError:
        raise DiffersError(f"{REMOTE} cannot be made: run this as root, or make it and own it") from None
    return REMOTE


def xsens_go(folder: Path, scratch: Path) -> str:
    """Output configuration and measurements of an MTi-630 by the `xsens` command of einride/xsens-go."""
    program = owned("xsens", "the command cmd/xsens of the public repository einride/xsens-go (Go)")
    with simulated("xbus?product=MTi-630&baud=115200", scratch / "imu") as port:
        place = str(Path(port).resolve())
        report = run([program, "get-output-config", place], scratch)
        expect(report, "Quaternion(EastNorthUp,Float32):", "Acceleration(Float32):", "100 Hz")
        with subprocess.Popen([program, "read", place], stdout=subprocess.PIPE, text=True) as reading:
            assert reading.stdout is not None
            norms: list[float] = []
            until = time.monotonic() + 60
            for line in reading.stdout:
                if line.strip() == "Acceleration":
                    parts = next(reading.stdout).strip().removeprefix("&{").removesuffix("}").split()
                    norms.append(sum(float(part[2:]) ** 2 for part in parts) ** 0.5)
                if len(norms) == 200 or time.monotonic() > until:
                    break
            reading.terminate()
    if len(norms) < 200 or not all(7 < norm < 13 for norm in norms):
        raise DiffersError(f"{len(norms)} accelerations of 200, between {min(norms)} and {max(norms)} m/s²")
    return "outputs read, 200 accelerations"
