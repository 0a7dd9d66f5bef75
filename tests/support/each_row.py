"""Rows of a table as one test: `@each_row("vector", VECTORS)` in place of `pytest.mark.parametrize`.

An item of pytest costs some milliseconds in every process that collects it; a row costs nothing here and is as good a
test. Every row runs, also after one has failed, and the report names each that failed, with its own traceback:

    2 of 265 rows fail: XDI_Quaternion Fp1632, XDI_DeltaV Fp1632
    Run one again: pytest tests/protocols/xbus/test_xbus_vectors.py -k test_vendor_values --row 'XDI_Quaternion Fp1632'

Each row has a `tmp_path` and a `monkeypatch` of its own, and what was printed before it is not in its `capsys`, if the
test asks for them. Other fixtures are shared by all rows, so a test that needs them fresh (a server) is parametrised.
Decorators stack, as pytest's do.
"""

from __future__ import annotations

import asyncio
import inspect
import itertools
import shlex
from collections.abc import Callable, Coroutine, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import pytest

MOST_SHOWN = 5  # tracebacks of one test
only = ""
"""Run only the rows whose title contains this (option `--row`)."""
current = ""
"""Title of the row that runs; "" between tests (for tests/checking/hang_report.py)."""

Test = Callable[..., Coroutine[Any, Any, None] | None]
Title = Callable[[Any], object] | Iterable[object] | None


@dataclass(frozen=True)
class Row:
    """One row of a table."""

    title: str
    values: dict[str, Any]


class RowsFailed(ExceptionGroup[Exception]):
    """Rows of a test that failed, each with its own traceback."""

    def derive(self, excs: Sequence[Exception]) -> RowsFailed:
        return RowsFailed(self.message, excs)


def each_row(names: str | Sequence[str], rows: Iterable[Any], *, ids: Title = None) -> Callable[[Test], Test]:
    """Run the decorated test once for each row, as one test.

    Args:
        names: of the arguments that a row gives, as `pytest.mark.parametrize` takes them.
        rows: a value each or, for several names, a tuple each.
        ids: name of each row, or a function that names a value; None for the value itself.
    """
    arguments = [name.strip() for name in names.split(",")] if isinstance(names, str) else list(names)
    table = [tuple(row) if len(arguments) > 1 else (row,) for row in rows]
    named = ids if ids is None or callable(ids) else [str(one) for one in ids]
    own = [Row(_title(row, named, n), dict(zip(arguments, row, strict=True))) for n, row in enumerate(table)]

    def decorate(test: Test) -> Test:
        body: Test = getattr(test, "body", test)
        inner: list[Row] = getattr(test, "rows", [Row("", {})])
        product = [
            Row("-".join(filter(None, (b.title, a.title))), {**a.values, **b.values})
            for a, b in itertools.product(own, inner)
        ]
        parameters = inspect.signature(test).parameters.values()
        missing = set(arguments) - {one.name for one in parameters}
        assert not missing, f"{body.__name__} does not take {', '.join(missing)}"

        def run(**fixtures: Any) -> None:
            _run_all(body, product, fixtures)

        run.__name__, run.__qualname__, run.__doc__ = body.__name__, body.__qualname__, body.__doc__
        run.__module__, run.__dict__ = body.__module__, {**test.__dict__, "body": body, "rows": product}
        remaining = [one for one in parameters if one.name not in arguments]
        run.__signature__ = inspect.Signature(remaining)  # type: ignore[attr-defined]
        return run

    return decorate


def _run_all(test: Test, every: Sequence[Row], fixtures: dict[str, Any]) -> None:
    chosen = [(n, one) for n, one in enumerate(every) if only in one.title]
    failed: list[tuple[str, Exception]] = []
    skipped: list[str] = []
    global current
    for number, row in chosen:
        current = row.title
        try:
            _run_one(test, number, row, fixtures)
        except pytest.skip.Exception as reason:
            skipped.append(f"{row.title}: {reason}")
        except (Exception, pytest.fail.Exception) as problem:
            error = problem if isinstance(problem, Exception) else AssertionError(str(problem))
            error.add_note(f"row: {row.title}")
            failed.append((row.title, error))
        finally:
            current = ""
    if failed:
        again = f"pytest -k {test.__name__} --row {shlex.quote(failed[0][0])}"
        raise RowsFailed(
            f"{len(failed)} of {len(chosen)} rows fail: {', '.join(title for title, _ in failed)}\n"
            f"Run one again: {again}",
            [error for _, error in failed[:MOST_SHOWN]],
        )
    if skipped:  # those that ran were well; what did not run must be seen
        pytest.skip(f"{len(skipped)} of {len(chosen)} rows: {'; '.join(skipped)}")


def _run_one(test: Test, number: int, row: Row, fixtures: dict[str, Any]) -> None:
    with ExitStack() as stack:
        settings = dict(fixtures)
        if "tmp_path" in settings:
            settings["tmp_path"] = settings["tmp_path"] / f"row{number}"
            settings["tmp_path"].mkdir()
        if "monkeypatch" in settings:
            settings["monkeypatch"] = stack.enter_context(pytest.MonkeyPatch.context())
        for capture in ("capsys", "capfd"):
            if capture in settings:
                settings[capture].readouterr()  # of the row before
        run_test(test, {**settings, **row.values})


def run_test(test: Test, source: dict[str, Any]) -> None:
    """Call a test; one that is a coroutine runs in an event loop of its own."""
    made = test(**source)
    if inspect.iscoroutine(made):
        asyncio.run(made)


def _title(row: tuple[Any, ...], ids: Callable[[Any], object] | list[str] | None, number: int) -> str:
    if isinstance(ids, list):
        return ids[number]
    return "-".join(_title_of(value, ids) for value in row)


def _title_of(value: Any, ids: Callable[[Any], object] | None) -> str:
    named = ids(value) if ids is not None else None
    if named is None:
        named = getattr(value, "__name__", value)
    return str(named)[:80]
