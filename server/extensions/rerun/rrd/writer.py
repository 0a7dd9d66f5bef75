"""`.rrd` writer for opened recordings: static entities first, then the 3D view's data, then curves.

The order suits a viewer that is still loading: the body comes with the first chunk, its attitudes next, then the
curves, block by block, so that memory stays bounded however long the recording is. The file is written under a
temporary name beside its place and renamed when complete.

A file has every sample. A viewer in a browser does not hold an hour of them (its memory ends at about 2 GB, and without
a GPU it draws a million points in seconds), so a stream for one can be thinned: of rotations and positions every n-th
sample, of values the least and the greatest of every range, of flags every change. The recording itself states what was
thinned.
"""

import math
import os
import re
import zlib
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from imuscope.protocols.arrays import Array
from imuscope.recordings.columns.payloads import payloads_of
from imuscope.recordings.columns.rows import ExactRows, MinMaxBuckets
from imuscope.recordings.columns.store import BLOCK_ROWS, Base, ColumnStore
from imuscope.recordings.exporters.entities import DeviceEntity, Info, PositionEntity, devices_of
from imuscope.recordings.exporters.enu import Origin, is_place
from imuscope.recordings.file_names import device_names
from imuscope.recordings.system import atomic_write
from imuscope.server.extensions.rerun.rrd import chunks, static
from imuscope.server.extensions.rerun.rrd.blueprint import blueprint
from imuscope.server.extensions.rerun.rrd.chunks import LEVELS, Times, moments, times_of

MAX_TEXTS = 20_000  # of one status word: one that changes with every sample is better shown as a curve
EVENTS, MARKERS = ("events",), ("markers",)


