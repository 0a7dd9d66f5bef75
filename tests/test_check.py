"""The check command: a failed test is a failure, even if it passes alone."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import pytest

from tests.check import Part, run

FLAKY = """
import pathlib, sys
seen = pathlib.Path(sys.argv[1])
first = not seen.exists()
seen.touch()
print("1 failed in 0.1s" if first else "1 passed in 0.1s")
sys.exit(first)
"""


def test_a_test_that_fails_once_and_passes_alone_has_failed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def flaky(_: argparse.Namespace) -> list[str]:
        return [sys.executable, "-c", FLAKY, str(tmp_path / "seen")]

    outcome = run(Part("tests", flaky, alone=flaky), argparse.Namespace(), {})
    assert outcome.status == 1
    assert outcome.closing == "1 failed in 0.1s"
    assert "alone: 1 passed" in capsys.readouterr().out
