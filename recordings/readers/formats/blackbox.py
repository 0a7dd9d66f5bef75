"""Blackbox logs of Betaflight, INAV and Cleanflight (.bbl, .bfl, .txt), which describe their frames in lines of text.

    H Product:Blackbox flight data recorder by Nicholas Sherlock
    H Field I name:loopIteration,time,gyroADC[0],…      names of the fields, then signs, predictors and encodings
    H gyro_scale:0x3f800000 …                           settings of the controller
    frames (blackbox_kernel.py)

A file has several logs if the controller was armed several times. Their tables follow each other, and their clock goes
back between them. Numbers whose unit depends on settings outside the log have none.

Source: Betaflight documentation, "Blackbox logging internals".
"""

import mmap
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import datetime
from itertools import pairwise
from pathlib import Path

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.readers.formats import blackbox_kernel as kernel
from imuscope.recordings.readers.formats.flight_log import (
    BLOCK_BYTES,
    MOST_COLUMNS,
    DatedBy,
    FlightLog,
    LogBlock,
    LogColumn,
    LogTable,
)
from imuscope.recordings.readers.registry import FileReader, OpenRequest, register_reader
from imuscope.recordings.system.regular_file import open_regular

MARK = b"H Product:Blackbox flight data recorder"
MAIN_FRAMES, OTHER_FRAMES = 1 << 15, 1 << 12  # read at once
LONGEST_LINE, MOST_LINES = 1 << 14, 4096
KINDS = "IPSGH"
TIME, MAIN, SLOW, GPS = "time", "main", "slow", "GPS"
ENCODINGS = (0, 1, 3, 6, 7, 8, 9, 10)
GROUPED = {kernel.TAG2_3S32: 3, kernel.TAG8_4S16: 4, kernel.TAG2_3SVARIABLE: 3}
"""Encodings of several numbers together, and of how many."""
WRAP_US = 1 << 32
STANDARD_GRAVITY = 9.80665
UNITS = {
    "GPS_coord": ("°", 1e-7),
    "GPS_speed": ("m/s", 0.01),
    "GPS_velned": ("m/s", 0.01),
    "GPS_ground_course": ("°", 0.1),
}


@dataclass(slots=True)
class _Head:
    """Lines before the frames of a log."""

    fields: dict[str, dict[str, list[str]]] = field(default_factory=lambda: {kind: {} for kind in KINDS})
    settings: dict[str, str] = field(default_factory=dict)

    def take(self, line: str) -> None:
        name, _, value = line.removeprefix("H ").partition(":")
        words = name.split()
        if len(words) == 3 and words[0] == "Field" and words[1] in KINDS:
            self.fields[words[1]][words[2]] = [part.strip() for part in value.split(",")]
        elif name not in self.settings:
            self.settings[name.strip()] = value.strip()

    def number(self, name: str, default: int) -> int:
        """A setting that is a number, or the first of several."""
        try:
            return int(self.settings.get(name, "").split(",")[0], 0)
        except ValueError:
            return default

    def real(self, name: str) -> float | None:
        """A setting that has the bits of a float."""
        try:
            return float(struct.unpack("<f", struct.pack("<I", int(self.settings.get(name, ""), 16)))[0])
        except (ValueError, struct.error):
            return None


