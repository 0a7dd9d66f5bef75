"""One alarm of one device: its condition, its state machine, its events and the intervals in which it was raised."""

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from imuscope.server import wire
from imuscope.server.errors import DomainError
from imuscope.server.extensions.alarms.conditions import ExpressionJudge, FlagJudge, Rows, SampleCondition
from imuscope.server.extensions.alarms.definitions import (
    AlarmDefinition,
    ExpressionCondition,
    FlagCondition,
    HealthCondition,
    StoredAlarm,
)
from imuscope.server.extensions.alarms.figures import HealthJudge, behind_words
from imuscope.server.extensions.alarms.machine import UNKNOWN, AlarmMachine, AlarmStatus, AlarmTiming, AlarmTransition
from imuscope.server.extensions.analysis.expressions.live_expression import RateUnknownError
from imuscope.server.streaming.bus import TelemetryBus
from imuscope.server.wire import ChannelInfo

MAX_INTERVALS = 200
EVENTS_PER_PERIOD = 10
PERIOD_S = 10.0
LIMITS = {1: "above", -1: "below"}

EventName = Literal["raised", "returned", "cleared", "missing", "data", "acknowledged", "repeated", "action"]


@dataclass(frozen=True, slots=True)
class RaisedInterval:
    """An interval in which an alarm was raised, unix s; `t1` None: until now."""

    t0: float
    t1: float | None
    worst: float | None


@dataclass(frozen=True, slots=True)
class AlarmState:
    """State of an alarm of one device; values are in `unit`."""

    device: str
    status: AlarmStatus
    raised: bool  # also while there is no data
    since: float | None  # unix s: raised or pending since
    value: float | None  # newest one
    raised_value: float | None  # the one that raised it
    worst: float | None  # since it was raised
    limit: float | None
    subject: str  # the value compared with it: "norm(Acceleration)"
    unit: str
    count: int  # how often it was raised
    acknowledged_by: str
    acknowledged: float | None  # unix s
    problem: str  # what prevents its evaluation at present, and what to do
    signals: list[str]  # columns that it needs: "Acceleration.x"
    intervals: list[RaisedInterval]


