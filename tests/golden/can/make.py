"""Golden logs of an MTi on a CAN bus, written by python-can, cantools and can-utils.

    python -m venv venv && venv/bin/pip install python-can==4.6.1 cantools==45.1.0
    venv/bin/python make.py FOLDER_OF_CAN_UTILS

cantools encodes the values by the database below, which was written from the tables of MT1604P; python-can writes the
files of `candump -l` and ASC, and log2long and log2asc of can-utils (2020.11) those of candump on a terminal and an
ASC of their own. values.json has the values that were given to the encoder.
"""

from __future__ import annotations

import gzip
import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import can
import cantools

HERE = Path(__file__).parent
BEGIN = 1_767_225_600.0  # 2026-01-01
GROUPS, RATE = 200, 100
FRAME_S = 0.000_5
DATABASE = """VERSION ""
BU_: MTI
BO_ 5 SampleTime: 4 MTI
 SG_ ticks : 7|32@0+ (1,0) [0|0] "" MTI
BO_ 6 GroupCounter: 2 MTI
 SG_ count : 7|16@0+ (1,0) [0|0] "" MTI
BO_ 7 UtcTime: 8 MTI
 SG_ year : 7|8@0+ (1,0) [0|0] "" MTI
 SG_ month : 15|8@0+ (1,0) [0|0] "" MTI
 SG_ day : 23|8@0+ (1,0) [0|0] "" MTI
 SG_ hour : 31|8@0+ (1,0) [0|0] "" MTI
 SG_ minute : 39|8@0+ (1,0) [0|0] "" MTI
 SG_ second : 47|8@0+ (1,0) [0|0] "" MTI
 SG_ tenthms : 55|16@0+ (1,0) [0|0] "" MTI
BO_ 17 StatusWord: 4 MTI
 SG_ word : 7|32@0+ (1,0) [0|0] "" MTI
BO_ 33 Quaternion: 8 MTI
 SG_ q0 : 7|16@0- (3.05185094759972e-05,0) [0|0] "" MTI
 SG_ q1 : 23|16@0- (3.05185094759972e-05,0) [0|0] "" MTI
 SG_ q2 : 39|16@0- (3.05185094759972e-05,0) [0|0] "" MTI
 SG_ q3 : 55|16@0- (3.05185094759972e-05,0) [0|0] "" MTI
BO_ 34 EulerAngles: 6 MTI
 SG_ x : 7|16@0- (0.0078125,0) [0|0] "" MTI
 SG_ y : 23|16@0- (0.0078125,0) [0|0] "" MTI
 SG_ z : 39|16@0- (0.0078125,0) [0|0] "" MTI
BO_ 50 RateOfTurn: 6 MTI
 SG_ x : 7|16@0- (0.001953125,0) [0|0] "" MTI
 SG_ y : 23|16@0- (0.001953125,0) [0|0] "" MTI
 SG_ z : 39|16@0- (0.001953125,0) [0|0] "" MTI
BO_ 52 Acceleration: 6 MTI
 SG_ x : 7|16@0- (0.00390625,0) [0|0] "" MTI
 SG_ y : 23|16@0- (0.00390625,0) [0|0] "" MTI
 SG_ z : 39|16@0- (0.00390625,0) [0|0] "" MTI
BO_ 65 MagneticField: 6 MTI
 SG_ x : 7|16@0- (0.0009765625,0) [0|0] "" MTI
 SG_ y : 23|16@0- (0.0009765625,0) [0|0] "" MTI
 SG_ z : 39|16@0- (0.0009765625,0) [0|0] "" MTI
BO_ 81 Temperature: 2 MTI
 SG_ t : 7|16@0- (0.00390625,0) [0|0] "" MTI
BO_ 82 BaroPressure: 4 MTI
 SG_ p : 7|32@0+ (3.0517578125e-05,0) [0|0] "" MTI
BO_ 113 LatLon: 8 MTI
 SG_ lat : 7|32@0- (5.9604644775390625e-08,0) [0|0] "" MTI
 SG_ lon : 39|32@0- (1.1920928955078125e-07,0) [0|0] "" MTI
BO_ 114 AltitudeEllipsoid: 4 MTI
 SG_ h : 7|32@0- (3.0517578125e-05,0) [0|0] "" MTI
BO_ 118 VelocityXYZ: 6 MTI
 SG_ x : 7|16@0- (0.015625,0) [0|0] "" MTI
 SG_ y : 23|16@0- (0.015625,0) [0|0] "" MTI
 SG_ z : 39|16@0- (0.015625,0) [0|0] "" MTI
"""


