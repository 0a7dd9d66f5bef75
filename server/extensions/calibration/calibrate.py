"""`imuscope calibrate FILE KIND`: calibrate a sensor with a stretch of any file that `decode` reads."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from imuscope.recordings.columns.store import ColumnStore
from imuscope.server.errors import DomainError, UsageError
from imuscope.server.extensions.analysis.signals.signals import SignalColumn, recorded_samples
from imuscope.server.extensions.analysis.signals.triads import Samples, finite
from imuscope.server.extensions.calibration.export import FORMATS, exported
from imuscope.server.extensions.calibration.kinds import (
    CalibrationInputs,
    CalibrationOptions,
    evaluated,
    is_table,
    method_for,
)
from imuscope.server.extensions.calibration.report import CalibrationReport, SensorCorrection
from imuscope.server.library.recording_detail import channels_of
from imuscope.server.wire import ChannelInfo

SUFFIXES = {".json": "json", ".yaml": "yaml", ".yml": "yaml", ".csv": "csv", ".h": "c"}


@dataclass(frozen=True, slots=True)
class Calibration:
    """A result and its device, in words."""

    report: CalibrationReport
    device: str


def format_of(name: str, output: Path | None) -> str:
    """The format to write: as given, else that of the suffix, else "text" for people.

    Raises:
        UsageError: the suffix selects none.
    """
    if name or output is None:
        return name or "text"
    by_suffix = SUFFIXES.get(output.suffix.lower())
    if by_suffix is None:
        known = ", ".join(SUFFIXES)
        raise UsageError(f"{output.name} selects no format; end the name with one of {known}, or give --format")
    return by_suffix


def calibrated(
    store: ColumnStore,
    name: str,
    kind: str,
    device: str,
    span: tuple[float, float],
    options: CalibrationOptions,
) -> Calibration:
    """Calibrate with the samples of a file.

    Args:
        name: of the file, for messages.
        kind: of the calibration.
        device: "" for the only one.
        span: first and last time, unix s.

    Raises:
        DomainError: the samples do not determine the answer.
    """
    infos = _of_one_device(store, name, device)
    inputs = CalibrationInputs.of(infos)
    method = method_for(kind, inputs, name, is_table=is_table(store.manifest, infos[0].device))
    triads = method.triads(inputs)
    samples: dict[str, Samples] = {}
    for key, triad in triads.items():
        columns = [recorded_samples(store, SignalColumn(triad.info, at), *span) for at in triad.at]
        samples[key] = finite(columns[0][0], np.stack([values for _, values in columns], axis=1) * triad.factor)
    report = evaluated(method, triads, samples, options)
    if report.correction is None:
        if report.refusal is None:
            raise DomainError("no-result", f"{name} is too short for this calibration.", "Give a longer recording.")
        raise DomainError("no-result", report.refusal.message, report.refusal.hint)
    device = infos[0].device
    about: Mapping[str, Any] = next((one for one in store.manifest["devices"] if one["id"] == device), {})
    words = " ".join(filter(None, (about.get("product") or about.get("name"), about.get("serial_number"))))
    return Calibration(report, words or name)


def _of_one_device(store: ColumnStore, name: str, device: str) -> list[ChannelInfo]:
    infos = list(channels_of(store).values())
    devices = sorted({info.device for info in infos})
    listed = ", ".join(devices)
    if device and device not in devices:
        raise DomainError("not-found", f"{name} has no device {device:.40}.", f"It has: {listed}.")
    if not device and len(devices) > 1:
        raise DomainError("which-device", f"{name} has several devices.", f"Name one as the device: {listed}.")
    if not devices:
        raise DomainError("not-found", f"{name} has no samples of a device.", "Give another file.")
    return [info for info in infos if info.device == (device or devices[0])]


def text_of(calibration: Calibration, export_format: str) -> str:
    """The result in a format of export, or as text for people."""
    if export_format in FORMATS:
        return exported(calibration.report, calibration.device, export_format)[0]
    return _for_people(calibration)


def _for_people(calibration: Calibration) -> str:
    report = calibration.report
    result = report.correction
    assert result is not None
    lines = [
        f"{report.kind} of {calibration.device}: corrected = matrix · (measured − bias)",
        "",
        *_numbers(result),
        *([result.presupposes] if result.presupposes else []),
        "",
    ]
    width = max((len(one.title) for one in report.figures), default=0)
    for one in report.figures:
        sigma = "" if one.uncertainty is None else f" ± {one.uncertainty:.2g}"
        lines.append(f"{one.title:<{width}}  {one.value:.6g}{sigma} {one.unit}".rstrip())
    return "\n".join([*lines, *report.notes]) + "\n"


def _numbers(result: SensorCorrection) -> list[str]:
    unit = f" {result.unit}" if result.unit else ""
    bias = [
        f"bias {axis}   {value:+.9g} ± {sigma:.2g}{unit}"
        for axis, value, sigma in zip("xyz", result.bias, result.bias_uncertainty, strict=True)
    ]
    rows = ["  ".join(f"{cell:+.9f}" for cell in row) for row in result.matrix]
    return [*bias, *(f"{'matrix' if k == 0 else '':<9}{row}" for k, row in enumerate(rows))]
