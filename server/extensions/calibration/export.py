"""A result as text for other programs.

json    everything, for scripts            yaml    matrices as Kalibr writes them, `rows`, `cols`, `data`
csv     a row for each number              c       a header with two arrays
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from imuscope.server.errors import DomainError
from imuscope.server.extensions.calibration.report import CalibrationReport, SensorCorrection

_EQUATION = "corrected = matrix * (measured - bias)"


@dataclass(frozen=True, slots=True)
class CalibrationFormat:
    """Writer of a calibration in one file format."""

    write: Callable[[CalibrationReport, str], str]
    media_type: str
    suffix: str


def exported(report: CalibrationReport, device: str, name: str) -> tuple[str, CalibrationFormat]:
    """The result in a format.

    Args:
        device: words on the device, for the head of the file.

    Raises:
        DomainError: "bad-value": unknown format; "no-result": there is no result.
    """
    form = FORMATS.get(name)
    if form is None:
        raise DomainError("bad-value", f"format {name!r:.40} is not allowed.", f"Give one of: {', '.join(FORMATS)}.")
    if report.correction is None:
        if report.refusal is not None:
            raise DomainError("no-result", report.refusal.message, report.refusal.hint)
        raise DomainError("no-result", "The calibration has no result yet.", "Go on until it is done.")
    return form.write(report, device), form


def _result(report: CalibrationReport) -> SensorCorrection:
    assert report.correction is not None
    return report.correction


def _json(report: CalibrationReport, device: str) -> str:
    body = report.model_dump(
        exclude={"trace", "coverage", "rest", "positions", "drive", "advice", "progress", "refusal"}
    )
    return json.dumps({"device": device, "equation": _EQUATION, **body}, ensure_ascii=False, indent=2) + "\n"


def _yaml(report: CalibrationReport, device: str) -> str:
    result = _result(report)
    rows = ",\n         ".join(", ".join(_number(cell) for cell in row) for row in result.matrix)
    lines = [
        f"# {report.kind} of {_plain(device)}: {_EQUATION}, in {result.unit or 'units of the signal'}",
        *(f"# {note}" for note in report.notes),
        f"{report.kind}:",
        f"  unit: {json.dumps(result.unit, ensure_ascii=False)}",
        "  bias:",
        "    rows: 3",
        "    cols: 1",
        f"    data: [{', '.join(map(_number, result.bias))}]",
        *([f"  # {result.presupposes}"] if result.presupposes else []),
        f"  bias_sigma: [{', '.join(map(_number, result.bias_uncertainty))}]",
        "  matrix:",
        "    rows: 3",
        "    cols: 3",
        f"    data: [{rows}]",
    ]
    return "\n".join(lines) + "\n"


def _csv(report: CalibrationReport, device: str) -> str:
    del device
    result = _result(report)
    lines = ["name,value,uncertainty,unit,presupposes"]
    words = f'"{result.presupposes}"' if result.presupposes else ""
    for k, axis in enumerate("xyz"):
        sigma = _number(result.bias_uncertainty[k])
        lines.append(f"bias_{axis},{_number(result.bias[k])},{sigma},{result.unit},{words}")
    for i, row in enumerate(result.matrix):
        for j, cell in enumerate(row):
            lines.append(f"matrix_{'xyz'[i]}{'xyz'[j]},{_number(cell)},{_number(result.matrix_uncertainty)},,{words}")
    return "\n".join(lines) + "\n"


def _c(report: CalibrationReport, device: str) -> str:
    result = _result(report)
    rows = ",\n    ".join("{" + ", ".join(f"{_number(cell)}" for cell in row) + "}" for row in result.matrix)
    name = report.kind
    lines = [
        f"/* {name} of {_plain(device)}: {_EQUATION}, in {result.unit or 'units of the signal'} */",
        "#pragma once",
        "",
        f"static const double {name}_bias[3] = {{{', '.join(map(_number, result.bias))}}};",
        f"static const double {name}_matrix[3][3] = {{\n    {rows}}};",
    ]
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    return f"{value:.9e}"


def _plain(text: str) -> str:
    """Without what could end a comment."""
    return text.replace("*/", "* /").replace("\n", " ").replace("\r", " ")


FORMATS: Mapping[str, CalibrationFormat] = {
    "json": CalibrationFormat(_json, "application/json", "json"),
    "yaml": CalibrationFormat(_yaml, "text/yaml; charset=utf-8", "yaml"),
    "csv": CalibrationFormat(_csv, "text/csv; charset=utf-8", "csv"),
    "c": CalibrationFormat(_c, "text/x-c; charset=utf-8", "h"),
}