def group(n: int) -> dict[str, dict[str, float]]:
    """The messages of one sample: fast ones in each, slow ones each tenth and each hundredth."""
    t, angle = n / RATE, 0.3 * math.sin(2 * math.pi * n / RATE)
    values = {
        "SampleTime": {"ticks": (2**32 - 5000 + 100 * n) % 2**32},  # it wraps after 0.5 s
        "GroupCounter": {"count": (65_500 + n) % 65_536},
        "StatusWord": {"word": 0x0080_0007},
        "Quaternion": {"q0": math.cos(angle / 2), "q1": 0.0, "q2": 0.0, "q3": math.sin(angle / 2)},
        "EulerAngles": {"x": 1.5, "y": -2.25, "z": math.degrees(angle)},
        "RateOfTurn": {"x": math.sin(4 * math.pi * t), "y": 0.0, "z": -0.25},
        "Acceleration": {"x": 0.01, "y": -0.02, "z": 9.81},
    }
    if n % 10 == 0:
        values |= {
            "MagneticField": {"x": 0.5, "y": -0.25, "z": 0.75},
            "LatLon": {"lat": 48.0 + n / 1e5, "lon": -11.5},
            "AltitudeEllipsoid": {"h": -3.5},
            "VelocityXYZ": {"x": 1.25, "y": -20.5, "z": 0.0},
        }
    if n % 100 == 0:
        values |= {
            "UtcTime": {"year": 26, "month": 1, "day": 1, "hour": 0, "minute": 0, "second": n // RATE, "tenthms": 0},
            "Temperature": {"t": -12.5},
            "BaroPressure": {"p": 101_325.25},
        }
    return values


def frames(database: cantools.database.Database, base: int = 0, *, extended: bool = False) -> list[can.Message]:
    """Frames of the device, and some of others."""
    made = []
    for n in range(GROUPS):
        time = BEGIN + n / RATE
        messages = [(database.get_message_by_name(name), values) for name, values in group(n).items()]
        for message, values in sorted(messages, key=lambda one: one[0].frame_id):
            data = message.encode(values, strict=False)
            made.append(can.Message(time, base + message.frame_id, is_extended_id=extended, data=data, channel="can0"))
            time += FRAME_S
        made.append(can.Message(time, 0x3A5, is_extended_id=False, data=bytes((n % 256, 1, 2)), channel="can0"))
        if n == 50:
            made.append(can.Message(time, 0x100, is_remote_frame=True, is_extended_id=False, dlc=4, channel="can0"))
            made.append(can.Message(time, 0x88, is_error_frame=True, data=bytes(8), channel="can0"))
    return made


def write(path: Path, messages: list[can.Message]) -> bytes:
    """A file of python-can."""
    writer = can.Logger(str(path))
    for one in messages:
        writer(one)
    writer.stop()
    return path.read_bytes()


def main() -> None:
    """Write all files."""
    tools = Path(sys.argv[1])
    database = cantools.database.load_string(DATABASE, "dbc")
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "mti.log"
        files = {"mti.log": write(log, frames(database))}
        files["mti.asc"] = write(Path(folder) / "mti.asc", frames(database))
        files["mti_29_bits.log"] = write(Path(folder) / "b.log", frames(database, 0x19FF_0000, extended=True))
        for name, command in (
            ("mti_terminal.txt", [tools / "log2long"]),
            ("mti_can_utils.asc", [tools / "log2asc", "-I", log, "can0"]),
        ):
            done = subprocess.run(command, input=files["mti.log"], stdout=subprocess.PIPE, check=True)
            files[name] = done.stdout
    for name, data in files.items():
        (HERE / f"{name}.gz").write_bytes(gzip.compress(data, mtime=0))
    (HERE / "values.json").write_text(json.dumps([group(n) for n in range(0, GROUPS, 20)]))


main()
