"""Content of evidence: everything that the file shows, as plain data.

{"title", "t0", "t1", "made", "plots": [{"title", "unit", "series": [{"label", …, "t", "v", "figures"}]}],
 "cursors", "devices", "losses", "events", "notes", "left_out", "versions"}
"""

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.recordings.columns.store import VERSION as COLUMNS_VERSION
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.errors import RecordingError
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.expressions.signal_request import ExpressionSignal, requested_signals
from imuscope.server.extensions.analysis.noise.registry import analysis_named
from imuscope.server.extensions.analysis.noise.report import figures_of
from imuscope.server.extensions.analysis.signals.signals import Signal, SignalColumn, is_shared, recorded_samples
from imuscope.server.extensions.evidence.position import (
    Scrubber,
    names_position,
    reveals_position,
    scrubbed,
    scrubber_of,
)
from imuscope.server.extensions.evidence.request import Colour, EvidencePlot, EvidenceRequest, EvidenceSeries
from imuscope.server.extensions.evidence.series import Blocks, embedded, intervals_for
from imuscope.server.library.api_models import RecordedSetting
from imuscope.server.library.decoder_fingerprint import decoding_mark
from imuscope.server.library.recorded_settings import settings_of
from imuscope.server.library.recording_detail import channels_of
from imuscope.server.library.reject_reasons import EXPLAINED, explained_rejects
from imuscope.server.version import VERSION
from imuscope.server.wire import ChannelInfo, ColumnInfo

FORMAT = 1  # of the embedded data
MOST_EVENTS = 2000
EventRow = dict[str, Any]
Step = Callable[[float], None]


@dataclass(slots=True)
class About:
    """Facts about the recording that are not in its columns.

    Args:
        notes: text of the recording as a whole.
        markers: those added later: time, kind, text, device.
        file, format: name and kind of its file.
    """

    title: str
    notes: str = ""
    tags: list[str] = field(default_factory=list)
    markers: list[dict[str, Any]] = field(default_factory=list)
    file: str = ""
    format: str = ""


@dataclass(slots=True)
class _Curve:
    plot: int
    series: EvidenceSeries
    signal: SignalColumn | ExpressionSignal


def content_of(
    store: ColumnStore, about: About, request: EvidenceRequest, room: int, step: Step
) -> tuple[dict[str, Any], Blocks]:
    """The content of a file, and its binary blocks.

    Args:
        room: bytes for the samples.

    Raises:
        RecordingError: the range has no samples of any plot.
    """
    infos = list(channels_of(store).values())
    scrub = Scrubber() if request.with_position else scrubber_of(store, infos)
    t0, t1 = _range(store, request)
    plots = request.plots if request.plots is not None else all_plots(infos, len(store.manifest["devices"]))
    left_out: list[str] = []
    curves = list(_curves(plots, infos, request.with_position, left_out))
    n_position = sum(1 for why in left_out if why == "")
    blocks = Blocks()
    shown = [{**asdict(plot), "series": []} for plot in plots]
    intervals = intervals_for(_sizes(store, curves, t0, t1, request), room)
    for number, curve in enumerate(curves):
        signal = _read(store, curve, t0, t1, request)
        if signal is None:
            count = np.subtract(*store.between(curve.signal.columns[0].info.id, t0, t1, request.base)[::-1])
            what = f"none of {count} samples in the range is valid" if count else "no samples in the range"
            left_out.append(f"{curve.series.signal}: {what}.")
        else:
            row = _series(curve, signal, (t0, t1), intervals, blocks, request)
            shown[curve.plot]["series"].append(row)
        step((number + 1) / len(curves))
    plots_with_data = [plot for plot in shown if plot["series"]]
    if not plots_with_data:
        raise RecordingError(
            "No sample in this range is valid."
            if any("is valid" in words for words in left_out)
            else "This range contains nothing to show.",
            "Choose a longer range or other plots." if n_position == 0 else "Choose plots without positions.",
        )
    devices, n_settings = _devices(store, request.with_position, about.file)
    events = _events(store, t0 if request.t0 is not None else -math.inf, t1 if request.t1 is not None else math.inf)
    content = {
        "title": about.title,
        "file": about.file if request.with_position else "",
        "tags": about.tags,
        "plots": plots_with_data,
        "devices": devices,
        "notes": {"text": about.notes, "times": _notes(store, about, t0, t1)},
        "events": events[:MOST_EVENTS],
        "not_shown": [why for why in left_out if why],
    }
    if not request.with_position:
        content = scrubbed(content, scrub)
    return content | {
        "format": FORMAT,
        "t0": t0,
        "t1": t1,
        "recorded": [store.manifest["started"], store.manifest["ended"]],
        "base": request.base,
        "cursors": {"a": request.cursor_a, "b": request.cursor_b},
        "made": time.time(),
        "events_left_out": int(store.manifest.get("events_left_out") or 0) + len(events[MOST_EVENTS:]),
        "damage": [one.get("words", "") for one in store.manifest.get("damage", [])],
        "position": None
        if request.with_position
        else {"signals": n_position, "settings": n_settings, "numbers": scrub.removed},
        "versions": {
            "imuscope": VERSION,
            "decoders": decoding_mark()[:12],
            "columns": COLUMNS_VERSION,
            "recording": about.format or store.manifest.get("format", ""),
        },
    }, blocks


