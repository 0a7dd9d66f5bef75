"""A table read by the fast way and by pyarrow: the same rows, and the same reports."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.recordings.tables import number_blocks, table_source
from imuscope.recordings.tables.number_blocks import is_fast
from imuscope.recordings.tables.table_source import CsvSource

pytestmark = pytest.mark.skipif(not is_fast(), reason="there is no machine code")
CELLS = st.sampled_from(["0.25", "-3", "1e-7", "", " 4 ", "nan", "inf", "x", '"5"', "é", "9007199254740993", "7,8"])
HEAD = "time (s),a (m/s²),b"


def contents(path: Path) -> tuple[dict[str, Any], list[str]]:
    """Times and columns of a table, and what is reported of it."""
    source = CsvSource(path)
    columns: dict[str, list[Any]] = {}
    for rows in source.rows():
        for name, values in {"time": rows.time, **{name: one for name, (one, _) in rows.columns.items()}}.items():
            columns.setdefault(name, []).extend(values.tolist())
    return columns, [one.words for one in source.damage]


@given(odd=st.dictionaries(st.integers(0, 199), st.tuples(CELLS, CELLS)), end=st.sampled_from(["\n", "\r\n"]))
def test_rows_are_those_that_pyarrow_reads(
    odd: dict[int, tuple[str, str]], end: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("table") / "a.csv"
    cells = [odd.get(row, (f"{row / 7:.7g}", str(row))) for row in range(200)]
    lines = [f"{1760000000 + row / 100:.2f},{a},{b}" for row, (a, b) in enumerate(cells)]
    path.write_bytes(end.join(["# a comment", HEAD, *lines]).encode())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(number_blocks, "BLOCK_BYTES", 500)
        fast = contents(path)
        patch.setattr(number_blocks, "HELD_BYTES", 0)  # read twice
        twice = contents(path)
        patch.setattr(table_source, "is_fast", lambda: False)
        slow = contents(path)
    for one in (fast, twice):
        assert one[1] == slow[1]
        assert one[0].keys() == slow[0].keys()
        for name, values in slow[0].items():
            np.testing.assert_array_equal(one[0][name], values, name)


def test_a_table_that_fits_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.csv"
    path.write_text("\n".join([HEAD, *(f"{1760000000 + row},{row},1" for row in range(100))]))
    reads: list[bytes] = []
    whole = number_blocks.numbers_in
    monkeypatch.setattr(table_source, "numbers_in", lambda block, *more: reads.append(block) or whole(block, *more))
    source = CsvSource(path)
    assert sum(len(rows.time) for rows in source.rows()) == 100
    assert len(reads) == 1
    assert sum(len(rows.time) for rows in source.rows()) == 100
    assert len(reads) == 2