class _Log:
    """One log of a file: its layout, and the memory of the kernel."""

    def __init__(self, head: _Head, file: str) -> None:
        self.head = head
        shared = head.fields["I"]
        head.fields["P"] = {**{"name": shared.get("name", []), "signed": shared.get("signed", [])}, **head.fields["P"]}
        self.names = {kind: head.fields[kind].get("name", [])[:MOST_COLUMNS] for kind in KINDS}
        self._counts = np.array([len(self.names[kind]) for kind in KINDS], np.int64)
        width = max(int(self._counts.max()), 1) + 4
        self._forms: Ints = np.zeros((3 * len(KINDS), width), np.int64)
        for row, kind in enumerate(KINDS):
            for place, what in enumerate(("encoding", "predictor", "signed")):
                texts = head.fields[kind].get(what, [])[: self._counts[row]]
                numbers = [int(text) if text.isdigit() else -1 for text in texts]
                self._forms[3 * row + place, : len(numbers)] = numbers
                if len(numbers) < self._counts[row] or -1 in numbers:
                    self._counts[row] = 0
            if not self._is_known(self._forms[3 * row, : self._counts[row]].tolist()):
                self._counts[row] = 0
        if TIME not in self.names["I"] or not self._counts[0]:
            raise RecordingError(f"A log in {file} does not describe its frames.", "It was cut, or is damaged.")
        self._parameters = self._parameters_of(head)
        self._state: Ints = np.zeros((4, width), np.int64)
        self._counters = np.zeros(8, np.int64)
        self._counters[kernel.JUMPS] = 1
        self._raw = np.zeros(width, np.int64)
        self._main = np.zeros((width, MAIN_FRAMES), np.int64)
        self._slow = np.zeros((width, OTHER_FRAMES), np.int64)
        self._gps = np.zeros((width, OTHER_FRAMES), np.int64)

    @staticmethod
    def _is_known(encodings: list[int]) -> bool:
        """Whether all encodings are known, and those of several numbers complete."""
        at = 0
        while at < len(encodings):
            size = GROUPED.get(encodings[at], 1)
            if encodings[at] not in ENCODINGS or encodings[at : at + size] != [encodings[at]] * size:
                return False
            at += size
        return True

    def _parameters_of(self, head: _Head) -> Ints:
        numbers = np.zeros(9, np.int64)
        names = self.names["I"]
        numbers[kernel.MIN_THROTTLE] = head.number("minthrottle", 1150)
        numbers[kernel.VBATREF] = head.number("vbatref", 4095)
        numbers[kernel.MIN_MOTOR] = head.number("motorOutput", head.number("minthrottle", 1150))
        numbers[kernel.MOTOR] = names.index("motor[0]") if "motor[0]" in names else 0
        numbers[kernel.TIME] = names.index(TIME)
        numbers[kernel.VERSION] = head.number("Data version", 1)
        numbers[kernel.I_INTERVAL] = min(max(head.number("I interval", 32), 1), 65_535)
        above, _, below = head.settings.get("P interval", "1/1").partition("/")
        if not below:
            above, below = "1", above
        valid = above.isdigit() and below.isdigit() and 0 < int(above) <= 65_535 and 0 < int(below) <= 65_535
        numbers[kernel.P_NUMBER], numbers[kernel.P_DENOMINATOR] = (int(above), int(below)) if valid else (1, 1)
        return numbers

    def decode(self, data: bytes, *, is_last: bool) -> tuple[dict[str, Ints], int]:
        """Frames in the data, as (fields, frames) of each table, and how many bytes they took; −1 minus these if the
        log ends.
        """
        counters = self._counters
        counters[[kernel.MAIN_COUNT, kernel.SLOW_COUNT, kernel.GPS_COUNT]] = 0
        tables = self._main, self._slow, self._gps
        layout = self._forms, self._counts, self._parameters, self._state, counters, self._raw
        used = kernel.frames_of(np.frombuffer(data, np.uint8), *layout, *tables, int(is_last))
        frames = {
            MAIN: self._main[: self._counts[kernel.INTRA], : counters[kernel.MAIN_COUNT]],
            SLOW: self._slow[: self._counts[kernel.SLOW] + 1, : counters[kernel.SLOW_COUNT]],
            GPS: self._gps[: self._counts[kernel.GPS], : counters[kernel.GPS_COUNT]],
        }
        return frames, used

    @property
    def damaged(self) -> int:
        """Bytes outside frames, so far."""
        return int(self._counters[kernel.DAMAGED])

    @property
    def lost(self) -> int:
        """Main frames left out so far, because one that they build on is missing."""
        return int(self._counters[kernel.LOST])


