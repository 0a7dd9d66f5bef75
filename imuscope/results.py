"""Results of `Recording.calibrate`, `Recording.compare` and `Recording.time`, as the command line prints them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.server.extensions.clocks.figures import ClockStepFigures, FileClock, MessageClocks
from imuscope.signals import Signal, checked

if TYPE_CHECKING:
    from imuscope.server.extensions.analysis.compare.two_sides import ComparisonAnswer
    from imuscope.server.extensions.calibration.calibrate import Calibration as Calibrated

__all__ = [
    "Calibration",
    "CalibrationFigure",
    "CalibrationKind",
    "ClockStepFigures",
    "ComparedSignal",
    "Comparison",
    "FileClock",
    "MessageClocks",
]
CalibrationKind = Literal["gyroscope", "magnetometer", "accelerometer", "mounting"]


@dataclass(frozen=True, slots=True)
class CalibrationFigure:
    """A number of a calibration; `uncertainty` is its standard uncertainty (1 σ), None where it has none."""

    value: float
    uncertainty: float | None
    unit: str
    title: str


@dataclass(frozen=True, slots=True)
class Calibration:
    """A calibration: corrected = matrix · (measured − bias), in the axes of the sensor.

    Args:
        device: product and serial number.
        sensor: name of the signal.
        unit: of the bias.
        bias, bias_uncertainty: (3,); the latter is 1 σ.
        matrix: (3, 3); matrix_uncertainty: the largest 1 σ of its elements.
        presupposes: what the uncertainties hold for, in a sentence; "" if nothing.
        figures: by name.
    """

    kind: CalibrationKind
    device: str
    sensor: str
    unit: str
    bias: Floats
    bias_uncertainty: Floats
    matrix: Floats
    matrix_uncertainty: float
    presupposes: str
    figures: Mapping[str, CalibrationFigure]
    notes: tuple[str, ...]

    @classmethod
    def of(cls, made: Calibrated) -> Calibration:
        """That of the calibration as it was computed."""
        report, result = made.report, made.report.correction
        assert result is not None  # else it was refused
        return cls(
            report.kind,
            made.device,
            report.sensor,
            result.unit,
            np.array(result.bias),
            np.array(result.bias_uncertainty),
            np.array(result.matrix),
            result.matrix_uncertainty,
            result.presupposes,
            {one.name: CalibrationFigure(one.value, one.uncertainty, one.unit, one.title) for one in report.figures},
            tuple(report.notes),
        )

    @checked
    def apply(self, signal: Signal) -> Floats:
        """(n, 3) the corrected samples of a signal, in `unit`."""
        values = signal.values_in(self.unit) if self.unit else signal.values
        corrected: Floats = (values - self.bias) @ self.matrix.T
        return corrected


@dataclass(frozen=True, slots=True)
class ComparedSignal:
    """B − A of one signal: `n`, `mean`, `sigma`, `rms` … by name; None where the samples do not determine it."""

    signal: str
    signal_b: str
    unit: str
    figures: Mapping[str, float | None]
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two recordings on one axis of time.

    Args:
        offset_s: added to the times of B.
        uncertainty_s: half of its 95 % interval; None unless it was found by correlation, as `correlation` (-1 to 1)
            and `overlap_s`, the length of the correlated parts.
        signals: an attitude follows its columns, as the angle between both, °.
    """

    offset_s: float
    uncertainty_s: float | None
    correlation: float | None
    overlap_s: float | None
    notes: tuple[str, ...]
    signals: tuple[ComparedSignal, ...]

    @classmethod
    def of(cls, answer: ComparisonAnswer) -> Comparison:
        """That of the comparison as it was computed."""
        signals = (
            ComparedSignal(one.signal, one.signal_b, one.unit, one.figures, tuple(one.notes)) for one in answer.signals
        )
        return cls(
            answer.offset, answer.uncertainty, answer.correlation, answer.overlap, tuple(answer.notes), tuple(signals)
        )
