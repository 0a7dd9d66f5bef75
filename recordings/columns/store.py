"""Decoded columns on disk: any range of any channel, exact or as min/max buckets, quickly at any length.

A file of hours is decoded once, from start to end, into a store; every plot at every zoom is then one query. A store is
two files, mapped into memory, an index and a manifest:

    columns.bin    block after block; a block is up to 65 536 rows of one channel, column by column, and its fine levels
    overview.bin   the coarse levels of the blocks (recordings/columns/downsampling.py defines the offsets in both)
    blocks.npy     one row a block: channel, rows, offsets of its clocks and values, first and last key and arrival
    manifest.json  the channels, and any data of the maker; written last, so a store without one is incomplete

A query reads the coarsest level with at least eight summaries for each bucket: it reads a few hundred kilobytes, never
the whole column.

Values are stored as the device sent them; those in other units are converted as they are read (columns/units.py).

`arrival` and `time` are whole ns. `key`, float s, is the search key in the device base: device time mapped to host
time, or the arrival if there is none, made non-decreasing, because a sample may carry a time older than its
neighbours'. `place` is the position of the packet in its stream: rows with the same arrival and place came in one
packet. Quantities of one message have the same clocks, which are written once.

Stores are a cache: written to a temporary folder and renamed, never changed afterwards, deletable at any time. A store
can be read while it is being made (`ColumnStoreWriter.show`): blocks are only added, and the index is replaced whole.
"""

import copy
import json
import os
import shutil
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from imuscope.protocols.arrays import Array, Floats, Ints
from imuscope.protocols.clocks.unix_time import NO_TIME, nanoseconds, seconds
from imuscope.recordings.columns.downsampling import FAR_LEVELS, LEVELS, LevelOffsets, level_offsets, padding, reduce
from imuscope.recordings.columns.rows import ExactRows, MinMaxBuckets, cuts
from imuscope.recordings.columns.units import Units, described_in, scaled
from imuscope.recordings.system import atomic_write

Base = Literal["device", "arrival"]
Clock = Literal["key", "arrival", "time", "place"]
_CLOCKS: tuple[Clock, ...] = ("key", "arrival", "time", "place")
_EXACT = ("arrival", "time")  # whole ns

VERSION = 6
BLOCK_ROWS = 1 << 16
PER_BUCKET = 8  # least number of summaries in a bucket
INDEX = np.dtype(
    [
        *(("channel", "<u4"), ("rows", "<u4"), ("clocks", "<u8"), ("values", "<u8")),
        *(("far_clocks", "<u8"), ("far_values", "<u8")),
        *(("key0", "<f8"), ("key1", "<f8"), ("arrival0", "<f8"), ("arrival1", "<f8")),
    ]
)
_MAX_CLOCKS = 4  # recently written ones, for sharing: as many messages as interleave closely


@dataclass(frozen=True, slots=True)
class ChannelLayout:
    """The own columns of a channel.

    Args:
        dtypes: as on the wire ("f4", "u2").
        status: for each, whether it is a flag word, summarised by its bits.
        factors: for each, that from the unit in which it is stored to the one in which it is read; none if all are 1.
    """

    dtypes: tuple[str, ...]
    status: tuple[bool, ...]
    factors: tuple[float, ...] = ()


