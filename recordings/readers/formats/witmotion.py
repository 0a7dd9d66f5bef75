"""Binary logs of WitMotion sensors: frames of 11 bytes, read as one table with a row for each cycle of them.

    0x55  type  8 bytes  sum of the 10 bytes before

    0x50  date and time of day, ms        0x53  angles, 180° / 32768           0x56  Pa (i32), cm (i32)
    0x51  acceleration, 16 g / 32768      0x54  magnetic field, counts         0x59  quaternion, w first, 1 / 32768
    0x52  angular velocity, 2000 °/s / 32768

Sensors with Bluetooth 5.0 have frames of 20 bytes without a sum, one for each sample:

    0x55  0x61  acceleration, angular velocity, angles as above, 18 bytes     0x55  0x71  answers, left out

A cycle begins with the type that the first frame has; with 0x50, if there is one. Without 0x50 the rows have no time,
and their rate has to be given. The last two bytes of most types are a temperature or a voltage, by a formula of the
model: they are left out, as are other types.

Source: https://docs.wit-motion.com/guides/high-precision/hwt905-ttl/protocol (Output Data Format), and the same
formulas in the data sheets of WT901 and BWT61CL; WT901BLE5.0 Communication Protocol.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Array
from imuscope.protocols.clocks.dates import UNKNOWN, utc_ns
from imuscope.protocols.schema.plural import counted
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.readers.formats.array_columns import columns_of
from imuscope.recordings.readers.formats.arrow_table import ArrowSource
from imuscope.recordings.readers.registry import HEAD_BYTES, FileReader, OpenRequest, register_reader
from imuscope.recordings.system.regular_file import open_regular

MARK, LENGTH, SUM = 0x55, 11, 10
CLOCK = 0x50
BLUETOOTH_LENGTH, SAMPLE, ANSWER = 20, 0x61, 0x71
FEWEST_FRAMES = 8  # at the begin of a file
MAX_FILE_BYTES = 1 << 28
FULL_SCALE = 32_768.0


@dataclass(frozen=True, slots=True)
class FrameType:
    """Numbers of a type of frame.

    Args:
        names, unit: headings of the columns.
        dtype: of its numbers.
        factor: value of one count.
    """

    names: tuple[str, ...]
    unit: str
    factor: float
    dtype: str = "<i2"


XYZ = ("x", "y", "z")
TYPES: Mapping[int, FrameType] = {
    0x51: FrameType(tuple(f"Acceleration.{axis}" for axis in XYZ), "g", 16 / FULL_SCALE),
    0x52: FrameType(tuple(f"Angular velocity.{axis}" for axis in XYZ), "deg/s", 2000 / FULL_SCALE),
    0x53: FrameType(("Roll", "Pitch", "Yaw"), "deg", 180 / FULL_SCALE),
    0x54: FrameType(tuple(f"Magnetic field.{axis}" for axis in XYZ), "", 1.0),
    0x56: FrameType(("Pressure", "Height"), "", 1.0, "<i4"),
    0x59: FrameType(tuple(f"Quaternion.{axis}" for axis in ("w", *XYZ)), "", 1 / FULL_SCALE),
}
UNITS = {"Pressure": "Pa", "Height": "cm"}


def _frames(data: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The whole frames: (n, 11)."""
    if len(data) < LENGTH:
        return np.empty((0, LENGTH), np.uint8)
    windows = np.lib.stride_tricks.sliding_window_view(data, LENGTH)
    starts = np.flatnonzero((windows[:, 0] == MARK) & (windows[:, 1] >> 4 == MARK >> 4))
    matches = windows[starts]
    starts = starts[matches[:, :SUM].sum(1, dtype=np.uint64).astype(np.uint8) == matches[:, SUM]]
    return np.asarray(windows[_apart(starts, LENGTH)])


