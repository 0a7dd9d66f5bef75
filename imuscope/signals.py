"""A signal of a recording: samples of one quantity of one device as arrays, tables and parts."""

from __future__ import annotations

import datetime
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats, Ints
from imuscope.protocols.clocks.unix_time import NO_TIME, seconds

if TYPE_CHECKING:
    import pandas
    import polars
    import pyarrow

    from imuscope.recordings.columns.store import ColumnStore

Moment = float | datetime.datetime | np.datetime64


class ImuscopeError(Exception):
    """Something that cannot be opened, found, analysed or exported: one sentence, and what to do."""


@dataclass(frozen=True, slots=True)
class Device:
    """A device of a recording.

    Args:
        id: unique in the recording.
        protocol: "xbus", "isb", "idtp", or "" of a file that is not of a device's bytes.
    """

    id: str
    name: str
    protocol: str
    product: str
    serial_number: str
    firmware: str


@dataclass(frozen=True)
class Signal:
    """Samples of one quantity of one device: all of them, or a range.

    Args:
        name: as the protocol's document has it, "RateOfTurn".
        title: as the page shows it, "Rate of turn".
        message: that carries it, "MTData2".
        columns: a name for each column, ("x", "y", "z").
        units: of each column; "" where it has none.
        frame: of reference, "ENU from body"; "" where it has none or it is not known.
        kind: "vector", "scalar", "quaternion", "status", "counter", "table" …
        doc: what it is; source: the section of the document.
        start, stop: rows of the recording.
    """

    device: Device
    name: str
    title: str
    message: str
    columns: tuple[str, ...]
    units: tuple[str, ...]
    frame: str
    kind: str
    doc: str
    source: str
    start: int
    stop: int
    _store: ColumnStore
    _channel: int
    _own: tuple[int, ...]

    def __len__(self) -> int:
        return self.stop - self.start

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.values, dtype, copy=copy)

    def __getitem__(self, rows: slice) -> Signal:
        """Some of the samples, by their place: `signal[100:200]`.

        Raises:
            ImuscopeError: it is no slice, or one with a step.
        """
        if not isinstance(rows, slice) or rows.step not in (None, 1):
            raise ImuscopeError(f"{self.title}[{rows!r}]: give a range of samples, [100:200]; `column` has one column.")
        lo, hi, _ = rows.indices(len(self))
        return self._part(self.start + lo, self.start + hi)

    def __repr__(self) -> str:
        units = ", ".join(dict.fromkeys(filter(None, self.units)))
        return f"<Signal {self.title!r} of {self.device.name}: {len(self)} × {len(self.columns)} {units}".rstrip() + ">"

    @functools.cached_property
    def time_ns(self) -> Ints:
        """(n,) unix ns: the device's clock, mapped to the host's; the arrival where a message has no device time."""
        times = self._store.clock_ns(self._channel, self.start, self.stop, "time")
        return _constant(np.where(times == NO_TIME, self.arrival_ns, times))

    @functools.cached_property
    def arrival_ns(self) -> Ints:
        """(n,) unix ns: when the bytes arrived at the host."""
        return _constant(self._store.clock_ns(self._channel, self.start, self.stop, "arrival"))

    @functools.cached_property
    def time(self) -> Floats:
        """(n,) unix s, as near to `time_ns` as a float is: 0.2 µs."""
        return _constant(seconds(self.time_ns))

    @functools.cached_property
    def arrival(self) -> Floats:
        """(n,) unix s, as near to `arrival_ns` as a float is."""
        return _constant(seconds(self.arrival_ns))

    @functools.cached_property
    def values(self) -> NDArray[Any]:
        """(n,) of one column, (n, columns) of several of one type; use `column` for those of different types."""
        columns = [self.column(k) for k in range(len(self.columns))]
        return columns[0] if len(columns) == 1 else _constant(np.column_stack(columns))

    @property
    def rate(self) -> float:
        """Samples per second, by the usual step between them; NaN of fewer than two."""
        steps = np.diff(self.time)
        steps = steps[steps > 0]
        return 1 / float(np.median(steps)) if len(steps) else float("nan")

    def values_in(self, unit: str) -> Floats:
        """The values in another unit of the same quantity: "rad/s", "g", "m/s²", "T".

        >>> gyr.values_in("°/s")[1].round(3).tolist()
        [28.648, 57.296, 0.0]

        Raises:
            ImuscopeError: a column has a unit of another quantity, or none.
        """
        from imuscope.server.extensions.analysis.signals.units import Unit

        wanted = Unit.parse(unit)
        factors = []
        for name, text in zip(self.columns, self.units, strict=True):
            own = Unit.parse(text)
            if not text or own.dimensions != wanted.dimensions:
                has = f"is in {text}" if text else "has no unit"
                raise ImuscopeError(f"{self.title}.{name} {has}, which cannot be given in {unit!r}.")
            factors.append(own.factor / wanted.factor)
        values: Floats = np.asarray(self.values, np.float64) * (factors[0] if len(factors) == 1 else np.array(factors))
        return values

    def column(self, name: str | int) -> NDArray[Any]:
        """(n,) one column, by its name or number.

        >>> gyr.column("x")[:3].tolist()
        [0.0, 0.5, 1.0]

        Raises:
            ImuscopeError: there is none of that name.
        """
        at = self.columns.index(name) if name in self.columns else name
        if not isinstance(at, int) or not -len(self.columns) <= at < len(self.columns):
            raise ImuscopeError(f"{self.title} has no column {name!r}; it has: {', '.join(self.columns)}")
        at = self._own[at]
        parts = list(self._store.values(self._channel, at, self.start, self.stop))
        return _constant(np.concatenate(parts) if parts else np.empty(0, self._store.shapes[self._channel].dtypes[at]))

    def between(self, begin: Moment, end: Moment) -> Signal:
        """The samples from `begin` to `end`, both included.

        Args:
            begin, end: seconds from the beginning of the recording, or moments: `datetime`, `numpy.datetime64` or
                `pandas.Timestamp` (UTC where they name no zone).

        >>> gyr.between(0, 0.015).values.tolist()
        [[0.0, 0.0, 0.0], [0.5, 1.0, 0.0]]

        Raises:
            ImuscopeError: the end is before the beginning, or they are no moments.
        """
        origin = self._store.manifest["started"] or 0.0
        t0, t1 = _unix_of(begin, origin), _unix_of(end, origin)
        if t1 < t0:
            raise ImuscopeError(f"between({begin!r}, {end!r}) of {self.title}: the end is before the beginning.")
        lo, hi = self._store.between(self._channel, t0, t1)
        return self._part(max(lo, self.start), min(hi, self.stop))

    def segments(self) -> list[Signal]:
        """The signal in parts, cut where the clock was set or the device restarted: times rise within each.

        >>> [len(part) for part in gyr.segments()]
        [12, 8]
        """
        starts = self._store.manifest.get("segments", {}).get(self.device.id, ())
        time = self._store.clock(self._channel, self.start, self.stop, "key")
        cuts = [int(at) for at in np.searchsorted(time, starts)]
        edges = [0, *sorted({cut for cut in cuts if 0 < cut < len(self)}), len(self)]
        return [self._part(self.start + a, self.start + b) for a, b in pairwise(edges) if b > a]

    def to_arrow(self) -> pyarrow.Table:
        """A table with `time`, `arrival` (moments to the ns, UTC) and a column for each of this signal's; units and
        frame in its metadata.

        >>> gyr.to_arrow().column_names
        ['time', 'arrival', 'x', 'y', 'z']
        """
        import pyarrow as pa

        moment = pa.timestamp("ns", "UTC")
        arrays = [pa.array(clock, moment) for clock in (self.time_ns, self.arrival_ns)]
        arrays += [pa.array(self.column(k)) for k in range(len(self.columns))]
        units = ("", "", *self.units)
        names = ("time", "arrival", *_distinct(self.columns))
        fields = [
            pa.field(name, array.type, metadata={"unit": unit} if unit else None)
            for name, array, unit in zip(names, arrays, units, strict=True)
        ]
        about = {"name": self.name, "title": self.title, "device": self.device.name, "frame": self.frame}
        schema = pa.schema(fields, metadata={key: value for key, value in about.items() if value})
        return pa.table(arrays, schema=schema)

    def to_pandas(self) -> pandas.DataFrame:
        """The table in pandas, with the time as its index, UTC."""
        _pandas()
        return self.to_arrow().to_pandas().set_index("time")

    def to_polars(self) -> polars.DataFrame:
        """The table in Polars."""
        try:
            import polars
        except ImportError:
            raise ImuscopeError("Polars is not installed: pip install polars.") from None
        return polars.DataFrame(self.to_arrow())

    def _part(self, start: int, stop: int) -> Signal:
        return replace(self, start=start, stop=max(start, stop))