def _range(store: ColumnStore, request: EvidenceRequest) -> tuple[float, float]:
    first, last = store.span(base=request.base) or (0.0, 0.0)
    t0 = first if request.t0 is None else max(request.t0, first)
    t1 = last if request.t1 is None else min(request.t1, last)
    if not t0 < t1:
        raise RecordingError("This range contains nothing to show.", "Choose a range within the recording.")
    return t0, t1


def _curves(
    plots: list[EvidencePlot], infos: list[ChannelInfo], with_position: bool, left_out: list[str]
) -> Iterator[_Curve]:
    """The curves that can be read; others are added to `left_out`, with "" for one that reveals the position."""
    for number, plot in enumerate(plots):
        for series in plot.series:
            try:
                signals = requested_signals(infos, [series.signal], zero_phase=True)
            except DomainError as error:
                left_out.append(error.message if with_position or not names_position(series.signal) else "")
                continue
            is_one = isinstance(signals[0], ExpressionSignal) or len(signals) <= series.part
            signal = signals[0] if is_one else signals[series.part]
            if not with_position and any(
                reveals_position(one.info, one.info.columns[one.at]) for one in signal.columns
            ):
                left_out.append("")
                continue
            yield _Curve(number, series, signal)


def _sizes(
    store: ColumnStore, curves: list[_Curve], t0: float, t1: float, request: EvidenceRequest
) -> list[tuple[int, int]]:
    """Samples, and bytes of their values, of curves that share their times."""
    widths: dict[tuple[int, int], int] = {}
    for number, curve in enumerate(curves):
        own = isinstance(curve.signal, SignalColumn)
        column = curve.signal.columns[0]
        key = (column.info.id, -1 if own else number)
        width = 8 if column.info.columns[column.at].dtype in ("f8", "i8", "u8") else 4
        widths[key] = widths.get(key, 0) + width
    sizes = []
    for key, width in widths.items():
        lo, hi = store.between(key[0], t0, t1, request.base)
        sizes.append((hi - lo, width))
    return sizes


def _read(store: ColumnStore, curve: _Curve, t0: float, t1: float, request: EvidenceRequest) -> Signal | None:
    try:
        signals = curve.signal.signals(lambda column: recorded_samples(store, column, t0, t1, request.base))
    except DomainError:
        return None
    signal = signals[curve.series.part if curve.series.part < len(signals) else 0]
    if isinstance(curve.signal, SignalColumn):
        signal = signals[0]
    if not len(signal.time):
        return None
    values = signal.values * curve.series.factor + curve.series.offset
    return Signal(signal.name, signal.unit, curve.series.period or signal.period, signal.time, values, signal.notes)


def _series(
    curve: _Curve, signal: Signal, span: tuple[float, float], intervals: int, blocks: Blocks, request: EvidenceRequest
) -> dict[str, Any]:
    series = {
        "name": signal.name,
        "label": curve.series.label or signal.name,
        "colour": curve.series.colour or "axis-n",
        "dash": curve.series.dash,
        "decimals": curve.series.decimals,
        "unit": signal.unit,
        "period": signal.period,
        "notes": list(signal.notes),
        "figures": _figures(signal),
    }
    a, b = request.cursor_a, request.cursor_b
    if a is not None and b is not None:
        low, high = min(a, b), max(a, b)
        part = (signal.time >= low) & (signal.time <= high)
        between = Signal(signal.name, signal.unit, signal.period, signal.time[part], signal.values[part])
        series["between"] = _figures(between) if part.any() else {"n": 0}
    return series | embedded(signal.time, signal.values, span, intervals, blocks)


def _figures(signal: Signal) -> dict[str, Any]:
    analysis = analysis_named("statistics")
    figures, _ = figures_of(analysis, signal, analysis.settings({}))
    return {name: value for name, value in figures.items() if name != "notes"}


def _devices(store: ColumnStore, with_position: bool, file: str) -> tuple[list[dict[str, Any]], int]:
    """Identity, counts and settings of the devices; and the number of settings left out."""
    devices, removed = [], 0
    for device in store.manifest["devices"]:
        counted = store.manifest.get("figures", {}).get(device["id"], {})
        snapshot = store.manifest.get("snapshots", {}).get(device["id"])
        settings = settings_of(snapshot).settings if isinstance(snapshot, Mapping) else []
        fields = []
        for one in settings:
            rows = _rows(one, with_position)
            removed += len(one.rows) - len(rows)
            if rows:
                fields.append({"title": one.title, "group": one.group, "rows": rows})
        device = {**device}
        if not with_position:  # a capture that does not name its device is called after its file, which may be a place
            for key in ("name", "source"):
                if file and file in str(device.get(key, "")):
                    device[key] = f"device {device['id']}" if key == "name" else ""
        devices.append(
            {
                **{name: device.get(name, "") for name in ("id", "name", "product", "serial_number", "firmware")},
                "protocol": device.get("protocol", ""),
                "source": device.get("source", ""),
                "bytes": counted.get("bytes"),
                "lost": counted.get("lost"),
                "restarts": counted.get("restarts", 0),
                "gaps": counted.get("gaps"),
                "rejects": counted.get("rejects"),
                "rejects_by": _reasons(device.get("protocol", ""), counted.get("rejects_by", {})),
                "messages": sum(counted.get("messages", {}).values()) if counted else None,
                "settings": fields,
            }
        )
    return devices, removed


