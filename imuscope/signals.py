"""A signal of a recording: samples of one quantity of one device as arrays, tables and parts."""

from __future__ import annotations

import datetime
import functools
import html
import importlib
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats, Ints
from imuscope.protocols.clocks.unix_time import NO_TIME, seconds
from imuscope.protocols.schema.units import Unit
from imuscope.recordings.columns.units import UNITS, Units
from imuscope.recordings.errors import ExplainedError, near_miss

if TYPE_CHECKING:
    import pandas
    import polars
    import pyarrow
    import xarray

    from imuscope.recordings.columns.store import ColumnStore

Moment = float | datetime.datetime | np.datetime64
P = ParamSpec("P")
R = TypeVar("R")
UNUSABLE = (TypeError, ValueError, AttributeError, LookupError, ArithmeticError, OSError)
"""Errors of arguments of the wrong type or size, and of columns that are gone; the ImuscopeError names the cause."""


class ImuscopeError(Exception):
    """Something that cannot be opened, found, analysed or exported: one sentence, and what to do."""


def choice(option: str, value: str, known: Sequence[str]) -> None:
    """ImuscopeError for a value that is none of an option's."""
    if value not in known:
        raise ImuscopeError(
            f"{option}={value!r} is unknown{near_miss(str(value), known)}; it can be: {', '.join(known)}"
        )


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """The function, which raises ImuscopeError alone: for unknown options, arguments that it cannot use, and errors of
    files and analyses.
    """
    signature = inspect.signature(function)
    own = signature.parameters
    takes_others = any(one.kind is one.VAR_KEYWORD for one in own.values())

    @functools.wraps(function)
    def call(*args: P.args, **options: P.kwargs) -> R:
        for name in () if takes_others else options:
            if name not in own:
                near = near_miss(name, [*own][1:])
                raise ImuscopeError(f"{function.__name__} has no option {name!r}{near}.")
        try:
            arguments = signature.bind(*args, **options).arguments
        except TypeError as error:
            raise ImuscopeError(f"{function.__name__}: {error}.") from None
        try:
            return function(*args, **options)
        except ExplainedError as error:
            raise ImuscopeError(error.text) from None
        except UNUSABLE as error:
            listed = ", ".join(f"{name}={value!r:.60}" for name, value in arguments.items() if name != "self")
            raise ImuscopeError(f"{function.__name__}({listed}): {str(error) or type(error).__name__}.") from error

    return call


