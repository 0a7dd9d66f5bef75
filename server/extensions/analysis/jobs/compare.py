"""`imuscope analyse A comparison --with B --signal …`: compare signals of two files on one axis of time."""

import json
from collections.abc import Sequence
from typing import TextIO

from imuscope.recordings.columns.store import ColumnStore
from imuscope.server.commands.decode import time_range_of
from imuscope.server.extensions.analysis.compare.two_sides import (
    ComparedSignal,
    ComparisonAnswer,
    ComparisonSide,
)
from imuscope.server.extensions.analysis.expressions.signal_request import requested_signals
from imuscope.server.extensions.analysis.signals.signals import recorded_samples
from imuscope.server.library.recording_detail import channels_of, products_of, segments_of

FIGURES = ("n", "mean", "sigma", "rms", "min", "max", "low", "high", "mounting", "remaining")


def side_of(store: ColumnStore, name: str, words: Sequence[str], begin_s: float, end_s: float | None) -> ComparisonSide:
    """Signals of a file in a part of it.

    Args:
        name: of the file, for messages.
        words: names of the signals (server/extensions/analysis/signals/signals.py).
        begin_s, end_s: seconds from the beginning of the file.

    Raises:
        UsageError, DomainError: the part is empty, or has no such signal.
    """
    t0, t1 = time_range_of(store, name, begin_s, end_s)
    signals = requested_signals(
        channels_of(store).values(), words, zero_phase=True, product=products_of(store), segments=segments_of(store)
    )
    return ComparisonSide(signals, lambda column: recorded_samples(store, column, t0, t1))


def print_comparison(answer: ComparisonAnswer, out: TextIO) -> None:
    """The offset, and a line for each signal with the figures of B − A."""
    offset = f"offset {answer.offset:+.6f} s"
    if answer.uncertainty is not None:
        offset += f" ± {answer.uncertainty:.2g} s"
    if answer.correlation is not None:
        offset += f", correlation {answer.correlation:.4f}"
    out.write(f"{offset} (added to the times of B)\n")
    shown = [name for name in FIGURES if any(one.figures.get(name) is not None for one in answer.signals)]
    rows = [["B − A", *shown, "unit"], *(_cells(one, shown) for one in answer.signals)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for first, *others in rows:
        cells = [first.ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True))]
        out.write("  ".join(cells).rstrip() + "\n")
    for note in answer.notes:
        out.write(f"{note}\n")
    for one in answer.signals:
        for note in one.notes:
            out.write(f"{one.signal}: {note}\n")


def _cells(one: ComparedSignal, shown: Sequence[str]) -> list[str]:
    name = one.signal if one.signal == one.signal_b else f"{one.signal_b} − {one.signal}"
    values = [one.figures.get(figure) for figure in shown]
    return [name, *("—" if value is None else f"{value:.6g}" for value in values), one.unit]


def print_json(answer: ComparisonAnswer, out: TextIO) -> None:
    """As `POST /api/comparison` answers."""
    out.write(json.dumps(answer.model_dump(), ensure_ascii=False, allow_nan=False) + "\n")
