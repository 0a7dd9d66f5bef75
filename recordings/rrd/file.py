"""How does an opened recording become an `.rrd` file? Static things first, then what the 3D view needs, then curves.

The order is that in which a viewer wants it while it still loads: the body is there with the first chunk, its attitudes
next, the curves after them, block by block, so that memory stays bounded however long the recording is. The file is
written under another name beside its place and renamed when it is whole.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from recordings.columns import BLOCK_ROWS, Columns, Exact
from recordings.rrd import chunks, still
from recordings.rrd.blueprint import blueprint
from recordings.rrd.chunks import LEVELS, Times, nanoseconds, times_of
from recordings.rrd.ground import Origin, is_place
from recordings.rrd.layout import WORLD, Device, Info, Position, devices_of

MOST_TEXTS = 20_000  # of one status word: one that flickers with every sample is better seen as a curve
EVENTS, MARKERS = ("events",), ("markers",)


class StoppedError(Exception):
    """It was cancelled; nothing is left behind."""


@dataclass(frozen=True, slots=True)
class Work:
    """What of a store is written, and who is told how far it is.

    Args:
        t0, t1: unix s, both included; None: from the beginning, to the end.
        wanted: numbers of channels; None: all.
        progress: called with 0..1.
        cancelled: asked between chunks.
    """

    columns: Columns
    t0: float | None = None
    t1: float | None = None
    wanted: Collection[int] | None = None
    progress: Callable[[float], None] = lambda share: None
    cancelled: Callable[[], bool] = lambda: False

    def rows(self, channel: int) -> tuple[int, int]:
        """First row, and one past the last."""
        whole = self.columns.rows(channel)
        lo = 0 if self.t0 is None else self.columns.row_at(channel, np.nextafter(self.t0, -np.inf)) + 1
        hi = whole if self.t1 is None else self.columns.row_at(channel, self.t1) + 1
        return lo, max(lo, hi)

    def blocks(self, channel: int) -> Iterator[tuple[int, Exact]]:
        """The rows, a block at a time, each with the number of its first."""
        lo, hi = self.rows(channel)
        while lo < hi:
            if self.cancelled():
                raise StoppedError
            past = min(lo + BLOCK_ROWS, hi)
            yield lo, self.columns.exact(channel, lo, past)
            lo = past

    def channels(self) -> list[Info]:
        """What the manifest says of the channels that are wanted and have rows."""
        infos: list[Info] = self.columns.manifest["channels"]
        return [
            info
            for info in infos
            if (self.wanted is None or info["id"] in self.wanted) and np.diff(self.rows(info["id"]))[0] > 0
        ]


def write_rrd(
    columns: Columns,
    out: Path,
    *,
    t0: float | None = None,
    t1: float | None = None,
    channels: Collection[int] | None = None,
    progress: Callable[[float], None] = lambda share: None,
    cancelled: Callable[[], bool] = lambda: False,
    title: str = "",
) -> None:
    """Write an opened recording, or a range of it.

    Args:
        out: the file; replaced when it is there.
        channels: numbers of those that are wanted; None: all.
        title: of the recording, as the viewer shows it; "": what the recording calls itself.
    Raises:
        StoppedError: `cancelled` said so; nothing is left behind.
        OSError: the disk failed; nothing is left behind.
    """
    work = Work(columns, t0, t1, channels, progress, cancelled)
    name = title or str(columns.manifest.get("about", {}).get("title") or out.stem)
    aside = out.with_name(f".{out.name}.{os.getpid()}.making")
    # The application's name keeps a viewer from opening one recording with the layout of another.
    stream = rr.RecordingStream(f"imuscope {name}")
    try:
        _write(stream, work, aside, name)
        stream.flush()
        stream.disconnect()
        os.replace(aside, out)
    except BaseException:
        stream.disconnect()
        aside.unlink(missing_ok=True)
        raise


def _write(stream: rr.RecordingStream, work: Work, out: Path, name: str) -> None:
    infos = work.channels()
    devices = devices_of(work.columns.manifest["devices"], infos)
    by_number = {int(info["id"]): info for info in infos}
    logs = [f"/{chunks.name_of(EVENTS)}/**", f"/{chunks.name_of(MARKERS)}/**"]
    for device in devices:
        for number, curves in device.curves.items():
            if by_number[number]["kind"] == "status":
                logs.extend(f"/{chunks.name_of((*curve.path, 'changes'))}" for curve in curves)
    stream.save(out, default_blueprint=blueprint(devices, infos, logs))
    stream.send_recording_name(name)
    span = work.columns.span()
    if span is not None:
        stream.send_recording_start_time_nanos(int(max(span[0], work.t0 or span[0]) * 1e9))
    still.send_scene(stream, devices)
    for device in devices:
        for number, curves in device.curves.items():
            for curve in curves:
                still.send_style(stream, curve, by_number[number]["columns"])
    _texts(stream, work, devices)
    _moving(stream, work, devices)
    _curves(stream, work, devices, by_number)


def _moving(stream: rr.RecordingStream, work: Work, devices: list[Device]) -> None:
    """Tracks, positions, attitudes."""
    origin = next((found for device in devices if (found := _origin(work, device.position)) is not None), None)
    for device in devices:
        if device.position is not None:
            times, enu = _places(work, device.position, origin)
            still.send_track(stream, device, enu)
            chunks.send_positions(stream, device.position.path, times, enu)
            here = rr.Points3D([(0, 0, 0)], radii=rr.Radius.ui_points(6), labels=[device.title])
            stream.log(chunks.name_of((WORLD, device.name, "here")), here, static=True)
    for device in devices:
        if device.attitude is not None:
            for first, rows in work.blocks(device.attitude.channel):
                chunks.send_attitude(stream, device.attitude, times_of(rows, first), rows.columns)
                stream.flush()


def _origin(work: Work, position: Position | None) -> Origin | None:
    """Where the plane is: at the first place."""
    if position is None or position.kind != "place":
        return None
    lat, lon, high = position.columns
    for _, rows in work.blocks(position.channel):
        good = np.flatnonzero(is_place(rows.columns[lat], rows.columns[lon]))
        if len(good):
            i = int(good[0])
            height = float(rows.columns[high][i]) if high >= 0 else float(_heights(work, position, rows.arrival[:1])[0])
            return Origin(
                float(rows.columns[lat][i]), float(rows.columns[lon][i]), height if np.isfinite(height) else 0
            )
    return None


def _places(work: Work, position: Position, origin: Origin | None) -> tuple[Times, Any]:
    """All of a device's positions: those of minutes at the rate of a receiver, or of hours at that of a filter."""
    times: list[Times] = []
    found: list[Any] = [np.empty((0, 3))]
    if position.kind == "place" and origin is None:
        return Times(*(np.empty(0, dtype) for dtype in ("datetime64[ns]", "datetime64[ns]", np.int64))), found[0]
    for first, rows in work.blocks(position.channel):
        height = _heights(work, position, rows.arrival) if position.height else None
        found.append(chunks.metres(position, rows.columns, height, origin))
        times.append(times_of(rows, first))
    joined = Times(*(np.concatenate([getattr(t, name) for t in times]) for name in ("device", "arrival", "sample")))
    return joined, np.concatenate(found)


