"""± of times and of drift: it covers the truth, or is withheld, under the conditions that it presumes."""

from collections.abc import Callable

import numpy as np
import pytest

from imuscope.protocols.arrays import Floats
from imuscope.protocols.clocks.clock_sync import ClockSync
from tests.support.each_row import each_row

EPOCH_NS = 17 * 10**17
SIZE, BYTE_NS = 60, 10_850
TRUTHS, SECONDS = 200, 25


def observed(rate: float, delayed: Callable[[Floats], Floats], random: np.random.Generator) -> Floats:
    """Error of the newest time and its ±, ms, and of the drift and its ±, ppm (NaN while withheld).

    (n, 4), each second from the tenth on, in some truths each tenth of a second as live, of a device whose drift and
    phase are random.
    """
    per_s = 10 if random.random() < 0.05 else 1
    ppm, count = random.uniform(-60, 60), int(rate * SECONDS)
    true = np.arange(count) / rate + random.uniform(0, 1 / rate)
    device = (np.floor((true * (1 + ppm * 1e-6) + 5) * 10_000) * 100_000).astype(np.int64)
    arrival = np.maximum.accumulate(delayed(true + SIZE * BYTE_NS * 1e-9))
    clock = ClockSync(BYTE_NS)
    rows = []
    ends = [*(np.flatnonzero(np.diff(np.floor(arrival * per_s))) + 1).tolist(), count]
    for first, last in zip([0, *ends[:-1]], ends, strict=True):
        [*_, host] = clock.add(device[first:last], (arrival[first:last] * 1e9).astype(np.int64) + EPOCH_NS, SIZE)
        if arrival[last - 1] > 10:
            drift = clock.drift_ppm - ppm if clock.knows_drift else np.nan
            error = (host - EPOCH_NS) / 1e6 - true[last - 1] * 1e3
            rows.append((error, clock.uncertainty_ns / 1e6, drift, clock.drift_bound_ppm))
    return np.array(rows)


def held(period: float, random: np.random.Generator) -> Callable[[Floats], Floats]:
    """An unknown adapter or poll that hands over at even times."""
    phase = random.uniform(0, period)
    return lambda end: np.ceil((end - phase) / period) * period + phase + random.exponential(5e-5, len(end))


@each_row(
    ("rate", "period"),
    [
        (100, 0.0),
        (400, 0.0),
        (200, 0.002),
        (100, 0.004),
        (400, 0.01),
        (125, 0.016),
        (200, 0.016),
        (100, 0.02),
        (200, 0.02),
    ],
)
def test_times_and_drift_lie_within_their_uncertainty_behind_a_grid(rate: float, period: float) -> None:
    random = np.random.default_rng(round(1e6 * period + rate))
    free = lambda end: end + random.exponential(5e-5, len(end))  # noqa: E731 - beside `held`
    rows = np.concatenate([observed(rate, held(period, random) if period else free, random) for _ in range(TRUTHS)])
    assert (np.abs(rows[:, 0]) <= rows[:, 1]).mean() >= 0.95
    drift = rows[np.isfinite(rows[:, 2])]
    if len(drift):
        assert (np.abs(drift[:, 2]) <= drift[:, 3]).mean() >= 0.93
        assert drift[:, 3].max() <= 100


def test_a_delay_of_all_frames_alike_is_presumed_not_to_be() -> None:
    """A steady delay of 9 ms cannot be seen: ± names what it presumes."""
    clock = ClockSync(BYTE_NS)
    assert clock.presumes == ""
    rows = np.arange(1000) * 10**7
    clock.add(rows, rows + EPOCH_NS + 9_000_000, SIZE)
    assert clock.uncertainty_ns < 9e6
    assert clock.presumes == "if not all frames are delayed alike"
    network = ClockSync(0, unknown_ns=1e6)
    network.add(rows, rows + EPOCH_NS, SIZE)
    assert "network" in network.presumes
    adapter = ClockSync(BYTE_NS, holds_ns=16e6)
    adapter.add(rows, rows + EPOCH_NS + 9_000_000, SIZE)
    assert adapter.presumes == ""
    assert adapter.uncertainty_ns > 9e6


def test_an_unknown_clock_has_no_drift() -> None:
    assert ClockSync().drift_bound_ppm == pytest.approx(float("inf"))
