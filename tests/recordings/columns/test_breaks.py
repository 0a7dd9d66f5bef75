"""Gaps of a series: each lost sample is one, and jitter, a change of rate, a pattern or bursts are none."""

import numpy as np

from imuscope.recordings.columns.breaks import BLOCK_ROWS, gaps_in
from tests.support.each_row import each_row

CHANGED = np.concatenate((np.arange(900) / 200, 4.5 + np.arange(900) / 50, 22.5 + np.arange(900) / 200))
JITTER = np.random.default_rng(1).normal(0, 0.0002, 3000)


@each_row(
    "time",
    [
        np.empty(0),
        np.array([0.0, 1.0]),
        np.arange(3000) / 100,
        np.sort(np.arange(3000) / 1000 + JITTER),
        CHANGED,
        np.cumsum(np.tile((0.01, 0.01, 0.02), 900)),  # every fourth slot is left out by the device
        np.repeat(np.arange(300) * 0.016, 16),
        np.repeat(np.arange(30) * 0.04, 100),
    ],
)
def test_nothing_is_missing(time: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
    assert gaps_in(time).tolist() == []


@each_row(["share", "at_least"], [(0.01, 1.0), (0.05, 1.0), (0.15, 0.97)])
def test_each_lost_sample_is_a_gap(share: float, at_least: float) -> None:
    time = np.arange(20_000) / 100
    time = time[np.random.default_rng(2).random(20_000) >= share]
    holes = np.flatnonzero(np.diff(time) > 0.015) + 1
    gaps = gaps_in(time)
    assert np.isin(gaps, holes).all()
    assert len(gaps) >= at_least * len(holes)


def test_a_gap_is_found_in_the_slower_part_too() -> None:
    time = np.delete(CHANGED, [100, 1500])
    assert gaps_in(time).tolist() == [1499]  # the other one is as long as a usual step next to it
    whole = np.concatenate((np.arange(4 * BLOCK_ROWS) / 200, 100 + np.arange(4 * BLOCK_ROWS) / 50))
    lost = [100, 7 * BLOCK_ROWS]
    assert gaps_in(np.delete(whole, lost)).tolist() == [100, 4 * BLOCK_ROWS - 1, lost[1] - 1]


def test_an_outage_hides_no_lost_sample_beside_it() -> None:
    time = np.arange(200) / 100
    time[150:] += 20.0
    assert gaps_in(np.delete(time, 170)).tolist() == [150, 170]


def test_a_pause_between_bursts_is_a_gap() -> None:
    time = np.repeat(np.arange(300) * 0.016, 16)
    time[2400:] += 0.2
    assert gaps_in(time).tolist() == [2400]