@dataclass(frozen=True, slots=True)
class Work:
    """Part of a store to write, and its progress callback.

    Args:
        t0, t1: unix s, both included.
        selection: numbers of channels; None: all.
        most: rows of a channel; 0: all.
        base: which time t0 and t1 are.
        progress: called with 0..1 between chunks; an exception it raises ends the work.
        payloads: kinds of undescribed bytes.
    """

    columns: ColumnStore
    t0: float = -math.inf
    t1: float = math.inf
    selection: Collection[int] | None = None
    most: int = 0
    base: Base = "device"
    progress: Callable[[float], None] = lambda share: None
    payloads: Sequence[Info] = ()

    def rows(self, channel: int) -> tuple[int, int]:
        """First row, and one past the last."""
        return self.columns.between(channel, self.t0, self.t1, self.base)

    def is_thinned(self, channel: int) -> bool:
        """Whether it has more rows than `most`."""
        lo, hi = self.rows(channel)
        return 0 < self.most < hi - lo

    def moving(self, channel: int) -> Iterator[tuple[Times, list[Array]]]:
        """Rotations or positions: block by block, or every n-th row."""
        if not self.is_thinned(channel):
            yield from ((times_of(rows, first), rows.columns) for first, rows in self.blocks(channel))
            return
        lo, hi = self.rows(channel)
        rows = self.columns.thinned(channel, *self._span(channel), self.most)
        times = times_of(rows, 0)
        yield Times(times.device, times.arrival, np.linspace(lo, hi - 1, len(rows)).astype(np.int64)), rows.columns

    def curves(self, channel: int) -> Iterator[tuple[Times, list[Array]]]:
        """Values: block by block, or the least and the greatest of every range."""
        query = self.columns.query(channel, *self._span(channel), self.most // 2) if self.is_thinned(channel) else None
        if not isinstance(query, MinMaxBuckets):
            yield from ((times_of(rows, first), rows.columns) for first, rows in self.blocks(channel))
            return
        lo, _ = self.rows(channel)
        near = self.columns.thinned(channel, *self._span(channel), self.most)
        key = np.where(np.isnan(near.time), near.arrival, near.time)
        t = np.repeat(query.t, 2)
        t[1:-1:2] += np.diff(query.t) / 2  # half a range between least and greatest, so that both are visible
        sample = lo + np.repeat(np.cumsum(query.n) - query.n, 2)
        sample[1::2] += query.n // 2
        arrival = np.interp(t, np.maximum.accumulate(key), near.arrival)
        pairs = zip(query.low, query.high, strict=True)
        yield Times(moments(t), moments(arrival), sample), [np.column_stack(pair).ravel() for pair in pairs]

    def _span(self, channel: int) -> tuple[float, float]:
        whole = self.columns.span(channel) or (0.0, 0.0)
        return max(whole[0], self.t0), min(whole[1], self.t1)

    def blocks(self, channel: int) -> Iterator[tuple[int, ExactRows]]:
        """The rows, block by block, each with the number of its first."""
        lo, hi = self.rows(channel)
        while lo < hi:
            past = min(lo + BLOCK_ROWS, hi)
            yield lo, self.columns.exact(channel, lo, past)
            lo = past

    def channels(self) -> list[Info]:
        """Manifest entries of the selected channels that have rows."""
        infos: list[Info] = self.columns.manifest["channels"]
        return [
            info
            for info in infos
            if (self.selection is None or info["id"] in self.selection) and np.diff(self.rows(info["id"]))[0] > 0
        ]


def write_rrd(
    columns: ColumnStore,
    out: Path,
    *,
    t0: float = -math.inf,
    t1: float = math.inf,
    channels: Collection[int] | None = None,
    base: Base = "device",
    progress: Callable[[float], None] = lambda share: None,
    title: str = "",
    payloads: Sequence[Info] = (),
) -> None:
    """Write an opened recording, or a range of it.

    Args:
        out: the file; replaced if it exists.
        t0, t1: unix s, both included; `base` selects the time.
        channels: numbers of the selected channels; None: all.
        progress: called with 0..1; an exception it raises ends the work, and nothing is left behind.
        title: of the recording, as the viewer shows it; "": the recording's own.
        payloads: kinds of undescribed bytes, from the manifest.

    Raises:
        OSError: the disk failed; nothing is left behind.
    """
    work = Work(columns, t0, t1, channels, 0, base, progress, payloads)
    name = title or str(columns.manifest.get("about", {}).get("title") or out.stem)
    temporary = out.with_name(f".{out.name}.{os.getpid()}.making")
    stream = stream_of(name)
    try:
        fill(stream, work, name, lambda layout: stream.save(temporary, default_blueprint=layout))
        stream.flush()
        stream.disconnect()
        atomic_write.replace(temporary, out, durable=False)
    except BaseException:
        stream.disconnect()
        temporary.unlink(missing_ok=True)
        raise


def stream_of(name: str) -> rr.RecordingStream:
    """A stream of a recording of that name. The application is named after it, because a viewer stores its layout by
    application and must not open one recording with the layout of another. Rerun accepts letters, digits and a few
    other characters in such a name, and warns of the rest.
    """
    plain = re.sub(r"[^A-Za-z0-9 _-]", "-", name)
    return rr.RecordingStream(f"imuscope {plain}" + (f" {zlib.crc32(name.encode()):08x}" if plain != name else ""))


def fill(stream: rr.RecordingStream, work: Work, name: str, begin: Callable[[rrb.Blueprint], None]) -> None:
    """Write a whole recording into a stream.

    Args:
        begin: called with the layout before anything is sent; sets the stream's destination.
    """
    infos = work.channels()
    devices = devices_of(work.columns.manifest["devices"], infos)
    by_number = {int(info["id"]): info for info in infos}
    logs = [f"{chunks.name_of(EVENTS)}/**", f"{chunks.name_of(MARKERS)}/**"]
    for device in devices:
        for number, curves in device.curves.items():
            if by_number[number]["kind"] == "status":
                logs.extend(f"{chunks.name_of((*curve.path, 'changes'))}" for curve in curves)
    begin(blueprint(devices, infos, logs))
    thinned = [info for info in infos if work.is_thinned(info["id"])]
    stream.send_recording_name(f"{name} (thinned)" if thinned else name)
    if thinned:
        words = f"Of {len(thinned)} quantities with more than {work.most} samples, least and greatest values are shown."
        stream.log("thinned", rr.TextDocument(f"{words} An exported file, or a shorter stretch, has all."), static=True)
    span = work.columns.span()
    if span is not None:
        stream.send_recording_start_time_nanos(int(max(span[0], work.t0) * 1e9))
    static.send_scene(stream, devices)
    for device in devices:
        for number, curves in device.curves.items():
            for curve in curves:
                info = by_number[number]
                static.send_style(stream, curve, info["columns"], str(info["frame"]))
    _moving(stream, work, devices)
    _curves(stream, work, devices, by_number)
    _payloads(stream, work)


def _moving(stream: rr.RecordingStream, work: Work, devices: list[DeviceEntity]) -> None:
    """Send tracks, the last of the static entities; then events, positions, attitudes."""
    origin = next((first for device in devices if (first := _origin(work, device.position)) is not None), None)
    places = [
        (device, device.position, *_places(work, device.position, origin)) for device in devices if device.position
    ]
    for device, _, _, enu, latlon in places:
        static.send_track(stream, device, enu, latlon)
    stream.flush()  # single entries wait in the stream, and columns would overtake them
    _texts(stream, work, devices)
    for _, position, times, enu, latlon in places:
        chunks.send_positions(stream, position.path, times, enu)
        chunks.send_places(stream, position.on_map, times, latlon)
    for device in devices:
        if device.attitude is not None:
            for times, columns in work.moving(device.attitude.channel):
                chunks.send_attitude(stream, device.attitude, times, columns)
                stream.flush()


def _origin(work: Work, position: PositionEntity | None) -> Origin | None:
    """Origin of the plane: the first position."""
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


def _places(work: Work, position: PositionEntity, origin: Origin | None) -> tuple[Times, Any, Any]:
    """All of a device's positions, in metres and in °: minutes of them at a receiver's rate, or hours at a filter's."""
    none = Times(*(np.empty(0, dtype) for dtype in ("datetime64[ns]", "datetime64[ns]", np.int64)))
    times, enu, latlon = [none], [np.empty((0, 3))], [np.empty((0, 2))]
    for when, columns in work.moving(position.channel) if position.kind == "local" or origin is not None else ():
        height = _heights(work, position, when.arrival.view(np.int64) / 1e9) if position.height else None
        enu.append(chunks.metres(position, columns, height, origin))
        latlon.append(chunks.degrees(position, columns))
        times.append(when)
    joined = Times(*(np.concatenate([getattr(t, name) for t in times]) for name in ("device", "arrival", "sample")))
    return joined, np.concatenate(enu), np.concatenate(latlon)


def _heights(work: Work, position: PositionEntity, arrival: Any) -> Any:
    """Heights of another channel at these arrivals, m; 0 if there are none."""
    rows = work.columns.exact(position.height, 0, work.columns.rows(position.height)) if position.height else None
    if rows is None or not len(rows):
        return np.zeros(len(arrival))
    at = np.clip(np.searchsorted(rows.arrival, arrival, "right") - 1, 0, len(rows) - 1)
    return rows.columns[0][at].astype(np.float64)


def _curves(stream: rr.RecordingStream, work: Work, devices: list[DeviceEntity], infos: dict[int, Info]) -> None:
    """Send every value, and the changes of flag words."""
    total = sum(int(np.diff(work.rows(number))[0]) for device in devices for number in device.curves) or 1
    done = 0
    for device in devices:
        for number, curves in device.curves.items():
            info = infos[number]
            put = chunks.send_table if info["kind"] == "table" else chunks.send_curve
            thin = info["kind"] != "table"  # a table is not a curve; there are few of them
            for times, columns in work.curves(number) if thin else work.moving(number):
                for curve in curves:
                    put(stream, curve, times, columns)
                stream.flush()  # the stream's queue is memory
                done += len(times)
                work.progress(min(done / total, 1.0))
            if info["kind"] == "status":
                flags = _Flags(stream, info, device)
                for first, rows in work.blocks(number):
                    flags.add(times_of(rows, first), rows)


def _payloads(stream: rr.RecordingStream, work: Work) -> None:
    names = device_names(work.columns.manifest["devices"])
    for info in work.payloads:
        path = (names.get(info["device"], str(info["device"])), f"{info['name']} bytes")
        for first, rows in work.blocks(info["id"]):
            (payloads,) = payloads_of(work.columns.folder, rows).columns
            texts = [one.hex(" ") for one in payloads]
            chunks.send_texts(stream, path, times_of(rows, first), texts, [LEVELS["info"]] * len(texts))
            stream.flush()


class _Flags:
    """The texts of a status channel, limited in number."""

    def __init__(self, stream: rr.RecordingStream, info: Info, device: DeviceEntity) -> None:
        self._stream = stream
        self._info = info
        self._curves = device.curves[info["id"]]
        self._before: dict[int, int] = {}
        self._count = 0

    def add(self, times: Times, rows: ExactRows) -> None:
        for curve in self._curves:
            for i in curve.columns:
                self._add(i, (*curve.path, "changes"), times, rows.columns[i])

    def _add(self, i: int, path: tuple[str, ...], times: Times, words: Any) -> None:
        column = self._info["columns"][i]
        if not column["bits"] or self._count >= MAX_TEXTS:
            return
        at, texts, levels = chunks.changes(column, self._before.get(i), words)
        self._before[i] = int(words[-1])
        room = MAX_TEXTS - self._count
        self._count += len(texts)
        if len(texts) > room:
            at, texts, levels = at[:room], texts[:room], levels[:room]
            texts[-1] = "It changes too often for more texts; the curve has every change."
            levels[-1] = LEVELS["warning"]
        chunks.send_texts(self._stream, path, times.only(at), texts, levels)


def _texts(stream: rr.RecordingStream, work: Work, devices: list[DeviceEntity]) -> None:
    names = {device.id: device.name for device in devices}
    events = [event for event in work.columns.manifest["events"] if work.t0 <= event["time"] <= work.t1]
    for device_id in dict.fromkeys(event["device"] for event in events):
        own = [event for event in events if event["device"] == device_id]
        path = (*EVENTS, names.get(device_id, str(device_id))) if device_id else (*EVENTS, "recording")
        _log(stream, path, own, [str(event["text"]) for event in own], [LEVELS[event["level"]] for event in own])
    markers = [marker for marker in work.columns.manifest["markers"] if work.t0 <= marker["time"] <= work.t1]
    texts = [str(marker["text"]) or f"{marker['kind']} {marker['id']}" for marker in markers]
    _log(stream, MARKERS, markers, texts, [LEVELS["info"]] * len(markers))


def _log(
    stream: rr.RecordingStream, path: tuple[str, ...], rows: list[Any], texts: list[str], levels: list[str]
) -> None:
    when = moments(np.array([row["time"] for row in rows], np.float64))
    chunks.send_texts(stream, path, Times(when, when, np.arange(len(rows))), texts, levels)