def column_of(signal: Signal, column: str) -> Signal:
    """A signal with one of its columns alone."""
    at = signal.columns.index(column)
    return replace(
        signal,
        name=f"{signal.name}.{column}",
        title=f"{signal.title}.{column}",
        columns=(column,),
        units=(signal.units[at],),
        kind="scalar",
        _own=(signal._own[at],),  # noqa: SLF001 - of the same class
    )


def column_names(info: Mapping[str, Any]) -> tuple[str, ...]:
    """Names of a channel's columns: of angles "roll", of a vector "x"."""
    own = "name" if info["kind"] == "euler" else "axis"
    return tuple(one[own] or one["name"] for one in info["columns"])


def _constant(values: NDArray[Any]) -> NDArray[Any]:
    """The array, read-only: a cached one is shared by all who ask for it."""
    values.flags.writeable = False
    return values


def _unix_of(moment: Moment, origin: float) -> float:
    """Unix s of a moment; a number counts from `origin`."""
    if isinstance(moment, np.datetime64):
        return float((moment - np.datetime64(0, "s")) / np.timedelta64(1, "ns")) / 1e9
    if isinstance(moment, datetime.datetime):
        zone = moment.tzinfo or datetime.UTC
        return moment.replace(tzinfo=zone).timestamp()
    if isinstance(moment, (int, float, np.integer, np.floating)):
        return origin + float(moment)
    raise ImuscopeError(f"{moment!r} is no moment: give seconds from the beginning, or a datetime.")


def _distinct(names: Sequence[str]) -> list[str]:
    """The names, numbered where two are the same."""
    result: list[str] = []
    for name in names:
        count = sum(other == name or other.startswith(f"{name} (") for other in result)
        result.append(f"{name} ({count + 1})" if count else name)
    return result


def _pandas() -> Any:
    try:
        import pandas
    except ImportError:
        raise ImuscopeError("pandas is not installed: pip install pandas.") from None
    return pandas
