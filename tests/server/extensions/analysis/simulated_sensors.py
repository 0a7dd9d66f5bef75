"""Simulated sensors at rest, with known noise and with faults: what verdicts on noise are tried with.

A sensor has a gyroscope (°/s) and an accelerometer (m/s²) of three axes, white noise N, flicker B and a rate random
walk K on each, an attitude, a temperature and a status word, as far as `sends` names them. A fault changes it in place.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.protocols.family.sensor_properties import SensorProperties
from imuscope.server.extensions.analysis.expressions.signal_request import requested_signals
from imuscope.server.extensions.analysis.noise.registry import analysis_named
from imuscope.server.extensions.analysis.noise.report import figures_of
from imuscope.server.extensions.analysis.signals.signals import Signal, SignalColumn
from imuscope.server.wire import BitsInfo, ChannelInfo, ColumnInfo

START = 1.76e9
G = 9.80665
N_SHEET, B_SHEET = 0.005, 8 / 3600
"""Random walk, °/s/√Hz, and bias instability, °/s, of the data sheet that all these sensors have."""
FORCE = G * 60e-6 / math.sqrt(2) / N_SHEET
"""Noise of the accelerometer, as a multiple of that of the gyroscope in its unit."""
EVERYTHING = ("force", "attitude", "temperature", "status")
SHEET = SensorProperties(
    turn=math.radians(N_SHEET) * math.sqrt(2),
    turn_bias=math.radians(B_SHEET),
    acceleration=G * 60e-6,
    acceleration_bias=G * 15e-6,
)


@dataclass
class SimulatedSensor:
    """Samples of one sensor, and the truth about it; `walk` is N, `flicker` B and `rate_walk` K of the gyroscope."""

    time: Floats
    turn: Floats
    force: Floats
    attitude: Floats
    status: Floats
    temperature: Floats
    rate: float
    walk: float
    flicker: float
    rate_walk: float
    sends: tuple[str, ...] = EVERYTHING

    @property
    def since(self) -> Floats:
        """Times from the first sample on, s."""
        return self.time - START

    def keep(self, which: Any) -> None:
        """Only these samples."""
        for name in ("time", "turn", "force", "attitude", "status", "temperature"):
            setattr(self, name, getattr(self, name)[which])

    def lowest(self) -> float:
        """Lowest part of the true Allan deviation of the gyroscope."""
        tau = np.geomspace(1 / self.rate, len(self.time) / self.rate / 4, 400)
        flat = 2 * math.log(2) / math.pi * self.flicker**2
        return float(np.sqrt(self.walk**2 / tau + flat + self.rate_walk**2 * tau / 3).min())

    def signal(self, name: str = "RateOfTurn.x") -> Signal:
        """A signal as a request finds it, with what the device sends beside it."""
        parts: dict[str, Floats] = {"RateOfTurn": self.turn, "Acceleration": self.force}
        if "force" not in self.sends and not name.startswith("Acceleration"):
            del parts["Acceleration"]
        if "attitude" in self.sends:
            parts["Quaternion"] = self.attitude
        if "status" in self.sends:
            parts["StatusWord"] = self.status[:, None]
        if "temperature" in self.sends:
            parts["Temperature"] = self.temperature[:, None]
        infos = [_channel(number, one) for number, one in enumerate(parts, 1)]

        def read(column: SignalColumn) -> tuple[Floats, Floats]:
            return self.time, parts[column.info.name][:, column.at]

        [requested] = requested_signals(
            infos, [name], zero_phase=True, product=lambda device: ("MTi-630", SHEET), companions=True
        )
        return requested.signals(read)[0]


def _channel(number: int, name: str) -> ChannelInfo:
    columns, kind, unit, bits = {
        "RateOfTurn": ("xyz", "vector", "°/s", []),
        "Acceleration": ("xyz", "vector", "m/s²", []),
        "Quaternion": (("q0", "q1", "q2", "q3"), "quaternion", "", []),
        "StatusWord": (("value",), "status", "", [BitsInfo("ClipGyrX", 11, 1), BitsInfo("ClipMagX", 14, 1)]),
        "Temperature": (("value",), "scalar", "°C", []),
    }[name]
    rows = [ColumnInfo(name=one, dtype="f4", unit=unit, bits=bits) for one in columns]
    title = {"RateOfTurn": "Rate of turn"}.get(name, name)
    results: dict[str, Any] = {"id": number, "device": "1", "name": name, "title": title, "kind": kind, "unit": unit}
    return ChannelInfo(**results, message="MTData2", frame="", columns=rows)


def at_rest(
    seed: int = 1,
    *,
    seconds: float = 600.0,
    rate: float = 100.0,
    walk: float = 0.8 * N_SHEET,
    flicker: float = 0.0,
    rate_walk: float = 0.0,
) -> SimulatedSensor:
    """A sensor at rest with this noise."""
    draw = np.random.default_rng(seed)
    n = round(seconds * rate)

    def noise() -> Floats:
        results: Floats = draw.normal(0, walk * math.sqrt(rate), (n, 3))
        if rate_walk:
            results += np.cumsum(draw.normal(0, rate_walk / math.sqrt(rate), (n, 3)), axis=0)
        if flicker:
            results += np.stack([flicker_noise(n, flicker, draw) for _ in range(3)], axis=1)
        return results

    time = START + np.arange(n) / rate
    attitude = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    turn, force = noise() + draw.uniform(-0.3, 0.3, 3), FORCE * noise() + (0.02, -0.03, G + 0.01)
    status, temperature = np.full(n, 3.0), 31.0 + draw.normal(0, 0.03, n)
    turn, force = turn.astype(np.float32).astype(np.float64), force.astype(np.float32).astype(np.float64)
    return SimulatedSensor(time, turn, force, attitude, status, temperature, rate, walk, flicker, rate_walk)


def flicker_noise(n: int, size: float, draw: np.random.Generator) -> Floats:
    """Noise of the one-sided density B²/(π f), whose Allan deviation is 0.664 B."""
    bins = n // 2 + 1
    frequency = np.arange(bins) / n
    frequency[0] = np.inf
    root = np.sqrt(size**2 / (math.pi * frequency) * n / 4)
    rows: Floats = np.fft.irfft(root * (draw.normal(size=bins) + 1j * draw.normal(size=bins)), n)
    return rows


def judged(sensor: SimulatedSensor, name: str = "RateOfTurn.x", **options: Any) -> dict[str, Any]:
    """Figures of the Allan deviation of one of its signals."""
    analysis = analysis_named("allan")
    return figures_of(analysis, sensor.signal(name), analysis.settings(options))[0]


def swinging(sensor: SimulatedSensor, size: float, period: float = 5.0) -> None:
    """Swing about x by a rate of `size` °/s, which tilts gravity too."""
    angle = 2 * math.pi * sensor.since / period
    sensor.turn[:, 0] += size * np.sin(angle)
    tilt = np.radians(size) * period / (2 * math.pi) * -np.cos(angle)
    sensor.force[:, 1] += G * np.sin(tilt)
    sensor.force[:, 2] += G * (np.cos(tilt) - 1)


def turning(sensor: SimulatedSensor, rate: float) -> None:
    """Turn steadily about the vertical, °/s."""
    sensor.turn[:, 2] += rate
    half = np.radians(rate * sensor.since) / 2
    sensor.attitude[:, 0], sensor.attitude[:, 3] = np.cos(half), np.sin(half)


def tilting(sensor: SimulatedSensor, rate: float) -> None:
    """Turn steadily about x, °/s."""
    sensor.turn[:, 0] += rate
    angle = np.radians(rate * sensor.since)
    sensor.force[:, 1] += G * np.sin(angle)
    sensor.force[:, 2] += G * (np.cos(angle) - 1)


def stuck(sensor: SimulatedSensor, seconds: float) -> None:
    """The last value again and again, at the end."""
    begin = max(0, len(sensor.time) - round(seconds * sensor.rate))
    sensor.turn[begin:] = sensor.turn[begin]
    sensor.force[begin:] = sensor.force[begin]


def rounded(sensor: SimulatedSensor, step: float) -> None:
    """Values rounded to steps of `step` °/s."""
    sensor.turn = np.round(sensor.turn / step) * step
    force = step * FORCE
    sensor.force = np.round(sensor.force / force) * force


def repeated(sensor: SimulatedSensor, part: float) -> None:
    """This part of the samples repeats the one before; 0.5: each is sent twice."""
    numbers = np.floor(np.arange(len(sensor.time)) * (1 - part) + 1e-9).astype(int)
    first = np.concatenate(([True], np.diff(numbers) > 0))
    source = np.maximum.accumulate(np.where(first, np.arange(len(numbers)), 0))
    sensor.turn, sensor.force = sensor.turn[source], sensor.force[source]


def vibrating(sensor: SimulatedSensor, rms: float, frequency: float = 37.3) -> None:
    """A line on all axes; above half the rate its image appears."""
    wave = rms * math.sqrt(2) * np.sin(2 * math.pi * frequency * sensor.since + 0.4)
    sensor.turn += wave[:, None]
    sensor.force += FORCE * wave[:, None]


def warming(sensor: SimulatedSensor, rise: float, seconds: float = 150.0, per_degree: float = 0.02) -> None:
    """A rise of the temperature, °C, that ends, and a bias that follows it along a curve."""
    degrees = rise * (1 - np.exp(-sensor.since / seconds))
    sensor.temperature += degrees
    bias = per_degree * (degrees + 0.02 * degrees**2)
    sensor.turn += bias[:, None]
    sensor.force += FORCE * bias[:, None]


def clipped(sensor: SimulatedSensor, above: float) -> None:
    """Values end at their mean and `above` standard deviations, at either side."""
    for values in (sensor.turn, sensor.force):
        mean, scatter = values.mean(axis=0), values.std(axis=0)
        np.clip(values, mean - above * scatter, mean + above * scatter, out=values)


def flagged(sensor: SimulatedSensor, part: float) -> None:
    """The status word says so in this part of the samples."""
    sensor.status[: max(1, round(part * len(sensor.time)))] += 1 << 11


def torn(sensor: SimulatedSensor, part: float) -> None:
    """This part of the samples is lost, in bursts of 20."""
    bursts = np.random.default_rng(5).random(len(sensor.time) // 20 + 1) >= part
    sensor.keep(np.repeat(bursts, 20)[: len(sensor.time)])


def shortened(sensor: SimulatedSensor, seconds: float) -> None:
    """Only so long."""
    sensor.keep(slice(0, round(seconds * sensor.rate)))


def filtered(sensor: SimulatedSensor, frequency: float) -> None:
    """A low-pass filter before the output."""
    from scipy.signal import butter, sosfilt

    sections = butter(2, min(0.95, 2 * frequency / sensor.rate), output="sos")
    for name in ("turn", "force"):
        values = getattr(sensor, name)
        setattr(sensor, name, sosfilt(sections, values - values[0], axis=0) + values[0])


def carried(sensor: SimulatedSensor, part: float) -> None:
    """In the hand at first: turns of some °/s about x and z, for this part of the time."""
    moving = round(part * len(sensor.time))
    draw = np.random.default_rng(8)
    slow = np.repeat(draw.normal(0, 8.0, (moving // round(sensor.rate / 5) + 1, 2)), round(sensor.rate / 5), axis=0)
    sensor.turn[:moving, ::2] += slow[:moving]
    tilt = np.radians(np.cumsum(slow[:moving, 0]) / sensor.rate)
    sensor.force[:moving, 1] += G * np.sin(tilt)
    sensor.force[:moving, 2] += G * (np.cos(tilt) - 1)


def soft_clipped(sensor: SimulatedSensor, above: float) -> None:
    """Values that saturate softly, `above` standard deviations from their mean."""
    for values in (sensor.turn, sensor.force):
        mean, limit = values.mean(axis=0), above * values.std(axis=0)
        values[:] = mean + limit * np.tanh((values - mean) / limit)


def clipped_then_noisy(sensor: SimulatedSensor, above: float) -> None:
    """Clipped, one side only from 2 σ on, and then rotated a little, so that no value is the highest one twice."""
    draw = np.random.default_rng(6)
    for values in (sensor.turn, sensor.force):
        mean, scatter = values.mean(axis=0), values.std(axis=0)
        low = mean - (above if above < 2 else 99) * scatter
        np.clip(values, low, mean + (above if above < 2 else above - 1.5) * scatter, out=values)
        values += draw.normal(0, 0.05 * scatter, values.shape)


def louder(sensor: SimulatedSensor, times: float) -> None:
    """More noise, all at once or little by little, in a part of the time."""
    draw = np.random.default_rng(round(times * 1e6))
    begin, end = sorted(draw.uniform(0, 1, 2))
    place = np.arange(len(sensor.time)) / len(sensor.time)
    growth = place if draw.random() < 0.3 else ((place > min(begin, 0.8)) & (place < max(end, begin + 0.2)))
    for values in (sensor.turn, sensor.force):
        mean = values.mean(axis=0)
        values[:] = mean + (values - mean) * (1 + (times - 1) * growth[:, None])


def stepping(sensor: SimulatedSensor, sigmas: float) -> None:
    """A bias that jumps by this many standard deviations of a sample, once to six times, to and fro."""
    draw = np.random.default_rng(round(sigmas * 1e6))
    at = np.sort(draw.integers(0, len(sensor.time), draw.integers(1, 7)))
    level = np.searchsorted(at, np.arange(len(sensor.time)), side="right") % 2
    for values in (sensor.turn, sensor.force):
        values += sigmas * values.std(axis=0) * level[:, None]


def spiky(sensor: SimulatedSensor, part: float) -> None:
    """Spikes of 10 to 50 standard deviations in this part of the samples."""
    draw = np.random.default_rng(round(part * 1e9))
    n = max(1, round(part * len(sensor.time)))
    for values in (sensor.turn, sensor.force):
        at = draw.integers(0, len(values), n)
        values[at] += draw.choice([-1, 1], (n, 1)) * draw.uniform(10, 50, (n, 1)) * values.std(axis=0)


def hushed(sensor: SimulatedSensor, share: float) -> None:
    """Less noise, this share of it, in a quarter of the time: held, or filtered more."""
    n = len(sensor.time)
    for values in (sensor.turn, sensor.force):
        part = values[n // 3 : n // 3 + n // 4]
        part[:] = part.mean(axis=0) + share * (part - part.mean(axis=0))


def bursting(sensor: SimulatedSensor, part: float) -> None:
    """Bursts of a tenth of a second with three to eight times the noise, in this part of the time."""
    draw = np.random.default_rng(round(part * 1e9))
    length = max(2, round(sensor.rate / 10))
    loud = np.repeat(draw.random(len(sensor.time) // length + 1) < part, length)[: len(sensor.time)]
    for values in (sensor.turn, sensor.force):
        mean = values.mean(axis=0)
        values[loud] = mean + (values[loud] - mean) * draw.uniform(3, 8)


FAULTS: Mapping[str, tuple[Callable[[SimulatedSensor, float], None], float, float]] = {
    "swinging": (swinging, 1e-4, 50.0),
    "turning": (turning, 1e-3, 30.0),
    "tilting": (tilting, 1e-4, 1.0),
    "stuck": (stuck, 0.1, 600.0),
    "rounded": (rounded, 1e-4, 2.0),
    "repeated": (repeated, 1e-3, 0.9),
    "vibrating": (vibrating, 1e-4, 1.0),
    "warming": (warming, 0.1, 40.0),
    "clipped": (clipped, 0.5, 5.0),
    "flagged": (flagged, 1e-5, 0.5),
    "torn": (torn, 1e-3, 0.8),
    "shortened": (shortened, 1.0, 100.0),
    "filtered": (filtered, 2.0, 200.0),
    "carried": (carried, 0.01, 1.0),
    "soft_clipped": (soft_clipped, 0.5, 5.0),
    "clipped_then_noisy": (clipped_then_noisy, 0.5, 4.0),
    "louder": (louder, 1.05, 5.0),
    "stepping": (stepping, 0.01, 5.0),
    "spiky": (spiky, 1e-5, 0.05),
    "hushed": (hushed, 0.01, 0.9),
    "bursting": (bursting, 1e-3, 0.3),
}
"""Faults with the range of their size, for random sensors."""


@dataclass(frozen=True)
class RandomSensor:
    """A sensor of random noise with a random fault; "" for none.

    Attributes:
        broken: its samples are not measurements of a sensor at rest, whatever its noise.
    """

    sensor: SimulatedSensor
    fault: str
    size: float
    signal: str
    broken: bool


GROSS = {"swinging": 1.0, "stuck": 20.0, "repeated": 0.3, "rounded": 0.5, "carried": 0.3, "torn": 0.5, "turning": 3.0}
"""Sizes from which no verdict may come, whatever it says."""


def random_sensor(seed: int, faults: Sequence[str] = ()) -> RandomSensor:
    """The sensor of this number: noise of 0.1 to 10 times the data sheet, any length, rate, fault and size of it.

    Args:
        faults: those to choose from, "" for none; () for all, and none in one of five.
    """
    draw = np.random.default_rng([seed, 2])
    walk = N_SHEET * 10 ** draw.uniform(-1, 1)
    sensor = at_rest(
        seed,
        seconds=10 ** draw.uniform(1.3, 3.2),
        rate=float(draw.choice([50.0, 100.0, 200.0])),
        walk=walk,
        flicker=float(draw.choice([0.0, B_SHEET * 10 ** draw.uniform(-1, 1)])),
        rate_walk=float(draw.choice([0.0, walk * 10 ** draw.uniform(-3, -0.5)])),
    )
    is_honest = draw.random() < 0.2 and not any(faults)
    fault = "" if is_honest else str(draw.choice(list(faults or FAULTS)))
    size = 0.0
    if fault:
        apply, low, high = FAULTS[fault]
        size = float(low * (high / low) ** draw.random())
        apply(sensor, size)
    sensor.sends = tuple(one for one in EVERYTHING if draw.random() < 0.6)
    gross = size >= GROSS.get(fault, math.inf)
    if fault == "turning" and gross and not set(sensor.sends) & {"attitude"}:
        gross = False  # its noise is still that of the sensor
    name = str(draw.choice(["RateOfTurn.x", "RateOfTurn.z"]))
    return RandomSensor(sensor, fault, size, name, gross)


def falsehoods(of: RandomSensor, figures: Mapping[str, Any]) -> list[str]:
    """Statements of the figures that are not so."""
    truth, result = of.sensor, []
    for verdict in figures["verdicts"]:
        is_walk = verdict["parameter"] == "random_walk"
        value = truth.walk if is_walk else truth.lowest()
        limit = N_SHEET * math.sqrt(2) if is_walk else B_SHEET
        wrong = {"met": value > limit, "above": value < limit, "open": False}[verdict["state"]]
        if wrong or (of.broken and verdict["state"] != "open"):
            result.append(f"{verdict['words']} (it is {value / (N_SHEET if is_walk else B_SHEET):.3g} times)")
    if (parameters := figures.get("parameters")) is not None:
        truths = {"random_walk": truth.walk, "bias_instability": truth.flicker, "rate_random_walk": truth.rate_walk}
        for name, value in truths.items():
            low, high = parameters[name]["low"], parameters[name]["high"]
            if not 2 * low - high <= value <= 2 * high - low:
                result.append(f"{name} of {low:.3g} to {high:.3g} in place of {value:.3g}")
        if of.broken:
            result.append("parameters of a sensor that is not at rest")
    return result
