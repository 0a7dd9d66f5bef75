"""Cells of a table as numbers and times, column by column. Some are in hexadecimal digits: 0x1388, or 00001388 and
0000139C.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats, Ints
from imuscope.protocols.clocks.dates import UNKNOWN, S, utc_ns
from imuscope.protocols.clocks.unix_time import NO_TIME, seconds
from imuscope.recordings.tables.clock import TableClock
from imuscope.recordings.tables.dates import GPS_EPOCH, Order, seconds_of_day, unix_seconds

if TYPE_CHECKING:  # imported where a table is read, so that a server starts sooner
    import pyarrow as pa


MIN_HEX_CELLS = 3  # cells in hexadecimal digits
_DIGITS = re.compile(r"^(?:0[xX])?[0-9A-Fa-f]{2,16}$")
_LETTER = re.compile(r"[A-DFa-df]")  # 13e2 is also a number
_PREFIX = re.compile(r"^0[xX]")

LEAPS = ((1_483_228_800.0, 18.0), (1_435_708_800.0, 17.0), (1_341_100_800.0, 16.0), (1_230_768_000.0, 15.0))
"""From when on GPS time is ahead of UTC by how much, s."""


@dataclass(frozen=True, slots=True)
class Cells:
    """Numbers of a column, NaN where there is none, and the rows that hold something else; of times the ns, too, where
    they have more digits than a float64.
    """

    values: Floats
    odd: NDArray[np.int64]
    ns: Ints | None = None


def are_hexadecimal(cells: Sequence[str]) -> bool:
    """Whether all cells of a column are, and not all are numbers in the usual digits.

    Args:
        cells: not empty ones, stripped.
    """
    if len(cells) < MIN_HEX_CELLS or not all(map(_DIGITS.match, cells)):
        return False
    if all(map(_PREFIX.match, cells)):
        return True
    letters = sum(1 for cell in cells if _LETTER.search(cell))
    digits = sum(1 for cell in cells if any(map(str.isdigit, cell)))
    return letters > 0 and digits > len(cells) / 2 and not any(map(_PREFIX.match, cells))


def hexadecimal_number(text: str) -> float | None:
    return float(int(text, 16)) if _DIGITS.match(text) else None


def _marked_number(text: str) -> float | None:
    """The number of a cell with the mark of hexadecimal digits; None without it."""
    return hexadecimal_number(text) if _PREFIX.match(text) else None


def _plain_number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _number(text: str) -> float | None:
    number = _plain_number(text.strip('" '))
    return number if number is not None else _marked_number(text)


def _each(column: pa.Array, read: Callable[[str], float | None]) -> Cells:
    """Cells by a function of their text, which gives None for those that it cannot read."""
    values, odd = np.full(len(column), np.nan), []
    for row, cell in enumerate(column.to_pylist()):
        if text := (cell or "").strip():
            number = read(text)
            values[row] = np.nan if number is None else number
            odd += [row] if number is None else []
    return Cells(values, np.array(odd, np.int64))


def numbers(column: pa.Array, decimal: str = ".") -> Cells:
    import pyarrow as pa
    import pyarrow.compute as pc

    if pa.types.is_floating(column.type):
        return Cells(column.to_numpy(), np.empty(0, np.int64))
    trimmed = pc.utf8_trim_whitespace(column)
    if decimal == ",":
        trimmed = pc.replace_substring(pc.replace_substring(trimmed, ".", ""), ",", ".")
    filled = pc.if_else(pc.equal(trimmed, ""), None, trimmed)
    try:
        values: Floats = pc.cast(filled, pa.float64()).to_numpy(zero_copy_only=False)
        return Cells(values.astype(np.float64), np.empty(0, np.int64))
    except pa.ArrowInvalid:
        return _each(filled, _number)


def digits(column: pa.Array) -> Cells:
    """Cells in hexadecimal digits that no clock reads: numbers if they are marked, else texts, of unknown sign."""
    return _each(column, _marked_number)


def sample_times(clock: TableClock, rows: Sequence[Sequence[str]], decimal: str = ".") -> Floats:
    """Times of a clock in some rows, s; NaN where there is none."""
    import pyarrow as pa

    if clock.kind == "rows":
        return np.arange(len(rows), dtype=np.float64) * clock.factors[0]
    return times_of(clock, [pa.array([row[i] for row in rows], pa.string()) for i in clock.columns], decimal).values


def times_of(
    clock: TableClock,
    columns: Sequence[pa.Array],
    decimal: str = ".",
    *,
    is_exact: bool = False,
    rest: pa.Array | None = None,
) -> Cells:
    """Times of a clock, s: since 1970, or since its own zero.

    Args:
        columns: those of the clock, in its order.
        is_exact: whether ns are wanted, too.
        rest: what the float64 of the first one lack (number_blocks.py).
    """
    if clock.kind == "rows":
        raise ValueError("rows have no columns")
    if clock.part:
        whole_clock = replace(clock, columns=clock.columns[:-1], factors=clock.factors[:-1], part=0.0)
        whole = times_of(whole_clock, columns[:-1], decimal)
        parts = numbers(columns[-1], decimal)
        return Cells(whole.values + parts.values * clock.part, np.union1d(whole.odd, parts.odd))
    if clock.kind in ("text", "date+time"):
        import pyarrow.compute as pc

        joined = columns[0] if clock.kind == "text" else pc.binary_join_element_wise(columns[0], columns[1], " ")
        texts = _texts(joined, clock.order, of_day=clock.epoch in ("day", "start"))
        ns = None if texts.ns is None else np.where(texts.ns == NO_TIME, NO_TIME, texts.ns - round(clock.zone * 1e9))
        return Cells(texts.values - clock.zone, texts.odd, ns)
    is_ns = clock.kind == "number" and clock.factors == (1e-9,) and clock.base == 10
    if is_ns and (times := of_nanoseconds(columns[0])) is not None:
        return Cells(_known(clock, seconds(times)), np.empty(0, np.int64), times)
    cells = [_each(one, hexadecimal_number) if clock.base == 16 else numbers(one, decimal) for one in columns]
    odd = np.unique(np.concatenate([one.odd for one in cells]))
    if clock.kind == "utc":
        return Cells(_utc([one.values for one in cells]), odd)
    values = np.full(len(columns[0]), clock.zero_s)
    for one, factor in zip(cells, clock.factors, strict=True):
        values = values + one.values * factor
    if clock.kind == "week":
        values = values + GPS_EPOCH
        values = values - _leap(values)
    is_plain = is_exact and clock.kind == "number" and clock.base == 10 and not clock.zero_s and decimal == "."
    ns = _whole_ns(columns[0], cells[0].values, round(clock.factors[0] * 1e9), rest) if is_plain else None
    return Cells(_known(clock, values), odd, ns)


def _whole_ns(column: pa.Array, values: Floats, unit_ns: int, rest: pa.Array | None) -> Ints | None:
    """Numbers of a unit of whole ns as ns, NO_TIME for none; None if their last digits are not known."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if not unit_ns or (rest is None and pa.types.is_floating(column.type)):
        return None
    if rest is None:
        try:
            filled = pc.if_else(pc.equal(column, ""), None, column)
            exact = pc.multiply(pc.cast(filled, pa.decimal128(27, 9)), pa.scalar(unit_ns, pa.decimal128(10, 0)))
            times: Ints = pc.cast(exact, pa.int64(), safe=False).fill_null(NO_TIME).to_numpy(zero_copy_only=False)
            return times
        except pa.ArrowInvalid:
            return None
    known = np.abs(values) < 2**63 / unit_ns
    values = values if known.all() else np.where(known, values, 0.0)
    whole = np.floor(values)
    part = values - whole
    part += rest.to_numpy()
    part *= unit_ns
    ns: Ints = whole.astype(np.int64)
    ns *= unit_ns
    ns += np.rint(part, out=part).astype(np.int64)
    return ns if known.all() else np.where(known, ns, NO_TIME)


