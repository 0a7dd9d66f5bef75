"""ULog of PX4.

    ULog 01 12 35 [version u8][start u64]      then messages: [size u16][type u8][body]
    B flags · F format · I, M information · P, Q parameters
    A subscription: multi_id u8, msg_id u16, name · D data: msg_id u16, fields · O dropout: ms u16 · L, C texts

    F  sensor_combined:uint64_t timestamp;float[3] gyro_rad;uint8_t[4] _padding0;

Source: PX4 guide, "ULog File Format".
"""

import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.schema.plural import counted
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.readers.formats.flight_log import (
    MOST_COLUMNS,
    MOST_TABLES,
    DatedBy,
    FlightLog,
    LogBlock,
    LogColumn,
    LogTable,
    Records,
)
from imuscope.recordings.readers.registry import FileReader, register_reader
from imuscope.recordings.sources import remark

MAGIC = b"ULog\x01\x12\x35"
HEADER_BYTES = 16
SYNC = b"\x2f\x73\x13\x20\x25\x0c\xbb\x12"
TYPES = {
    **{f"{sign}int{bits}_t": f"<{(sign and 'u') or 'i'}{bits // 8}" for sign in ("", "u") for bits in (8, 16, 32, 64)},
    **{"float": "<f4", "double": "<f8", "bool": "u1", "char": "S1"},
}
KINDS = frozenset(b"BFIMPQARDLCSO")
APPENDED_FLAG = 1  # the incompatible flag that is supported: data was appended after a crash
MAX_DEPTH = 8
LARGEST_RECORD = 1 << 16
_FIELD = re.compile(r"^(\w+)(?:\[(\d{1,5})\])? (\w+)$")
_HEAD = struct.Struct("<HB")
GNSS = ("sensor_gps", "vehicle_gps_position")
UNITS = (("_m_s2", "m/s²"), ("_m_s", "m/s"), ("_pa", "Pa"), ("_celcius", "°C"), ("_celsius", "°C"), ("_degc", "°C"))
GYRO = "gyro_rad"
"""A field of sensor_combined whose unit is rad/s."""


class Ulog(FlightLog):
    def __init__(self, path: Path) -> None:
        super().__init__(path, "ulog")

    def blocks(self) -> Iterator[LogBlock]:
        reading = _Messages(self)
        yield from self.read(reading, HEADER_BYTES, lambda rest: len(rest) < _HEAD.size)
        if reading.drops:
            words = f"The logger dropped records {counted(reading.drops, 'time')}, for {reading.dropped_ms} ms in all."
            self.damage.append(remark(words))

    def dated(self, table: LogTable, records: NDArray[Any]) -> DatedBy | None:
        names = table.dtype.names or ()
        if table.name.partition(".")[0] not in GNSS or "time_utc_usec" not in names:
            return None
        known = np.flatnonzero(records["time_utc_usec"] > 0)
        if "fix_type" in names:
            known = known[records["fix_type"][known] >= 2]
        if not len(known):
            return None
        row = records[known[:1]]
        return DatedBy(
            float(table.time.values(row)[0]), int(row["time_utc_usec"][0]) / 1e6, f"the GNSS receiver in {table.name}"
        )


