"""The calibrations there are: which sensors each needs, and how it is made from their samples."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from imuscope.server.errors import DomainError, UsageError
from imuscope.server.extensions.analysis.noise.sample_quality import stuck_or_clipped
from imuscope.server.extensions.analysis.signals.triads import NO_SAMPLES, Samples, Triad, sensors_in, temperature_in
from imuscope.server.extensions.calibration.accelerometer import six_positions
from imuscope.server.extensions.calibration.gyroscope import gyroscope_bias
from imuscope.server.extensions.calibration.magnetometer import magnetometer_iron
from imuscope.server.extensions.calibration.mounting import VerticalAxis, mounting_rotation
from imuscope.server.extensions.calibration.report import CalibrationKind, CalibrationRefusal, CalibrationReport
from imuscope.server.wire import ChannelInfo

TEMPERATURE = "temperature"


@dataclass(frozen=True, slots=True)
class CalibrationInputs:
    """Sensors of one device, by their words.

    Attributes:
        temperature: its channel and column, as a triad of three equal columns.
    """

    triads: Mapping[str, Triad]
    temperature: Triad | None = None

    @classmethod
    def of(cls, infos: Iterable[ChannelInfo]) -> "CalibrationInputs":
        """Those of a device with these channels."""
        known = list(infos)
        column = temperature_in(known)
        warmth = None if column is None else Triad(column[0], (column[1],) * 3, TEMPERATURE, 1.0, "°C")
        return cls(sensors_in(known), warmth)

    def all(self) -> dict[str, Triad]:
        """All of them, the temperature too."""
        return {**self.triads, **({TEMPERATURE: self.temperature} if self.temperature else {})}


@dataclass(frozen=True, slots=True)
class CalibrationOptions:
    """Calibration inputs that no device can report.

    Attributes:
        field: strength of the magnetic field there, in the unit of the magnetometer; 0 if unknown.
        gravity: there, m/s²; 0 if unknown.
        square: the housing is square and rests on a level table (accelerometer).
        vertical: where z of the vehicle points (mounting).
    """

    field: float = 0.0
    gravity: float = 0.0
    square: bool = False
    vertical: VerticalAxis = "up"

    def __post_init__(self) -> None:
        for name, most in (("field", 1e6), ("gravity", 20.0)):
            if not 0 <= getattr(self, name) <= most:
                raise UsageError(f"{name} {getattr(self, name):g} is outside 0 … {most:g}")


Evaluate = Callable[[Mapping[str, Samples], Mapping[str, Triad], CalibrationOptions], CalibrationReport]


@dataclass(frozen=True, slots=True)
class CalibrationMethod:
    """A calibration.

    Attributes:
        sensor: that it belongs to.
        uses: sensors that it uses as well, if the device has them.
        needs: sensors without which it cannot be made, besides `sensor`.
    """

    kind: CalibrationKind
    title: str
    sensor: str
    evaluate: Evaluate
    uses: tuple[str, ...] = ()
    needs: tuple[str, ...] = field(default=())

    def missing(self, inputs: CalibrationInputs) -> list[str]:
        """Sensors that the device does not show."""
        return [one for one in (self.sensor, *self.needs) if one not in inputs.triads]

    def triads(self, inputs: CalibrationInputs) -> dict[str, Triad]:
        """The sensors that it reads."""
        known = inputs.all()
        return {name: known[name] for name in (self.sensor, *self.needs, *self.uses) if name in known}


def _gyroscope(
    samples: Mapping[str, Samples], triads: Mapping[str, Triad], options: CalibrationOptions
) -> CalibrationReport:
    del triads, options
    return gyroscope_bias(
        samples["gyroscope"],
        *(samples.get(name, NO_SAMPLES) for name in ("accelerometer", TEMPERATURE, "magnetometer")),
    )


def _magnetometer(
    samples: Mapping[str, Samples], triads: Mapping[str, Triad], options: CalibrationOptions
) -> CalibrationReport:
    return magnetometer_iron(samples["magnetometer"], triads["magnetometer"].unit, options.field)


def _accelerometer(
    samples: Mapping[str, Samples], triads: Mapping[str, Triad], options: CalibrationOptions
) -> CalibrationReport:
    del triads
    turn = samples.get("gyroscope", NO_SAMPLES)
    return six_positions(samples["accelerometer"], turn, options.gravity, square=options.square)


def _mounting(
    samples: Mapping[str, Samples], triads: Mapping[str, Triad], options: CalibrationOptions
) -> CalibrationReport:
    del triads
    return mounting_rotation(samples["accelerometer"], samples["gyroscope"], options.vertical)


METHODS: Mapping[str, CalibrationMethod] = {
    one.kind: one
    for one in (
        CalibrationMethod(
            "gyroscope",
            "Gyroscope bias",
            "gyroscope",
            _gyroscope,
            uses=("accelerometer", TEMPERATURE, "magnetometer"),
        ),
        CalibrationMethod("magnetometer", "Magnetometer", "magnetometer", _magnetometer),
        CalibrationMethod("accelerometer", "Accelerometer", "accelerometer", _accelerometer, uses=("gyroscope",)),
        CalibrationMethod("mounting", "Mounting rotation", "accelerometer", _mounting, needs=("gyroscope",)),
    )
}


HINT = "Add it to the output configuration of the device."
TABLE_HINT = "Name columns and units of the table, gyr_x in rad/s: with --columns, or Read otherwise… on the page."


def method_for(kind: str, inputs: CalibrationInputs, device: str, *, is_table: bool = False) -> CalibrationMethod:
    """A calibration of a device, or of the columns of a table.

    Raises:
        DomainError: "not-found": there is no such calibration; "not-now": the device does not show its sensor.
    """
    method = METHODS.get(kind)
    if method is None:
        raise DomainError("not-found", f"Calibration {kind:.40} not found.", f"There are: {', '.join(METHODS)}.")
    missing = method.missing(inputs)
    if missing and is_table:
        raise DomainError("not-now", f"{device} has no columns of {' and '.join(missing)}.", TABLE_HINT)
    if missing:
        raise DomainError("not-now", f"{device} sends no data of its {' and '.join(missing)}.", HINT)
    return method


def is_table(manifest: Mapping[str, Any], device: str) -> bool:
    """Whether a device of a recording is a table of another program."""
    return all(not one["protocol"] for one in manifest["devices"] if one["id"] == device)


def evaluated(
    method: CalibrationMethod,
    triads: Mapping[str, Triad],
    samples: Mapping[str, Samples],
    options: CalibrationOptions,
) -> CalibrationReport:
    """The report of a calibration; some of the samples may be missing.

    A fit of a stuck or clipped sensor is not a calibration: it is refused.
    """
    report = method.evaluate({name: samples.get(name, NO_SAMPLES) for name in triads}, triads, options)
    triad = triads[method.sensor]
    report.sensor = triad.name
    if triad.others:
        report.notes.append(f"This is {triad.title}; the device also has {', '.join(triad.others)}.")
    if report.refusal is None:
        report.refusal = _fault(triads, samples)
    if report.refusal is not None:
        report.correction = None
        report.progress = min(report.progress, 0.95)
    return report


def _fault(triads: Mapping[str, Triad], samples: Mapping[str, Samples]) -> CalibrationRefusal | None:
    """A fault in the samples of a sensor that was used."""
    for name, triad in triads.items():
        own = samples.get(name, NO_SAMPLES)
        if name in (TEMPERATURE, "magnetometer" if "gyroscope" in triads else "") or not own.rate:
            continue
        for at, axis in enumerate("xyz"):
            for _, message, hint in stuck_or_clipped(own.values[:, at], own.rate, triad.unit):
                return CalibrationRefusal(message=f"{triad.name}.{axis}: {message}", hint=hint)
    return None
