"""Preview of an alarm: how often it would have been raised, judged on past samples by the code that judges live ones.

Samples come in slices of about SLICE_ROWS, so that a recording of hours needs little memory. The state of filters and
of durations is kept from slice to slice.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imuscope.recordings.columns.store import ColumnStore
from imuscope.server.errors import DomainError
from imuscope.server.extensions.alarms.conditions import Rows, SampleCondition
from imuscope.server.extensions.alarms.definitions import AlarmDefinition
from imuscope.server.extensions.alarms.figures import HealthJudge
from imuscope.server.extensions.alarms.instance import RaisedInterval, compiled, timing_of
from imuscope.server.extensions.alarms.machine import AlarmMachine, AlarmTransition
from imuscope.server.extensions.analysis.expressions.channel_rates import RATE_SAMPLES
from imuscope.server.extensions.analysis.expressions.live_expression import usual_rate
from imuscope.server.extensions.analysis.jobs.jobs import Content, json_content, opened_store
from imuscope.server.streaming.channel_store import ChannelStore
from imuscope.server.wire import ChannelInfo

SLICE_ROWS = 1 << 16
MAX_SHOWN = 100  # intervals in an answer


@dataclass(frozen=True, slots=True)
class AlarmPreview:
    """Result of a preview: the times an alarm would have been raised. Values are in `unit`.

    Attributes:
        times: number of times.
        t0, t1: first and last sample judged, unix s; null without samples.
        worst: worst value while it was raised; null if it was not, or has no values.
        seconds: time raised in sum.
        intervals: the first ones.
    """

    times: int
    t0: float | None
    t1: float | None
    worst: float | None
    unit: str
    seconds: float
    intervals: list[RaisedInterval] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class LivePreviewJob:
    """A preview over samples of a live device; `rates`: as for `judge_of`."""

    definition: AlarmDefinition
    infos: Sequence[ChannelInfo]
    rates: Mapping[int, float]
    rows: Rows

    def content(self) -> Content:
        judge = judge_of(self.definition, self.infos, self.rates)
        return json_content(asdict(preview_of(self.definition, judge, [self.rows])))


@dataclass(frozen=True, slots=True)
class RecordedPreviewJob:
    """A preview over a recording, by the folder of its columns."""

    definition: AlarmDefinition
    infos: Sequence[ChannelInfo]
    folder: Path

    def content(self) -> Content:
        return json_content(asdict(recorded_preview(self.definition, opened_store(self.folder), self.infos)))


def judge_of(definition: AlarmDefinition, infos: Sequence[ChannelInfo], rates: Mapping[int, float]) -> SampleCondition:
    """The condition of an alarm for the channels of a device, with their usual rates (Hz) by id.

    Raises:
        DomainError: it does not fit the device, or is a figure of the link.
    """
    judge = compiled(definition, infos, rates)
    if isinstance(judge, HealthJudge):
        message = "Figures of the link have no past that could be judged."
        raise DomainError("bad-value", message, "Preview a condition on signals or flags.")
    return judge


def preview_of(definition: AlarmDefinition, judge: SampleCondition, slices: Iterable[Rows]) -> AlarmPreview:
    """Judge past samples. A latched alarm counts each time, as if it were acknowledged at once.

    Args:
        slices: new samples by channel, each after those before.
    """
    machine = AlarmMachine(replace(timing_of(definition), latched=False), judge.direction)
    changes: list[AlarmTransition] = []
    first = last = math.nan
    for rows in slices:
        time, codes, values = judge.judge(rows)
        if len(time):
            first = float(time[0]) if math.isnan(first) else first
            last = float(time[-1])
            changes += machine.feed(time, codes, values)
    raised = [(one.began, one.time, one.value) for one in changes if one.kind == "cleared"]
    if machine.is_on:
        raised.append((machine.began, last, machine.worst))
    worst = [value for _, _, value in raised if math.isfinite(value)]
    return AlarmPreview(
        times=len(raised),
        t0=_finite(first),
        t1=_finite(last),
        worst=(max if judge.direction > 0 else min)(worst, default=None),
        unit=judge.unit,
        seconds=sum(end - begin for begin, end, _ in raised),
        intervals=[RaisedInterval(begin, end, _finite(value)) for begin, end, value in raised[:MAX_SHOWN]],
    )


def rows_in_memory(store: ChannelStore, channels: Iterable[int], seconds: float) -> Rows:
    """Copies of the rows of the last seconds in memory."""
    rows = {number: store.of(number).ring.read() for number in channels}
    newest = max((float(columns[0][-1]) for columns in rows.values() if len(columns[0])), default=0.0)
    begins = {number: int(np.searchsorted(columns[0], newest - seconds)) for number, columns in rows.items()}
    recent = {number: [column[begins[number] :] for column in columns] for number, columns in rows.items()}
    return {number: columns for number, columns in recent.items() if len(columns[0])}


def recorded_preview(definition: AlarmDefinition, store: ColumnStore, infos: Sequence[ChannelInfo]) -> AlarmPreview:
    """Judge all samples of a device of a recording.

    Raises:
        DomainError: as `judge_of`.
    """
    rates = {info.id: usual_rate(store.clock(info.id, 0, min(RATE_SAMPLES, store.rows(info.id)))) for info in infos}
    judge = judge_of(definition, infos, rates)
    return preview_of(definition, judge, _slices(store, sorted(judge.channels)))


def _slices(store: ColumnStore, channels: Sequence[int]) -> Iterator[Rows]:
    """All rows of channels in slices of the same time."""
    span = [store.span(number) for number in channels]
    known = [one for one in span if one is not None]
    if not known:
        return
    begin, end = min(one[0] for one in known), max(one[1] for one in known)
    count = max(1, *(store.rows(number) // SLICE_ROWS for number in channels))
    at = dict.fromkeys(channels, 0)
    for edge in np.linspace(begin, end, count + 1)[1:]:
        rows: dict[int, Sequence[NDArray[Any]]] = {}
        for number in channels:
            stop = store.rows(number) if edge == end else store.between(number, -math.inf, float(edge))[1]
            if stop > at[number]:
                exact = store.exact(number, at[number], stop)
                rows[number] = [exact.arrival, exact.time, *exact.columns]
                at[number] = stop
        if rows:
            yield rows


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
