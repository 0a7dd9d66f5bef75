"""State machine of one alarm of one device. Pure: times are those of the samples.

            BEYOND for raise_s                 WITHIN for clear_s
    ok ─────> pending ─────> raised ────────────────────────────────> ok         latched: only once acknowledged
                               └─ acknowledge ─> acknowledged ──────> ok

    no sample for missing_s, in any state: missing, until the next one. A raised alarm is still raised after it.

A duration runs from the first sample of a run to the present one; a sample of another code or a gap longer than
missing_s ends the run. Samples with the code UNKNOWN count as no samples.
"""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats

BEYOND, BETWEEN, WITHIN, UNKNOWN = 1, 0, -1, 2

AlarmStatus = Literal["missing", "ok", "pending", "raised", "acknowledged"]
TransitionKind = Literal["raised", "returned", "cleared", "missing", "data"]
Codes = NDArray[np.int8]


@dataclass(frozen=True, slots=True)
class AlarmTiming:
    """Durations of an alarm, s, and whether it stays until it is acknowledged."""

    raise_s: float = 0.0
    clear_s: float = 0.0
    missing_s: float = 3.0
    latched: bool = False


@dataclass(frozen=True, slots=True)
class AlarmTransition:
    """A change of the state of an alarm.

    Attributes:
        kind: "returned" is a latched alarm within its limit again, not yet acknowledged.
        time: unix s, of the sample that completed it.
        value: at that sample; of "returned" and "cleared" the worst one while it was raised. NaN if it has none.
        began: unix s, when the alarm was raised; NaN if it was not.
    """

    kind: TransitionKind
    time: float
    value: float = math.nan
    began: float = math.nan


@dataclass(frozen=True, slots=True)
class Acknowledgement:
    """Name of the user who has seen a raised alarm, and the time (unix s)."""

    by: str
    time: float


