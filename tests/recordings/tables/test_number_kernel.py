"""Numbers of a table: each the nearest float, as Python reads it, and blocks with anything else refused."""

from fractions import Fraction
from typing import Any

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from imuscope.protocols.native.kernels import plain
from imuscope.recordings.tables.number_kernel import REFUSED, numbers_of
from tests.support.each_row import each_row

DIGITS = st.from_regex(r"\A[+-]?([0-9]{1,17}\.[0-9]{0,9}|\.[0-9]{1,17}|[0-9]{1,15})([eE][+-]?[0-9]{1,2})?\Z")
NUMBERS = st.one_of(DIGITS, st.floats(allow_nan=False, allow_infinity=False).map(repr))


def read(text: bytes, columns: int, separator: str = ",", read_by: Any = numbers_of) -> Any:
    """(columns, rows) the numbers; None if they are refused."""
    out = np.full((columns, text.count(b"\n")), -7.0)
    rows = read_by(np.frombuffer(text, np.uint8), ord(separator), np.arange(columns), np.nan, np.full(columns, -1), out)
    return None if rows == REFUSED else out[:, :rows]


@given(st.lists(NUMBERS, min_size=1, max_size=5))
@example(["1795987000.012300001", "-0.0", "5e-324", "9007199254740993.0"])
@example(["1e22", "1e23", "123456789012345678e-40", "8.5e-200", "0.30000000000000004"])
def test_each_number_is_the_nearest_float_or_refused(cells: list[str]) -> None:
    for cell in cells:
        numbers = read(f"{cell}\n".encode(), 1)
        np.testing.assert_array_equal(numbers, read(f"{cell}\n".encode(), 1, read_by=plain(numbers_of)))
        if numbers is not None:
            assert repr(float(numbers[0, 0])) == repr(float(cell))


def test_numbers_of_a_sensor_are_not_refused() -> None:
    """A refused block is right, but slow: those with all digits of a float64, and those near 0, must not be."""
    values = np.random.default_rng(1).normal(size=2000) * 10.0 ** np.random.default_rng(2).integers(-60, 15, 2000)
    numbers = read("".join(f"{value!r}\n" for value in values.tolist()).encode(), 1)
    assert numbers is not None
    np.testing.assert_array_equal(numbers[0], values)


@each_row(
    ("text", "columns", "rows"),
    [
        ("1,2\n3,4\n", 2, [[1, 2], [3, 4]]),
        ("1,\r\n\n ,\t4 \r\n", 2, [[1, np.nan], [np.nan, 4]]),
        ("+1,-.5\n5.,1E3\n", 2, [[1, -0.5], [5, 1000]]),
        ("1,2\n3\n", 2, None),
        ("1,2\n3,4,5\n", 2, None),
        ('1,"2"\n', 2, None),
        ("1,é\n", 2, None),
        ("nan,1\n", 2, None),
        ("1e,1\n", 2, None),
        ("-,1\n", 2, None),
        ("1 2,1\n", 2, None),
        ("1,2\r3,4\n", 2, None),
        ("9007199254740993,1\n", 2, None),
    ],
)
def test_a_block_is_read_whole_or_refused(text: str, columns: int, rows: list[list[float]] | None) -> None:
    for way in (numbers_of, plain(numbers_of)):
        numbers = read(text.encode(), columns, read_by=way)
        np.testing.assert_array_equal(numbers, None if rows is None else np.array(rows).T)


@given(st.lists(st.integers(0, 2**62), min_size=1, max_size=5), st.integers(0, 12))
def test_a_number_is_the_nearest_float_and_its_remainder(mantissas: list[int], decimals: int) -> None:
    text = "".join(f"{one // 10**decimals}.{one % 10**decimals:0{decimals}d}\n" for one in mantissas).encode()
    for way in (numbers_of, plain(numbers_of)):
        out = np.zeros((2, len(mantissas)))
        rows = way(np.frombuffer(text, np.uint8), ord(","), np.arange(1), np.nan, np.array([1]), out)
        if rows != REFUSED:
            for one, number, rest in zip(mantissas, *out.tolist(), strict=True):
                exact = Fraction(one, 10**decimals) - Fraction(number)
                assert abs(exact - Fraction(rest)) <= abs(exact) / 10**9
