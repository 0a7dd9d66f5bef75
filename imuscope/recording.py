"""A recording, or any other file that imuscope opens, as arrays: `imuscope.open`.

The file is decoded once into columns on disk, in a temporary folder that goes when the recording is closed; a signal
reads no more of them than is asked of it.

Times are unix s. Values have the type in which the device sent them; units and frames are beside them, not in the
values. Nothing is interpolated, and nothing runs across a step of the clock unless you do that: `Signal.segments`.

The examples here are of this table, whose clock goes back:

>>> import tempfile
>>> file = Path(tempfile.mkdtemp(), "walk.csv")
>>> times = [1500000000 + k / 100 - (2 if k >= 12 else 0) for k in range(20)]
>>> rows = [f"{time:.2f},{k / 2},{k},0" for k, time in enumerate(times)]
>>> _ = file.write_text("\\n".join(["time (s),gyr_x (rad/s),gyr_y (rad/s),gyr_z (rad/s)", *rows]))
>>> recording = open(file)
>>> recording
<Recording walk.csv: walk; 2 signals, 0.280 s>
>>> gyr = recording["gyr"]
>>> gyr
<Signal 'gyr' of walk: 20 × 3 rad/s>
"""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Literal

from imuscope.recordings.columns.units import UNITS, Units
from imuscope.recordings.errors import near_miss
from imuscope.signals import (
    Device,
    Event,
    ImuscopeError,
    Signal,
    checked,
    choice,
    column_names,
    column_of,
    dataset,
    frame_of,
    html_table,
    package,
)

if TYPE_CHECKING:
    import pandas
    import xarray

    from imuscope.frames import Align, Frame
    from imuscope.recordings.columns.store import ColumnStore
    from imuscope.results import Calibration, CalibrationKind, Comparison, MessageClocks