def _reasons(protocol: str, counts: Mapping[str, int]) -> list[str]:
    """Why frames were rejected, with their number."""
    words = explained_rejects(PROTOCOLS[protocol]) if protocol in PROTOCOLS else EXPLAINED
    return [f"{count} {words.get(reason, reason.replace('_', ' '))}" for reason, count in counts.items()]


def _rows(setting: RecordedSetting, with_position: bool) -> list[list[str]]:
    rows = [[row.title, row.words] for row in setting.rows]
    if with_position:
        return rows
    if names_position(f"{setting.name} {setting.title}"):
        return []
    return [row for row in rows if not names_position(f"{row[0]} {row[1]}")]


def _notes(store: ColumnStore, about: About, t0: float, t1: float) -> list[dict[str, Any]]:
    markers = [*store.manifest.get("markers", []), *about.markers]
    return sorted(
        (
            {"time": one["time"], "kind": one.get("kind", "marker"), "text": one.get("text", "")}
            for one in markers
            if t0 <= one.get("time", math.nan) <= t1
        ),
        key=lambda one: float(one["time"]),
    )


def _events(store: ColumnStore, t0: float, t1: float) -> list[EventRow]:
    """Events that concern the range, in order of time."""
    events = []
    for event in store.manifest.get("events", []):
        begin = event.get("t0") if event.get("t0") is not None else event.get("time")
        end = event.get("t1") if event.get("t1") is not None else event.get("time")
        if begin is None or end is None or end < t0 or begin > t1:
            continue
        row = {name: event.get(name) for name in ("time", "device", "kind", "level", "text", "t0", "t1", "samples")}
        events.append(row | {"time": event.get("time", begin)})
    events.sort(key=lambda one: float(np.nan_to_num(one["time"])))
    return events


MAX_SIGNALS = 40
KINDS = ("vector", "euler", "scalar", "quaternion", "record")
_COLOURS: dict[str, Colour] = {"x": "axis-x", "y": "axis-y", "z": "axis-z", "w": "axis-n"}
_AXES: tuple[Colour, ...] = ("axis-x", "axis-y", "axis-z", "axis-n")
_DASHES: tuple[list[float], ...] = ([], [5.0, 3.0], [1.5, 2.5])
_CURVES_PER_PLOT = 4  # curves in a plot


def all_plots(infos: Iterable[ChannelInfo], devices: int) -> list[EvidencePlot]:
    """Plots of the channels, in their order.

    Args:
        devices: number of devices; with several, titles and signals name theirs, and where several messages have
            channels of one name, these.
    """
    plots: list[EvidencePlot] = []
    known = list(infos)
    for info in known:
        if info.kind not in KINDS:
            continue
        units: dict[str, list[ColumnInfo]] = {}
        for column in info.columns:
            is_number = not column.bits and not column.choices
            if is_number and (column.unit or info.unit or info.kind != "record"):
                units.setdefault(column.unit or info.unit, []).append(column)
        for unit, columns in units.items():
            for first in range(0, len(columns), _CURVES_PER_PLOT):
                some = columns[first : first + _CURVES_PER_PLOT]
                plots.append(_plot(info, unit, some, len(units) > 1, devices, is_shared(info, known)))
    return plots[:MAX_SIGNALS]


def _plot(
    info: ChannelInfo, unit: str, columns: list[ColumnInfo], is_part: bool, devices: int, is_shared: bool
) -> EvidencePlot:
    title = info.title or info.name
    words = [title, info.message if is_shared else "", info.group, f"device {info.device}" if devices > 1 else ""]
    if is_part:
        words.append(", ".join(column.label or column.name for column in columns))
    prefix = f"{info.device}/" if devices > 1 else ""
    prefix += f"{info.message}/" if is_shared else ""
    series = [
        EvidenceSeries(
            f"{prefix}{info.name}.{column.name}",
            label=column.label or column.name,
            colour=_COLOURS.get(column.axis, _AXES[number % len(_AXES)]),
            dash=[] if column.axis else _DASHES[number // len(_AXES) % len(_DASHES)],
            decimals=column.decimals,
            period=column.period,
        )
        for number, column in enumerate(columns)
    ]
    return EvidencePlot(" · ".join(filter(None, words)), unit, series)
