"""DataFlash logs of ArduPilot (.BIN), which describe themselves.

    A3 95 [type u8] fields ···                    a record
    FMT  (128)  type, length, name, format codes, labels of the fields
    UNIT, MULT  meaning of the identifiers in FMTU: units, multipliers
    FMTU        for a type, a character for the unit and one for the multiplier of each field

Source: ArduPilot developer documentation, "Logging in code" and libraries/AP_Logger/LogStructure.h (names and codes).
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.recordings.readers.formats.flight_log import (
    MOST_COLUMNS,
    DatedBy,
    FlightLog,
    LogBlock,
    LogColumn,
    LogTable,
    Records,
)
from imuscope.recordings.readers.registry import FileReader, OpenRequest, register_reader
from imuscope.recordings.tables.cells import times_of
from imuscope.recordings.tables.clock import TableClock
from imuscope.recordings.tables.dates import WEEK_S

MARK = b"\xa3\x95"
FMT = 128
FMT_BYTES = 89
CODES = {
    **{"a": ("<i2", 32), "b": ("i1", 1), "B": ("u1", 1), "h": ("<i2", 1), "H": ("<u2", 1), "i": ("<i4", 1)},
    **{"I": ("<u4", 1), "f": ("<f4", 1), "d": ("<f8", 1), "n": ("S4", 1), "N": ("S16", 1), "Z": ("S64", 1)},
    **{"c": ("<i2", 1), "C": ("<u2", 1), "e": ("<i4", 1), "E": ("<u4", 1), "L": ("<i4", 1), "M": ("u1", 1)},
    **{"q": ("<i8", 1), "Q": ("<u8", 1), "g": ("<f2", 1)},
}
SCALES = {**dict.fromkeys("cCeE", 0.01), "L": 1e-7}
TEXTS = "nNZ"
TIMES = {"TimeUS": 1e-6, "TimeMS": 1e-3}
UNITS = {
    **{"s": "s", "d": "°", "D": "°", "U": "°", "h": "°", "k": "°/s", "e": "°/s²", "m": "m", "n": "m/s", "o": "m/s²"},
    **{"E": "rad/s", "L": "rad/s²", "r": "rad", "G": "G", "O": "°C", "%": "%", "v": "V", "A": "A", "W": "W"},
    **{"P": "Pa", "z": "Hz", "q": "rpm", "b": "B", "w": "Ohm"},
}
"""Units by their identifiers in UNIT. The table in a log has precedence for others."""
INSTANCE = "#"
KEPT_RECORDS = ("FMT", "FMTU", "UNIT", "MULT", "MULU")
LEFT_OUT = {"PARM": "parameters", "MSG": "logged texts"}
FIX_3D = 3
_FMT = struct.Struct("<BB4s16s64s")


@dataclass(slots=True)
class _Format:
    """A kind of records as FMT describes it."""

    length: int
    name: str
    codes: str
    labels: list[str]


class DataFlash(FlightLog):
    clock_name = "TimeUS"

    def __init__(self, path: Path) -> None:
        super().__init__(path, "dataflash")

    def blocks(self) -> Iterator[LogBlock]:
        return self.read(_Records(self), 0, lambda rest: not rest.strip(b"\0\xff"))

    def dated(self, table: LogTable, records: NDArray[Any]) -> DatedBy | None:
        names = table.dtype.names or ()
        if table.name not in ("GPS", "GPS2") or not {"GMS", "GWk"} <= set(names):
            return None
        known = records["GWk"] > 0
        if "Status" in names:
            known &= records["Status"] >= FIX_3D
        rows = np.flatnonzero(known)[:1]
        if not len(rows):
            return None
        import pyarrow as pa

        row = records[rows]
        clock = TableClock("", (0, 1), "week", "", (WEEK_S, 1e-3), "GPS", "stated", "")
        cells = [pa.array([str(int(row[name][0]))]) for name in ("GWk", "GMS")]
        return DatedBy(
            float(table.time.values(row)[0]),
            float(times_of(clock, cells).values[0]),
            f"the GNSS receiver in {table.name}",
        )


class _Records(Records):
    def __init__(self, log: DataFlash) -> None:
        super().__init__()
        self._log = log
        self._formats: dict[int, _Format] = {FMT: _Format(FMT_BYTES, "FMT", "", [])}
        self._lengths = [0] * 256
        self._lengths[FMT] = FMT_BYTES
        self._units: dict[str, str] = {}
        self._factors: dict[str, float] = {}
        self._unit_ids: dict[int, tuple[str, str]] = {}  # by kind: a unit and a multiplier for each field

    def take(self, data: bytes, offset: int) -> int:
        at, end, lengths, gathered, order = 0, len(data), self._lengths, self._gathered, self._order
        while at + 3 <= end:
            kind = data[at + 2]
            length = lengths[kind]
            if data[at] != 0xA3 or data[at + 1] != 0x95 or not length:
                next_at = self._resynchronised(data, at + 1)
                if data[at:next_at].strip(b"\0\xff"):
                    self._log.note(offset + at, f"{next_at - at} bytes at {offset + at} are damaged.")
                at = next_at
                continue
            if at + length > end:
                break
            if kind in gathered:
                gathered[kind].append(data[at : at + length])
                order.append(kind)
            else:
                self._describe(kind, data[at + 3 : at + length], offset + at)
            at += length
        return at

    def _table_of(self, kind: int) -> LogTable | None:
        form = self._formats[kind]
        table = self._log.tables.get(form.name) or self._table(kind, form)
        if table is None:
            self._log.left_out[LEFT_OUT.get(form.name, form.name)] = None
            return None
        self._log.tables[form.name] = table
        return table if table.dtype.itemsize == form.length else None

    def _resynchronised(self, data: bytes, at: int) -> int:
        """The next record of a known kind; the end of the data without one."""
        while (at := data.find(MARK, at)) >= 0:
            if at + 2 >= len(data) or self._lengths[data[at + 2]]:
                return at
            at += 1
        return len(data) - 1 if data.endswith(MARK[:1]) else len(data)

    def _describe(self, kind: int, body: bytes, at: int) -> None:
        """Take a record that describes others."""
        if kind == FMT:
            number, length, name, codes, labels = _FMT.unpack(body)
            form = _Format(length, _text(name), _text(codes), _text(labels).split(","))
            sizes = [CODES[code] for code in form.codes if code in CODES]
            size = 3 + sum(np.dtype(code).itemsize * count for code, count in sizes)
            if number == FMT or number in self._formats:
                return
            if len(sizes) != len(form.codes) or size != length or len(form.labels) < len(form.codes) or not form.name:
                self._log.note(at, f"The format of {form.name or number!r} is damaged: its records are left out.")
                self._lengths[number] = max(length, 3) if length >= 3 else 0
                self._formats[number] = _Format(length, "", "", [])
                return
            self._formats[number] = form
            self._lengths[number] = length
            if form.name not in KEPT_RECORDS:
                self._gathered[number] = []
            return
        form = self._formats[kind]
        if not form.name:
            return
        [record] = np.frombuffer(b"\0\0\0" + body, _dtype(form))
        values = {name: record[name] for name in form.labels if name in record.dtype.names}
        match form.name:
            case "UNIT" if {"Id", "Label"} <= values.keys():
                self._units[chr(int(values["Id"]) & 127)] = _text(bytes(values["Label"]))
            case "MULT" if {"Id", "Mult"} <= values.keys():
                self._factors[chr(int(values["Id"]) & 127)] = float(values["Mult"])
            case "FMTU" if {"FmtType", "UnitIds", "MultIds"} <= values.keys():
                ids = _text(bytes(values["UnitIds"])), _text(bytes(values["MultIds"]))
                self._unit_ids[int(values["FmtType"])] = ids

    def _table(self, kind: int, form: _Format) -> LogTable | None:
        """The table of a kind of records; None if they have no time, or nothing else."""
        time = next((label for label in form.labels if label in TIMES), "")
        if not time or form.name in LEFT_OUT:
            return None
        units, factors = self._unit_ids.get(kind, ("", ""))
        columns: list[LogColumn] = []
        instance = ""
        dtype = _dtype(form)
        for place, (code, label) in enumerate(zip(form.codes, form.labels, strict=False)):
            if code in TEXTS or label == time or label not in (dtype.names or ()):
                continue
            unit, factor = units[place : place + 1], factors[place : place + 1]
            if unit == INSTANCE:
                instance = label
                continue
            scale = SCALES.get(code) or self._factors.get(factor) or 1.0
            words = UNITS.get(unit) or (self._units.get(unit, "") if unit not in ("-", "?") else "")
            count = CODES[code][1]
            if count == 1:
                columns.append(LogColumn(label, label, None, words, scale))
            else:
                columns += [LogColumn(f"{label}[{n}]", label, n, words, scale) for n in range(count)]
        if not columns:
            return None
        return LogTable(form.name, dtype, LogColumn(time, time, factor=TIMES[time]), columns[:MOST_COLUMNS], instance)


def _dtype(form: _Format) -> np.dtype[Any]:
    """A whole record with its head."""
    spec: list[Any] = [("", "V3")]
    names: set[str] = set()
    for code, label in zip(form.codes, form.labels, strict=False):
        kind, count = CODES[code]
        name = label if label and label not in names else f"{label}.{len(names)}"
        names.add(name)
        spec.append((name, kind, (count,)) if count > 1 else (name, kind))
    return np.dtype(spec)


def _text(data: bytes) -> str:
    return data.partition(b"\0")[0].decode("ascii", errors="replace")


def _open(request: OpenRequest) -> DataFlash:
    return DataFlash(request.path)


register_reader(FileReader("dataflash", "DataFlash", (".bin",), _open, {0: (b"\xa3\x95\x80\x80",)}, order=31))
