"""Model of one uninterrupted segment of a device's clock, observed through a link that only delays.

## The lower envelope

A frame cannot arrive before it was sent. With `w` the time its own bytes take on the wire,

    arrival = device + offset + drift × device + w + delay,      delay ≥ 0

so the points (device, arrival − device − w) all lie on or above a straight line, and touch it whenever a frame met no
delay. The model estimates that line: the lower envelope. (Of a frame that came in pieces, the first bytes touch it, not
the last ones, which waited in an adapter: chunk_boundaries.py.)

    arrival − device − w
       │   ·    ·      · ·        ·          each · a frame: delayed by scheduling, a 16 ms USB burst, a busy network
       │ ·   · ·  ·  ·     · ·  ·    ·
       │·_·____·_______·_______·_______·__   the line: offset, and the drift as its slope
       └─────────────────────────────────── device

Of each second of device time only the lowest point is kept, for `WINDOW_S` seconds. Once a second their lower convex
hull is computed; the hull's edge above the mean device time is the line under all points with the least mean distance
to them. With little history a slope is meaningless, so it is weighted by T² / (T² + S²) of the span T: points known to
A need S = A / 50 ppm to resolve the drift of a usual crystal: a second or two behind a good cable, eight behind an
adapter.

## The mapping

The line moves as it is learned, but published times never do: the mapping is a chain of knots (device, host), fixed up
to the newest device time added, and from there it approaches the line, faster or slower than true by at most a few per
cent. So host times are continuous, strictly increasing in device time, and a frame that carries an older time (a GNSS
solution among IMU samples) falls on the same mapping as its neighbours.

    host │            ╱ line now
         │        _ ╱            the plan: reach the line within `SLEW` of slope error
         │     __╱·
         │  _╱   newest added    the past: never rewritten
         └──────────────────── device

## Limits

The reference is the end of a frame on the wire: a delay common to all frames (a buffering adapter which never delivers
at once) looks like an offset. `uncertainty` estimates ± how much of that could be hidden, from the spread of the delays
(delay_stats.py).

Rules for editing: all times are int64 ns outside and float64 ns relative to the first row inside (exact for 100 days).
"""

from collections import deque
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Array, Ints
from imuscope.protocols.clocks.delay_stats import RECENT_NS, DelaySpread, DelayStatistics
from imuscope.protocols.clocks.kernels import host_times

WINDOW_S = 120  # memory of the envelope: a beat between a 125 Hz stream and 16 ms polls takes 80 s at 100 ppm; with a
# longer one a drift that changes by 8 ppm a minute (a sensor warming up) would cost more than half a millisecond
BUCKET_NS = 1e9  # one point is kept per bucket
CRYSTAL_DRIFT = 50e-6  # drift of a usual crystal
SURE_S, UNSURE_S = 1.0, 8.0  # limits of S
DRIFT_SPANS = 3.0  # S, from which on the drift is known: nine tenths of the slope count
MAX_DRIFT = 1e-3  # a crystal is 20-100 ppm off; an RC oscillator may be worse
PLAN_NS = 20e6  # the mapping is replanned at most this often
PLAN_TIME_NS = 0.25e9  # ... to meet the line after this time
SLEW, SLEW_EARLY, SLEW_FAR = 0.005, 0.05, 0.5  # slope error while settled; in the first seconds; when far off
FAR_NS = 50e6
EARLY_NS = 3e9
MAX_KNOTS = 1024
PRIOR_NS, PRIOR_ROWS = 16e6, 16  # initially: one burst of a USB adapter; halved after this many rows
COMMON_DRIFT = 1e-4  # bound of a drift not yet known
FLOOR_NS = 100e3  # scheduling of the reading thread itself, and the tick of an MTi's clock
SHARP_NS = 50e3  # best accuracy of the least late point of a second
FEWEST_POINTS = 6  # of the envelope, from which their own scatter gives their accuracy
FORGET_NS = 120e9  # a delay hidden by an adapter moves with the drift between two crystals: for this long ...
WANDER_FACTOR = 1.4  # ... it may have moved by the hidden amount, and more, while the drift was learned
JUDGED_NS, JUDGED_FROM = 0.2e9, 64  # how often the delays are judged, once there are this many
JUDGED_LATER_NS, LATER_NS = 1e9, 30e9  # and how often after that time: those of the last seconds change slowly then
STEP_NS = 50e6  # rows this far below the line are a step of the clock: three times the longest USB burst
SMALLEST_STEP_NS, STEP_BOUNDS = 1e6, 4  # once the line is known, a step is this much and this many ± below it


