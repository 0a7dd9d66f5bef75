"""A single sample beyond a limit, in an hour of 1 kHz, is an alarm and is in the buckets of every zoom."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imuscope.recordings.columns.rows import ExactRows
from imuscope.recordings.columns.store import ChannelLayout, ColumnStore, ColumnStoreWriter
from imuscope.server.extensions.alarms.conditions import ExpressionJudge
from imuscope.server.extensions.alarms.definitions import AlarmDefinition, ExpressionCondition
from imuscope.server.extensions.alarms.machine import AlarmMachine, AlarmTiming
from imuscope.server.extensions.alarms.preview import recorded_preview
from imuscope.server.wire import ChannelInfo, ColumnInfo

RATE, HOUR, BEGIN = 1000.0, 3_600_000, 1_760_000_000.0
LIMIT = 50.0
SHOWN = 200  # single samples beyond the limit
INFO = ChannelInfo(1, "1", "M", "Force", "Force", "scalar", "N", "", [ColumnInfo("value", "f4", "N")])
CONDITION = ExpressionCondition(expression="Force > 50 N")


@cache
def places() -> np.ndarray:
    """Rows of the single samples."""
    return np.sort(np.random.default_rng(5).choice(HOUR // 10, SHOWN, replace=False)) * 10 + 3


@cache
def hour() -> tuple[np.ndarray, np.ndarray]:
    """Times, and noise far within the limit with the single samples beyond it, each with a value of its own.

    Not made while the tests are collected, which every process of them does.
    """
    values = np.random.default_rng(6).uniform(-1, 1, HOUR).astype(np.float32)
    values[places()] = 100 + np.arange(SHOWN)
    return BEGIN + np.arange(HOUR) / RATE, values


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> ColumnStore:
    writer = ColumnStoreWriter(tmp_path_factory.mktemp("hour") / "store")
    writer.channel(1, ChannelLayout(("f4",), (False,)))
    times, values = hour()
    for begin in range(0, HOUR, 50_000):
        at = slice(begin, begin + 50_000)
        writer.append(1, [times[at] + 0.002, times[at], values[at]])
    return writer.finish({"channels": []})


@settings(max_examples=100, deadline=None)
@given(
    which=st.integers(0, SHOWN - 1),
    span=st.floats(-2, np.log10(3600)).map(lambda power: 10**power),
    share=st.floats(0.001, 0.999),
    width=st.integers(30, 4000),
)
def test_it_is_in_the_bucket_of_its_time_at_every_zoom(
    store: ColumnStore, which: int, span: float, share: float, width: int
) -> None:
    when = hour()[0][places()[which]]
    t0 = when - share * span
    result = store.query(1, t0, t0 + span, width)
    if isinstance(result, ExactRows):
        assert result.columns[0].max() >= 100 + which
        return
    pixel = span / width
    near = np.abs(np.clip(when, result.t, np.append(result.t[1:], t0 + span)) - when) <= pixel
    assert result.high[0][near].max() >= 100 + which


def test_each_is_an_alarm_in_the_recording(store: ColumnStore) -> None:
    results = recorded_preview(AlarmDefinition(name="Shock", condition=CONDITION), store, [INFO])
    assert results.times == SHOWN
    assert results.worst == 100 + SHOWN - 1
    expected = hour()[0][places()[: len(results.intervals)]]
    np.testing.assert_allclose([one.t0 for one in results.intervals], expected, atol=1e-6)


@settings(max_examples=10, deadline=None)
@given(sizes=st.lists(st.integers(1, 5000), max_size=8))
def test_each_is_an_alarm_live_in_whatever_batches_it_comes(sizes: list[int]) -> None:
    times, values = (all_of[:20_000] for all_of in hour())
    judge, machine = ExpressionJudge(CONDITION, [INFO], 3.0), AlarmMachine(AlarmTiming())
    at, turn, raised, target = 0, 0, [], [*sizes, 3000]
    while at < len(values):
        rows = slice(at, at + target[turn % len(target)])
        judged = judge.judge({1: [times[rows], times[rows], values[rows]]})
        raised += [one.time for one in machine.feed(*judged) if one.kind == "raised"]
        at, turn = rows.stop, turn + 1
    expected = times[values > LIMIT].tolist()
    assert expected
    assert raised == expected