def _bluetooth_frames(data: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The frames of 20 bytes, (n, 20): those that begin where another one ends, or are followed by one."""
    if len(data) < BLUETOOTH_LENGTH:
        return np.empty((0, BLUETOOTH_LENGTH), np.uint8)
    windows = np.lib.stride_tricks.sliding_window_view(data, BLUETOOTH_LENGTH)
    is_mark = (windows[:, 0] == MARK) & ((windows[:, 1] == SAMPLE) | (windows[:, 1] == ANSWER))
    starts = np.flatnonzero(is_mark)
    beside = np.isin(starts + BLUETOOTH_LENGTH, starts) | np.isin(starts - BLUETOOTH_LENGTH, starts)
    return np.asarray(windows[_apart(starts[beside], BLUETOOTH_LENGTH)])


def _apart(starts: NDArray[np.int64], length: int) -> list[int]:
    """Starts of frames, without those inside of another one, which are there by chance."""
    whole, end = [], 0
    for start in starts.tolist():
        if start >= end:
            whole.append(start)
            end = start + length
    return whole


def is_bluetooth(head: bytes) -> bool:
    """Whether the first bytes of a file are frames of 20 bytes without a gap, but for the one in which it begins."""
    for offset in range(min(BLUETOOTH_LENGTH, len(head))):
        data = np.frombuffer(head[offset : offset + FEWEST_FRAMES * BLUETOOTH_LENGTH], np.uint8)
        if data[0] == MARK and len(_bluetooth_frames(data)) == FEWEST_FRAMES:
            return True
    return False


def is_witmotion(head: bytes) -> bool:
    """Whether the first bytes of a file are frames without a gap, but for the one in which it begins."""
    if is_bluetooth(head):
        return True
    for offset in range(LENGTH):
        data = np.frombuffer(head[offset : offset + FEWEST_FRAMES * LENGTH], np.uint8)
        if head[offset : offset + 1] == bytes([MARK]) and len(_frames(data)) == FEWEST_FRAMES:
            return True
    return False


def _open(request: OpenRequest) -> ArrowSource:
    path = request.path
    size = path.stat().st_size
    if size > MAX_FILE_BYTES:
        raise RecordingError(f"{path.name} is too large for a log of WitMotion.", "Give a part of it.")
    with open_regular(path) as file:
        data = np.frombuffer(file.read(), np.uint8)
    if is_bluetooth(data[:HEAD_BYTES].tobytes()):
        frames = _bluetooth_frames(data)
        arrays, units, left_out = _samples(frames)
    else:
        frames = _frames(data)
        arrays, units, left_out = _table(path, frames)
    lost = len(data) - frames.size
    if lost >= frames.shape[1]:
        left_out.append(f"{counted(lost, 'byte is', 'bytes are')} in no whole frame, and left out.")
    return ArrowSource(path, columns_of(path.name, arrays, left_out, units), "witmotion", request.table)


def _samples(frames: NDArray[np.uint8]) -> tuple[dict[str, Array], dict[str, str], list[str]]:
    """Columns of frames of 20 bytes, their units, and a sentence on frames that are left out."""
    is_sample = frames[:, 1] == SAMPLE
    answers = len(frames) - int(is_sample.sum())
    left_out = [f"{counted(answers, 'answer is', 'answers are')} left out."] if answers else []
    values = np.ascontiguousarray(frames[is_sample, 2:]).view("<i2")
    arrays: dict[str, Array] = {}
    units: dict[str, str] = {}
    for place, number in enumerate((0x51, 0x52, 0x53)):
        of = TYPES[number]
        for column, name in enumerate(of.names):
            arrays[name] = values[:, 3 * place + column] * of.factor
            units[name] = of.unit
    return arrays, units, left_out


def _table(path: Path, frames: NDArray[np.uint8]) -> tuple[dict[str, Array], dict[str, str], list[str]]:
    """Columns, their units, and sentences on frames that are left out."""
    types = frames[:, 1]
    there = np.unique(types).tolist()
    leader = CLOCK if CLOCK in there else int(types[0])
    row = np.cumsum(types == leader) - 1
    rows = int(row[-1]) + 1
    others = [f"0x{one:02X}" for one in there if one not in TYPES and one != CLOCK]
    left_out = [f"Frames of the types {', '.join(others)} are left out."] if others else []
    arrays: dict[str, Array] = {}
    units: dict[str, str] = {}
    if leader == CLOCK:
        arrays["time"] = _times(frames[types == CLOCK, 2:SUM])
    for number, of in TYPES.items():
        is_type = (types == number) & (row >= 0)
        if not is_type.any():
            continue
        values = np.ascontiguousarray(frames[is_type, 2:SUM]).view(of.dtype) * of.factor
        for column, name in enumerate(of.names):
            numbers = np.full(rows, np.nan)
            numbers[row[is_type]] = values[:, column]
            arrays[name] = numbers
            units[name] = UNITS.get(name, of.unit)
    if rows < 2 or not arrays:
        raise RecordingError(f"{path.name} has no frames of WitMotion with numbers.", "Give a log of its samples.")
    return arrays, units, left_out


def _times(bodies: NDArray[np.uint8]) -> Array:
    """Dates of frames of the type 0x50: year since 2000, month, day, hour, minute, second, ms (u16)."""
    year, month, day, hour, minute, second = bodies[:, :6].astype(np.int64).T
    ms = np.ascontiguousarray(bodies[:, 6:8]).view("<u2")[:, 0].astype(np.int64)
    ns = utc_ns(2000 + year, month, day, hour, minute, second, ms * 10**6, np.ones(len(bodies), np.bool_))
    dates: Array = np.where(ns == UNKNOWN, np.datetime64("NaT", "ns"), ns.view("M8[ns]"))
    return dates


register_reader(FileReader("witmotion", "WitMotion", (), _open, recognises=is_witmotion, order=70))