class ClockModel:
    """One uninterrupted segment of a device's clock: its envelope, its line, and the published knots.

    Args:
        origin: device time of its first row, ns.
        host_origin: arrival of that row, ns since the Unix epoch.
        late: stores its delays.
        unknown_ns: unknowable part of the delay: the one-way time of a network.

    Inside: x = device − origin; y = arrival − w − host origin − x; h = host − host origin; all float64 ns.
    """

    def __init__(self, origin: int, host_origin: int, late: DelayStatistics, unknown_ns: float = 0.0) -> None:
        self.origin = origin
        self.host_origin = host_origin
        self.slope = 0.0
        self.intercept = 0.0
        self.newest = 0.0  # greatest x added
        self.oldest = 0.0
        self.arrival = 0  # arrival of the newest good row
        self._buckets: deque[tuple[float, float]] = deque(maxlen=WINDOW_S)
        self._bucket_end = -np.inf
        self._lowest: tuple[float, float] | None = None  # lowest point of the open bucket
        self._knot_x = np.zeros(2 * MAX_KNOTS)
        self._knot_h = np.zeros(2 * MAX_KNOTS)
        self._breakpoints = 1
        self._final_slope = 1.0  # of the mapping after its last knot
        self._planned = -np.inf
        self.late = late
        self.step_ns = STEP_NS
        self.spread = DelaySpread()
        self._unknown_ns = unknown_ns
        self._shrink_s = UNSURE_S
        self._scatter: float | None = None  # of the envelope's points above their line; None: too few
        self._tested = -np.inf
        self._vague = PRIOR_NS  # accuracy of the envelope's points
        self._wander = 0.0  # how far a hidden delay may have moved while the drift was learned
        self._uncertainty = PRIOR_NS

    # -- learning

    def update(
        self,
        x: Array,
        delay: Array,
        arrival: int,
        size: float = 0.0,
        waited: Array | None = None,
        *,
        judged: bool = True,
        rows: tuple[int, int, int] | None = None,
    ) -> None:
        """Add rows with their delays over the current line; move the line, then the plan.

        Args:
            size: bytes of a frame.
            waited: extra delay of the last bytes of the frames, ns; None: none.
            judged: its delays describe the link; not those of a message that waits for others on the line.
            rows: those with the least delay, the least and the greatest x, if known.
        """
        settled = self.newest
        first = self.late.rows == 0
        at, oldest, last = rows or (int(delay.argmin()), int(x.argmin()), int(x.argmax()))
        low_x, low = float(x[at]), float(delay[at])
        newest = float(x[last])
        if judged or first:
            self._append_history(x, delay, arrival, size, waited, is_fresh=x[oldest] >= self.newest)
        self.newest = max(settled, newest)
        self.oldest = min(self.oldest, float(x[0]))
        self.arrival = max(self.arrival, arrival)
        if low < 0 or first:
            self.intercept += low
            low = 0.0
        self._store(low_x, low + self.intercept + self.slope * low_x)
        if first:
            self.begin_at(self.intercept, 0.0)
        elif self.newest - self._planned >= PLAN_NS:
            self._plan(settled)
        interval = JUDGED_NS if self.newest < LATER_NS else JUDGED_LATER_NS
        if self.newest - self._tested >= interval or self.late.rows <= JUDGED_FROM:
            self._test_step()

    def _append_history(
        self, x: Array, delay: Array, arrival: int, size: float, waited: Array | None, *, is_fresh: bool
    ) -> None:
        """Store delays. An older row (a GNSS solution, seconds late by its own time) gives no information on the
        link.
        """
        if self.late.rows and not is_fresh:
            fresh = x >= self.newest
            x, delay, waited = x[fresh], delay[fresh], None if waited is None else waited[fresh]
        if len(x):
            self.late.add(x, delay, size, arrival, waited)

    def _store(self, x: float, y: float) -> None:
        """Add one point of the envelope; at the end of a bucket fit the line again."""
        if x >= self._bucket_end:
            if self._lowest is not None:
                self._buckets.append(self._lowest)
                self._fit()
            self._bucket_end = x + BUCKET_NS
            self._lowest = (x, y)
        elif self._lowest is None or y - self.slope * x < self._lowest[1] - self.slope * self._lowest[0]:
            self._lowest = (x, y)

    def _fit(self) -> None:
        """The line under all points with the least mean distance to them, its slope weighted by the history."""
        points = sorted(self._buckets)
        span = (points[-1][0] - points[0][0]) / 1e9
        self.slope = 0.0
        if span >= 2.0:
            steep = _edge_slope(_lower_hull(points), sum(x for x, _ in points) / len(points))
            above = np.sort([y - steep * x for x, y in points])
            self._scatter = float(above[len(above) // 2] - above[0]) if len(points) >= FEWEST_POINTS else None
            self.slope = min(max(steep, -MAX_DRIFT), MAX_DRIFT) * span**2 / (span**2 + self._shrink_s**2)
        self.intercept = min(y - self.slope * x for x, y in points)

    # -- the mapping

    def begin_at(self, h: float, x: float | None = None) -> None:
        """Start the mapping: host time `h` at `x` (default: the origin)."""
        self._knot_x[0] = 0.0 if x is None else x
        self._knot_h[0] = h
        self._breakpoints = 1
        self._final_slope = 1.0 + self.slope
        self._planned = self._knot_x[0]

    def _plan(self, settled: float) -> None:
        """Keep the mapping up to `settled`; from there approach the line."""
        h = self._evaluate(settled)
        line = 1.0 + self.slope
        error = settled * line + self.intercept - h
        size = abs(error)
        slew = SLEW_FAR if size > FAR_NS else SLEW_EARLY if self.newest < EARLY_NS else SLEW
        time = max(size / slew, PLAN_TIME_NS)
        n = self._breakpoints
        while n > 1 and self._knot_x[n - 1] >= settled:
            n -= 1
        if n + 2 > 2 * MAX_KNOTS:
            self._knot_x[:MAX_KNOTS] = self._knot_x[n - MAX_KNOTS : n]
            self._knot_h[:MAX_KNOTS] = self._knot_h[n - MAX_KNOTS : n]
            n = MAX_KNOTS
        if settled > self._knot_x[n - 1]:
            self._knot_x[n], self._knot_h[n] = settled, h
            n += 1
        self._knot_x[n], self._knot_h[n] = settled + time, h + time * line + error
        self._breakpoints = n + 1
        self._final_slope = line
        self._planned = settled

    def _evaluate(self, x: float) -> float:
        """The mapping at one x."""
        n = self._breakpoints
        end = self._knot_x[n - 1]
        if x >= end:
            return float(self._knot_h[n - 1] + (x - end) * self._final_slope)
        if x < self._knot_x[0]:
            return float(self._knot_h[0] + (x - self._knot_x[0]) * self._final_slope)
        return float(np.interp(x, self._knot_x[:n], self._knot_h[:n]))

    def host(self, device: Array) -> Ints:
        """Unix ns of device times."""
        knots = self._knot_x, self._knot_h, self._breakpoints
        host = np.empty(len(device), np.int64)
        host_times(
            np.ascontiguousarray(device, np.int64), self.origin, self.host_origin, *knots, self._final_slope, host
        )
        return host

    def last_host(self) -> float:
        """Host time of the newest row, ns."""
        return self._evaluate(self.newest) + float(self.host_origin)

    def first_host(self) -> float:
        """Host time at which the mapping begins, ns."""
        return float(self._knot_h[0]) + float(self.host_origin)

    def distance(self, device: Array) -> NDArray[np.float64]:
        """Distance of device times from the observed range, ns; 0 within."""
        x = (device - self.origin).astype(np.float64)
        return np.asarray(np.abs(x - np.clip(x, self.oldest, self.newest)))

    # -- judging

    def jitter(self, p: float) -> float:
        """The `p`-th percentile of the delays of the last seconds, ns."""
        recent = self.late.recent(self.newest)
        if not len(recent):
            return 0.0
        at = (len(recent) - 1) * p / 100  # as np.percentile, which sorts them again
        low, high = recent[int(at)], recent[min(int(at) + 1, len(recent) - 1)]
        return float(max(low, 0.0) + (max(high, 0.0) - max(low, 0.0)) * (at - int(at)))

    @property
    def knows_drift(self) -> bool:
        """Whether the history is long enough for the slope to be that of the clock."""
        span = self.newest - self.oldest
        return (
            self._scatter is not None
            and span >= DRIFT_SPANS * self._shrink_s * 1e9
            and self.drift_bound() <= COMMON_DRIFT
        )

    def drift_bound(self) -> float:
        """± of the slope: that of both ends of the line, and the part of the slope that a short history withholds."""
        span = min(max((self.newest - self.oldest) / 1e9, 1.0), WINDOW_S)
        withheld = self._shrink_s**2 / (span**2 + self._shrink_s**2)
        return 2 * (self._vague + SHARP_NS) / (span * 1e9) + (abs(self.slope) + CRYSTAL_DRIFT) * withheld

    def uncertainty(self) -> float:
        """± in ns."""
        return self._uncertainty

    def _test_step(self) -> None:
        """±, from all sources of error: few rows so far; no recent row touched the line; the delays come in steps (a
        poll grid that beats with the stream), so that the smallest may itself be most of a step; an adapter may hide
        more; the drift is not known yet; the mapping has not reached the line yet.
        """
        spread = self.spread = self.late.spread(self.newest)
        if spread.hold and self.newest > RECENT_NS:
            faded = min(max((self.newest - self._tested) / FORGET_NS, 0.0), 1.0)
            self._wander = max(WANDER_FACTOR * spread.hidden, self._wander * (1 - faded))
        doubt = spread.low + max(spread.hidden, spread.grid, min(COMMON_DRIFT * self.newest, self._wander))
        vague = max(self._wander, spread.gap if self._scatter is None else self._scatter)
        self._vague = max(spread.hidden, spread.gap if self._scatter is None else self._scatter)
        self._shrink_s = min(max((vague + SHARP_NS) / CRYSTAL_DRIFT / 1e9, SURE_S), UNSURE_S)
        self._tested = self.newest
        span, shrink = self.newest / 1e9, self._shrink_s
        value = max(PRIOR_NS * PRIOR_ROWS / (PRIOR_ROWS + self.late.rows), doubt)
        value += COMMON_DRIFT * self.newest * shrink**2 / (shrink**2 + span**2)
        value += abs(self.newest * (1 + self.slope) + self.intercept - self._evaluate(self.newest)) + FLOOR_NS
        self._uncertainty = value + self._unknown_ns
        settled = self.newest - self.oldest > EARLY_NS
        self.step_ns = min(STEP_NS, STEP_BOUNDS * self._uncertainty + SMALLEST_STEP_NS) if settled else STEP_NS


def _lower_hull(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Corners of the lower convex hull of points sorted by x (Andrew's monotone chain)."""
    hull: list[tuple[float, float]] = []
    for x, y in points:
        while len(hull) >= 2:
            (ax, ay), (bx, by) = hull[-2], hull[-1]
            if (bx - ax) * (y - ay) > (by - ay) * (x - ax):
                break
            hull.pop()
        hull.append((x, y))
    return hull


def _edge_slope(hull: list[tuple[float, float]], x: float) -> float:
    """Slope of the hull's edge above `x`; 0 for a single corner."""
    for (ax, ay), (bx, by) in pairwise(hull):
        if bx >= x and bx > ax:
            return (by - ay) / (bx - ax)
    return 0.0