class AlarmInstance:
    """One alarm of one device.

    Args:
        infos: channels of the device.
        rates: usual rates of these, Hz, by id.
        name: lasting name of the device.

    Attributes:
        is_waiting: a rate that the condition needs is not known yet.
        is_new: the condition has taken no sample since it was compiled.
    """

    def __init__(
        self,
        stored: StoredAlarm,
        info: wire.DeviceInfo,
        infos: Sequence[ChannelInfo],
        rates: Mapping[int, float],
        bus: TelemetryBus,
        name: str,
    ) -> None:
        self.stored = stored
        self.device = info.id
        self.name = name
        self.channels: frozenset[int] = frozenset()
        self.problem = ""
        self.fed = bus.now()  # when the last sample was taken, by the server's clock
        self.is_closed = False
        self.deliver: Callable[[AlarmInstance, dict[str, Any]], None] | None = None  # takes the body for a webhook
        self.raises: list[float] = []  # when it was raised since they were taken, unix s
        self._bus = bus
        self._samples: SampleCondition | None = None
        self._health: HealthJudge | None = None
        self._known: tuple[object, ...] | None = None
        self._obstacle = self._behind = ""  # what prevents a verdict at present
        self._intervals: deque[RaisedInterval] = deque(maxlen=MAX_INTERVALS)
        self._period = -math.inf
        self._reported = 0
        self._suppressed: list[AlarmTransition] = []
        self.machine = AlarmMachine(timing_of(stored.definition))
        self.is_waiting = self.is_new = False
        self.compile(info, infos, rates)

    @property
    def definition(self) -> AlarmDefinition:
        return self.stored.definition

    @property
    def rates(self) -> Mapping[int, float]:
        """The rates of channels that the condition was compiled with, as far as it depends on them."""
        return self._samples.rates if isinstance(self._samples, ExpressionJudge) else {}

    def compile(self, device: wire.DeviceInfo, infos: Sequence[ChannelInfo], rates: Mapping[int, float]) -> None:
        """Compile the condition for the present channels of the device and their rates, unless they are as before."""
        known = (*(info.id for info in infos), *device.absent)
        if known == self._known and not self.is_waiting:
            return
        self._known = known
        try:
            judge = compiled(self.definition, infos, rates, device)
        except DomainError as error:
            self.problem = error.text
            self._samples, self.channels = None, frozenset()
            self.is_waiting = isinstance(error, RateUnknownError)
            return
        self.is_waiting = False
        self.problem = ""
        self.machine.direction = judge.direction
        if isinstance(judge, HealthJudge):
            if self._health is None:
                self._health = judge
            self._health.channels = judge.channels
        else:
            if self._samples is None or self._samples.channels != judge.channels:
                self._samples = judge
                self.is_new = isinstance(judge, ExpressionJudge) and bool(judge.rates)
            self.channels = judge.channels

    def restart(self) -> None:
        """Compile the condition again at the next occasion: the rate of a channel has changed."""
        self._samples, self._known = None, None

    def warm_up(self, rows: Rows) -> None:
        """Take past samples, for the state of filters and moving windows; they raise and clear nothing."""
        self.is_new = False
        if self._samples is not None and rows:
            self._samples.judge(rows)

    def feed(self, rows: Rows) -> bool:
        """Take new samples; returns whether the state changed."""
        if self._samples is None or self.channels.isdisjoint(rows):
            return False
        time, codes, values = self._samples.judge(rows)
        if not len(time):
            return False
        is_known = bool((codes != UNKNOWN).any())
        self._obstacle = "" if is_known else self._samples.obstacle
        if is_known:
            self.fed = self._bus.now()
        return self._report(self.machine.feed(time, codes, values))

    def feed_health(self, info: wire.DeviceInfo, health: wire.DeviceHealth | None, now: float) -> bool:
        """Take the present figures; returns whether the state changed."""
        self._behind = behind_words(health)
        if self._health is None:
            return False
        code, value = self._health.judge(info, health, now)
        self._obstacle = self._health.obstacle
        if code == UNKNOWN:
            return False
        self.fed = now
        time, codes, values = np.array([now]), np.array([code], np.int8), np.array([value])
        return self._report(self.machine.feed(time, codes, values))

    def tick(self, now: float) -> bool:
        """Note missing samples, and sum up suppressed events; returns whether the state changed."""
        if self._suppressed and now - self._period >= PERIOD_S:
            self._sum_up(now)
        if self.machine.is_missing or now - self.fed <= self.machine.timing.missing_s:
            return False
        return self._report(self.machine.lose())

    def acknowledge(self, by: str, now: float) -> None:
        """Acknowledge the alarm.

        Raises:
            DomainError: it is not raised.
        """
        if not self.machine.is_active:
            message = f"The alarm {self.definition.name!r:.90} is not raised."
            raise DomainError("not-now", message, "It may have cleared by itself.")
        cleared = self.machine.acknowledge(by, now)
        data = {"by": by}
        self._event("acknowledged", "info", f"Alarm {self._title} was acknowledged by {by}.", now, data)
        if cleared is not None:
            self._report([cleared])

    def close(self, now: float) -> None:
        """End the evaluation: the alarm was changed, disabled or deleted, or its device was removed."""
        self.is_closed = True
        if self._suppressed:
            self._sum_up(now)
        if self.machine.is_active:
            data = {"t0": self.machine.began, "t1": now}
            text = f"Alarm {self._title} is no longer evaluated; it was raised."
            self._event("cleared", "info", text, now, data)

    def state(self) -> AlarmState:
        """The state as shown."""
        machine, condition = self.machine, self._condition
        since = machine.began if machine.is_active else machine.pending_since
        current = [RaisedInterval(machine.began, None, _finite(machine.worst))] if machine.is_active else []
        acknowledgement = machine.acknowledgement
        return AlarmState(
            device=self.device,
            status=machine.status,
            raised=machine.is_active,
            since=_finite(since),
            value=_finite(machine.last_value),
            raised_value=_finite(machine.raised_value) if machine.is_active else None,
            worst=_finite(machine.worst) if machine.is_active else None,
            limit=_finite(math.nan if condition is None else condition.limit),
            subject="" if condition is None else condition.subject,
            unit="" if condition is None else condition.unit,
            count=machine.count,
            acknowledged_by="" if acknowledgement is None else acknowledgement.by,
            acknowledged=None if acknowledgement is None else acknowledgement.time,
            problem=self.problem or self._obstacle or self._behind,
            signals=[] if self._samples is None else list(self._samples.signals),
            intervals=[*self._intervals, *current],
        )

    # ── events ───────────────────────────────────────────────────────────────────────────────────────────────────────

    @property
    def _condition(self) -> SampleCondition | HealthJudge | None:
        return self._samples if self._health is None else self._health

    @property
    def _title(self) -> str:
        return f"“{self.definition.name}”"

    @property
    def holds(self) -> bool:
        """Whether the condition holds, and is evaluated; latched alarms stay raised after it."""
        return self.machine.is_on and not self.is_closed

    def note(self, level: wire.Level, text: str, **data: Any) -> None:
        """Report what an action of the alarm did."""
        self._event("action", level, f"Alarm {self._title} {text}", self._bus.now(), data)

    def _report(self, transitions: Sequence[AlarmTransition]) -> bool:
        for one in transitions:
            if one.kind == "raised" and self.definition.recording is not None:
                self.raises.append(one.time)
            if one.kind == "cleared":
                self._intervals.append(RaisedInterval(one.began, one.time, _finite(one.value)))
            if one.time - self._period >= PERIOD_S or one.time < self._period:
                self._sum_up(one.time)
                self._period, self._reported = one.time, 0
            if self._reported >= EVENTS_PER_PERIOD:
                self._suppressed.append(one)
                continue
            self._reported += 1
            self._event(*self._words(one))
        return bool(transitions)

    def _sum_up(self, now: float) -> None:
        """Report transitions that were not reported one by one, as one interval."""
        suppressed, self._suppressed = self._suppressed, []
        raised = [one for one in suppressed if one.kind == "raised"]
        if not suppressed:
            return
        first = min((one.began for one in suppressed if math.isfinite(one.began)), default=suppressed[0].time)
        last = suppressed[-1].time
        text = f"Alarm {self._title} was raised {len(raised)} more times within {last - first:.1f} s."
        data = {"t0": first, "t1": last, "times": len(raised), "is_raised": self.machine.is_active}
        self._event("repeated", self.definition.level, text, last, data)

    def _words(self, one: AlarmTransition) -> tuple[EventName, wire.Level, str, float, dict[str, Any]]:
        """Name, level, text, time and data of the event for a transition."""
        values = {"value": one.value, "limit": self._condition.limit if self._condition else math.nan, "t0": one.began}
        data: dict[str, Any] = {name: value for name, value in values.items() if math.isfinite(value)}
        if one.kind == "raised":
            data["unit"] = self._condition.unit if self._condition else ""
            return one.kind, self.definition.level, f"Alarm {self._title}: {self._cause(one.value)}.", one.time, data
        if one.kind in ("cleared", "returned"):
            data["t1"] = one.time
            worst = f"; worst {self._shown(one.value)}" if "value" in data and "limit" in data else ""
            length = f"after {one.time - one.began:.3g} s" if one.time - one.began < 100 else "again"
            if one.kind == "cleared":
                return one.kind, "info", f"Alarm {self._title} cleared {length}{worst}.", one.time, data
            text = f"Alarm {self._title} is within its limit {length}{worst}. It stays until it is acknowledged."
            return one.kind, "warning", text, one.time, data
        if one.kind == "missing":
            why = self._obstacle or self._behind
            words = f"cannot be evaluated: {why}" if why else "has no data: it cannot be evaluated."
            text = f"Alarm {self._title} {words}"
            return one.kind, "warning", text, one.time, data
        return one.kind, "info", f"Alarm {self._title} has data and is evaluated.", one.time, data

    def _cause(self, value: float) -> str:
        condition, definition = self._condition, self.definition.condition
        assert condition is not None
        if isinstance(definition, HealthCondition):
            if definition.figure == "link":
                return "the link is lost"
            return f"{condition.subject} is {self._shown(value)}, {self._limit_words(condition)}"
        if isinstance(definition, FlagCondition):
            return f"{definition.flag} is {'set' if definition.is_set else 'clear'}"
        if math.isnan(condition.limit):
            return f"{definition.expression} is true"
        return f"{condition.subject} is {self._shown(value)}, {self._limit_words(condition)}"

    def _limit_words(self, condition: SampleCondition | HealthJudge) -> str:
        return f"{LIMITS[condition.direction]} {self._shown(condition.limit)}"

    def _shown(self, value: float) -> str:
        unit = self._condition.unit if self._condition is not None else ""
        return f"{value:.4g} {unit}".strip() if unit != "°" else f"{value:.4g}°"

    def _event(self, name: EventName, level: wire.Level, text: str, time: float, data: dict[str, Any]) -> None:
        body = {"alarm": self.stored.id, "name": self.definition.name, "change": name, **data}
        if name in ("raised", "repeated", "returned", "cleared"):
            body["level"] = self.definition.level
            body["signals"] = [] if self._samples is None else list(self._samples.signals)
            body["subject"] = "" if self._condition is None else self._condition.subject
        self._bus.event(self.device, "alarm", level, text, time=time, data=body)
        if self.deliver is not None and name not in ("data", "action"):
            self.deliver(self, {**body, "level": self.definition.level, "time": time, "text": text})


def timing_of(definition: AlarmDefinition) -> AlarmTiming:
    """The durations of a definition."""
    return AlarmTiming(definition.raise_s, definition.clear_s, definition.missing_s, definition.latched)


def compiled(
    definition: AlarmDefinition,
    infos: Sequence[ChannelInfo],
    rates: Mapping[int, float],
    device: wire.DeviceInfo | None = None,
) -> SampleCondition | HealthJudge:
    """The condition for the channels of a device, with their usual rates (Hz) by id.

    Args:
        device: None if only its channels are known.

    Raises:
        RateUnknownError: a rate that it needs is not known yet.
        DomainError: the device does not have what it names, or units do not fit; ExpressionError says where.
    """
    condition = definition.condition
    if isinstance(condition, ExpressionCondition):
        return ExpressionJudge(condition, infos, definition.missing_s, rates)
    if isinstance(condition, FlagCondition):
        return FlagJudge(condition, infos, device)
    return HealthJudge(condition, [info.name for info in infos])


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
