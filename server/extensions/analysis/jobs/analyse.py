"""`imuscope analyse FILE NAME --signal …`: figures of signals of any file that `decode` reads."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, TextIO

from imuscope.protocols.schema.plural import counted
from imuscope.recordings.columns.store import ColumnStore
from imuscope.server.commands.decode import time_range_of
from imuscope.server.errors import DomainError, UsageError
from imuscope.server.extensions.analysis.expressions.signal_request import ExpressionSignal, requested_signals
from imuscope.server.extensions.analysis.noise.registry import FiguresOfSignal, analysis_named
from imuscope.server.extensions.analysis.noise.report import Figures, figures_of, in_parallel
from imuscope.server.extensions.analysis.signals.signals import SignalColumn, recorded_samples, signals_in
from imuscope.server.library.recording_detail import channels_of, products_of, segments_of

BELOW = ("notes", "obstacles", "unchecked")  # sentences, printed below the table


@dataclass(frozen=True, slots=True)
class AnalyseRequest:
    """Request for an analysis of a file.

    Args:
        analysis: its name.
        signals: names (server/extensions/analysis/signals/signals.py); none for all that it can be applied to.
        begin_s, end_s: seconds from the beginning of the file.
        options: of the analysis, as NAME=VALUE.
    """

    analysis: str
    signals: Sequence[str]
    begin_s: float = 0.0
    end_s: float | None = None
    options: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class SignalReport:
    """Figures of one signal, and the units of those that have one."""

    name: str
    unit: str
    figures: Figures
    units: Mapping[str, str]


def reports_of(store: ColumnStore, name: str, request: AnalyseRequest) -> list[SignalReport]:
    """Analyse signals of an opened file.

    Args:
        name: of the file, for messages.

    Raises:
        UsageError, DomainError: the request cannot be fulfilled.
    """
    analysis = analysis_named(request.analysis)
    chosen = {}
    for option in request.options:
        key, equals, value = option.partition("=")
        if not equals:
            raise UsageError(f"--option {option!r:.60} is not NAME=VALUE")
        chosen[key] = value
    settings = analysis.settings(chosen)
    t0, t1 = time_range_of(store, name, request.begin_s, request.end_s)

    infos = list(channels_of(store).values())

    def reports(one: SignalColumn | ExpressionSignal) -> list[tuple[str, SignalReport]]:
        try:
            signals = one.signals(lambda column: recorded_samples(store, column, t0, t1))
            return [
                (one.device, SignalReport(signal.name, signal.unit, *figures_of(analysis, signal, settings)))
                for signal in signals
            ]
        except DomainError:
            if request.signals:
                raise
            return []  # it cannot be applied to this one

    requested = requested_signals(
        infos,
        request.signals or signals_in(infos),
        zero_phase=True,
        product=products_of(store),
        companions=analysis.companions,
        segments=segments_of(store),
    )
    made = list(chain(*in_parallel(reports, requested)))
    if not made:
        hint = "Choose another analysis or range."
        raise DomainError("not-found", f"{name} has no signal for {analysis.title}.", hint)
    names = Counter(report.name for _, report in made)
    return [  # of several devices, each names its own
        replace(report, name=f"{device}/{report.name}") if names[report.name] > 1 and device else report
        for device, report in made
    ]


def print_text(analysis: str, name: str, reports: Sequence[SignalReport], out: TextIO) -> None:
    """A format that the analysis has.

    Raises:
        DomainError: it has no such format, or it cannot be made of these signals.
    """
    signals = [FiguresOfSignal(one.name, one.unit, one.figures) for one in reports]
    out.write(analysis_named(analysis).text(name, signals))


def print_json(reports: Sequence[SignalReport], out: TextIO) -> None:
    """An object of figures by name of the signal."""
    body = {report.name: report.figures for report in reports}
    out.write(json.dumps(body, ensure_ascii=False, allow_nan=False) + "\n")


def print_table(reports: Sequence[SignalReport], out: TextIO) -> None:
    """A column for each signal, a line for each figure. Lists are shown by their length; --json has them whole."""
    lines = [["", *(report.name for report in reports)]]
    flat = [_flattened(report.figures) for report in reports]
    for name in flat[0]:
        shown = [_cell(of.get(name), report.units.get(name, "")) for of, report in zip(flat, reports, strict=True)]
        lines.append([name, *shown])
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    for first, *others in lines:
        cells = [first.ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True))]
        out.write("  ".join(cells).rstrip() + "\n")
    for report in reports:
        for sentence in _sentences(report.figures):
            out.write(f"{report.name}: {sentence}\n")


def _sentences(figures: Mapping[str, Any]) -> list[str]:
    """Obstacles, notes, and checks that could not be made."""
    prevented = [f"{one['message']} {one['hint']}" for one in figures.get("obstacles", ())]
    return [*prevented, *figures.get("notes", ()), *filter(None, [figures.get("unchecked", "")])]


def _flattened(figures: Mapping[str, Any], within: str = "") -> dict[str, Any]:
    """Figures of objects by the names of both, with a point between them; sentences are printed below the table."""
    flat: dict[str, Any] = {}
    for name, value in figures.items():
        if isinstance(value, Mapping):
            flat |= _flattened(value, f"{within}{name}.")
        elif name not in BELOW:
            flat[within + name] = value
    return flat


def _cell(value: Any, unit: str) -> str:
    if isinstance(value, list):
        return counted(len(value), "value")
    if value is None:
        return "—"
    shown = f"{value:.7g}" if isinstance(value, float) else str(value)
    return f"{shown} {unit}" if unit else shown
