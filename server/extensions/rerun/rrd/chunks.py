"""Columns of a Rerun entity, from rows of a channel; whole columns at once, never row by row.

A Rerun chunk is one entity's columns with their three timelines. The viewer handles few large chunks quickly and
thousands of small ones very slowly, so callers pass as many rows as there are, up to a block of a store.

Scalars are float64 there: an integer beyond ±2^53 loses its last digits, everything else is exact.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from imuscope.protocols.arrays import Array, Floats
from imuscope.protocols.clocks.unix_time import NO_TIME, nanoseconds
from imuscope.protocols.rotations import quaternion_columns
from imuscope.recordings.columns.rows import ExactRows
from imuscope.recordings.exporters.entities import Attitude, Curve, Path, PositionEntity
from imuscope.recordings.exporters.enu import Origin, enu_of, is_place

DEVICE_TIME, ARRIVAL_TIME, SAMPLE = "device_time", "arrival_time", "sample"
LEVELS = {"info": "INFO", "warning": "WARN", "error": "ERROR"}


@dataclass(frozen=True, slots=True)
class Times:
    """Times and sequence numbers of samples: (n,) each, datetime64[ns] twice and int64."""

    device: Array
    arrival: Array
    sample: Array

    def columns(self) -> list[rr.TimeColumn]:
        """Time columns for Rerun."""
        return [
            rr.TimeColumn(DEVICE_TIME, timestamp=self.device),
            rr.TimeColumn(ARRIVAL_TIME, timestamp=self.arrival),
            rr.TimeColumn(SAMPLE, sequence=self.sample),
        ]

    def only(self, which: Any) -> "Times":
        """A subset, by a mask or by position."""
        return Times(self.device[which], self.arrival[which], self.sample[which])

    def __len__(self) -> int:
        return len(self.sample)


def times_of(rows: ExactRows, first: int) -> Times:
    """The timelines of rows.

    Args:
        first: number of the first row within its channel.
    """
    return Times(
        np.where(rows.time_ns == NO_TIME, rows.arrival_ns, rows.time_ns).view("datetime64[ns]"),
        rows.arrival_ns.view("datetime64[ns]"),
        np.arange(first, first + len(rows)),
    )


def moments(times: Floats) -> Array:
    """Unix seconds as datetime64[ns]."""
    return nanoseconds(times).view("datetime64[ns]")


def name_of(path: Path) -> str:
    """The entity's path as Rerun writes it."""
    return rr.new_entity_path(list(path))


def send(stream: rr.RecordingStream, path: Path, times: Times, columns: Iterable[rr.ComponentColumn]) -> None:
    rr.send_columns(name_of(path), times.columns(), columns, recording=stream, strict=True)


def send_curve(stream: rr.RecordingStream, curve: Curve, times: Times, columns: Sequence[Array]) -> None:
    """Send values of one entity; `columns` are all of the channel."""
    if len(times):
        values = np.column_stack([columns[i].astype(np.float64, copy=False) for i in curve.columns])
        send(stream, curve.path, times, rr.Scalars.columns(scalars=values))


def send_table(stream: rr.RecordingStream, curve: Curve, times: Times, columns: Sequence[Array]) -> None:
    """Send values of a table, several rows of which share one time: as instances."""
    if len(times):
        starts = np.flatnonzero(np.append(True, np.diff(times.arrival.view(np.int64)) != 0))
        lengths = np.diff(starts, append=len(times))
        values = columns[curve.columns[0]].astype(np.float64, copy=False)
        send(stream, curve.path, times.only(starts), rr.Scalars.columns(scalars=values).partition(lengths))


def send_attitude(stream: rr.RecordingStream, attitude: Attitude, times: Times, columns: Sequence[Array]) -> None:
    """Send transforms for the rows that are rotations: before its first solution a device sends zeros or NaN."""
    values = np.column_stack([column.astype(np.float64, copy=False) for column in columns])
    with np.errstate(invalid="ignore"):
        good = np.isfinite(values).all(axis=1)
        if attitude.kind != "euler":
            good &= (values**2).sum(axis=1) > 0.25
    times, values = times.only(good), values[good]
    if not len(times):
        return
    if attitude.kind == "matrix":  # row-major here, column-major there
        turned = values.reshape(-1, 3, 3).transpose(0, 2, 1).reshape(-1, 9).astype(np.float32)
        send(stream, attitude.path, times, rr.Transform3D.columns(mat3x3=turned))
        return
    if attitude.kind == "euler":
        values = np.column_stack(quaternion_columns(list(values.T)))
    xyzw = np.ascontiguousarray(values[:, [1, 2, 3, 0]], np.float32)
    send(stream, attitude.path, times, rr.Transform3D.columns(quaternion=xyzw))