class ColumnStoreWriter:
    """A store being made.

    Args:
        folder: its final place; nothing is there before `finish`.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._temporary = folder.with_name(f".{folder.name}.{os.getpid()}.making")
        shutil.rmtree(self._temporary, ignore_errors=True)
        self._temporary.mkdir(parents=True)
        self._near = _Growing(self._temporary / "columns.bin")
        self._far = _Growing(self._temporary / "overview.bin")
        self._shapes: dict[int, ChannelLayout] = {}
        self._waiting: dict[int, list[Sequence[Array]]] = {}
        self._rows: dict[int, int] = {}
        self._newest: dict[int, float] = {}  # key of the last row written
        self._index: list[tuple[float, ...]] = []
        self._written: deque[tuple[tuple[Array, ...], Array, float, tuple[int, int]]] = deque(maxlen=_MAX_CLOCKS)

    def channel(self, number: int, shape: ChannelLayout) -> None:
        """Declare a channel, before its first rows."""
        self._shapes[number] = shape
        self._waiting[number] = []
        self._rows[number] = 0

    def append(self, number: int, columns: Sequence[Array], place: Array | None = None) -> None:
        """Append rows: `arrival`, `time` (unix ns, or s as floats; NO_TIME or NaN without a clock), then the channel's
        own columns.

        Args:
            place: (n,) position of each row's packet in its stream; None for rows that came in no packet.
        """
        if len(columns[0]) == 0:
            return
        place = np.full(len(columns[0]), -1.0) if place is None else np.asarray(place, np.float64)
        clocks = [one if one.dtype == np.int64 else nanoseconds(one) for one in columns[:2]]
        self._waiting[number].append([*clocks, place, *columns[2:]])
        self._rows[number] += len(columns[0])
        if self._rows[number] >= BLOCK_ROWS:
            self._write(number, everything=False)

    @property
    def temporary(self) -> Path:
        """The folder in which it is made, also for further files of the store."""
        return self._temporary

    def show(self, manifest: Mapping[str, Any]) -> Path:
        """Make the rows appended so far readable while more are added: a folder for ColumnStore, removed by `finish`.

        Raises:
            OSError: the disk failed.
        """
        self._name(manifest)
        return self._temporary

    def finish(self, manifest: Mapping[str, Any]) -> "ColumnStore":
        """Write the remaining rows and the manifest; afterwards the store exists.

        Raises:
            OSError: the disk failed; nothing is left behind.
        """
        try:
            self._name(manifest)
            self._close()
            shutil.rmtree(self._folder, ignore_errors=True)
            atomic_write.replace(self._temporary, self._folder, durable=False)
        except OSError:
            self.abandon()
            raise
        return ColumnStore(self._folder)

    def abandon(self) -> None:
        """Remove everything written."""
        self._close()
        shutil.rmtree(self._temporary, ignore_errors=True)

    def _close(self) -> None:
        self._near.file.close()
        self._far.file.close()

    def _name(self, manifest: Mapping[str, Any]) -> None:
        """Write waiting blocks and the index; concurrent readers have the old index or this one."""
        for number in self._shapes:
            self._write(number, everything=True)
        self._near.file.flush()
        self._far.file.flush()
        index = np.array(self._index, INDEX) if self._index else np.empty(0, INDEX)
        shapes = {str(number): [one.dtypes, one.status, one.factors] for number, one in self._shapes.items()}
        sizes = {"columns.bin": self._near.at, "overview.bin": self._far.at}
        body = json.dumps({**manifest, "version": VERSION, "shapes": shapes, "sizes": sizes}, ensure_ascii=False)
        np.save(self._temporary / "next.npy", index)
        atomic_write.replace(self._temporary / "next.npy", self._temporary / "blocks.npy", durable=False)
        (self._temporary / "next.json").write_text(body, encoding="utf-8")
        atomic_write.replace(self._temporary / "next.json", self._temporary / "manifest.json", durable=False)

    def _write(self, number: int, *, everything: bool) -> None:
        """Write whole blocks of the waiting rows; the rest, too, if `everything`."""
        parts, shape = self._waiting[number], self._shapes[number]
        if not parts:
            return
        joined = [np.concatenate(column) for column in zip(*parts, strict=True)]
        rows, start = len(joined[0]), 0
        while rows - start >= BLOCK_ROWS or (everything and start < rows):
            stop = min(start + BLOCK_ROWS, rows)
            self._block(number, shape, [column[start:stop] for column in joined])
            start = stop
        self._waiting[number] = [[column[start:] for column in joined]] if start < rows else []
        self._rows[number] = rows - start

    def _block(self, number: int, shape: ChannelLayout, columns: list[Array]) -> None:
        arrival, time = (np.ascontiguousarray(column, np.int64) for column in columns[:2])
        newest = self._newest.get(number, -np.inf)
        key, (clocks, far_clocks) = self._clocks((arrival, time, np.ascontiguousarray(columns[2])), newest)
        values, far_values = self._near.at, self._far.at
        own = [column.astype("<" + dtype, copy=False) for column, dtype in zip(columns[3:], shape.dtypes, strict=True)]
        for array in own:
            self._near.put(array)
        low, high, step = own, own, 1
        for level in LEVELS:
            cuts = np.arange(0, -(-len(key) // step), level // step)
            low = [reduce(c, cuts, flags, 0) for c, flags in zip(low, shape.status, strict=True)]
            high = [reduce(c, cuts, flags, 1) for c, flags in zip(high, shape.status, strict=True)]
            step = level
            for array in (*low, *high):
                (self._far if level in FAR_LEVELS else self._near).put(array)
        ends = (float(key[0]), float(key[-1]), *seconds(np.array([arrival.min(), arrival.max()])).tolist())
        self._index.append((number, len(key), clocks, values, far_clocks, far_values, *ends))
        self._newest[number] = float(key[-1])

    def _clocks(self, clocks: tuple[Array, ...], newest: float) -> tuple[Array, tuple[int, int]]:
        """The key of these rows after one of `newest`, and the offsets of their clocks and the levels of these; written
        once if several quantities of a message share them.
        """
        for known, key, before, at in self._written:
            if before == newest and all(np.array_equal(*pair) for pair in zip(known, clocks, strict=True)):
                return key, at
        arrival, time, _ = clocks
        key = seconds(np.where(time == NO_TIME, arrival, time))
        key[0] = max(key[0], newest)
        key = np.maximum.accumulate(key)
        at = self._near.at, self._far.at
        for array in (key, *clocks):
            self._near.put(array)
        for level in LEVELS:
            file = self._far if level in FAR_LEVELS else self._near
            file.put(np.ascontiguousarray(key[::level]))
            file.put(seconds(arrival[::level]))
        self._written.append((clocks, key, newest, at))
        return key, at


class _Growing:
    """A file to which columns are appended."""

    def __init__(self, path: Path) -> None:
        self.file = path.open("wb", buffering=1 << 20)
        self.at = 0

    def put(self, array: Array) -> None:
        self.file.write(array.data)
        self.file.write(bytes(padding(array.nbytes)))
        self.at += array.nbytes + padding(array.nbytes)


class ColumnStore:
    """A store, for queries. Threads may share it.

    Attributes:
        units: those of its values and of its manifest; `in_units` has others.

    Args:
        folder: made by ColumnStoreWriter.

    Raises:
        OSError, ValueError: it is missing, of another version, or damaged: make it again.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            self._load(folder)
        except (TypeError, KeyError, AttributeError, IndexError, EOFError, RecursionError, OverflowError) as error:
            raise ValueError(f"the columns in {folder.name} are damaged: {type(error).__name__}") from None

    def _load(self, folder: Path) -> None:
        self.manifest: dict[str, Any] = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
        if self.manifest.get("version") != VERSION:
            raise ValueError(f"columns of version {self.manifest.get('version')}, not {VERSION}")
        shapes = self.manifest["shapes"]
        self.shapes = {int(number): ChannelLayout(*map(tuple, own)) for number, own in shapes.items()}
        index = np.load(folder / "blocks.npy")
        self._near, self._far = _mapped(folder / "columns.bin"), _mapped(folder / "overview.bin")
        self._blocks = {number: index[index["channel"] == number] for number in self.shapes}
        self._firsts = {
            number: np.cumsum(entries["rows"]) - entries["rows"] for number, entries in self._blocks.items()
        }
        self._rows = {number: int(entries["rows"].sum()) for number, entries in self._blocks.items()}
        self._own = {number: [np.dtype("<" + dtype) for dtype in shape.dtypes] for number, shape in self.shapes.items()}
        self._places: dict[int, LevelOffsets] = {}  # of the channels that were read
        self.units: Units = "shown"
        self._as_shown, self._views = (self.shapes, self.manifest), dict[Units, ColumnStore]()
        self._check(folder)

    def _check(self, folder: Path) -> None:
        """Raise ValueError if the files are too short for their manifest, or hold other times than their index."""
        for name, file in (("columns.bin", self._near), ("overview.bin", self._far)):
            if len(file) < self.manifest["sizes"][name]:
                raise ValueError(f"{name} in {folder.name} is too short")
        for entries in self._blocks.values():
            for block in {0, len(entries) - 1} if len(entries) else ():
                at, n = int(entries["clocks"][block]), int(entries["rows"][block])
                key = self._near[at : at + 8 * n].view("<f8")
                if (key[0], key[-1]) != (entries["key0"][block], entries["key1"][block]):
                    raise ValueError(f"columns.bin in {folder.name} does not hold what its index names")

    def in_units(self, units: Units) -> "ColumnStore":
        """The same columns in other units; so is the manifest."""
        if units not in self._views:
            view = self._views[units] = copy.copy(self)
            shapes, manifest = self._as_shown
            view.units, view.shapes, channels = units, dict(shapes), []
            for info in manifest["channels"] if units != "shown" else ():
                described, factors = described_in(info, shapes[info["id"]].factors, units)
                dtypes = tuple(column["dtype"] for column in described["columns"])
                view.shapes[info["id"]] = replace(shapes[info["id"]], dtypes=dtypes, factors=factors)
                channels.append(described)
            view.manifest = {**manifest, "channels": channels} if units != "shown" else manifest
        return self._views[units]

    def rows(self, channel: int) -> int:
        """Number of rows of a channel."""
        return self._rows[channel]

    def span(self, channel: int | None = None, base: Base = "device") -> tuple[float, float] | None:
        """First and last time of a channel, or of all; None without rows."""
        name = "key" if base == "device" else "arrival"
        parts = [self._blocks[channel]] if channel is not None else list(self._blocks.values())
        ends = [(entries[f"{name}0"].min(), entries[f"{name}1"].max()) for entries in parts if len(entries)]
        return (float(min(a for a, _ in ends)), float(max(b for _, b in ends))) if ends else None

    def query(
        self,
        channel: int,
        t0: float,
        t1: float,
        width: int = 0,
        *,
        columns: Sequence[int] | None = None,
        base: Base = "device",
    ) -> ExactRows | MinMaxBuckets:
        """The rows with t0 ≤ t ≤ t1.

        Args:
            width: number of buckets; rows are returned as stored if there are at most twice as many, and always with
                0.
            columns: the channel's own columns, by position; None for all.
            base: which time `t` is.
        """
        selected = range(len(self.shapes[channel].dtypes)) if columns is None else columns
        lo, hi = self._row(channel, t0, "left", base), self._row(channel, t1, "right", base)
        if width <= 0 or hi - lo <= 2 * width:
            return self.exact(channel, lo, hi, columns=selected)
        return self._buckets(channel, lo, hi, (t0, t1, width), selected, base)

    def exact(self, channel: int, lo: int, hi: int, *, columns: Sequence[int] | None = None) -> ExactRows:
        """Rows lo ≤ row < hi, in stream order."""
        selected = range(len(self.shapes[channel].dtypes)) if columns is None else columns
        names: list[Any] = ["arrival", "time", *selected]
        parts: list[list[Array]] = [[] for _ in names]
        for block, a, b in self._within(channel, lo, hi):
            for part, name in zip(parts, names, strict=True):
                part.append(self._column(channel, block, name)[a:b])
        dtypes = ["i8", "i8", *(self.shapes[channel].dtypes[i] for i in selected)]
        whole = [np.concatenate(p) if p else np.empty(0, "<" + d) for p, d in zip(parts, dtypes, strict=True)]
        return ExactRows(whole[0], whole[1], whole[2:])

    def thinned(self, channel: int, t0: float, t1: float, most: int, *, base: Base = "device") -> ExactRows:
        """At most `most` of the rows with t0 ≤ t ≤ t1, evenly chosen, always with the last: an attitude needs samples,
        its least and greatest components are meaningless.
        """
        lo, hi = self._row(channel, t0, "left", base), self._row(channel, t1, "right", base)
        if hi - lo <= most:
            return self.exact(channel, lo, hi)
        chosen = np.unique(np.linspace(lo, hi - 1, most).astype(np.int64))
        columns: list[list[Array]] = []
        for block, a, b in self._within(channel, lo, hi):
            first = int(self._firsts[channel][block])
            rows = chosen[np.searchsorted(chosen, first + a) : np.searchsorted(chosen, first + b)] - first
            names: list[Any] = ["arrival", "time", *range(len(self.shapes[channel].dtypes))]
            columns.append([self._column(channel, block, name)[rows] for name in names])
        whole = [np.concatenate(column) for column in zip(*columns, strict=True)]
        return ExactRows(whole[0], whole[1], whole[2:])

    def row_at(self, channel: int, t: float, base: Base = "device") -> int:
        """The last row with time ≤ t; −1 without one."""
        return self._row(channel, t, "right", base) - 1

    def between(self, channel: int, t0: float, t1: float, base: Base = "device") -> tuple[int, int]:
        """The rows with t0 ≤ t ≤ t1: the first, and one past the last."""
        lo = self._row(channel, t0, "left", base)
        return lo, max(lo, self._row(channel, t1, "right", base))

    def clock(self, channel: int, lo: int, hi: int, name: Clock = "key") -> Floats:
        """One clock of the rows lo ≤ row < hi, s; `key` is the non-decreasing search key."""
        parts = [self._column(channel, block, name)[a:b] for block, a, b in self._within(channel, lo, hi)]
        return np.concatenate([seconds(one) if name in _EXACT else one for one in parts]) if parts else np.empty(0)

    def clock_ns(self, channel: int, lo: int, hi: int, name: Literal["arrival", "time"]) -> Ints:
        """As `clock`, in whole ns."""
        parts = [self._column(channel, block, name)[a:b] for block, a, b in self._within(channel, lo, hi)]
        return np.concatenate(parts) if parts else np.empty(0, np.int64)

    def values(self, channel: int, column: int, lo: int, hi: int) -> Iterator[Array]:
        """One own column of the rows lo ≤ row < hi, block by block."""
        for block, a, b in self._within(channel, lo, hi):
            yield self._column(channel, block, column)[a:b]

    # -- finding rows --------------------------------------------------------------------------------------------------

    def _row(self, channel: int, t: float, side: Literal["left", "right"], base: Base) -> int:
        blocks = self._blocks[channel]
        if not len(blocks):
            return 0
        name: Clock = "key" if base == "device" else "arrival"
        at = int(np.searchsorted(blocks[f"{name}1"], t, side))
        if at == len(blocks):
            return self.rows(channel)
        values = self._column(channel, at, name)
        if name in _EXACT:
            values = seconds(values)
        return int(self._firsts[channel][at]) + int(np.searchsorted(values, t, side))

    def _within(self, channel: int, lo: int, hi: int) -> list[tuple[int, int, int]]:
        """(block, first, past the last) of the rows lo ≤ row < hi."""
        firsts, rows = self._firsts[channel], self._blocks[channel]["rows"]
        start = max(int(np.searchsorted(firsts, lo, "right")) - 1, 0)
        positions = []
        for block in range(start, len(firsts)):
            first, n = int(firsts[block]), int(rows[block])
            if first >= hi:
                break
            if first + n > lo:
                positions.append((block, max(lo - first, 0), min(hi - first, n)))
        return positions

    def _buckets(
        self, channel: int, lo: int, hi: int, grid: tuple[float, float, int], selected: Sequence[int], base: Base
    ) -> MinMaxBuckets:
        width = grid[2]
        step = max((level for level in (1, *LEVELS) if (hi - lo) // level >= PER_BUCKET * width), default=1)
        status = self.shapes[channel].status
        name: Clock = "key" if base == "device" else "arrival"
        times: list[Array] = []
        counts: list[Array] = []
        lows: list[list[Array]] = [[] for _ in selected]
        highs: list[list[Array]] = [[] for _ in selected]
        for block, a, b in self._within(channel, lo, hi):
            rows = int(self._blocks[channel]["rows"][block])
            first, past = a // step, -(-b // step)  # summaries across an end are included: nothing is hidden
            t = self._column(channel, block, name, step)[first:past]
            times.append(seconds(t) if step == 1 and name in _EXACT else t)
            n = np.full(past - first, step, np.int64)
            if past * step > rows and past > first:
                n[-1] = rows - (past - 1) * step
            counts.append(n)
            for i, column in enumerate(selected):
                lows[i].append(self._column(channel, block, column, step, 0)[first:past])
                highs[i].append(self._column(channel, block, column, step, 1)[first:past])
        t = np.concatenate(times)
        at = cuts(t, grid)
        return MinMaxBuckets(
            t[at],
            np.add.reduceat(np.concatenate(counts), at),
            [reduce(np.concatenate(low), at, status[c], 0) for low, c in zip(lows, selected, strict=True)],
            [reduce(np.concatenate(high), at, status[c], 1) for high, c in zip(highs, selected, strict=True)],
        )

    # -- offsets of columns --------------------------------------------------------------------------------------------

    def _column(self, channel: int, block: int, name: Clock | int, step: int = 1, which: int = 0) -> Array:
        """One column of a block: its rows (step 1), or a level: `which` 0 the least, 1 the greatest values."""
        n = -(-int(self._blocks[channel]["rows"][block]) // step)
        data, where = self._far if step in FAR_LEVELS else self._near, self._places.get(channel)
        if where is None:
            sizes = [dtype.itemsize for dtype in self._own[channel]]
            where = self._places[channel] = level_offsets(self._blocks[channel], sizes)
        if isinstance(name, str):
            at = int(where.clocks[step][block, _CLOCKS.index(name)])
            return data[at : at + 8 * n].view("<i8" if step == 1 and name in _EXACT else "<f8")
        dtype = self._own[channel][name]
        at = int(where.values[step][block, name + (len(self._own[channel]) if which and step > 1 else 0)])
        values = data[at : at + n * dtype.itemsize].view(dtype)
        shape = self.shapes[channel]
        factor = shape.factors[name] if shape.factors else 1.0
        return values if factor == 1 else scaled(values.astype(shape.dtypes[name], copy=False), factor)


def _mapped(path: Path) -> Array:
    """A file's bytes. Not np.memmap: it slices in Python, and a query takes a thousand slices."""
    return np.asarray(np.memmap(path, np.uint8, "r")) if path.stat().st_size else np.empty(0, np.uint8)