class Recording:
    """An opened file. Close it, or use it in `with`: its columns are in a temporary folder.

    Attributes:
        path: of the file.
        devices: in the order of the file.
        signals: of all devices.
        events: in the order of time.
        start, end: unix s of the first and the last sample; None in a file without samples.
        remarks: what is damaged in the file, was left out of it or could not be read, in sentences: cells of a table by
            column and row.
        clock: which clock is the time axis of a file that imuscope did not record, why, and how sure that is; {} of a
            device's bytes, whose clock is known.
    """

    def __init__(self, path: Path, store: ColumnStore, folder: Path) -> None:
        self.path = path
        self._store = store
        self._finalizer = weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        manifest = store.manifest
        self.start: float | None = manifest["started"]
        self.end: float | None = manifest["ended"]
        self.clock: Mapping[str, Any] = manifest.get("time") or {}
        self.remarks = tuple(str(one["words"]) for one in manifest.get("damage", ()))
        fields = ("id", "name", "protocol", "product", "serial_number", "firmware")
        self.devices = tuple(Device(**{name: one[name] for name in fields}) for one in manifest["devices"])
        by_id = {one.id: one for one in self.devices}
        self.signals = tuple(
            self._signal(info, by_id[info["device"]]) for info in manifest["channels"] if store.rows(info["id"])
        )
        self.events = tuple(
            Event(one["time"], one["device"], one["kind"], one["level"], one["text"], one["data"])
            for one in manifest["events"]
            if "text" in one
        )

    def _signal(self, info: Mapping[str, Any], device: Device) -> Signal:
        columns = info["columns"]
        return Signal(
            device=device,
            name=info["name"],
            title=info["title"],
            message=info["message"],
            columns=column_names(info),
            units=tuple(one["unit"] for one in columns),
            frame=frame_of(info),
            kind=info["kind"],
            doc=info["doc"],
            source=info["source"],
            start=0,
            stop=self._store.rows(info["id"]),
            _store=self._store,
            _channel=info["id"],
            _own=tuple(range(len(columns))),
        )

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __iter__(self) -> Iterator[Signal]:
        return iter(self.signals)

    def __len__(self) -> int:
        return len(self.signals)

    def keys(self) -> list[str]:
        """Names under which its signals are found, without those of columns: "DEVICE/NAME" where devices share one."""
        names = Counter(one.name for one in self.signals)
        return [one.name if names[one.name] == 1 else f"{one.device.name}/{one.name}" for one in self.signals]

    def __contains__(self, name: object) -> bool:
        """Whether a signal, or a column of one, is found under this name."""
        return isinstance(name, str) and len(self._named(name)) == 1

    @checked
    def get(self, name: str, default: Signal | None = None) -> Signal | None:
        """The signal of this name; `default` where there is none, or several."""
        named = self._named(name)
        return named[0] if len(named) == 1 else default

    def _named(self, name: str) -> list[Signal]:
        """The signals of a name, title or "SIGNAL.COLUMN", each also after "DEVICE/"."""

        def own(text: str, of: Sequence[Signal]) -> list[Signal]:
            named = [one for one in of if text in (one.name, one.title)]
            signal, _, column = text.rpartition(".")
            parts = [column_of(one, column) for one in of if signal in (one.name, one.title) and column in one.columns]
            return named or parts

        device, slash, rest = name.rpartition("/")
        of = [one for one in self.signals if slash and device in (one.device.id, one.device.name)]
        return own(name, self.signals) or own(rest, of)

    def _repr_html_(self) -> str:
        """A table of its signals, for notebooks."""
        heads = ("device", "signal", "columns", "unit", "frame", "samples", "Hz")
        rows = [
            (
                one.device.name,
                one.name,
                ", ".join(one.columns),
                ", ".join(dict.fromkeys(filter(None, one.units))),
                one.frame,
                str(len(one)),
                f"{one.rate:.4g}",
            )
            for one in self.signals
        ]
        return html_table(repr(self), heads, rows)

    def __repr__(self) -> str:
        lasts = f"{self.end - self.start:.3f} s" if self.start is not None and self.end is not None else "no samples"
        devices = ", ".join(one.name for one in self.devices)
        return f"<Recording {self.path.name}: {devices}; {len(self.signals)} signals, {lasts}>"

    @checked
    def __getitem__(self, name: str) -> Signal:
        """The signal of this name or title; "SIGNAL.COLUMN" is one column, "DEVICE/NAME" that of one device.

        Raises:
            ImuscopeError: there is none, or several; the message lists them.
        """
        if not isinstance(name, str):
            raise ImuscopeError(f"{name!r} is no name of a signal; `signals` has them in the order of the file.")
        named = self._named(name)
        if len(named) == 1:
            return named[0]
        if named:
            several = ", ".join(f"{one.device.name}/{one.name}" for one in named)
            messages = ", ".join(f"{one.message} of {one.device.name}" for one in named)
            words = several if len({one.device.id for one in named}) == len(named) else f"from {messages}"
            raise ImuscopeError(f"{self.path.name} has several signals {name!r}: {words}. Use `signals` to choose one.")
        known = list(dict.fromkeys(one.title for one in self.signals))
        near = near_miss(name, [*known, *(one.name for one in self.signals)])
        raise ImuscopeError(f"{self.path.name} has no signal {name!r}{near}; it has: {', '.join(known) or 'none'}")

    def _frame(self, signals: str | Signal | Sequence[str | Signal], align: Align, rate: float, units: Units) -> Frame:
        from imuscope.frames import frame_of

        names = (signals,) if isinstance(signals, str | Signal) else signals
        chosen = [self[one] if isinstance(one, str) else one for one in names] or self.signals
        return frame_of(chosen, align, rate, units)

    @checked
    def to_pandas(
        self,
        signals: str | Signal | Sequence[str | Signal] = (),
        *,
        align: Align = "nearest",
        rate: float = 0.0,
        units: Units = "shown",
    ) -> pandas.DataFrame:
        """Several signals in one frame of pandas, over UTC; columns are named "RateOfTurn.x".

        >>> recording.to_pandas("gyr", units="SI").columns.tolist()
        ['gyr.x', 'gyr.y', 'gyr.z']

        Args:
            signals: names, or signals (parts of them, too); none for all.
            align: "nearest": of each signal its nearest sample, at most half of its step away, else NaN;
                "interpolate": linear between two samples, NaN across gaps and steps of the clock. Counts and flags are
                always those of the nearest sample.
            rate: of even times, Hz; 0 for the times of the signal with the most samples.
            units: "shown": those of the page; "device": as sent; "SI". They are in `attrs["units"]`, by column.

        Raises:
            ImuscopeError: pandas is not installed, a name is unknown, or there are no samples.
        """
        frame = self._frame(signals, align, rate, units)
        made_by = package("pandas")
        index = made_by.DatetimeIndex(frame.time_ns.astype("datetime64[ns]"), name="time").tz_localize("UTC")
        made: pandas.DataFrame = made_by.DataFrame(frame.columns, index)
        made.attrs["units"] = frame.units
        return made

    @checked
    def to_xarray(
        self,
        signals: str | Signal | Sequence[str | Signal] = (),
        *,
        align: Align = "nearest",
        rate: float = 0.0,
        units: Units = "shown",
    ) -> xarray.Dataset:
        """The frame of `to_pandas` in xarray: a variable for each column over `time`, with its unit."""
        frame = self._frame(signals, align, rate, units)
        return dataset(frame.time_ns, frame.columns, frame.units, {"title": self.path.name})

    @checked
    def analyse(
        self, analysis: str, *signals: str, begin_s: float = 0.0, end_s: float | None = None, **options: float | str
    ) -> dict[str, dict[str, Any]]:
        """Run an analysis of the page: "statistics", "psd", "allan" …; `imuscope analyse --help` lists them.

        >>> recording.analyse("statistics", "gyr.x")["gyr.x"]["max"]
        9.5

        Args:
            signals: names; none for all that it can be applied to.
            begin_s, end_s: seconds from the beginning of the recording.
            options: of the analysis, by name.

        Returns:
            figures by name of the signal, as `imuscope analyse --format json` has them.

        Raises:
            ImuscopeError: it is unknown, or does not apply.
        """
        from imuscope.server.extensions.analysis.jobs.analyse import AnalyseRequest, reports_of

        if wrong := [name for name in signals if not isinstance(name, str)]:
            raise ImuscopeError(f"{wrong[0]!r} is no name of a signal; give names one after the other.")
        texts = tuple(f"{name}={value}" for name, value in options.items())
        request = AnalyseRequest(analysis, signals, begin_s, end_s, texts)
        return {report.name: dict(report.figures) for report in reports_of(self._store, self.path.name, request)}

    @checked
    def time(self) -> tuple[MessageClocks, ...]:
        """Every clock of the file, by device and message, and which of them is the time axis: as `imuscope time`.

        >>> [clock.name for clock in recording.time()[0].clocks if clock.is_axis]
        ['time']
        """
        from imuscope.server.extensions.clocks.figures import clocks_of

        return tuple(clocks_of(self._store))

    @checked
    def calibrate(
        self,
        kind: CalibrationKind,
        *,
        device: str = "",
        begin_s: float = 0.0,
        end_s: float | None = None,
        field: float = 0.0,
        gravity: float = 0.0,
        square: bool = False,
        vertical: Literal["up", "down"] = "up",
    ) -> Calibration:
        """Calibrate a sensor with the samples: as `imuscope calibrate`.

        Args:
            kind: "gyroscope", "magnetometer", "accelerometer" or "mounting".
            device: id or name, if there are several.
            begin_s, end_s: seconds from the beginning of the recording.
            field: magnetometer: field strength, in the unit of the signal; 0 if unknown.
            gravity: accelerometer: local gravity, m/s²; 0 if unknown.
            square: accelerometer: the housing is square and rests on a level table.
            vertical: mounting: where z of the vehicle points.

        Raises:
            ImuscopeError: the samples do not determine the answer; the sentence says why.
        """
        from imuscope.results import Calibration
        from imuscope.server.commands.decode import time_range_of
        from imuscope.server.extensions.calibration.calibrate import calibrated
        from imuscope.server.extensions.calibration.kinds import METHODS, CalibrationOptions

        choice("kind", kind, tuple(METHODS))
        choice("vertical", vertical, ("up", "down"))
        options = CalibrationOptions(field, gravity, square, vertical)
        span = time_range_of(self._store, self.path.name, begin_s, end_s)
        return Calibration.of(calibrated(self._store, self.path.name, kind, self._device_id(device), span, options))

    @checked
    def compare(
        self,
        other: Recording,
        *signals: str,
        signals_b: Sequence[str] = (),
        align: Literal["offset", "start", "correlation"] = "offset",
        offset_s: float = 0.0,
        search_s: float | None = None,
        begin_s: float = 0.0,
        end_s: float | None = None,
    ) -> Comparison:
        """Compare signals of this recording, A, with those of another one, B: as `imuscope analyse A comparison`.

        >>> recording.compare(recording, "gyr.x").signals[0].figures["rms"]
        0.0

        Args:
            signals: names.
            signals_b: those of B, if they differ.
            align: "offset": by the clock, B moved by `offset_s`; "start": the first samples coincide; "correlation":
                where the signals fit best, at most `search_s` from `offset_s`.
            begin_s, end_s: seconds from the beginning of each recording.

        Raises:
            ImuscopeError: a signal is unknown, or the sides cannot be aligned.
        """
        from imuscope.results import Comparison
        from imuscope.server.extensions.analysis.compare.two_sides import ComparisonOptions, compared
        from imuscope.server.extensions.analysis.jobs.compare import side_of

        choice("align", align, ("offset", "start", "correlation"))
        if not signals or (signals_b and len(signals_b) != len(signals)):
            raise ImuscopeError("compare() needs the names of signals, and as many in signals_b if they differ in B.")
        pairs = ((self, signals), (other, signals_b or signals))
        sides = [side_of(one._store, one.path.name, names, begin_s, end_s) for one, names in pairs]  # noqa: SLF001
        return Comparison.of(compared(sides, sides, ComparisonOptions(align, offset_s, search_s)))

    @checked
    def export(
        self,
        out: str | Path,
        *,
        signals: str | Sequence[str] = (),
        device: str = "",
        begin_s: float = 0.0,
        end_s: float | None = None,
        units: Units = "shown",
    ) -> list[Path]:
        """Write a file that other programs read; its suffix selects the format, as of `imuscope decode`.

        Args:
            signals: names, or one; none for all.
            device: id or name; "" for all.
            begin_s, end_s: seconds from the beginning of the recording.
            units: of the values in tables, as of `to_pandas`.

        Returns:
            the files.

        Raises:
            ImuscopeError: the format is unknown, or the part is empty.
        """
        from imuscope.server.commands.decode import DecodedPart, export_columns

        choice("units", units, UNITS)
        names = (signals,) if isinstance(signals, str) else signals
        chosen = tuple(self[name]._channel for name in names)  # noqa: SLF001 - of this package
        part = DecodedPart(begin_s, end_s, self._device_id(device), chosen, units=units)
        return export_columns(self._store, self.path, Path(out), part)

    def _device_id(self, name: str) -> str:
        of = [one.id for one in self.devices if name in (one.id, one.name)]
        if name and len(of) != 1:
            listed = ", ".join(f"{one.id} ({one.name})" for one in self.devices)
            raise ImuscopeError(f"{self.path.name} has {'several devices' if of else 'no device'} {name!r}: {listed}.")
        return of[0] if name else ""

    def close(self) -> None:
        """Remove the columns. Arrays that were read stay."""
        self._finalizer()