@dataclass(frozen=True, slots=True)
class Event:
    """An event of a recording: a loss, a step of a clock, a reset, a note.

    Args:
        time: unix s.
        device: id of the device; "" of the recording.
        kind: one word: "gap", "clock", "reset" …
        level: "info", "warning" or "error".
        data: figures of it, by name.
    """

    time: float
    device: str
    kind: str
    level: str
    text: str
    data: Mapping[str, Any]


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
        frame: of reference, "body", "ENU from body"; "" where it has none or it is not known.
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

    @checked
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

    def _repr_html_(self) -> str:
        """Its first and last samples, for notebooks."""
        ends = [*range(len(self))] if len(self) <= 6 else [0, 1, 2, len(self) - 3, len(self) - 2, len(self) - 1]
        heads = [f"{name} ({unit})" if unit else name for name, unit in zip(self.columns, self.units, strict=True)]
        columns = [self.time_ns.astype("datetime64[ns]"), *(self.column(k) for k in range(len(self.columns)))]
        rows = [[str(ends_at), *(str(column[ends_at]) for column in columns)] for ends_at in ends]
        return html_table(f"{self!r} {self.frame}".strip(), ("", "time (UTC)", *heads), rows)

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

    @checked
    def values_in(self, unit: str) -> Floats:
        """The values in another unit of the same quantity: "rad/s", "g", "m/s²", "T".

        >>> gyr.values_in("°/s")[1].round(3).tolist()
        [28.648, 57.296, 0.0]

        Raises:
            ImuscopeError: a column has a unit of another quantity, or none.
        """
        wanted, sent = Unit.parse(unit), self.in_units("device")
        factors = []
        for name, text, shown in zip(self.columns, sent.units, self.units, strict=True):
            own = Unit.parse(text)
            if not text or own.dimensions != wanted.dimensions:
                has = f"is in {shown}" if shown else "has no unit"
                raise ImuscopeError(f"{self.title}.{name} {has}, which cannot be given in {unit!r}.")
            factors.append(own.factor / wanted.factor)
        values: Floats = np.asarray(sent.values, np.float64) * (factors[0] if len(factors) == 1 else np.array(factors))
        return values

    @checked
    def in_units(self, units: Units) -> Signal:
        """The same samples in other units.

        >>> gyr.in_units("device").units
        ('rad/s', 'rad/s', 'rad/s')

        Args:
            units: "shown": those of the page, °/s and µT; "device": those in which they were sent, bit by bit; "SI":
                rad/s, rad, m/s², T and Pa, in 64 bits where that is a conversion. °C and units of their own stay.
        """
        choice("units", units, UNITS)
        store = self._store.in_units(units)
        [columns] = [one["columns"] for one in store.manifest["channels"] if one["id"] == self._channel]
        return replace(self, units=tuple(columns[at]["unit"] for at in self._own), _store=store)

    @checked
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

    @checked
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

    @checked
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

    @checked
    def to_arrow(self, *, units: Units = "shown") -> pyarrow.Table:
        """A table with `time`, `arrival` (moments to the ns, UTC) and a column for each of this signal's; units and
        frame in its metadata.

        >>> gyr.to_arrow().column_names
        ['time', 'arrival', 'x', 'y', 'z']

        Args:
            units: "shown": those of the page; "device": as sent; "SI", in 64 bits where that is a conversion.
        """
        import pyarrow as pa

        moment = pa.timestamp("ns", "UTC")
        columns, by_unit = self._columns(units)
        arrays = [
            *(pa.array(clock, moment) for clock in (self.time_ns, self.arrival_ns)),
            *map(pa.array, columns.values()),
        ]
        fields = [
            pa.field(name, array.type, metadata={"unit": unit} if (unit := by_unit.get(name)) else None)
            for name, array in zip(("time", "arrival", *columns), arrays, strict=True)
        ]
        return pa.table(arrays, schema=pa.schema(fields, metadata=self._about))

    @checked
    def to_pandas(self, *, units: Units = "shown") -> pandas.DataFrame:
        """The table in pandas, with the time as its index, UTC; units by column in its `attrs`."""
        package("pandas")
        frame = self.to_arrow(units=units).to_pandas().set_index("time")
        frame.attrs["units"] = self._columns(units)[1]
        return frame

    @checked
    def to_polars(self, *, units: Units = "shown") -> polars.DataFrame:
        """The table in Polars."""
        frame: polars.DataFrame = package("polars", "Polars").DataFrame(self.to_arrow(units=units))
        return frame

    @checked
    def to_xarray(self, *, units: Units = "shown") -> xarray.Dataset:
        """A variable for each column over `time` (UTC), with its unit; frame and names in the attributes."""
        return dataset(self.time_ns, *self._columns(units), self._about)

    @property
    def _about(self) -> dict[str, str]:
        about = {"name": self.name, "title": self.title, "device": self.device.name, "frame": self.frame}
        return {key: value for key, value in about.items() if value}

    def _columns(self, units: Units) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
        """Columns and their units, by names that differ."""
        own, names = self.in_units(units), distinct(self.columns)
        return {name: own.column(k) for k, name in enumerate(names)}, dict(zip(names, own.units, strict=True))

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


def frame_of(info: Mapping[str, Any]) -> str:
    """Frame of reference of a channel: three axes without one are those of the body."""
    is_body = info["kind"] == "vector" and [one["axis"] for one in info["columns"]] == ["x", "y", "z"]
    return info["frame"] or ("body" if is_body else "")


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


def distinct(names: Sequence[str]) -> list[str]:
    """The names, numbered where two are the same."""
    result: list[str] = []
    for name in names:
        count = sum(other == name or other.startswith(f"{name} (") for other in result)
        result.append(f"{name} ({count + 1})" if count else name)
    return result


def package(name: str, title: str = "") -> Any:
    """A package that not everyone has.

    Raises:
        ImuscopeError: it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise ImuscopeError(f"{title or name} is not installed: pip install {name}.") from None


def dataset(
    time_ns: Ints, columns: Mapping[str, NDArray[Any]], units: Mapping[str, str], about: Mapping[str, str]
) -> xarray.Dataset:
    """Columns over `time` in xarray, each with its unit."""
    made: xarray.Dataset = package("xarray").Dataset(
        {name: ("time", values, {"units": units[name]} if units[name] else {}) for name, values in columns.items()},
        {"time": time_ns.astype("datetime64[ns]")},
        about,
    )
    return made


def html_table(caption: str, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table for notebooks."""
    cells = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    head = "".join(f"<th>{html.escape(one)}</th>" for one in heads)
    return f"<p>{html.escape(caption)}</p><table><thead><tr>{head}</tr></thead><tbody>{cells}</tbody></table>"
