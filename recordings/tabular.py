"""Numbers decoded by other programs: CSV with a time column.

    CSV     time (s),Acceleration.x (m/s²),Acceleration.y (m/s²),Temperature [°C]
            1760000000.00,0.1,0.2,24.5

The time column is the first whose name is time, timestamp, t, date, datetime or utc, with or without a unit: s, ms, µs,
ns, in brackets of either kind or after an underscore (`time_ms`). Without a unit, the size of the first number decides;
text is read as ISO 8601, UTC if it names no zone. Times that are not since 1970 are counted from when the file was last
written. A column `arrival` beside it is taken as the arrival time. Lines before the heading that begin with # are
skipped; fields are separated by comma, semicolon or tab. A cell that is not a number is empty, and reported.

Columns are grouped into channels by name: `Acceleration.x`, `acc_x` and `accX` go with their y and z.
"""

from __future__ import annotations

import codecs
import csv
import io
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.plural import counted, plural
from imuscope.recordings.mcap_reader import FileDamage
from imuscope.recordings.mcap_writer import RecordingError
from imuscope.recordings.regular_file import open_regular
from imuscope.recordings.sources import ChunkBlock, SourceDevice

if TYPE_CHECKING:  # imported where a CSV file is read, so that a server starts sooner
    import pyarrow as pa

Floats = NDArray[np.float64]

DEVICE = "1"
TIMES = ("time", "timestamp", "t", "date", "datetime", "utc")
UNITS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9}
SINCE_1970 = 1e8  # s; smaller times are counted from another epoch
BLOCK_BYTES = 4 << 20
LONGEST_LINE = 4 << 20  # of the comment with the markers in an exported CSV file
MAX_COLUMNS = 500
_TAIL_BYTES = 1 << 16  # more than a line of 500 numbers
ODD = "\ufffd"
NO_UTF8 = "Some characters are not UTF-8; they are left out."
_FRAME = re.compile(r"(ENU|NED|NWU|ECEF|body)\b")  # of quantities, as exports name them
_HEAD = re.compile(r"^\s*(?P<name>.*?)\s*(?:[(\[](?P<unit>[^)\]]*)[)\]])?\s*$")
_AXIS = re.compile(r"^(?P<group>.+?)(?:[._](?P<axis>[^._]+)|(?<=[a-z])(?P<letter>[XYZ]))$")


@dataclass(frozen=True, slots=True)
class TableRows:
    """Rows of one table: (n,) each; a missing number is NaN.

    Args:
        table: its name.
        time, arrival: unix s; time NaN if unknown.
        columns: by heading, (values, unit). The headings are the same in every block of a table.
        done: share of the file read, 0..1.
    """

    table: str
    time: Floats
    arrival: Floats
    columns: Mapping[str, tuple[Floats, str]]
    done: float


class TableSource:
    """A file of numbers, without bytes of a device. As recordings/sources.Source, with `rows` in place of parts."""

    timed = True

    def __init__(self, path: Path, format: str) -> None:
        self.path, self.format = path, format
        self.header: Mapping[str, str] = {}
        self.devices = {DEVICE: SourceDevice(DEVICE, "", {"source": path.name, "name": path.stem})}
        self.damage: list[FileDamage] = []

    def parts(self, start_ns: int | None = None, stop_ns: int | None = None) -> Iterator[ChunkBlock]:
        """Nothing: the file has no bytes of a device."""
        return iter(())

    def metadata(self) -> Iterator[tuple[str, int, Mapping[str, Any]]]:
        """Metadata stored beside the numbers: none."""
        return iter(())

    def rows(self) -> Iterator[TableRows]:
        """All rows, in blocks of each table."""
        raise NotImplementedError

    def last(self) -> float:
        """Time of the last row, as far as known before all are read, unix s; 0 if unknown."""
        return 0.0


