"""Validation of values before they are sent, by the ranges in the rows of a table.

    Field.low, high          the range of a number, if narrower than its type
    Field.choices            an enumeration: one of these numbers
    Field.max_length         the greatest number of elements of a list, of characters of a text, of bytes
    Field.dtype, shape       everything else

Anything a device has sent can be composed again (protocols/schema/layouts.py); user input is checked here first. A form
shows all problems at once, each at its field; other callers get the first as an error.

Paths: names and list indexes joined by dots, "outputs.3.output_frequency".
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from imuscope.protocols.schema.fields import Field
from imuscope.protocols.schema.layouts import EncodeError, is_open
from imuscope.protocols.schema.shown_values import is_scaled, meant, shown_number, signed_number

MAX_LISTED = 40  # choices in an error; a longer list hides the error
MAX_ANGLE = 1e6  # of an angle that is worth reading in degrees, rad
_FIXED = {"fp1220": 2.0**11, "fp1632": 2.0**15}


@dataclass(frozen=True, slots=True)
class ValueProblem:
    """Problem of one value: `message` names the field, the value and the allowed range."""

    path: str
    message: str


def require_valid(fields: Sequence[Field], values: Mapping[str, Any], *, partial: bool = False) -> None:
    """Raise the first problem.

    Raises:
        EncodeError: with its path.
    """
    for problem in find_problems(fields, values, partial=partial):
        raise EncodeError(problem.message, problem.path)


def find_problems(
    fields: Sequence[Field], values: Mapping[str, Any], *, partial: bool = False, at: str = ""
) -> Iterator[ValueProblem]:
    """Find every problem of `values`.

    Args:
        partial: fields may be left out; read-only fields always may.
        at: path of the record `values`.
    """
    names = [field.name for field in fields]
    for name in values:
        if name not in names:
            there = f"there are: {', '.join(names)}" if names else "there are none"
            yield ValueProblem(_join(at, name), f"no field is called {name!r}; {there}")
    for field in fields:
        path = _join(at, field.name)
        if field.name in values and field.meaning_of:  # its range and unit are those of the other field
            yield from _of(meant(field, values), signed_number(field, values[field.name], values), path)
        elif field.name in values:
            yield from _of(field, values[field.name], path)
        elif not partial and not field.read_only:
            yield ValueProblem(path, f"{field.name} is missing")


def _join(at: str, name: str | int) -> str:
    return f"{at}.{name}" if at else str(name)


def _of(field: Field, value: Any, path: str) -> Iterator[ValueProblem]:
    if field.dtype == "ascii" and len(field.shape) == 2:
        for place, one in enumerate(value if isinstance(value, (list, tuple)) else [value]):
            yield from _of_text(replace(field, shape=field.shape[1:]), one, _join(path, place))
    elif field.dtype in ("bytes", "ascii"):
        yield from _of_text(field, value, path)
    elif not field.shape:
        yield from _of_element(field, value, path)
    elif not isinstance(value, (list, tuple)):
        yield ValueProblem(path, f"{field.name} is a list, given {value!r:.80}")
    else:
        count = math.prod(field.shape)
        if is_open(field) and field.max_length and len(value) > field.max_length:
            yield ValueProblem(path, f"{field.name} has at most {field.max_length} entries, given {len(value)}")
        elif not is_open(field) and len(value) != count:
            which = f" ({', '.join(field.axes)})" if field.axes else ""
            yield ValueProblem(path, f"{field.name} has {count} values{which}, given {len(value)}")
        for place, one in enumerate(value):
            yield from _of_element(field, one, _join(path, place))


def _of_element(field: Field, value: Any, path: str) -> Iterator[ValueProblem]:
    if not field.fields:
        problem = _of_number(field, value)
        if problem:
            yield ValueProblem(path, problem)
    elif isinstance(value, Mapping):
        yield from find_problems(field.fields, value, at=path)
    else:
        yield ValueProblem(
            path, f"{field.name} is a record of {', '.join(f.name for f in field.fields)}, given {value!r:.80}"
        )


def _of_text(field: Field, value: Any, path: str) -> Iterator[ValueProblem]:
    """Text, or bytes as hex."""
    unit = "bytes" if field.dtype == "bytes" else "characters"
    try:
        raw = bytes.fromhex(value) if field.dtype == "bytes" else str(value).encode("ascii")
    except (TypeError, ValueError):
        yield ValueProblem(path, f"{field.name} is {'hex' if unit == 'bytes' else 'ASCII text'}, given {value!r:.80}")
        return
    most = field.max_length if is_open(field) else math.prod(field.shape)
    least = int(field.low or 0)
    if most and len(raw) > most:
        yield ValueProblem(path, f"{field.name} has at most {most} {unit}, given {len(raw)}")
    elif len(raw) < least:
        yield ValueProblem(path, f"{field.name} has at least {least} {unit}, given {len(raw)}")
    elif unit == "bytes" and not is_open(field) and len(raw) != most:
        yield ValueProblem(path, f"{field.name} has {most} bytes, given {len(raw)}")


def _of_number(field: Field, value: Any) -> str:
    """Problem of one number; "" if there is none."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return f"{field.name} is a number, given {value!r:.80}"
    low, high = bounds(field)
    whole = is_whole(field)
    if whole and isinstance(value, float) and not value.is_integer():
        what = "a whole number" if not is_scaled(field) else f"a multiple of {field.scale:g}{_unit(field)}"
        return f"{field.name} is {what}, given {_value_text(field, value)}"
    if not low <= value <= high:  # not a number fails too
        limits = " and ".join(_shown(shown_number(field, limit)) for limit in (low, high))
        limits += _unit(field) + _degrees(field, low, high)
        return f"{field.name} lies between {limits}, given {_value_text(field, value)}"
    if field.choices and value not in field.choices:
        if len(field.choices) > MAX_LISTED:
            return f"{field.name} is one of {len(field.choices)} known values, given {value!r:.80}"
        return f"{field.name} is one of {_listed(field)}, given {value!r:.80}"
    return ""


def is_whole(field: Field) -> bool:
    """Whether the field holds integers."""
    return field.dtype not in _FIXED and np.dtype(field.dtype).kind in "iu"


def bounds(field: Field) -> tuple[float, float]:
    """The least and the greatest allowed wire value."""
    if field.dtype in _FIXED:
        least, greatest = -_FIXED[field.dtype], math.nextafter(_FIXED[field.dtype], 0)
    elif is_whole(field):
        limits = np.iinfo(np.dtype(field.dtype))
        least, greatest = int(limits.min), int(limits.max)
    else:
        greatest = float(np.finfo(np.dtype(field.dtype)).max)
        least = -greatest
    return least if field.low is None else field.low, greatest if field.high is None else field.high


def _shown(number: float) -> str:
    return f"{number:g}" if isinstance(number, float) else str(number)


def _unit(field: Field) -> str:
    return f" {field.unit}" if field.unit else ""


def _value_text(field: Field, value: float) -> str:
    number = f"{shown_number(field, value):.9g}" if is_scaled(field) else f"{value!r:.80}"
    return f"{number}{_unit(field)}{_degrees(field, value)}"


def _degrees(field: Field, *numbers: float) -> str:
    """Radians in degrees as well, in which they are shown; "" for other units."""
    if not field.unit.startswith("rad") or is_scaled(field) or not all(abs(one) < MAX_ANGLE for one in numbers):
        return ""
    return f" ({' and '.join(f'{math.degrees(one):.6g}' for one in numbers)} °{field.unit[3:]})"


def _listed(field: Field) -> str:
    return ", ".join(f"{number} ({meaning})" for number, meaning in field.choices.items())
