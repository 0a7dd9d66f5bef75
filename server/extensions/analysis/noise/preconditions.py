"""Preconditions of a statement on the noise of a sensor: rest, sound samples, and a model that fits.

    CHECKS, group by group ─> Obstacle: what prevents a verdict, and what to do

The curve is drawn in any case. Noise parameters, verdicts on a data sheet and texts for other programs are withheld
while there is an obstacle: they would be figures of the motion, the vibration or the fault. Checks that could not be
made because the device does not send it is stated too (`unchecked`).

A new check is a function of `Measured` that returns an Obstacle or None, in CHECKS.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.protocols.schema.plural import counted
from imuscope.protocols.schema.units import G, Unit, rounded
from imuscope.server.extensions.analysis.noise.allan_deviation import AllanCurve
from imuscope.server.extensions.analysis.noise.disturbances import (
    STEP,
    SlowChange,
    Spectrum,
    bandwidth,
    slow_change,
    spectrum_of,
    strongest_line,
)
from imuscope.server.extensions.analysis.noise.noise_model import NoiseModel
from imuscope.server.extensions.analysis.noise.sample_quality import sample_faults
from imuscope.server.extensions.analysis.noise.steadiness import MAX_SKEWNESS, MAX_TAIL, MIN_FLATNESS, Regularity
from imuscope.server.extensions.analysis.signals.companions import Companions
from imuscope.server.extensions.analysis.signals.rest import Rest
from imuscope.server.extensions.analysis.signals.sampling import Sampling
from imuscope.server.extensions.analysis.signals.signals import Signal

LEAST_S = 20.0  # at rest, for any parameter
MAX_MOVING_SHARE = 0.25  # part of the range
MAX_REST_OF_GRAVITY = 1.0  # m/s²: it was removed, with the error of an attitude
GRAVITY_ERROR = 0.5  # m/s², of its strength: an uncalibrated accelerometer is off by less
MAX_TILT_DEG = 0.5  # °: gravity turns by less as an accelerometer warms up
MAX_BIAS, MAX_KNOWN_BIAS = 10.0, 2.0  # °/s: a larger mean rate is a turn, also of a sensor whose data sheet is unknown
MAX_TURN_DEG, MAX_TURN_RATE = 3.0, 0.01  # ° and °/s: the heading of a filter without a reference drifts by less
MAX_WARMING_C = 10.0  # °C: over more a line is not how a bias depends on temperature
MAX_MISSING_SHARE = 0.1  # part of the range
MIN_LONGEST_SHARE = 0.2  # the longest stretch as part of all samples
REST = "Lay the sensor down where nothing moves it, for 20 minutes, and record again."
MAX_LEVEL_RATIO = 1.1  # of the loudest part to the quietest; up to it the intervals contain both
STRETCH_BLOCKS, BLOCK_STEPS = 30, 20  # parts of a stretch, of 2 s or more


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A finding that prevents a verdict.

    Attributes:
        check: name of the check.
        message: the finding, one sentence.
        hint: what to do.
    """

    check: str
    message: str
    hint: str

    def figures(self) -> dict[str, str]:
        """The attributes by name."""
        return {"check": self.check, "message": self.message, "hint": self.hint}


@dataclass(frozen=True)
class Measured:
    """A signal with its companions and its curve, as the checks take it.

    Attributes:
        signal: as requested.
        values: those judged: without the part that follows the temperature.
        rest: stretches that were judged.
        model: the model fitted to the curve.
    """

    signal: Signal
    values: Floats
    sampling: Sampling
    rest: Rest
    curve: AllanCurve
    model: NoiseModel

    @cached_property
    def companions(self) -> Companions:
        """The other sensors of the device; without samples if there are none."""
        return Companions() if self.signal.companions is None else self.signal.companions()

    @cached_property
    def spectrum(self) -> Spectrum | None:
        """Of the stretches at rest."""
        return spectrum_of(self.values, self.rest.runs, self.sampling)

    @cached_property
    def slow(self) -> SlowChange:
        """Of the stretches at rest."""
        return slow_change(self.signal.time, self.values, self.rest.runs)

    @cached_property
    def regularity(self) -> Regularity:
        """Of the stretches at rest."""
        return Regularity(self.values, self.rest.runs, self.sampling.rate)

    @cached_property
    def duration(self) -> float:
        """Time at rest, s."""
        return float(sum(run.stop - run.start for run in self.rest.runs)) / self.sampling.rate