def metres(position: PositionEntity, columns: Sequence[Array], height: Floats | None, origin: Origin | None) -> Floats:
    """East, north, up of each row; NaN for an invalid position.

    Args:
        height: (n,) m, from another channel; None if the channel has heights itself, or none exist.
        origin: of the plane; not needed for a local position.

    Returns:
        (n, 3) float64.
    """
    first, second, third = (columns[i].astype(np.float64) if i >= 0 else None for i in position.columns)
    assert first is not None
    assert second is not None
    if position.kind == "local":
        assert third is not None
        return np.column_stack((second, first, -third))
    assert origin is not None
    up = third if third is not None else height
    enu = enu_of(first, second, np.full(len(first), origin.height) if up is None else up, origin)
    enu[~is_place(first, second)] = np.nan
    return enu


def send_positions(stream: rr.RecordingStream, path: Path, times: Times, enu: Floats) -> None:
    """Send transforms for the rows that are valid positions."""
    good = np.isfinite(enu).all(axis=1)
    if good.any():
        send(stream, path, times.only(good), rr.Transform3D.columns(translation=enu[good].astype(np.float32)))


def degrees(position: PositionEntity, columns: Sequence[Array]) -> Floats:
    """Latitude and longitude of each row, °; NaN for an invalid position, and for a local one.

    Returns:
        (n, 2) float64.
    """
    lat, lon = (columns[i].astype(np.float64) for i in position.columns[:2])
    positions = np.column_stack((lat, lon))
    positions[~is_place(lat, lon) if position.on_map else slice(None)] = np.nan
    return positions


def send_places(stream: rr.RecordingStream, path: Path, times: Times, latlon: Floats) -> None:
    """Send points on a map for the rows that are valid positions."""
    good = np.isfinite(latlon).all(axis=1)
    if path and good.any():
        send(stream, path, times.only(good), rr.GeoPoints.columns(positions=latlon[good]))


def send_texts(stream: rr.RecordingStream, path: Path, times: Times, texts: list[str], levels: list[str]) -> None:
    """Send log lines."""
    if texts:
        send(stream, path, times, rr.TextLog.columns(text=texts, level=levels))


def changes(column: Mapping[str, Any], before: int | None, words: Array) -> tuple[Array, list[str], list[str]]:
    """Changes of a flag word.

    Args:
        column: from the manifest, with its `bits`.
        before: the word before the first row; None: the first is reported completely.
        words: (n,) unsigned.

    Returns:
        row numbers, one sentence each, and its level.
    """
    whole = words.astype(np.uint64)
    earlier = np.empty_like(whole)
    earlier[1:] = whole[:-1]
    earlier[0] = ~whole[0] if before is None else before
    rows = np.flatnonzero(whole != earlier)
    texts = [_change(column["bits"], int(earlier[i]) if i or before is not None else None, int(whole[i])) for i in rows]
    indices = [k for k, (text, _) in enumerate(texts) if text]
    return rows[indices], [texts[k][0] for k in indices], [texts[k][1] for k in indices]


def _change(groups: Sequence[Mapping[str, Any]], before: int | None, now: int) -> tuple[str, str]:
    parts: list[str] = []
    level = "info"
    for group in groups:
        mask = (1 << group["width"]) - 1
        value = now >> group["low"] & mask
        if before is not None and before >> group["low"] & mask == value:
            continue
        if group["width"] == 1:
            abnormal = bool(value) != bool(group["normal_set"])
            if before is None and not value:
                continue
            parts.append(f"{group['name']} {'set' if value else 'cleared'}")
        else:
            abnormal = False
            parts.append(f"{group['name']}: {group['choices'].get(str(value), value)}")
        if abnormal and group["severity"] and level != "error":
            level = group["severity"]
    return ", ".join(parts), LEVELS[level]