def _heights(work: Work, position: Position, arrival: Any) -> Any:
    """Heights of another channel at these arrivals, m; 0 where there are none."""
    rows = work.columns.exact(position.height, 0, work.columns.rows(position.height)) if position.height else None
    if rows is None or not len(rows):
        return np.zeros(len(arrival))
    at = np.clip(np.searchsorted(rows.arrival, arrival, "right") - 1, 0, len(rows) - 1)
    return rows.columns[0][at].astype(np.float64)


def _curves(stream: rr.RecordingStream, work: Work, devices: list[Device], infos: dict[int, Info]) -> None:
    """Every value, and what changed in words of flags."""
    total = sum(int(np.diff(work.rows(number))[0]) for device in devices for number in device.curves) or 1
    done = 0
    for device in devices:
        for number, curves in device.curves.items():
            info = infos[number]
            put = chunks.send_table if info["kind"] == "rows" else chunks.send_curve
            told = _Flags(stream, info, device) if info["kind"] == "status" else None
            for first, rows in work.blocks(number):
                times = times_of(rows, first)
                for curve in curves:
                    put(stream, curve, times, rows.columns)
                if told is not None:
                    told.take(times, rows)
                stream.flush()  # what waits in the stream's queue is memory
                done += len(rows)
                work.progress(min(done / total, 1.0))


class _Flags:
    """The texts of a status channel, bounded."""

    def __init__(self, stream: rr.RecordingStream, info: Info, device: Device) -> None:
        self._stream = stream
        self._info = info
        self._curves = device.curves[info["id"]]
        self._before: dict[int, int] = {}
        self._told = 0

    def take(self, times: Times, rows: Exact) -> None:
        for curve in self._curves:
            for i in curve.columns:
                self._take(i, (*curve.path, "changes"), times, rows.columns[i])

    def _take(self, i: int, path: tuple[str, ...], times: Times, words: Any) -> None:
        column = self._info["columns"][i]
        if not column["bits"] or self._told >= MOST_TEXTS:
            return
        at, texts, levels = chunks.changes(column, self._before.get(i), words)
        self._before[i] = int(words[-1])
        room = MOST_TEXTS - self._told
        self._told += len(texts)
        if len(texts) > room:
            at, texts, levels = at[:room], texts[:room], levels[:room]
            texts[-1] = "It changes too often to be told further; the curve has every change."
            levels[-1] = LEVELS["caution"]
        chunks.send_texts(self._stream, path, times.only(at), texts, levels)


def _texts(stream: rr.RecordingStream, work: Work, devices: list[Device]) -> None:
    """What happened, and what a person marked."""
    names = {device.id: device.name for device in devices}
    events = [event for event in work.columns.manifest["events"] if _within(work, event["time"])]
    for id in dict.fromkeys(event["device"] for event in events):
        own = [event for event in events if event["device"] == id]
        path = (*EVENTS, names.get(id, str(id))) if id else (*EVENTS, "recording")
        _log(stream, path, own, [str(event["text"]) for event in own], [LEVELS[event["level"]] for event in own])
    markers = [marker for marker in work.columns.manifest["markers"] if _within(work, marker["time"])]
    texts = [str(marker["text"]) or f"{marker['kind']} {marker['id']}" for marker in markers]
    _log(stream, MARKERS, markers, texts, [LEVELS["info"]] * len(markers))


def _within(work: Work, time: float) -> bool:
    return (work.t0 is None or time >= work.t0) and (work.t1 is None or time <= work.t1)


def _log(
    stream: rr.RecordingStream, path: tuple[str, ...], rows: list[Any], texts: list[str], levels: list[str]
) -> None:
    when = nanoseconds(np.array([row["time"] for row in rows], np.float64))
    chunks.send_texts(stream, path, Times(when, when, np.arange(len(rows))), texts, levels)
