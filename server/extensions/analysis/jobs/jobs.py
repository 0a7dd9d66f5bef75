"""Analyses as jobs of another process: the request, with the samples or the place of the recording.

Samples in memory are sent: the columns that the job reads, in its range, and the times once for each channel. A
recording is opened where the job runs. The answer are the bytes of the response.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.protocols.schema.plural import counted
from imuscope.recordings.columns.store import Base, ColumnStore
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.compare.two_sides import ComparisonOptions, ComparisonSide, compared
from imuscope.server.extensions.analysis.expressions.signal_request import ExpressionSignal
from imuscope.server.extensions.analysis.noise.registry import Figure, FiguresOfSignal, analysis_named
from imuscope.server.extensions.analysis.noise.report import arrow_of, figures_of, in_parallel
from imuscope.server.extensions.analysis.signals.body_axes import ATTITUDES
from imuscope.server.extensions.analysis.signals.pairs import Pairing, paired, shortened, thinned
from imuscope.server.extensions.analysis.signals.signals import ReadSamples, Signal, SignalColumn, recorded_samples

TEXT = "text/plain; charset=utf-8"
ARROW = "application/vnd.apache.arrow.stream"
JSON = "application/json"

Requested = Sequence[SignalColumn | ExpressionSignal]


class Content(NamedTuple):
    """The body of a response."""

    media: str
    body: bytes


class AnalysisJob(Protocol):
    """A job; picklable."""

    def content(self) -> Content:
        """Carry it out.

        Raises:
            DomainError: it cannot be.
        """


class SampleSource(Protocol):
    """Origin of the samples of a job; picklable."""

    def opened(self) -> ReadSamples:
        """A reader of the samples."""


def opened_store(folder: Path) -> ColumnStore:
    """The columns of a recording.

    Raises:
        DomainError: "gone": they were deleted just now.
    """
    try:
        return ColumnStore(folder)
    except (OSError, ValueError):
        raise DomainError("gone", "The columns of the recording have been deleted.", "Request it again.") from None


@dataclass(frozen=True, slots=True)
class RecordedSource:
    """A range of a recording, by the folder of its columns."""

    folder: Path
    t0: float
    t1: float
    base: Base

    def opened(self) -> ReadSamples:
        """A reader of the samples. Raises as `opened_store`."""
        store = opened_store(self.folder)
        return lambda column: recorded_samples(store, column, self.t0, self.t1, self.base)


@dataclass(frozen=True, slots=True)
class CopiedSource:
    """Samples of columns by channel and position, from the memory of live devices."""

    samples: Mapping[tuple[int, int], tuple[Floats, Floats]]

    def opened(self) -> ReadSamples:
        def read(column: SignalColumn) -> tuple[Floats, Floats]:
            samples = self.samples.get((column.info.id, column.at))
            if samples is None:  # while the request waited for its turn
                raise DomainError("gone", f"{column.name} has been removed, with its device.", "Request another.")
            return samples

        return read


def read_columns(requested: Requested) -> list[SignalColumn]:
    """The columns that a job may read: those named, their temperatures, and all of an attitude."""
    named = [column for one in requested for column in one.columns]
    columns = [*named, *(column.temperature for column in named if column.temperature is not None)]
    for column in named:
        if column.info.kind in ATTITUDES:
            columns += [SignalColumn(column.info, at) for at in range(len(column.info.columns))]
    return list({(column.info.id, column.at): column for column in columns}.values())


def copied(read: ReadSamples, columns: Iterable[SignalColumn]) -> CopiedSource:
    """The samples of columns, to be sent."""
    times: dict[int, Floats] = {}
    samples = {}
    for column in columns:
        time, values = read(column)
        samples[column.info.id, column.at] = times.setdefault(column.info.id, time), values
    return CopiedSource(samples)


@dataclass(frozen=True, slots=True)
class FiguresJob:
    """Figures of signals.

    Args:
        analysis: its name.
        settings: its options.
        format: json, arrow, or one of the analysis.
    """

    analysis: str
    settings: Mapping[str, float]
    format: str
    requested: Requested
    source: SampleSource

    def content(self) -> Content:
        """The figures of each signal, as `SignalFigures` of the API; otherwise a table or a text."""
        analysis, read = analysis_named(self.analysis), self.source.opened()

        def work(one: SignalColumn | ExpressionSignal) -> list[tuple[str, dict[str, Figure]]]:
            reports = []
            for signal in one.signals(read):
                figures, units = figures_of(analysis, signal, self.settings)
                row = {"signal": signal.name, "device": one.device, "units": units, "figures": figures}
                reports.append((signal.unit, row))
            return reports

        reports = list(chain(*in_parallel(work, self.requested)))
        rows = [row for _, row in reports]
        if self.format == "json":
            return json_content(rows)
        if self.format == "arrow":
            return Content(ARROW, arrow_of(rows))
        signals = [FiguresOfSignal(row["signal"], unit, row["figures"]) for unit, row in reports]
        return Content(TEXT, analysis.text(self.format, signals).encode())


@dataclass(frozen=True, slots=True)
class PairsSide:
    """One signal of a pair: the `part`-th of those requested."""

    requested: Requested
    source: SampleSource
    part: int

    def signal(self) -> Signal:
        """That signal.

        Raises:
            DomainError: there is no such part.
        """
        read = self.source.opened()
        signals = list(chain.from_iterable(one.signals(read) for one in self.requested))
        if self.part >= len(signals):
            hint = f"Give a part from 0 to {len(signals) - 1}."
            words = f"part {self.part} is not allowed: it names {counted(len(signals), 'signal')}."
            raise DomainError("bad-value", words, hint)
        return signals[self.part]


@dataclass(frozen=True, slots=True)
class PairsJob:
    """Pairs of two signals; `points`: at most about so many of them."""

    x: PairsSide
    y: PairsSide
    pairing: Pairing
    points: int

    def content(self) -> Content:
        """The pairs, as `PairsInfo` of the API."""
        x, y = self.x.signal(), self.y.signal()
        whole = paired(x, y, self.pairing)
        few = thinned(whole, self.points)
        t0 = float(few.time[0]) if len(few.time) else 0.0
        return json_content(
            {
                "n": len(whole.time),
                "t0": t0,
                "time": np.round(few.time - t0, 6).tolist(),
                "x": shortened(few.x),
                "y": shortened(few.y),
                "starts": np.flatnonzero(few.starts).tolist(),
                "x_unit": x.unit,
                "y_unit": y.unit,
                "leader": few.leader,
            }
        )


@dataclass(frozen=True, slots=True)
class ComparisonJob:
    """A comparison of two sides; `by`: signals to correlate, the same object as `sides` for those compared."""

    sides: Sequence[tuple[Requested, SampleSource]]
    by: Sequence[tuple[Requested, SampleSource]]
    options: ComparisonOptions

    def content(self) -> Content:
        """The comparison, as `ComparisonAnswer`."""
        sides = _opened(self.sides)
        by = sides if self.by is self.sides else _opened(self.by)
        return Content(JSON, compared(sides, by, self.options).model_dump_json().encode())


def _opened(sides: Sequence[tuple[Requested, SampleSource]]) -> list[ComparisonSide]:
    return [ComparisonSide(requested, source.opened()) for requested, source in sides]


def json_content(value: Figure) -> Content:
    """A value as JSON; it has no numbers that are not finite."""
    return Content(JSON, json.dumps(value, ensure_ascii=False, allow_nan=False).encode())
