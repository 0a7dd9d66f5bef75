"""Operators of expressions: arithmetic, comparison and logic, with units carried and checked."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from imuscope.protocols.arrays import Floats
from imuscope.protocols.schema.units import NO_UNIT, Unit
from imuscope.server.extensions.analysis.expressions.expression_syntax import Call, ExpressionError
from imuscope.server.extensions.analysis.signals.quantities import Quantity, on_one_axis

MAX_POWER = 100  # of a unit; beyond, it is a text of digits, not a unit
_SUMS: Mapping[str, Callable[[Any, Any], Any]] = {"+": np.add, "-": np.subtract}
_COMPARISONS: Mapping[str, Callable[[Any, Any], Any]] = {
    "<": np.less,
    "<=": np.less_equal,
    ">": np.greater,
    ">=": np.greater_equal,
    "==": np.equal,
    "!=": np.not_equal,
}
OPERATORS = frozenset({*_SUMS, *_COMPARISONS, "*", "/", "^", "negative", "and", "or", "not"})


def operate(node: Call, arguments: list[Quantity]) -> Quantity:
    """The value of one of OPERATORS.

    Raises:
        ExpressionError: units or numbers of columns do not fit.
    """
    name = node.name
    if name in _SUMS:
        return _sum(node, *arguments)
    if name in _COMPARISONS:
        left, right, _ = _alike(node, *arguments)
        return _paired(node, left, right, _COMPARISONS[name], NO_UNIT, is_logical=True)
    if name == "*":
        left, right = on_one_axis(arguments)
        return _paired(node, left, right, np.multiply, left.unit * right.unit)
    if name == "/":
        left, right = on_one_axis(arguments)
        return _paired(node, left, right, np.divide, left.unit / right.unit)
    if name == "^":
        return _power(node, *arguments)
    if name == "negative":
        return _each(arguments[0], np.negative)
    return _logic(node, arguments)


def _sum(node: Call, left: Quantity, right: Quantity) -> Quantity:
    period = left.period or right.period
    left, right, unit = _alike(node, left, right)
    result = _paired(node, left, right, _SUMS[node.name], unit)
    if node.name == "-" and period and left.period and right.period:  # the difference of two angles takes the short way
        half = left.period / 2
        return result.with_parts([(part + half) % left.period - half for part in result.parts])
    return result


def _alike(node: Call, left: Quantity, right: Quantity) -> tuple[Quantity, Quantity, Unit]:
    """Both in one unit and at the same times: the unit is that of the signal, not of a constant."""
    if left.is_zero:
        unit = right.unit
    elif right.is_zero:
        unit = left.unit
    elif not left.unit.fits(right.unit):
        raise ExpressionError(_misfit(node, left.unit, right.unit), node.begin, node.end, _hint(left, right))
    else:
        unit = right.unit if left.is_number and not right.is_number else left.unit
        left, right = left.in_unit(unit), right.in_unit(unit)
    left, right = on_one_axis([left, right])
    return left, right, unit


def _misfit(node: Call, left: Unit, right: Unit) -> str:
    first, second = (f"A value in {one}" if str(one) else "A number without a unit" for one in (left, right))
    joined = "be added or subtracted" if node.name in _SUMS else "be compared"
    return f"{first} and {second[0].lower()}{second[1:]} cannot {joined}."


def _hint(left: Quantity, right: Quantity) -> str:
    for one, other in ((left, right), (right, left)):
        if one.is_literal and not str(one.unit):
            return f"Write the unit of the number, for example {one.number:g} {other.unit}."
    return "Multiply or divide to make the units equal."


def _paired(
    node: Call,
    left: Quantity,
    right: Quantity,
    work: Callable[[Any, Any], Any],
    unit: Unit,
    *,
    is_logical: bool = False,
) -> Quantity:
    n, m = len(left.parts), len(right.parts)
    if n != m and 1 not in (n, m):
        message = f"A vector of {n} columns and one of {m} do not fit."
        raise ExpressionError(message, node.begin, node.end, "Name single columns, or use norm.")
    wide = left if n > m or (n == m and not left.is_number) else right
    pairs = [(left.parts[i % n], right.parts[i % m]) for i in range(max(n, m))]
    parts = tuple(_checked(work(a, b), a, b, is_logical=is_logical) for a, b in pairs)
    time = left.time if left.time is not None else right.time
    breaks, is_literal = left.breaks or right.breaks, left.is_literal and right.is_literal
    return Quantity(parts, unit, time, wide.names, 0.0, is_logical, is_literal, breaks)


def _checked(result: Any, a: Floats, b: Floats, *, is_logical: bool) -> Floats:
    """Truth as 0 and 1, and undefined where an operand is."""
    if not is_logical:
        return np.asarray(result, np.float64)
    truth: Floats = result.astype(np.float64)
    if np.isnan(a.sum() + b.sum()):  # a sum is quicker than a search
        truth[np.isnan(a) | np.isnan(b)] = np.nan
    return truth


def _each(quantity: Quantity, work: Callable[[Floats], Floats]) -> Quantity:
    result = quantity.with_parts([work(part) for part in quantity.parts])
    return replace(result, is_literal=quantity.is_literal)


def _power(node: Call, base: Quantity, exponent: Quantity) -> Quantity:
    if not exponent.is_number or exponent.unit.dimensions or not np.isfinite(exponent.number):
        begin, end = node.arguments[1].begin, node.arguments[1].end
        raise ExpressionError("An exponent has to be a number without a unit.", begin, end, "For example x^2.")
    power = Fraction(exponent.number).limit_denominator(12)
    if base.unit.powers and float(power) != exponent.number:
        begin, end = node.arguments[1].begin, node.arguments[1].end
        raise ExpressionError("A unit cannot have that exponent.", begin, end, "Divide by the unit first.")
    unit = base.unit**power if base.unit.powers else NO_UNIT
    if any(abs(one) > MAX_POWER for _, one in unit.powers):
        begin, end = node.arguments[1].begin, node.arguments[1].end
        largest = max(abs(one) for _, one in unit.powers)
        message = f"A unit to the power of {float(largest):.6g} is not allowed."
        raise ExpressionError(message, begin, end, f"At most {MAX_POWER}; divide by the unit first.")
    result = _each(base, lambda part: np.power(part, exponent.number))
    return replace(result, unit=unit)


def _logic(node: Call, arguments: list[Quantity]) -> Quantity:
    for one, argument in zip(node.arguments, arguments, strict=True):
        if argument.unit.dimensions:
            message = f"{node.name} takes a condition (true or false), not a value in {argument.unit}."
            raise ExpressionError(message, one.begin, one.end, "Compare it, for example with > 0.")
    if node.name == "not":
        [only] = arguments
        return only.with_parts([_truth(part, part == 0) for part in only.parts], NO_UNIT, is_logical=True)
    left, right = on_one_axis(arguments)
    work = np.logical_and if node.name == "and" else np.logical_or
    return _paired(node, left, right, lambda a, b: work(a != 0, b != 0), NO_UNIT, is_logical=True)


def _truth(values: Floats, result: Any) -> Floats:
    return np.where(np.isnan(values), np.nan, result)