class Blackbox(FlightLog):
    """A file of blackbox logs."""

    clock_name = TIME

    def __init__(self, path: Path) -> None:
        self._start: DatedBy | None = None
        super().__init__(path, "blackbox")

    def blocks(self) -> Iterator[LogBlock]:
        self.damage.clear()
        with open_regular(self.path) as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as whole:
            begins: list[int] = []
            at = whole.find(MARK)
            while at >= 0:
                begins.append(at)
                at = whole.find(MARK, at + 1)
            for begin, end in pairwise([*begins, len(whole)]):
                yield from self._log(whole, begin, end)

    def _log(self, whole: mmap.mmap, begin: int, end: int) -> Iterator[LogBlock]:
        head, at = _Head(), begin
        for _ in range(MOST_LINES):
            if whole[at : at + 2] != b"H " or at >= end:
                break
            stop = whole.find(b"\n", at, min(end, at + LONGEST_LINE))
            if stop < 0:
                break
            head.take(whole[at:stop].decode("latin-1").rstrip("\r"))
            at = stop + 1
        try:
            log = _Log(head, self.path.name)
        except RecordingError as error:
            self.note(begin, error.text)
            return
        self._describe(log)
        wraps = {name: _Wraps() for name in (MAIN, SLOW, GPS)}
        used = 0
        while at < end and used >= 0:
            data = whole[at : min(at + BLOCK_BYTES, end)]
            tables, used = log.decode(data, is_last=at + len(data) >= end)
            records = {
                name: self._bytes_of(name, frames, log, wraps[name]) for name, frames in tables.items() if frames.size
            }
            at += used if used >= 0 else -1 - used
            if self._start is None and MAIN in records:
                self._start = self._dated(log.head, records[MAIN])
            yield LogBlock(records, at / len(whole))
            if used == 0 and not records:
                break
        if log.damaged:
            self.note(begin, f"Bytes of the log at {begin} outside frames: {log.damaged}.")
        if log.lost:
            words = "because one that they build on is missing"
            self.note(begin, f"Frames of the log at {begin} left out {words}: {log.lost}.")

    def _describe(self, log: _Log) -> None:
        """Add the tables of a log, or new fields of a later one."""
        for name, kind in ((MAIN, "I"), (SLOW, "S"), (GPS, "G")):
            fields = log.names[kind]
            if not fields or (kind == "G" and TIME not in fields):
                continue
            table = self.tables.get(name)
            known = list(table.dtype.names or ()) if table is not None else []
            merged = list(dict.fromkeys([*known, *fields, TIME]))[:MOST_COLUMNS]
            if merged == known:
                continue
            columns = [_column(one, log.head) for one in merged if one not in (TIME, "loopIteration")]
            dtype = np.dtype([(one, "<f8") for one in merged])
            self.tables[name] = LogTable(name, dtype, LogColumn(TIME, TIME, factor=1e-6), columns)

    def _dated(self, head: _Head, data: bytes) -> DatedBy | None:
        try:
            utc = datetime.fromisoformat(head.settings.get("Log start datetime", "")).timestamp()
        except (ValueError, OverflowError, OSError):
            return None
        clock = float(self.tables[MAIN].time.values(self._records(self.tables[MAIN], data))[0])
        return DatedBy(clock, utc, "the log's start datetime")

    def _bytes_of(self, name: str, frames: Ints, log: _Log, wraps: "_Wraps") -> bytes:
        """Records of a table from some frames; a field that this log lacks is not a number."""
        dtype = self.tables[name].dtype
        records = np.full((frames.shape[1], len(dtype.names or ())), np.nan)
        fields = log.names[{MAIN: "I", SLOW: "S", GPS: "G"}[name]]
        fields = [*fields, TIME] if name == SLOW else fields
        for row, one in zip(frames, fields, strict=True):
            records[:, (dtype.names or ()).index(one)] = wraps.unwrapped(row) if one == TIME else row
        return records.tobytes()

    def fix(self) -> DatedBy | None:
        """The start of the first log that gives its date."""
        for block in self.blocks():
            if MAIN in block.records:
                break
        return self._start


class _Wraps:
    """A clock of 32 bits, continued beyond its end."""

    def __init__(self) -> None:
        self._last = 0
        self._added = 0

    def unwrapped(self, times: Ints) -> Ints:
        steps = np.diff(times, prepend=self._last)
        added = self._added + WRAP_US * np.cumsum(steps < -(WRAP_US // 2))
        self._last, self._added = int(times[-1]), int(added[-1])
        return times + added


def _column(name: str, head: _Head) -> LogColumn:
    """A field with its unit, if the log determines it."""
    base = name.partition("[")[0]
    if base in UNITS:
        unit, factor = UNITS[base]
        return LogColumn(name, name, None, unit, factor)
    scale, one_g = head.real("gyro_scale"), head.number("acc_1G", 0)
    if base in ("gyroADC", "gyroUnfilt") and scale and _firmware(head) in ("Betaflight", "INAV"):
        return LogColumn(name, name, None, "°/s", scale)
    if base == "accSmooth" and one_g > 0:
        return LogColumn(name, name, None, "m/s²", STANDARD_GRAVITY / one_g)
    return LogColumn(name, name)


def _firmware(head: _Head) -> str:
    return head.settings.get("Firmware revision", "").partition(" ")[0]


def _open(request: OpenRequest) -> Blackbox:
    return Blackbox(request.path)


register_reader(
    FileReader("blackbox", "Betaflight blackbox", (".bbl", ".bfl"), _open, {0: (b"H Product:Blackbox",)}, order=32)
)