def _known(clock: TableClock, values: Floats) -> Floats:
    """Times with NaN for each zero, if the clock counts dates: the logger's clock was not set yet."""
    is_date = clock.epoch == "1970" and clock.kind in ("number", "parts") and not clock.zero_s
    return np.where(values == 0, np.nan, values) if is_date else values


def of_nanoseconds(column: pa.Array) -> Ints | None:
    """Whole ns, which have more digits than a float64; NO_TIME for none. None if a cell is something else."""
    import pyarrow as pa
    import pyarrow.compute as pc

    try:
        text = column if pa.types.is_floating(column.type) else pc.utf8_trim_whitespace(column)
        whole = pc.cast(text, pa.int64())
    except pa.ArrowInvalid:
        return None
    times: Ints = whole.fill_null(NO_TIME).to_numpy(zero_copy_only=False)
    return times


def _leap(gps: Floats) -> Floats:
    """Leap seconds by which GPS times are ahead of UTC."""
    leap = np.full(len(gps), LEAPS[-1][1] - 1)
    for since, ahead in reversed(LEAPS):
        leap[gps >= since + ahead] = ahead
    return leap


def leap_seconds(gps: float) -> float:
    """Seconds by which GPS time, written as a date, is ahead of UTC."""
    return float(_leap(np.array([gps]))[0])


def _utc(parts: Sequence[Floats]) -> Floats:
    known = np.all(np.isfinite(parts), axis=0)
    whole = [np.where(known, part, 0).astype(np.int64) for part in parts]
    second = np.where(known, parts[5], 0.0)
    ns = whole[6] if len(whole) > 6 else np.round((second - np.floor(second)) * S).astype(np.int64)
    year, month, day, hour, minute = whole[:5]
    times = utc_ns(year, month, day, hour, minute, np.floor(second).astype(np.int64), ns, known)
    return np.where(times == UNKNOWN, np.nan, times / S)


def _texts(column: pa.Array, order: Order, *, of_day: bool = False) -> Cells:
    """Dates and times, or times of day."""
    import pyarrow as pa
    import pyarrow.compute as pc

    trimmed = pc.utf8_trim_whitespace(column)
    if not of_day:
        try:
            plain = pc.replace_substring_regex(trimmed, "Z$", "")
            moments = pc.cast(pc.if_else(pc.equal(plain, ""), None, plain), pa.timestamp("ns"))
            ns = moments.cast(pa.int64()).fill_null(NO_TIME).to_numpy(zero_copy_only=False)
            return Cells(seconds(ns), np.empty(0, np.int64), ns)
        except pa.ArrowInvalid:
            pass

    def read(text: str) -> float | None:
        moment = seconds_of_day(text) if of_day else unix_seconds(text, order)
        return moment if moment is not None else _plain_number(text)

    return _each(trimmed, read)