def obstacles(measured: Measured) -> list[Obstacle]:
    """Findings that prevent a verdict: those of the first group of checks that has any; empty if nothing does."""
    for checks in CHECKS:
        if problems := [obstacle for check in checks if (obstacle := check(measured)) is not None]:
            return problems
    return []


def unchecked(signal: Signal) -> str:
    """A sentence on checks that could not be made; "" if all were."""
    beside = None if signal.companions is None else signal.companions()
    missing = [
        name
        for name, there in (
            ("the rate of turn", beside is not None and len(beside.gyroscope) > 0),
            ("gravity", beside is not None and (_gravity_of(beside) or 0.0) >= MAX_REST_OF_GRAVITY),
            ("the attitude", beside is not None and len(beside.attitude) > 0),
            ("flags for clipping", beside is not None and beside.has_status),
            ("the temperature", signal.temperature is not None),
        )
        if not there
    ]
    if not missing:
        return ""
    listed = " and ".join([", ".join(missing[:-1]), missing[-1]] if len(missing) > 1 else missing)
    return f"Not checked, because it is not known here: {listed}."


def _samples(measured: Measured) -> Obstacle | None:
    signal = measured.signal
    # an angle that wraps has its own extremes
    for check, message, hint in sample_faults(signal.values, measured.rest.runs, measured.sampling.rate, signal.unit):
        if check != "clipped" or not signal.period:
            return Obstacle(check, message, hint)
    return None


def _status(measured: Measured) -> Obstacle | None:
    clipped = measured.companions.clipped
    if not clipped:
        return None
    name, count = max(clipped.items(), key=lambda one: one[1])
    message = f"Clipped: the device reports {name} in {counted(count, 'sample')}."
    return Obstacle("status", message, "Set a larger range of the sensor, or remove what drives it to its limit.")


def _motion(measured: Measured) -> Obstacle | None:
    rest = measured.rest
    if rest.moving <= MAX_MOVING_SHARE * rest.whole:
        return None
    return Obstacle("motion", f"Moving: {rounded(rest.moving)} s of {rounded(rest.whole)} s.", REST)


def _gravity(measured: Measured) -> Obstacle | None:
    size = _gravity_of(measured.companions)
    if size is None or abs(size - G) <= GRAVITY_ERROR:
        return None
    hint = "Calibrate the accelerometer, and record at rest."
    if size < MAX_REST_OF_GRAVITY:
        if not Unit.parse(measured.signal.unit).fits(Unit.parse("m/s²")):
            return None  # of the gyroscope beside it, gravity is not known (`unchecked`)
        hint = "Gravity was removed from this acceleration: analyse the one that the sensor measures, with gravity."
    message = f"Gravity: the accelerometers show {size:.3g} m/s² in place of 9.81 m/s²."
    return Obstacle("gravity", message, hint)


def _gravity_of(companions: Companions) -> float | None:
    """Mean strength of the acceleration at rest, m/s²; None if it is not known."""
    force = companions.steps[1]
    means = [force.means[part] for part in _stretches(force.time, companions.moving)]
    return float(np.linalg.norm(np.concatenate(means), axis=1).mean()) if means else None


def _tilt(measured: Measured) -> Obstacle | None:
    if (_gravity_of(measured.companions) or 0.0) < MAX_REST_OF_GRAVITY:
        return None
    force, moving = measured.companions.steps[1], measured.companions.moving
    worst = 0.0
    for part in _stretches(force.time, moving):
        blocks = _block_means(force.means[part])
        directions = blocks / np.maximum(np.linalg.norm(blocks, axis=1, keepdims=True), 1e-9)
        angles = np.degrees(np.arccos(np.clip(directions @ directions[0], -1, 1)))
        scatter = np.degrees(np.linalg.norm(np.diff(directions, axis=0), axis=1))
        angle = float(angles.max())
        if angle > max(MAX_TILT_DEG, 6 * float(np.median(scatter)) if len(scatter) > 2 else 0.0):
            worst = max(worst, angle)
    if not worst:
        return None
    return Obstacle("tilt", f"Turning slowly: the direction of gravity changes by {worst:.2g}°.", REST)