@checked
def open(  # noqa: A001 (as gzip.open: read with its module)
    path: str | PathLike[str] | BinaryIO,
    *,
    protocol: str = "",
    time_column: str = "",
    time_unit: str = "",
    rate: float = 0.0,
    columns: Mapping[str, str] | None = None,
    packet_stamp: Literal["", "first", "last"] = "",
    clock: Literal["", "device", "arrival"] = "",
    **options: str,
) -> Recording:
    """Open a recording of imuscope, a capture of a device's bytes, a table or a log of another program.

    >>> with file.open("rb") as stream:
    ...     open(stream)
    <Recording walk.csv: walk; 2 signals, 0.280 s>

    Args:
        path: of the file; or a file of bytes, which is copied: its attribute `name` may say its format.
        protocol: of a capture; "" to detect it.
        time_column, time_unit, rate, columns: of a table, where the file does not say it: heading of the times; "ns",
            "us", "ms" or "s"; samples a second where there are no times; headings in place of the file's.
        packet_stamp: which sample of a packet of a table has its time, where several rows share one.
        clock: of devices and messages, that is the time axis; "" for the usual one.
        options: decode options of the protocol, as on the command line.

    What is not given is as chosen for this recording on the page, in the file beside it, else as the file says.

    Raises:
        ImuscopeError: it cannot be opened; where its times can be read in two ways the message names the option.
    """
    from imuscope.recordings.importers.open_file import open_file
    from imuscope.recordings.tables.options import TableOptions
    from imuscope.server.devices.decode.decode_options import DecodeOptions, source_options
    from imuscope.server.devices.decode.protocol_set import all_protocols
    from imuscope.server.library.computed_signals import compute_signals
    from imuscope.server.library.decode import decode

    known = {option.name for option in source_options()}
    own = {"protocol": protocol, "time_column": time_column, "time_unit": time_unit}
    own |= {"packet_stamp": packet_stamp, "clock": clock}
    for name, value in {**own, **options}.items():
        if name not in (*own, *known):
            near = near_miss(name, [*known, *own, "rate", "columns"])
            raise ImuscopeError(f"There is no option {name!r}{near}; options of protocols: {', '.join(sorted(known))}.")
        if not isinstance(value, str):
            raise ImuscopeError(f"{name}={value!r:.60} is no text.")
    table = TableOptions(time_column, time_unit, None, rate, columns or {}, packet_stamp)
    reading = DecodeOptions(protocol, options, table, clock)
    folder = Path(tempfile.mkdtemp(prefix="imuscope-"))
    try:
        file = _on_disk(path, folder)
        source = open_file(file, protocol, reading.table)
        store = decode(source, folder / "columns", all_protocols(), reading, lambda _: None, compute=compute_signals)
        return Recording(file, store, folder)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def _on_disk(path: str | PathLike[str] | BinaryIO, folder: Path) -> Path:
    """The file, or a copy of an open one."""
    if isinstance(path, (str, PathLike)):
        file = Path(path).expanduser()
        if not file.exists():
            raise ImuscopeError(f"{file} does not exist.")
        return file
    copy = Path(tempfile.mkdtemp(dir=folder), Path(str(getattr(path, "name", ""))).name or "data")
    with copy.open("wb") as out:
        shutil.copyfileobj(path, out)
    return copy
