"""Packets of an OXTS receiver in a folder, as in KITTI raw data: one table, with a row for each packet.

    oxts/timestamps.txt           2011-09-26 13:02:44.335092332, a line for each packet
    oxts/data/0000000000.txt      30 numbers: place, attitude, velocities, accelerations, rates, accuracy, states

A packet without a file has no row. The times name no zone, and are read as UTC.

Source: A. Geiger et al., "Vision meets robotics: the KITTI dataset", IJRR 32 (2013), and its dataformat.txt.
"""

import io
from pathlib import Path

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.readers.folders import PACKETS, TIMES
from imuscope.recordings.readers.formats.decompressing import UnpackedFolder
from imuscope.recordings.system.regular_file import open_regular
from imuscope.recordings.tables.options import TableOptions
from imuscope.recordings.tables.table_source import CsvSource

MAX_BYTES = 4096  # bytes of a packet
MAX_PACKETS = 1_000_000  # packets
COLUMNS = (
    "latitude (deg),longitude (deg),altitude (m),roll (rad),pitch (rad),yaw (rad),velocity north (m/s),"
    "velocity east (m/s),velocity forward (m/s),velocity left (m/s),velocity up (m/s),acceleration.x (m/s²),"
    "acceleration.y (m/s²),acceleration.z (m/s²),acceleration forward (m/s²),acceleration left (m/s²),"
    "acceleration up (m/s²),angular velocity.x (rad/s),angular velocity.y (rad/s),angular velocity.z (rad/s),"
    "angular velocity forward (rad/s),angular velocity left (rad/s),angular velocity up (rad/s),position accuracy (m),"
    "velocity accuracy (m/s),navigation status,satellites,position mode,velocity mode,orientation mode"
)


def open_oxts_folder(folder: Path, options: TableOptions) -> CsvSource:
    """The packets of a folder as a table.

    Raises:
        RecordingError: its files are not those of packets.
    """
    with open_regular(folder / TIMES) as file:
        lines = file.read(MAX_BYTES * MAX_PACKETS).decode(errors="replace").splitlines()
        times = [line.strip() for line in lines[:MAX_PACKETS]]
    rows = [f"{time},{packet}\n" for number, time in enumerate(times) if (packet := _packet(folder, number))]
    if not rows:
        hint = (
            f"Give the folder of a drive, with oxts/{TIMES} and a file of 30 numbers in oxts/{PACKETS} for each line."
        )
        raise RecordingError(f"{folder.name} holds no packets of an OXTS receiver.", hint)
    unpacked = UnpackedFolder(folder / TIMES)
    text = f"time,{COLUMNS}\n" + "".join(rows)
    return unpacked.source(lambda: CsvSource(unpacked.write("oxts.csv", io.BytesIO(text.encode())), options))


def _packet(folder: Path, number: int) -> str:
    """The numbers of a packet, separated by commas; "" without its file, or with another count of them."""
    try:
        with open_regular(folder / PACKETS / f"{number:010}.txt") as file:
            cells = file.read(MAX_BYTES).decode(errors="replace").split()
    except OSError:
        return ""
    return ",".join(cells) if len(cells) == COLUMNS.count(",") + 1 else ""