def _turning(measured: Measured) -> Obstacle | None:
    turn = measured.companions.steps[0]
    unit = Unit.parse(measured.signal.unit)
    if len(turn):
        still = [turn.means[part] for part in _stretches(turn.time, measured.companions.moving)]
        size = float(np.linalg.norm(np.concatenate(still).mean(axis=0))) if still else 0.0
    elif unit.fits(Unit.parse("°/s")):
        mean = np.mean([measured.signal.values[run].mean() for run in measured.rest.runs])
        size = abs(float(mean)) * unit.to(Unit.parse("°/s"))
    else:
        return None
    known = measured.signal.data_sheet is not None
    limit = MAX_KNOWN_BIAS if known else MAX_BIAS
    if size <= limit:
        return None
    message = f"Turning: the mean rate of turn is {size:.3g} °/s; a bias is at most {limit:.3g} °/s."
    return Obstacle("turning", message, REST)


def _attitude(measured: Measured) -> Obstacle | None:
    samples = measured.companions.attitude
    worst, within = 0.0, 0.0
    for part in _stretches(samples.time, measured.companions.moving):
        time, q = samples.time[part], samples.values[part][:: max(1, (part.stop - part.start) // 1000)]
        angle = float(np.degrees(2 * np.arccos(np.clip(np.abs(q @ q[0]), 0, 1))).max())
        seconds = float(time[-1] - time[0])
        if angle > max(MAX_TURN_DEG, MAX_TURN_RATE * seconds, worst):
            worst, within = angle, seconds
    if not worst:
        return None
    return Obstacle("attitude", f"Turning: the attitude changes by {worst:.3g}° in {rounded(within)} s.", REST)


def _temperature(measured: Measured) -> Obstacle | None:
    if measured.signal.temperature is None:
        return None
    degrees = measured.signal.temperature()[1]
    degrees = degrees[np.isfinite(degrees)]
    if len(degrees) < 2:
        return None
    low, high = (float(one) for one in np.quantile(degrees, (0.01, 0.99)))
    if high - low <= MAX_WARMING_C:
        return None
    message = f"Warming up: the temperature goes from {low:.1f} to {high:.1f} °C, by more than {MAX_WARMING_C:.0f} °C."
    return Obstacle("temperature", message, "Let the sensor warm up for 20 minutes, and record again.")


def _gaps(measured: Measured) -> Obstacle | None:
    sampling = measured.sampling
    total = measured.rest.whole + sampling.missing
    longest = sampling.longest / sampling.rate
    if (
        sampling.missing <= MAX_MISSING_SHARE * total
        and sampling.longest >= MIN_LONGEST_SHARE * measured.rest.whole * sampling.rate
    ):
        return None
    message = (
        f"Gaps: {rounded(sampling.missing)} s of {rounded(total)} s are missing in {counted(sampling.gaps, 'gap')}; "
    )
    message += f"the longest stretch without one has {rounded(longest)} s."
    return Obstacle("gaps", message, "Mend the link or lower the output rate (see the panel Health), and record again.")


def _duration(measured: Measured) -> Obstacle | None:
    if measured.duration >= LEAST_S * (1 - 1e-3):
        return None
    message = f"Too short: {rounded(measured.duration)} s at rest; at least {LEAST_S:.0f} s are needed."
    return Obstacle("duration", message, REST)


def _line(measured: Measured) -> Obstacle | None:
    if measured.spectrum is None:
        return None
    line = strongest_line(measured.spectrum, measured.sampling.rate, measured.curve)
    if line is None:
        return None
    low, high = line.images
    unit = measured.signal.unit
    word = "Vibration" if line.frequency >= 1 else "Swinging or vibration"
    message = f"{word}: a line of {rounded(line.rms)} {unit} rms stands at {rounded(line.frequency, 4)} Hz"
    message += f" (it may be the image of one at {rounded(low, 4)} or {rounded(high, 4)} Hz)."
    return Obstacle("vibration", message, "Stop what vibrates or swings, and record again.")


def _slow(measured: Measured) -> Obstacle | None:
    if not measured.slow.is_sure or measured.slow.words == STEP:
        return None
    hint = "Let the sensor warm up for 20 minutes where nothing moves it and the temperature is even, and record again."
    return Obstacle("drift", f"Slow change: the signal shows {measured.slow.words}, which is not noise.", hint)


def _jump(measured: Measured) -> Obstacle | None:
    jump = measured.regularity.jump
    if jump is None and not (measured.slow.is_sure and measured.slow.words == STEP):
        return None
    message = "Step: the mean jumps, and may jump back."
    if jump is not None:
        time, size = measured.signal.time, f"{rounded(abs(jump.size))} {measured.signal.unit}".rstrip()
        message = f"Step: the mean jumps by {size} at {rounded(float(time[jump.at] - time[0]))} s."
    hint = "Look for a change of settings, temperature or supply there, and choose a range without it."
    return Obstacle("step", message, hint)


def _level(measured: Measured) -> Obstacle | None:
    level = measured.regularity.level
    if level is None or level.high <= MAX_LEVEL_RATIO * level.low:
        return None
    message = f"Unsteady: the noise of one part of the range is {level.high / level.low:.3g} times that of another."
    return Obstacle("level", message, "Look at the signal for what changed, and choose a range in which it is even.")


def _distribution(measured: Measured) -> Obstacle | None:
    tail, skewness = measured.regularity.moments
    hint = "Set a larger range of the sensor, or remove what drives it to its limit."
    if tail > MAX_TAIL:
        message = "Bursts: the values lie far from their mean more often than noise does"
        hint = "Look at the signal for bursts and spikes, and choose a range without them."
    elif tail < -MIN_FLATNESS or abs(skewness) > MAX_SKEWNESS:
        message = "Saturated: the values lie far from their mean less often than noise does"
        message += ", on one side" if abs(skewness) > MAX_SKEWNESS else ""
    elif measured.regularity.is_compressed:
        return Obstacle(
            "distribution", "Saturated: the noise is smaller the further the values are from their mean.", hint
        )
    else:
        return None
    figures = f"kurtosis {3 + tail:.2f} and skewness {skewness:.2f}, where noise has 3 and 0"
    return Obstacle("distribution", f"{message} ({figures}).", hint)


def _fit(measured: Measured) -> Obstacle | None:
    misfit = measured.model.misfit
    if misfit is None:
        return None
    rate = measured.sampling.rate
    if misfit.ratio < 1 and measured.spectrum is not None and (passed := bandwidth(measured.spectrum)):
        message = f"Filtered: hardly anything is left above {passed:.3g} Hz, at a rate of {rate:.4g} Hz."
        hint = f"Set the output rate to {2 * passed:.3g} Hz or less, or the filter wider, and record again."
        return Obstacle("bandwidth", message, hint)
    percent = 100 * abs(misfit.ratio - 1)
    side = "above" if misfit.ratio > 1 else "below"
    message = f"The noise model does not fit: the curve is {percent:.0f} % {side} it at {rounded(misfit.tau)} s, "
    message += f"where {100 * misfit.expected:.2g} % are expected."
    return Obstacle("fit", message, "Look at the spectrum for filters, vibration and bursts, and choose another range.")


CHECKS: Sequence[Sequence[Callable[[Measured], Obstacle | None]]] = (
    (_samples,),
    (_status, _motion, _gaps),
    (_gravity, _tilt, _turning, _attitude, _temperature, _duration),
    (_line, _slow, _jump),
    (_level,),
    (_distribution,),
    (_fit,),
)
"""Each group presupposes the ones before: in motion everything is a disturbance, and with one no model fits."""


def _stretches(time: Floats, moving: Sequence[tuple[float, float]]) -> list[slice]:
    """Stretches of samples without motion."""
    still = np.ones(len(time), np.bool_)
    for begin, end in moving:
        still[slice(*np.searchsorted(time, (begin, end)))] = False
    edges = np.flatnonzero(np.diff(np.concatenate(([False], still, [False])).astype(np.int8))).tolist()
    return [slice(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _block_means(values: Floats) -> Floats:
    """Means of equal parts of a stretch, (n, 3), fewer if it is short."""
    count = max(1, min(STRETCH_BLOCKS, len(values) // BLOCK_STEPS))
    return np.stack([part.mean(axis=0) for part in np.array_split(values, count)])
