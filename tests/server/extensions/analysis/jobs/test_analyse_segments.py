"""A clock that steps back: no statistic, spectrum, Allan deviation or filter runs across the step."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imuscope.server.cli import main

RATE = 100
FIRST, SECOND = 250, 350
EPOCH = 1_500_000_000


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path, Path]:
    """A table whose clock goes back by 2 s, and both of its parts alone."""
    values = np.random.default_rng(1).normal(size=FIRST + SECOND)
    values[FIRST:] += 50  # what crosses the step is seen
    clock = EPOCH + np.arange(FIRST + SECOND) / RATE
    clock[FIRST:] -= 2
    rows = [f"{t:.2f},{x:.9f}\n" for t, x in zip(clock, values, strict=True)]
    paths = tmp_path / "both.csv", tmp_path / "first.csv", tmp_path / "second.csv"
    for path, part in zip(paths, (rows, rows[:FIRST], rows[FIRST:]), strict=True):
        path.write_text("time (s),x\n" + "".join(part), encoding="utf-8")
    return paths


def figures(capsys: pytest.CaptureFixture[str], path: Path, analysis: str, signal: str = "x") -> dict[str, Any]:
    assert main(["analyse", str(path), analysis, "--signal", signal, "--json"]) == 0
    [answer] = json.loads(capsys.readouterr().out).values()
    return answer


def test_statistics_are_those_of_the_segments(
    files: tuple[Path, Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    both, first, second = (figures(capsys, path, "statistics") for path in files)
    assert both["rate"] == pytest.approx(RATE, rel=1e-6)
    assert both["duration"] == pytest.approx(first["duration"] + second["duration"])
    assert both["integral"] == pytest.approx(first["integral"] + second["integral"], rel=1e-6)
    assert both["slope"] == pytest.approx(second["slope"], rel=1e-3)
    assert both["gaps"] == 0
    assert "2 segments" in both["notes"][0]
    assert "notes" not in first


@pytest.mark.parametrize("analysis", ["psd", "allan", "spectrogram"])
def test_spectra_and_allan_deviations_stop_at_a_step(
    analysis: str, files: tuple[Path, Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    both = figures(capsys, files[0], analysis)
    assert any("1 step of the clock" in note for note in both["notes"])
    assert both["rate"] == pytest.approx(RATE, rel=1e-4)
    if analysis == "psd":  # a jump of 50 would be in every frequency
        assert max(both["psd"][2:]) < 1


@pytest.mark.parametrize(
    "expression", ["lowpass(x, 5 Hz)", "derivative(x)", "mean(x, 0.1 s)", "integral(x)", "highpass(2 * x, 1 Hz)"]
)
def test_expressions_are_computed_segment_by_segment(
    expression: str, files: tuple[Path, Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    both, first, second = (figures(capsys, path, "expression", expression)["values"] for path in files)
    np.testing.assert_allclose(both, [*first, *second], rtol=1e-5, atol=1e-5)
