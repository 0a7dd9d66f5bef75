"""Property tests try the same examples wherever they run, so that a failure comes again when its test runs alone."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest
from hypothesis import given, seed, settings
from hypothesis import strategies as st

from tests import conftest


def examples() -> list[int]:
    """What a property test is given."""
    results: list[int] = []

    @seed(1)
    @settings(max_examples=300, database=None)
    @given(st.integers(0, 2**64))
    def collect(number: int) -> None:
        results.append(number)

    collect()
    return results


@pytest.mark.skipif(conftest.PROFILE != "fast", reason="other profiles try new examples each time")
def test_a_module_that_is_imported_changes_no_example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = examples()
    (tmp_path / "many_numbers.py").write_text(f"NUMBERS = {list(range(70_001, 72_000, 7))}\n")
    spec = importlib.util.spec_from_file_location("many_numbers", tmp_path / "many_numbers.py")
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "many_numbers", module)
    assert examples() == before
