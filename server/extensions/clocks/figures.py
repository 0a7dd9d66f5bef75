"""Clocks of a decoded file: each with its unit, epoch, resolution and steps, against the clock that is the time axis.

    axis      ├──┼──┼──┼──┼──┤        drift    slope of the clock against the axis, ppm
    clock     ├──┼───┼──┼─┼──┤        jitter   standard deviation of the differences from that line
                                      steps    back, ahead, restarts, wraps: where the clock does not continue
                                      bursts   share of samples that come at once, after a pause

Drift and jitter are those of the longest stretch in which the difference has no step; samples that are missing on both
clocks, or a stall that is caught up, are none.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.recordings.columns.health_history import health_history
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.tables.clocks.axis import MIN_STEP_AHEAD_S, step_limits
from imuscope.recordings.tables.clocks.steps import ClockWatch, StepOfClock, periods_of
from imuscope.recordings.tables.time_units import UNITS, is_dated
from imuscope.server.extensions.clocks.against import ClockDifference, difference_between
from imuscope.server.library.collector import DEVICE_TIME

MOST_ROWS = 4_000_000  # examined of one message: an hour at 1 kHz
MOST_STEPS = 20  # listed of one clock
BURST_STEP_SHARE = 0.2  # of the usual step: samples that follow sooner came with the one before
RATE_TOLERANCE = 0.05  # of a rate that is that of a unit
EXACT_RATE_TOLERANCE = 0.001  # of one that is, by most of its steps
LONG_STEPS = 20.0  # usual steps: a longer one is none by which the unit is found
RESTART_SHARE = 0.1  # of a clock: one that goes back below that share of it has begun again
STAMPS = (
    *("stamp", "utc", "timestamp", "time", "sequence", "PacketCounter"),
    *("SampleTimeFine", "SampleTimeCoarse", "timeOfWeek", "iTOW"),
)
COUNTS = "counts of"
LATEST_UNIX_S = 4e9  # unix s
FINE = {"100 µs": 1e-4}
STATED = {"0.1 ms": "100 µs"}


@dataclass(frozen=True, slots=True)
class ClockStepFigures:
    """A step of a clock: "back", "ahead", "restart" or "wrap".

    `row` counts from 1 in its message, `time` is on the axis, unix s.
    """

    kind: str
    by_s: float
    row: int
    time: float


@dataclass(slots=True)
class FileClock:
    """A clock of one message of a device, or of a table.

    Args:
        is_axis: whether it is the time axis.
        epoch: what its zero is.
        resolution_s: least step that occurs.
        rate_hz: by the usual step; None without one.
        drift_ppm, jitter_s: against the axis; None for the axis itself, and where they are unknown.
        drift_error_ppm: half of the drift's 95 % interval, with the error of an axis that arrivals gave.
        repeats: samples with the time of the one before.
        bursts: share of samples that came at once with the one before, 0..1.
        burst_samples: of a burst, on average; 0 without one.
        difference: to the axis, over its length; None as for the jitter.
        use: the choice that makes it the axis: the heading of a time column, "device" or "arrival"; "" if it cannot be.
    """

    name: str
    unit: str
    epoch: str
    is_axis: bool
    why: str
    samples: int
    resolution_s: float | None = None
    rate_hz: float | None = None
    drift_ppm: float | None = None
    drift_error_ppm: float | None = None
    jitter_s: float | None = None
    repeats: int = 0
    gaps: int = 0
    bursts: float = 0.0
    burst_samples: float = 0.0
    steps: list[ClockStepFigures] = field(default_factory=list)
    steps_in_all: int = 0
    use: str = ""
    difference: ClockDifference | None = None


@dataclass(slots=True)
class MessageClocks:
    """Clocks of one message."""

    device: str
    message: str
    clocks: list[FileClock]


def clocks_of(store: ColumnStore) -> list[MessageClocks]:
    """Clocks of all messages of a file."""
    messages: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for info in store.manifest["channels"]:
        messages.setdefault((info["device"], info["message"]), []).append(info)
    return [
        MessageClocks(device, message, list(_clocks(store, device, message, infos)))
        for (device, message), infos in messages.items()
        if any(store.rows(info["id"]) for info in infos)
    ]


def _clocks(store: ColumnStore, device: str, message: str, infos: list[dict[str, Any]]) -> Iterator[FileClock]:
    info = max(infos, key=lambda one: store.rows(one["id"]))
    rows = store.exact(info["id"], 0, MOST_ROWS, columns=[])
    time, arrival = rows.time, rows.arrival
    known = np.isfinite(time)
    axis = np.where(known, time, arrival)
    described = store.manifest.get("time") or {}
    table: Mapping[str, Any] = described if "axis" in described else {}
    uses = table.get("options", {})
    own, units = _columns(store, device, message, infos, len(axis), table)
    if table:
        raw = own.pop(table["axis"], None)
        factor = {**UNITS, **FINE}.get(table["unit"], 0.0) if raw is not None else 0.0
        clock = _figures(table["axis"], raw if raw is not None else axis, axis, is_axis=True, factor=factor)
        clock.unit, clock.epoch, clock.why = table["unit"], table["epoch"], table["why"]
        clock.use = uses.get(table["axis"], "")
        yield clock
    else:
        yield from _of_device(store, time, arrival, own)
    error = 0.0 if table else _axis_error_ppm(store, device, axis)
    units |= table.get("units", {})
    for name, values in own.items():
        factor = {**UNITS, **FINE}.get(units.get(name, ""), 0.0)
        factor, unit = (factor, units[name]) if factor else _unit_of(values, axis)
        if unit:
            clock = _figures(name, values * factor, axis, factor=factor)
            clock.unit, clock.use = unit, uses.get(name, "")
            if unit.startswith(COUNTS):  # of the axis itself
                clock.drift_ppm = clock.drift_error_ppm = None
            if clock.drift_error_ppm is not None:
                clock.drift_error_ppm = math.hypot(clock.drift_error_ppm, error)
            yield clock


def _of_device(store: ColumnStore, time: Floats, arrival: Floats, own: dict[str, Floats]) -> Iterator[FileClock]:
    """The axis of samples of a device, and the other one of its time and the arrival."""
    known = np.isfinite(time)
    axis = np.where(known, time, arrival)
    device = own.pop(DEVICE_TIME, None)
    if store.manifest.get("clock") == "arrival":
        clock = _figures("arrival", axis, axis, is_axis=True, why="it was chosen")
        clock.use = "arrival"
        yield clock
        if device is not None and np.isfinite(device).any():
            clock = _figures("time", device, axis)
            clock.use = "device"
            yield clock
        return
    is_device = bool(known.any())
    why = "time of the device, on the clock of this host" if is_device else "there is no other"
    has_both = is_device and not np.array_equal(time[known], arrival[known])
    is_choice = has_both and bool(store.manifest["timed"])  # else the arrival was made of the time
    clock = _figures("time" if is_device else "arrival", axis, axis, is_axis=True, why=why)
    clock.use = "device" if is_choice else ""
    yield clock
    if has_both:
        clock = _figures("arrival", arrival, axis)
        clock.drift_ppm = clock.drift_error_ppm = None  # the axis follows arrivals: a trend is that of their delays
        clock.use = "arrival" if is_choice else ""
        yield clock


def _axis_error_ppm(store: ColumnStore, device: str, axis: Floats) -> float:
    """± of the rate of an axis that was mapped by arrivals, from the uncertainty of its times; 0 if it was not.

    Most of that is a delay of all frames, which both ends of the axis share: their difference is less than the half of
    what two independent ends would have, in simulations of adapters, networks and stalls.
    """
    span, names = float(np.ptp(axis)) if len(axis) else 0.0, store.manifest.get("health", {})
    if not span or not names:
        return 0.0
    history = health_history(store.folder, names, device, device, math.floor(axis.min()), math.ceil(axis.max()))
    bounds = [one for one in history.uncertainty_ms[len(history.uncertainty_ms) // 5 :] if one is not None]
    return 1e3 * float(np.median(bounds)) / span if bounds else 0.0


def _columns(
    store: ColumnStore, device: str, message: str, infos: list[dict[str, Any]], n: int, table: Mapping[str, Any]
) -> tuple[dict[str, Floats], dict[str, str]]:
    """Values of clocks by name, and the units that the protocol states."""
    names = {*STAMPS, DEVICE_TIME, *table.get("others", ()), table.get("axis", "")}
    columns: dict[str, Floats] = {}
    units: dict[str, str] = {}
    beside = [one for one in store.manifest.get("clocks", ()) if (one["device"], one["message"]) == (device, message)]
    for info in [*beside, *infos]:
        if store.rows(info["id"]) < n:
            continue
        for at, column in enumerate(info["columns"]):
            name = column["name"]
            if name == "value":
                name = info["title"] if info["title"] in names else info["name"]
            if name in names:
                [values] = store.exact(info["id"], 0, n, columns=[at]).columns
                columns.setdefault(name, values.astype(np.float64))
                if not table and (unit := STATED.get(column["unit"], column["unit"])):
                    units.setdefault(name, unit)
    return columns, units


def _unit_of(values: Floats, axis: Floats) -> tuple[float, str]:
    """Unit in which a clock runs like the axis, s and as text; "" if it does not run."""
    known = np.isfinite(values)
    steps, passed = np.diff(values[known]), np.diff(axis[known])
    forward = (steps > 0) & (passed > 0)
    if not forward.any():
        return 1.0, ""
    forward &= (steps <= LONG_STEPS * np.median(steps[forward])) & (passed <= LONG_STEPS * np.median(passed[forward]))
    if not forward.any():
        return 1.0, ""
    whole = float(passed[forward].sum() / steps[forward].sum())  # the axis may be coarse
    usual = float(np.median(passed[forward] / steps[forward]))  # or may have steps that this clock lacks
    for unit, factor in {**UNITS, **FINE}.items():
        if abs(whole / factor - 1) < RATE_TOLERANCE or abs(usual / factor - 1) < EXACT_RATE_TOLERANCE:
            return factor, unit
    return usual, f"{COUNTS} {usual:.4g} s"


def _figures(
    name: str, clock: Floats, axis: Floats, *, is_axis: bool = False, why: str = "", factor: float = 0.0
) -> FileClock:
    """Figures of a clock in s; `factor`: s per count, by which it may wrap."""
    known = np.isfinite(clock)
    times, on_axis = clock[known], axis[known]
    first = float(times[0]) if len(times) else 0.0
    epoch = "1970" if is_dated(first, LATEST_UNIX_S) else "start"
    made = FileClock(name, "s", epoch, is_axis, why, len(times))
    if len(times) < 2:
        return made
    usual, ahead = step_limits(times)
    expected = usual if is_axis else step_limits(on_axis)[0]
    steps = np.diff(times)
    forward = steps[steps > 0]
    made.resolution_s = float(forward.min()) if len(forward) else None
    _count_bursts(made, steps, expected)
    if made.bursts and expected:  # then single steps say nothing on the rate
        usual, ahead = expected, max(ahead, MIN_STEP_AHEAD_S * expected)
    made.rate_hz = 1 / usual if usual else None
    watch = ClockWatch(usual, ahead, periods_of(factor, "counter" if factor else "text", "start"))
    watch.feed(times)
    watch.end()
    made.repeats, made.steps_in_all = watch.repeats, len(watch.steps) + watch.left_out
    made.gaps = sum(step.kind == "ahead" for step in watch.steps)
    made.steps = [
        ClockStepFigures(_kind(step), step.by_s, step.row + 1, float(on_axis[step.row]))
        for step in watch.steps[:MOST_STEPS]
    ]
    if not is_axis:
        against = difference_between(times, on_axis, watch.steps)
        made.drift_ppm, made.drift_error_ppm = against.drift_ppm, against.drift_error_ppm
        made.jitter_s, made.difference = against.jitter_s, against.series
    return made


def _kind(step: StepOfClock) -> str:
    return "restart" if step.kind == "back" and 0 <= step.after < RESTART_SHARE * step.before else step.kind


def _count_bursts(clock: FileClock, steps: Floats, usual: float) -> None:
    """Share and size of bursts; samples of a clock that stands still (a coarse one) are at once, too."""
    at_once = (steps >= 0) & (steps < BURST_STEP_SHARE * usual)
    followers = int(at_once.sum())
    bursts = int(np.count_nonzero(at_once & ~np.concatenate(([False], at_once[:-1]))))
    clock.bursts = followers / len(steps)
    clock.burst_samples = followers / bursts + 1 if bursts else 0.0


def as_json(store: ColumnStore) -> dict[str, Any]:
    """All clocks, and the description of the axis, for programs."""
    return {"axis": store.manifest.get("time"), "messages": [asdict(one) for one in clocks_of(store)]}
