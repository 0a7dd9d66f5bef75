"""Rows of plain numbers: text to float64, each the nearest float.

    1760000000.012300000,-0.03421,,9.81\\n      ──>   one column each, NaN for an empty cell

A block is refused whole (REFUSED) at the first thing that is not plain: a quotation mark, a word, another number of
cells, a whole number beyond 2⁵³, a character beyond ASCII. pyarrow reads such a block, and gives the same for others.

A number is `mantissa` · 10^`exponent`, the mantissa of up to 19 digits as an integer. Up to 2⁵³ and 10^±22 both are
floats, and one product or quotient is the nearest float. Beyond, the computation has twice the digits (`_rounded`), and
a result so near the middle between two floats that its rounding is open is refused, too.

Source: W. D. Clinger, "How to read floating point numbers accurately", 1990; T. J. Dekker, "A floating-point technique
for extending the available precision", 1971.
"""

import numpy as np

from imuscope.protocols.arrays import Bytes, Floats, Ints
from imuscope.protocols.native.kernels import BYTES, FLOAT, INT, INTS, ArrayType, compiled, inlined

REFUSED = -1
FLOAT_TABLE = ArrayType("float64", 2)
POWERS = np.array([10.0**k for k in range(23)])  # those that are floats
_EXACT = 1 << 53
_SPLIT = 134_217_729.0  # 2²⁷ + 1
_MARGIN = 1 + 2.0**-40  # for the relative error of the lower digits, which is far less
_BLANK, _TAB, _PLUS, _MINUS, _POINT, _ZERO, _LINE, _RETURN = b" \t+-.0\n\r"
_STOPS = np.array([byte in b',;\t|"\n\r' or byte > 127 for byte in range(256)], np.uint8)  # of a cell without numbers


@inlined
def _rest(a: float, b: float, product: float) -> float:
    """Digits of a · b that the product has lost."""
    a1 = a * _SPLIT
    a1 = a1 - (a1 - a)
    b1 = b * _SPLIT
    b1 = b1 - (b1 - b)
    a2, b2 = a - a1, b - b1
    return ((a1 * b1 - product) + a1 * b2 + a2 * b1) + a2 * b2


@compiled(FLOAT, INT, INT)
def _rounded(mantissa: int, exponent: int) -> float:
    """Nearest float; −1 if that is not certain."""
    high = float(mantissa)
    low = float(mantissa - int(high))
    while exponent < 0:
        by = POWERS[min(-exponent, 22)]
        quotient = high / by
        product = quotient * by
        low = (high - product - _rest(quotient, by, product) + low) / by
        high = quotient + low
        low = low - (high - quotient)
        exponent += min(-exponent, 22)
    if exponent > 0:
        by = POWERS[exponent]
        product = high * by
        low = _rest(high, by, product) + low * by
        high = product + low
        low = low - (high - product)
    return high if high + low * _MARGIN == high else -1.0


@inlined
def _behind_zeros(data: Bytes, at: int) -> int:
    while int(data[at]) == _ZERO:
        at += 1
    return at


@inlined
def _digits(data: Bytes, at: int, number: int) -> tuple[int, int]:
    """A number with the digits that follow it, and the position after these."""
    byte = int(data[at])
    while _ZERO <= byte <= _ZERO + 9:
        number = number * 10 + byte - _ZERO
        at += 1
        byte = int(data[at])
    return number, at


@compiled(FLOAT, INT, INT, FLOAT)
def _remainder(mantissa: int, exponent: int, value: float) -> float:
    """Part of a number that the nearest float lacks; 0 where it is not known."""
    if exponent > 0 or exponent < -22:
        return 0.0
    by = POWERS[-exponent]
    product = value * by
    whole = int(product)
    remainder: float = (float(mantissa - whole) - (product - float(whole)) - _rest(value, by, product)) / by
    return remainder


@compiled(INT, BYTES, INT, INTS, FLOAT, INTS, FLOAT_TABLE)
def numbers_of(data: Bytes, separator: int, slots: Ints, none: float, rests: Ints, out: Floats) -> int:
    """Read whole lines.

    Args:
        data: ends with a line break.
        slots: of each column its row in `out`, −1 for one that is not wanted.
        none: for an empty cell.
        rests: of each slot the row in `out`, of zeros, for its remainders: numbers minus the nearest floats; −1: none.
        out: receives the numbers; has room for a row of each line.

    Returns:
        Number of rows, REFUSED if any is not plain.
    """
    at = row = column = 0
    while at < len(data):
        byte = int(data[at])
        if column == 0 and byte == _LINE:  # an empty line
            at += 1
            continue
        slot = slots[column]
        while byte == _BLANK or (byte == _TAB and separator != _TAB):
            at += 1
            byte = int(data[at])
        if slot < 0:
            while _STOPS[byte] == 0:
                at += 1
                byte = int(data[at])
        else:
            value = none
            if byte != separator and byte != _LINE and byte != _RETURN:
                is_negative = byte == _MINUS
                if byte in (_MINUS, _PLUS):
                    at += 1
                begin = first = _behind_zeros(data, at)
                is_empty = first == at
                mantissa, at = _digits(data, first, 0)
                is_empty = is_empty and at == first
                count, exponent = at - first, 0
                is_whole = int(data[at]) != _POINT
                if not is_whole:
                    at += 1
                    begin = _behind_zeros(data, at) if count == 0 else at
                    first = begin if count == 0 else first
                    mantissa, end = _digits(data, begin, mantissa)
                    is_empty = is_empty and end == at
                    count, exponent, at = count + end - begin, at - end, end
                if is_empty or count > 19 or (count == 19 and int(data[first]) == _ZERO + 9):  # 2⁶³ is 9.2 · 10¹⁸
                    return REFUSED
                byte = int(data[at])
                if byte in (69, 101):  # E, e
                    at += 1
                    byte = int(data[at])
                    sign = -1 if byte == _MINUS else 1
                    if byte in (_MINUS, _PLUS):
                        at += 1
                    power, end = _digits(data, at, 0)
                    if not 0 < end - at < 4:
                        return REFUSED
                    exponent += sign * power
                    at = end
                    byte = int(data[at])
                if mantissa <= _EXACT and -22 <= exponent <= 22:
                    value = float(mantissa) / POWERS[-exponent] if exponent < 0 else float(mantissa) * POWERS[exponent]
                elif mantissa == 0:
                    value = 0.0
                else:
                    if is_whole or exponent < -250 or exponent > 22:
                        return REFUSED
                    value = _rounded(mantissa, exponent)
                    if value < 0:
                        return REFUSED
                rest = rests[slot]
                if rest >= 0:
                    remainder = _remainder(mantissa, exponent, value)
                    out[rest, row] = -remainder if is_negative else remainder
                if is_negative:
                    value = -value
                while byte == _BLANK or (byte == _TAB and separator != _TAB):
                    at += 1
                    byte = int(data[at])
            out[slot, row] = value
        column += 1
        if byte == separator:
            if column == len(slots):
                return REFUSED
        else:
            if byte == _RETURN:
                at += 1
                byte = int(data[at]) if at < len(data) else 0
            if byte != _LINE or column < len(slots):
                return REFUSED
            column = 0
            row += 1
        at += 1
    return row