class CsvSource(TableSource):
    """One CSV file.

    Raises:
        RecordingError: it has no time column, or no numeric one.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "csv")
        self._skip, self._delimiter, heads, first = _beginning(path)
        matches = [_HEAD.match(head) for head in heads]
        self._heads = [(match["name"], _unit(match["unit"] or "")) if match else ("", "") for match in matches]
        self._time = next((i for i, (name, _) in enumerate(self._heads) if _unit_in(name) is not None), None)
        if self._time is None:
            hint = f"Name one time, with its unit: time (s). There are: {', '.join(heads)[:300]}."
            raise RecordingError(f"{path.name} has no column of times.", hint)
        name, unit = self._heads[self._time]
        self._arrival = next((i for i, (name, _) in enumerate(self._heads) if name.lower() == "arrival"), None)
        value = first[self._time].strip() if self._time < len(first) else ""
        self._factor = UNITS.get(unit.strip()) or UNITS.get(_unit_in(name) or "") or _guessed(value)
        self._origin = 0.0
        number = _seconds(value, self._factor)
        if number is not None and abs(number) < SINCE_1970:
            self._origin = path.stat().st_mtime - number
            self.timed = False

    def rows(self) -> Iterator[TableRows]:
        import pyarrow as pa
        import pyarrow.csv

        names = _unique([name or f"column {i + 1}" for i, (name, _) in enumerate(self._heads)])
        options = pa.csv.ReadOptions(
            block_size=BLOCK_BYTES, skip_rows=self._skip + 1, column_names=names, use_threads=False
        )
        odd: list[Any] = []

        def skip(row: Any) -> str:
            odd.append(row)
            return "skip"

        parsing = pa.csv.ParseOptions(delimiter=self._delimiter, invalid_row_handler=skip)
        types = pa.csv.ConvertOptions(column_types=dict.fromkeys(names, pa.string()))
        size, done = max(self.path.stat().st_size, 1), 0
        wrong = 0
        try:
            with (
                open_regular(self.path) as file,
                pa.csv.open_csv(_Utf8(file, self.damage), options, parsing, types) as reader,
            ):
                for batch in reader:
                    done += batch.nbytes
                    rows, bad = self._converted(batch, names, min(done / size, 1.0))
                    wrong += bad
                    yield rows
        except pa.ArrowInvalid as error:
            self.damage.append(FileDamage(-1, f"Not a table from some line on: {str(error).splitlines()[0][:200]}"))
        if odd:
            lines = f"{counted(len(odd), 'line does', 'lines do')} not have {counted(len(names), 'field')}"
            self.damage.append(FileDamage(-1, f"{lines} and {plural(len(odd), 'was', 'were')} skipped."))
        if wrong:
            cells = counted(wrong, "cell was not a number and was", "cells were not numbers and were")
            self.damage.append(FileDamage(-1, f"{cells} left empty."))

    def last(self) -> float:
        assert self._time is not None
        with open_regular(self.path) as file:
            file.seek(max(0, self.path.stat().st_size - _TAIL_BYTES))
            lines = file.read().decode(errors="replace").splitlines()
        cells = next(csv.reader(lines[-1:], delimiter=self._delimiter), [])
        number = _seconds(cells[self._time], self._factor) if len(cells) > self._time else None
        return number + self._origin if number is not None and math.isfinite(number) else 0.0

    def _converted(self, batch: pa.RecordBatch, names: list[str], done: float) -> tuple[TableRows, int]:
        assert self._time is not None
        wrong = 0
        columns: dict[str, tuple[Floats, str]] = {}
        for i, (name, (_, unit)) in enumerate(zip(names, self._heads, strict=True)):
            if i not in (self._time, self._arrival):
                values, bad = _numbers(batch.column(i))
                wrong += bad
                columns[name] = (values, unit)
        time = self._times(batch.column(self._time))
        arrival = time
        if self._arrival is not None:
            arrival = _numbers(batch.column(self._arrival))[0] * self._factor + self._origin
            arrival = np.where(np.isnan(arrival), time, arrival)
        known = ~np.isnan(arrival)
        known_rows = {name: (values[known], unit) for name, (values, unit) in columns.items()}
        return TableRows(self.path.stem, time[known], arrival[known], known_rows, done), wrong + int((~known).sum())

    def _times(self, column: pa.Array) -> Floats:
        values, bad = _numbers(column)
        if bad == 0:
            scaled: Floats = values * self._factor + self._origin
            return scaled
        times = [_seconds(text, self._factor) for text in column.to_pylist()]
        return np.array([np.nan if time is None else time for time in times]) + self._origin


class _Utf8(io.RawIOBase):
    """A file as UTF-8, whatever its bytes: invalid ones are replaced, and reported once."""

    def __init__(self, file: BinaryIO, damage: list[FileDamage]) -> None:
        self._file = file
        self._damage = damage
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")

    def readable(self) -> bool:
        return True

    def read(self, size: int = -1) -> bytes:
        while data := self._file.read(size):
            if text := self._decoder.decode(data):
                return self._report(text)
        return self._report(self._decoder.decode(b"", True))

    def _report(self, text: str) -> bytes:
        if ODD in text and not any(one.words == NO_UTF8 for one in self._damage):
            self._damage.append(FileDamage(-1, NO_UTF8))
        return text.encode()


def _beginning(path: Path) -> tuple[int, str, list[str], list[str]]:
    """Lines before the heading, delimiter, headings, first row."""
    skip = 0
    with io.TextIOWrapper(open_regular(path), encoding="utf-8-sig", errors="replace", newline="") as file:
        line = file.readline(LONGEST_LINE)
        while line and (line.startswith("#") or not line.strip()):
            skip += 1
            line = file.readline(LONGEST_LINE)
        second = file.readline(1 << 16)
    delimiter = max(",;\t", key=line.count)
    if line.count(delimiter) == 0:
        raise RecordingError(
            f"{path.name} is not a table.", "The first line must name the columns, separated by commas."
        )
    heads = next(csv.reader([line], delimiter=delimiter))
    first = next(csv.reader([second], delimiter=delimiter), [])
    if len(heads) > MAX_COLUMNS:
        raise RecordingError(f"{path.name} has {len(heads)} columns; {MAX_COLUMNS} are read.", "Leave some out.")
    return skip, delimiter, heads, first


def _unit(text: str) -> str:
    """The unit in the brackets after a name; a frame may stand with it or instead of it ("m/s; NED")."""
    return ";".join(part.strip() for part in text.split(";") if not _FRAME.match(part.strip()))


def _unit_in(name: str) -> str | None:
    """Unit of a time heading, "" if it has none; None for any other heading."""
    text = name.strip().lower()
    if text in TIMES:
        return ""
    stem, _, unit = text.rpartition("_")
    return unit if stem in TIMES and unit in UNITS else None


def _guessed(value: str) -> float:
    """The unit of a number without one, by its size; text has none."""
    try:
        size = abs(float(value))
    except ValueError:
        return 1.0
    return 1e-9 if size > 1e17 else 1e-6 if size > 1e14 else 1e-3 if size > 1e11 else 1.0


def _seconds(text: str | None, factor: float) -> float | None:
    """A cell of the time column, s."""
    try:
        return float(text or "") * factor
    except ValueError:
        pass
    try:
        moment = datetime.fromisoformat((text or "").strip())
    except ValueError:
        return None
    return (moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)).timestamp()


def _numbers(column: pa.Array) -> tuple[Floats, int]:
    """Cells as numbers, and the number of cells with anything else."""
    import pyarrow as pa
    import pyarrow.compute as pc

    trimmed = pc.utf8_trim_whitespace(column)
    filled = pc.if_else(pc.equal(trimmed, ""), None, trimmed)
    try:
        values: Floats = pc.cast(filled, pa.float64()).to_numpy(zero_copy_only=False)
        return values.astype(np.float64), 0
    except pa.ArrowInvalid:
        numbers, bad = np.full(len(filled), np.nan), 0
        for row, text in enumerate(filled.to_pylist()):
            try:
                numbers[row] = np.nan if text is None else float(text)
            except ValueError:
                bad += 1
        return numbers, bad


def _unique(names: list[str]) -> list[str]:
    counts: dict[str, int] = {}
    out = []
    for name in names:
        counts[name] = counts.get(name, 0) + 1
        out.append(name if counts[name] == 1 else f"{name} #{counts[name]}")
    return out


def grouped(names: list[str]) -> list[tuple[str, list[tuple[str, str]]]]:
    """Columns grouped by quantity: (name of the quantity, [(heading, name in it)])."""
    groups: dict[str, list[tuple[str, str]]] = {}
    for name in names:
        match = _AXIS.match(name)
        if match is None:
            groups.setdefault(name, []).append((name, "value"))
        else:
            groups.setdefault(match["group"], []).append((name, match["axis"] or match["letter"].lower()))
    out: list[tuple[str, list[tuple[str, str]]]] = []
    for group, members in groups.items():
        if len(members) == 1:
            out.append((members[0][0], [(members[0][0], "value")]))
        else:
            out.append((group, members))
    return out