class _Messages(Records):
    """Messages of a file, gathered by subscription.

    Attributes:
        drops, dropped_ms: how often, and for how long in all, the logger could not write.
    """

    def __init__(self, log: Ulog) -> None:
        super().__init__()
        self.drops = self.dropped_ms = 0
        self._log = log
        self._formats: dict[str, str] = {}
        self._tables: dict[int, LogTable] = {}

    def take(self, data: bytes, offset: int) -> int:
        at, unpack, end = 0, _HEAD.unpack_from, len(data)
        gathered, order = self._gathered, self._order
        while at + 3 <= end:
            size, kind = unpack(data, at)
            if kind == 68:  # D
                after = at + 3 + size
                if after > end:
                    break
                number = data[at + 3] | data[at + 4] << 8 if size >= 2 else -1
                if number in gathered:
                    gathered[number].append(data[at + 5 : after])
                    order.append(number)
                at = after
                continue
            if kind not in KINDS or not size:
                next_at = self._resynchronised(data, at)
                self._log.note(offset + at, f"{next_at - at} bytes at {offset + at} are damaged.")
                at = next_at
                continue
            if at + 3 + size > end:
                break
            self._message(chr(kind), data[at + 3 : at + 3 + size], offset + at)
            at += 3 + size
        return at

    def _table_of(self, kind: int) -> LogTable | None:
        return self._tables[kind]

    def _joined(self, table: LogTable, records: list[bytes]) -> bytes:
        size = table.dtype.itemsize
        return b"".join(one if len(one) == size else one[:size].ljust(size, b"\0") for one in records)

    def _resynchronised(self, data: bytes, at: int) -> int:
        """The next place with the heads of two messages, or a synchronisation message."""
        sync = data.find(SYNC, at)
        if sync >= 0:
            return max(sync - 3, at + 1)
        for place in range(at + 1, min(len(data) - 3, at + 2 * LARGEST_RECORD)):
            size, kind = _HEAD.unpack_from(data, place)
            after = place + 3 + size
            if (
                kind in KINDS
                and size
                and after + 3 <= len(data)
                and data[after + 2] in KINDS
                and data[after : after + 2] != b"\0\0"
            ):
                return place
        return len(data)

    def _message(self, kind: str, body: bytes, at: int) -> None:
        if kind == "F":
            name, _, fields = body.decode(errors="replace").partition(":")
            self._formats.setdefault(name, fields)
        elif kind == "A" and len(body) > 3:
            self._subscribe(int.from_bytes(body[1:3], "little"), body[3:].decode(errors="replace"), body[0])
        elif kind == "B" and len(body) >= 16 and (any(body[9:16]) or body[8] & ~APPENDED_FLAG):
            name = self._log.path.name
            raise RecordingError(f"{name} is a ULog with features that are not known.", "Install a newer imuscope.")
        elif kind == "O" and len(body) == 2:
            self.drops += 1
            self.dropped_ms += int.from_bytes(body, "little")
        elif kind in "LC":
            self._log.left_out["logged texts"] = None
        elif kind in "PQ":
            self._log.left_out["parameters"] = None

    def _subscribe(self, number: int, name: str, instance: int) -> None:
        title = f"{name}.{instance}" if instance else name
        if number in self._tables:
            return
        try:
            table = self._table(name, title)
        except ValueError as error:
            self._log.left_out[f"{title} ({error})"] = None
            return
        if len(self._tables) < MOST_TABLES:
            self._tables[number] = table
            self._gathered[number] = []
            self._log.tables[title] = table

    def _table(self, name: str, title: str) -> LogTable:
        columns: list[LogColumn] = []
        spec: dict[str, list[Any]] = {"names": [], "formats": [], "offsets": []}
        size = self._lay_out(name, "", 0, columns, spec, 0)
        if "timestamp" not in spec["names"]:
            raise ValueError("without a timestamp")
        dtype = np.dtype({**spec, "itemsize": size})  # type: ignore[call-overload]
        return LogTable(title, dtype, LogColumn("timestamp", "timestamp", factor=1e-6), columns[:MOST_COLUMNS])

    def _lay_out(
        self, name: str, prefix: str, at: int, columns: list[LogColumn], spec: dict[str, list[Any]], depth: int
    ) -> int:
        """Add the fields of a format; returns the place after them."""
        if depth > MAX_DEPTH or name not in self._formats:
            raise ValueError(f"its format {name!r:.60} is not known")
        for text in filter(None, self._formats[name].split(";")):
            match = _FIELD.match(text.strip())
            if match is None:
                raise ValueError(f"not a field: {text!r:.60}")
            kind, count, field = match[1], int(match[2] or 1), f"{prefix}{match[3]}"
            if at > LARGEST_RECORD or len(spec["names"]) > 4 * MOST_COLUMNS:
                raise ValueError("its format is too long")
            if kind not in TYPES:
                for index in range(count):
                    inner = f"{field}[{index}]." if match[2] else f"{field}."
                    at = self._lay_out(kind, inner, at, columns, spec, depth + 1)
                continue
            width = np.dtype(TYPES[kind]).itemsize * count
            if not match[3].startswith("_padding"):
                if field in spec["names"]:
                    raise ValueError(f"{field} twice")
                spec["names"].append(field)
                spec["formats"].append((TYPES[kind], (count,)) if match[2] else TYPES[kind])
                spec["offsets"].append(at)
                if kind != "char" and field != "timestamp":
                    columns += _columns(field, count if match[2] else None)
            at += width
        return at


def _columns(field: str, count: int | None) -> list[LogColumn]:
    unit = "rad/s" if field == GYRO else next((unit for end, unit in UNITS if field.endswith(end)), "")
    if count is None:
        return [LogColumn(field, field, None, unit)]
    return [LogColumn(f"{field}[{index}]", field, index, unit) for index in range(min(count, MOST_COLUMNS))]


register_reader(
    FileReader("ulog", "ULog", (".ulg", ".ulog"), lambda request: Ulog(request.path), {0: (MAGIC,)}, order=30)
)
