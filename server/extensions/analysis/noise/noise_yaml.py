"""Noise parameters as the YAML that other programs read.

    kalibr               imu.yaml of Kalibr: continuous-time densities
    vins                 acc_n, gyr_n, acc_w, gyr_w of VINS-Mono and VINS-Fusion: per sample at the recording's rate
    robot_localization   covariances of sensor_msgs/Imu, which robot_localization takes from the messages of the driver

Of several axes the noisiest one counts. A parameter that a curve does not show stands there with its limit, and a
comment says so.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from imuscope.protocols.schema.units import Unit
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.noise.registry import FiguresOfSignal


@dataclass(frozen=True, slots=True)
class _SensorNoise:
    """Noise of the noisiest axis in SI units.

    Attributes:
        walk, rate_walk: random walk and rate random walk; of one that the curve does not show, its limit.
        limits: names of those that are limits.
        axes: random walk of each axis, in the order of the signals.
        rate: of the samples, Hz.
        names: of the signals.
    """

    walk: float
    rate_walk: float
    limits: frozenset[str]
    axes: tuple[float, ...]
    rate: float
    names: tuple[str, ...]


def kalibr(signals: Sequence[FiguresOfSignal]) -> str:
    """imu.yaml of Kalibr."""
    sensors = _sensors(signals)
    lines = _head(sensors, "Kalibr imu.yaml: noise of continuous time")
    for name, unit, sensor in _present(sensors, "accelerometer", "gyroscope"):
        lines += [
            f"{name}_noise_density: {sensor.walk:.6e}  # {unit}/√Hz{_limit(sensor, 'random_walk')}",
            f"{name}_random_walk: {sensor.rate_walk:.6e}  # {unit}/s/√Hz{_limit(sensor, 'rate_random_walk')}",
        ]
    lines += ["rostopic: /imu/data_raw", f"update_rate: {_rate(sensors):.6g}  # Hz"]
    return _text(lines)


def vins(signals: Sequence[FiguresOfSignal]) -> str:
    """The noise parameters of a VINS configuration."""
    sensors = _sensors(signals)
    rate = _rate(sensors)
    lines = _head(sensors, f"VINS: standard deviations per sample at {rate:.6g} Hz, density × √rate")
    for name, unit, sensor in _present(sensors, "acc", "gyr"):
        root = math.sqrt(sensor.rate)
        lines += [
            f"{name}_n: {sensor.walk * root:.6e}  # {unit}{_limit(sensor, 'random_walk')}",
            f"{name}_w: {sensor.rate_walk * root:.6e}  # {unit}/s{_limit(sensor, 'rate_random_walk')}",
        ]
    return _text(lines)


def robot_localization(signals: Sequence[FiguresOfSignal]) -> str:
    """Covariances of the Imu messages that robot_localization weighs its input by."""
    sensors = _sensors(signals)
    lines = _head(sensors, "robot_localization takes these from sensor_msgs/Imu: set them in the driver of the sensor")
    for name, unit, sensor in _present(sensors, "linear_acceleration", "angular_velocity"):
        axes = sensor.axes if len(sensor.axes) == 3 else (max(sensor.axes),) * 3
        cells = [f"{axes[row] ** 2 * sensor.rate:.6e}" if row == col else "0.0" for row in range(3) for col in range(3)]
        lines.append(f"{name}_covariance: [{', '.join(cells)}]  # ({unit})²{_limit(sensor, 'random_walk')}")
    return _text(lines)


FORMATS = {"kalibr": kalibr, "vins": vins, "robot_localization": robot_localization}


def _sensors(signals: Sequence[FiguresOfSignal]) -> Mapping[str, _SensorNoise]:
    """Accelerometers and gyroscopes among the signals.

    Raises:
        DomainError: "bad-value": there is none; "no-result": something prevents a statement on one of them.
    """
    for one in signals:
        for obstacle in one.figures.get("obstacles", ()):
            raise DomainError("no-result", f"{one.name}: {obstacle['message']}", obstacle["hint"])
    sensors = {
        unit: _noise([one for one in signals if Unit.parse(one.unit).fits(Unit.parse(unit))], Unit.parse(unit))
        for unit in ("m/s²", "rad/s")
        if any(Unit.parse(one.unit).fits(Unit.parse(unit)) for one in signals)
    }
    if not sensors:
        names = ", ".join(one.name for one in signals)
        hint = "Request the accelerometers and the gyroscopes."
        raise DomainError("bad-value", f"{names:.200} is neither an acceleration nor a rate of turn.", hint)
    return sensors


def _noise(signals: Sequence[FiguresOfSignal], unit: Unit) -> _SensorNoise:
    walks, rate_walks = (
        [_parameter(one, name, unit) for one in signals] for name in ("random_walk", "rate_random_walk")
    )
    (walk, walk_is_limit), (rate_walk, rate_walk_is_limit) = max(walks), max(rate_walks)
    limits = [("random_walk", walk_is_limit), ("rate_random_walk", rate_walk_is_limit)]
    return _SensorNoise(
        walk,
        rate_walk,
        frozenset(name for name, is_limit in limits if is_limit),
        tuple(value for value, _ in walks),
        min(float(one.figures["rate"]) for one in signals),
        tuple(one.name for one in signals),
    )


def _parameter(signal: FiguresOfSignal, name: str, unit: Unit) -> tuple[float, bool]:
    """A parameter in `unit`, and whether it is only a limit."""
    parameter: Mapping[str, float] = signal.figures["parameters"][name]
    is_limit = not parameter["value"]
    return (parameter["high"] if is_limit else parameter["value"]) * Unit.parse(signal.unit).to(unit), is_limit


def _present(sensors: Mapping[str, _SensorNoise], acceleration: str, turn: str) -> list[tuple[str, str, _SensorNoise]]:
    names = {"m/s²": acceleration, "rad/s": turn}
    return [(names[unit], unit, sensor) for unit, sensor in sensors.items()]


def _head(sensors: Mapping[str, _SensorNoise], title: str) -> list[str]:
    missing = {"m/s²": "accelerometer", "rad/s": "gyroscope"}
    lines = [f"# {title}", f"# Allan deviation of {'; '.join(', '.join(one.names) for one in sensors.values())}"]
    return lines + [f"# No {name} was requested." for unit, name in missing.items() if unit not in sensors]


def _limit(sensor: _SensorNoise, name: str) -> str:
    return "; at most: the curve does not show it" if name in sensor.limits else ""


def _rate(sensors: Mapping[str, _SensorNoise]) -> float:
    return min(sensor.rate for sensor in sensors.values())


def _text(lines: Sequence[str]) -> str:
    return "\n".join(lines) + "\n"
