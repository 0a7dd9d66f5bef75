"""The state machine of alarms against a slow oracle that looks at every pair of samples."""

from __future__ import annotations

import itertools
import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from imuscope.server.extensions.alarms.machine import BETWEEN, BEYOND, UNKNOWN, WITHIN, AlarmMachine, AlarmTiming

Samples = list[tuple[float, int]]
STEPS = st.sampled_from([0.0, 0.25, 0.5, 1.0, 2.0, 5.0])  # exact in binary, so that sums are
CODES = st.sampled_from([BEYOND, BETWEEN, WITHIN, UNKNOWN])


@st.composite
def sequences(draw: st.DrawFn) -> Samples:
    steps = draw(st.lists(st.tuples(STEPS, CODES), max_size=60))
    time, result = 1000.0, []
    for step, code in steps:
        time += step
        result.append((time, code))
    return result


TIMINGS = st.builds(
    AlarmTiming,
    raise_s=st.sampled_from([0.0, 0.25, 1.0, 3.0]),
    clear_s=st.sampled_from([0.0, 0.5, 2.0]),
    missing_s=st.sampled_from([1.0, 4.0]),
    latched=st.booleans(),
)


def oracle(samples: Samples, timing: AlarmTiming) -> list[tuple[str, float]]:
    """Changes by their definition: looks back from each sample over all before it."""
    samples = [(time, code) for time, code in samples if code != UNKNOWN]
    results: list[tuple[str, float]] = []
    is_on, changed = False, -1  # changed: index of the sample at which it changed
    for i, (time, _) in enumerate(samples):
        if i == 0:
            results.append(("data", time))
        elif time - samples[i - 1][0] > timing.missing_s:
            results += [("missing", samples[i - 1][0] + timing.missing_s), ("data", time)]
        expected, hold = (WITHIN, timing.clear_s) if is_on else (BEYOND, timing.raise_s)
        for j in range(i, changed, -1):
            stretch = samples[j : i + 1]
            gaps = [b[0] - a[0] > timing.missing_s for a, b in itertools.pairwise(stretch)]
            if any(code != expected for _, code in stretch) or any(gaps):
                break
            if time - samples[j][0] >= hold:
                results.append((("returned" if timing.latched else "cleared") if is_on else "raised", time))
                is_on, changed = not is_on, i
                break
    return results


@given(sequences(), TIMINGS, st.lists(st.integers(1, 20), min_size=1, max_size=20))
def test_any_division_into_batches_gives_what_the_oracle_states(
    samples: Samples, timing: AlarmTiming, sizes: list[int]
) -> None:
    machine = AlarmMachine(timing)
    results, at, turn = [], 0, 0
    while at < len(samples):
        batch = samples[at : at + sizes[turn % len(sizes)]]
        at, turn = at + len(batch), turn + 1
        time, codes = np.array([one[0] for one in batch]), np.array([one[1] for one in batch], np.int8)
        results += machine.feed(time, codes, time * 1.0)
    assert [(one.kind, one.time) for one in results] == oracle(samples, timing)
    raised = [one for one in results if one.kind == "raised"]
    assert all(one.value == one.time for one in raised)  # the value of the sample that raised it
    assert machine.count == len(raised)


def fed(machine: AlarmMachine, codes: list[int], begin: float, values: list[float] | None = None) -> list[str]:
    time = begin + np.arange(len(codes)) * 0.1
    return [
        one.kind for one in machine.feed(time, np.array(codes, np.int8), np.array(values or [math.nan] * len(codes)))
    ]


def test_the_states_of_an_alarm_in_turn() -> None:
    machine = AlarmMachine(AlarmTiming(raise_s=0.2))
    assert machine.status == "missing"
    fed(machine, [WITHIN], 0)
    assert machine.status == "ok"
    fed(machine, [BEYOND, BEYOND], 1)
    assert machine.status == "pending"
    assert machine.pending_since == 1
    assert fed(machine, [BEYOND], 1.25) == ["raised"]
    assert machine.status == "raised"
    assert machine.acknowledge("Ada", 2.0) is None
    assert machine.status == "acknowledged"
    assert fed(machine, [BETWEEN, WITHIN], 2) == ["cleared"]
    assert machine.status == "ok"
    assert machine.acknowledgement is None


def test_a_latched_alarm_stays_until_it_is_acknowledged() -> None:
    machine = AlarmMachine(AlarmTiming(latched=True))
    assert fed(machine, [WITHIN, BEYOND, WITHIN], 0) == ["data", "raised", "returned"]
    assert machine.status == "raised"
    cleared = machine.acknowledge("Ada", 1.0)
    assert cleared is not None
    assert cleared.kind == "cleared"
    assert machine.status == "ok"


def test_an_acknowledged_latched_alarm_clears_by_itself_and_a_new_one_has_to_be_acknowledged_again() -> None:
    machine = AlarmMachine(AlarmTiming(latched=True))
    fed(machine, [BEYOND], 0)
    machine.acknowledge("Ada", 0.0)
    assert fed(machine, [WITHIN, BEYOND], 1) == ["cleared", "raised"]
    assert machine.status == "raised"


def test_missing_data_neither_raise_nor_clear() -> None:
    machine = AlarmMachine(AlarmTiming(missing_s=1.0))
    fed(machine, [BEYOND], 0)
    assert [one.kind for one in machine.lose()] == ["missing"]
    assert machine.status == "missing"
    assert machine.is_active
    assert machine.lose() == []
    assert fed(machine, [UNKNOWN], 5) == []
    assert machine.status == "missing"
    assert fed(machine, [BEYOND], 6) == ["data"]
    assert machine.status == "raised"
    assert machine.count == 1


def test_the_worst_value_is_that_of_its_direction() -> None:
    machine = AlarmMachine(AlarmTiming(), direction=-1)
    fed(machine, [BEYOND, BEYOND, BETWEEN, BEYOND], 0, [5.0, 2.0, 8.0, 3.0])
    assert machine.worst == 2.0
    assert machine.raised_value == 5.0


def test_a_restart_keeps_what_was_raised_and_who_has_seen_it() -> None:
    machine = AlarmMachine(AlarmTiming())
    fed(machine, [BEYOND], 0, [5.0])
    machine.acknowledge("Ada", 1.0)
    again = AlarmMachine(AlarmTiming())
    again.restore(machine.saved())
    assert again.status == "missing"
    assert again.is_active
    assert fed(again, [BEYOND], 60, [4.0]) == ["data"]
    assert again.status == "acknowledged"
    assert again.began == 0.0
    assert again.worst == 5.0