class AlarmMachine:
    """State of one alarm of one device.

    Args:
        direction: 1 if greater values are worse, -1 if smaller ones are.

    Attributes:
        is_on: the condition holds, by hysteresis and durations.
        is_active: raised, or latched and not yet acknowledged.
        is_missing: no data at present, as at the beginning.
        began: unix s, when the alarm was raised last; NaN: never.
        raised_value: value that raised it.
        worst: worst value since.
        count: how often it was raised.
    """

    def __init__(self, timing: AlarmTiming, direction: int = 1) -> None:
        self.timing = timing
        self.direction = direction
        self.is_on = False
        self.is_active = False
        self.is_missing = True
        self.began = math.nan
        self.raised_value = math.nan
        self.worst = math.nan
        self.last_value = math.nan
        self.count = 0
        self.acknowledgement: Acknowledgement | None = None
        self.last = math.nan  # time of the last sample
        self._since = math.nan  # beginning of the run that would change the state

    @property
    def status(self) -> AlarmStatus:
        """State as shown; `is_active` says whether an alarm without data is still raised."""
        if self.is_missing:
            return "missing"
        if self.is_active:
            return "acknowledged" if self.acknowledgement is not None else "raised"
        return "ok" if math.isnan(self._since) else "pending"

    @property
    def pending_since(self) -> float:
        """Beginning of the pending run, unix s; NaN if the alarm is not pending."""
        return math.nan if self.is_on else self._since

    def feed(self, time: Floats, codes: Codes, values: Floats) -> list[AlarmTransition]:
        """Take further samples, in order.

        Args:
            time: (n,) unix s; a step back counts as no step.
            codes: (n,).
            values: (n,), NaN where there are none.
        """
        known = codes != UNKNOWN
        if not known.all():
            time, codes, values = time[known], codes[known], values[known]
        if not len(time):
            return []
        first = math.isnan(self.last)
        time = np.maximum.accumulate(time)
        if not first and time[0] < self.last:
            time = np.maximum(time, self.last)
        self.last_value = float(values[-1])
        steps = np.diff(time, prepend=time[0] if first else self.last)
        transitions: list[AlarmTransition] = []
        cuts = codes[1:] != codes[:-1]
        cuts |= steps[1:] > self.timing.missing_s
        begin = 0
        for end in (*(np.flatnonzero(cuts) + 1).tolist(), len(time)):
            if steps[begin] > self.timing.missing_s:
                transitions += self._lose(self.last + self.timing.missing_s)
            transitions += self._run(time[begin:end], int(codes[begin]), values[begin:end])
            begin = end
        return transitions

    def _run(self, time: Floats, code: int, values: Floats) -> list[AlarmTransition]:
        """Take samples of one code without a gap between them."""
        transitions = []
        if self.is_missing:
            self.is_missing = False
            transitions.append(AlarmTransition("data", float(time[0])))
        self.last = float(time[-1])
        if code != (WITHIN if self.is_on else BEYOND):
            self._since = math.nan
        else:
            if math.isnan(self._since):
                self._since = float(time[0])
            held = time - self._since >= (self.timing.clear_s if self.is_on else self.timing.raise_s)
            if held[-1]:
                at = int(np.argmax(held))
                self._since = math.nan
                if self.is_on:
                    transitions.append(self._end(float(time[at])))
                    return transitions
                transitions.append(self._raise(float(time[at]), float(values[at])))
                values = values[at:]
        if self.is_on:
            self._note_worst(values)
        return transitions

    def _raise(self, time: float, value: float) -> AlarmTransition:
        if not self.is_active:
            self.began, self.worst = time, value
        self.is_on = self.is_active = True
        self.raised_value = value
        self.acknowledgement = None
        self.count += 1
        return AlarmTransition("raised", time, value, self.began)

    def _end(self, time: float) -> AlarmTransition:
        self.is_on = False
        stays = self.timing.latched and self.acknowledgement is None
        if not stays:
            self.is_active, self.acknowledgement = False, None
        return AlarmTransition("returned" if stays else "cleared", time, self.worst, self.began)

    def _note_worst(self, values: Floats) -> None:
        signed = values * self.direction
        if np.isfinite(signed).any():
            worst = float(np.nanmax(signed)) * self.direction
            if math.isnan(self.worst) or worst * self.direction > self.worst * self.direction:
                self.worst = worst

    def lose(self) -> list[AlarmTransition]:
        """Note that no sample has come for too long."""
        return [] if math.isnan(self.last) else self._lose(self.last + self.timing.missing_s)

    def _lose(self, time: float) -> list[AlarmTransition]:
        self._since = math.nan
        if self.is_missing:
            return []
        self.is_missing = True
        return [AlarmTransition("missing", time, began=self.began if self.is_active else math.nan)]

    def acknowledge(self, by: str, time: float) -> AlarmTransition | None:
        """Acknowledge it; a latched alarm that is within its limit again is cleared by it."""
        self.acknowledgement = Acknowledgement(by, time)
        if self.is_on:
            return None
        self.is_active, self.acknowledgement = False, None
        return AlarmTransition("cleared", time, self.worst, self.began)

    def saved(self) -> dict[str, Any]:
        """State that has to survive a restart of the server; numbers that are not finite are left out."""
        ack = self.acknowledgement
        numbers = {"began": self.began, "raised_value": self.raised_value, "worst": self.worst}
        return {
            "is_on": self.is_on,
            "is_active": self.is_active,
            "count": self.count,
            **{name: value for name, value in numbers.items() if math.isfinite(value)},
            **({} if ack is None else {"acknowledged_by": ack.by, "acknowledged": ack.time}),
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Continue from `saved`, without data until the first sample.

        Raises:
            TypeError, ValueError: it holds something else.
        """
        self.is_on, self.is_active = bool(saved.get("is_on")), bool(saved.get("is_active"))
        self.count = int(saved.get("count", 0))
        self.began, self.raised_value, self.worst = (
            float(saved.get(name, math.nan)) for name in ("began", "raised_value", "worst")
        )
        if self.is_active and "acknowledged_by" in saved:
            self.acknowledgement = Acknowledgement(str(saved["acknowledged_by"]), float(saved.get("acknowledged", 0)))
