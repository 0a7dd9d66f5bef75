"""Progress, result or refusal of a calibration, in the words of the HTTP API.

All calibrations end in one form, corrected = matrix · (measured − bias), so that one export and one page serve them.
"""

from typing import Literal

from pydantic import BaseModel, Field

from imuscope.server.extensions.analysis.signals.triads import Samples

CalibrationKind = Literal["gyroscope", "magnetometer", "accelerometer", "mounting"]

Vector = list[float]


class CalibrationRefusal(BaseModel):
    """The reason why the samples do not determine the answer, and what helps."""

    message: str
    hint: str


class CalibrationFigure(BaseModel):
    """A number of the result."""

    name: str
    title: str
    value: float
    uncertainty: float | None = Field(default=None, description="standard uncertainty (1 σ), in `unit`")
    unit: str


class ResidualTrace(BaseModel):
    """A magnitude that does not depend on attitude, before and after the correction."""

    title: str
    unit: str
    target: float = Field(description="the value without error")
    before: Vector
    after: Vector


class SensorCorrection(BaseModel):
    """The result: corrected = matrix · (measured − bias), in the axes of the sensor."""

    unit: str
    bias: Vector = Field(description="x, y, z, in `unit`")
    bias_uncertainty: Vector = Field(description="standard uncertainties (1 σ), in `unit`")
    matrix: list[Vector] = Field(description="three rows")
    matrix_uncertainty: float = Field(description="the largest standard uncertainty (1 σ) of its elements")
    presupposes: str = Field(description="a sentence: what the uncertainties hold for; shown beside them")


class DirectionCoverage(BaseModel):
    """Directions seen, as cells of equal area on a sphere around the sensor.

    The half around +z comes first, then the half around −z; in each the rings from its centre outwards; in a ring
    the cells by azimuth, from +x over +y.
    """

    rings: list[int] = Field(description="number of cells in each ring of a half")
    seen: list[bool] = Field(description="by cell")
    share: float = Field(description="of the cells, 0 to 1")
    needed: float = Field(description="share from which a result is given")
    goal: float = Field(description="share at which the calibration is complete")
    missing: list[str] = Field(description="axes without samples near them: +x, −z …")
    now: Vector = Field(description="direction of the newest sample, unit vector; empty if there is none")


class RestProgress(BaseModel):
    """Stillness of the sensor, and its duration."""

    is_still: bool
    motion: float = Field(description="of the last second, as a share of what still counts as rest; above 1 it moves")
    seconds: float = Field(description="the longest rest so far")
    needed: float = Field(description="seconds from which a result is given")
    goal: float = Field(description="seconds at which the calibration is complete")


class RestPosition(BaseModel):
    """One of the six positions: the axis that points up, and how long it rested there."""

    up: str = Field(description="+x, −x, +y …")
    seconds: float
    is_done: bool


class SixPositions(BaseModel):
    """Rest in each of the six positions, and the present position."""

    positions: list[RestPosition]
    now: str = Field(description='the position that the sensor is in: "+x" …; "" between two')
    seconds: float = Field(description="rest in each position from which it counts")


class DriveProgress(BaseModel):
    """The straight drive of a mounting calibration."""

    rest_s: float = Field(description="rest before the drive, s")
    rest_needed_s: float
    speed_change: float = Field(description="m/s, summed over acceleration and braking")
    speed_needed: float
    turn: float = Field(description="° of heading between the beginning and the end of the drive")
    turn_allowed: float


class CalibrationReport(BaseModel):
    """A calibration of a sensor, complete or on its way."""

    kind: CalibrationKind
    sensor: str = Field(description="channel that it is of")
    unit: str
    t0: float = Field(description="unix seconds of the first sample")
    seconds: float = Field(description="from the first sample to the last")
    samples: int
    progress: float = Field(description="0 to 1; 1 when there is nothing left to do")
    advice: str = Field(description="what to do next, in a sentence")
    refusal: CalibrationRefusal | None = Field(default=None, description="null once there is a result")
    correction: SensorCorrection | None = None
    figures: list[CalibrationFigure] = Field(default_factory=list)
    notes: list[str] = Field(default_factory=list)
    trace: ResidualTrace | None = None
    coverage: DirectionCoverage | None = None
    rest: RestProgress | None = None
    positions: SixPositions | None = None
    drive: DriveProgress | None = None


def begun(kind: CalibrationKind, unit: str, samples: Samples, *, progress: float, advice: str) -> CalibrationReport:
    """A report on these samples, without a result yet."""
    first, last = (float(samples.time[0]), float(samples.time[-1])) if len(samples) else (0.0, 0.0)
    return CalibrationReport(
        kind=kind,
        sensor="",
        unit=unit,
        t0=first,
        seconds=last - first,
        samples=len(samples),
        progress=progress,
        advice=advice,
    )


def figure(name: str, title: str, value: float, unit: str, uncertainty: float | None = None) -> CalibrationFigure:
    """A number of the result, with its standard uncertainty if it has one."""
    return CalibrationFigure(name=name, title=title, value=value, uncertainty=uncertainty, unit=unit)
