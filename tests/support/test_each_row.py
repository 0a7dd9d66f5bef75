"""Rows of a table as one test: every row runs, and each that fails is named."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from tests.support import each_row
from tests.support.each_row import RowsFailed

VISITED: list[object] = []


@each_row.each_row("number", [1, 2, 3, 4])
def odd(number: int) -> None:
    VISITED.append(number)
    assert number % 2 == 1, "it is even"


@each_row.each_row(("left", "right"), [(1, 2), (3, 4)], ids=["first", "second"])
@each_row.each_row("letter", "ab", ids=str.upper)
def product(left: int, right: int, letter: str) -> None:
    VISITED.append((letter, left, right))


@each_row.each_row("number", range(2))
def own_folder(number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(f"IMUSCOPE_ROW_{number}", "set")
    assert not list(tmp_path.iterdir())
    (tmp_path / "file").touch()


@each_row.each_row("number", range(3))
def some_skipped(number: int) -> None:
    if number == 1:
        pytest.skip("no capture")
    VISITED.append(number)


@each_row.each_row("number", [1, 2])
async def awaited(number: int) -> None:
    await asyncio.sleep(0)
    VISITED.append(number)


@pytest.fixture(autouse=True)
def nothing_visited() -> None:
    VISITED.clear()


def test_every_row_runs_and_each_that_fails_is_named() -> None:
    with pytest.raises(RowsFailed, match="2 of 4 rows fail: 2, 4\nRun one again: pytest -k odd --row 2") as caught:
        odd()
    assert VISITED == [1, 2, 3, 4]
    assert [error.__notes__ for error in caught.value.exceptions] == [["row: 2"], ["row: 4"]]
    assert "it is even" in str(caught.value.exceptions[0])


def test_only_some_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(each_row, "only", "3")
    odd()
    assert VISITED == [3]


def test_a_coroutine_is_awaited_for_each_row() -> None:
    awaited()
    assert VISITED == [1, 2]


def test_decorators_stack() -> None:
    product()
    assert VISITED == [("a", 1, 2), ("b", 1, 2), ("a", 3, 4), ("b", 3, 4)]
    assert [row.title for row in product.rows] == ["A-first", "B-first", "A-second", "B-second"]


def test_each_row_has_its_own_folder_and_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own_folder(tmp_path=tmp_path, monkeypatch=monkeypatch)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["row0", "row1"]


def test_a_row_that_is_skipped_does_not_hide_the_others() -> None:
    with pytest.raises(pytest.skip.Exception, match="1 of 3 rows: 1: no capture"):
        some_skipped()
    assert VISITED == [0, 2]


def test_an_argument_that_the_test_does_not_take_is_named() -> None:
    with pytest.raises(AssertionError, match="odd does not take other"):
        each_row.each_row("other", [1])(odd)
