"""Values in the unit of their row, as a user types and reads them, and the values on the wire.

    shown 1.5 ms  ──(− bias) ÷ scale──▶  wire 15  ──× scale + bias──▶  shown 1.5 ms

A field whose meaning depends on another one of its record (schema.Meaning) has the unit and scale of that meaning; a
signed meaning of an unsigned word is its two's complement. Names, flags, texts and opaque bytes are the same in both.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from imuscope.protocols.schema.fields import Field
from imuscope.protocols.schema.layouts import EncodeError

STEP_TOLERANCE = 1e-6  # of a step: a decimal fraction is not exact in binary


def meant(field: Field, record: Mapping[str, Any]) -> Field:
    """A field with the meaning that it has beside the other values of its record."""
    if not field.meaning_of:
        return field
    value = record.get(field.meaning_of)
    meaning = next((one for one in field.meanings if not one.values or value in one.values), None)
    if meaning is None:
        return field
    return replace(
        field,
        unit=meaning.unit,
        scale=meaning.scale,
        decimals=meaning.decimals,
        low=field.low if meaning.low is None else meaning.low,
        high=field.high if meaning.high is None else meaning.high,
    )


def signed_number(field: Field, number: Any, record: Mapping[str, Any]) -> Any:
    """A wire value of a field with its meaning in a record: an unsigned word may be a two's complement."""
    if not _is_signed(field, record) or not isinstance(number, int):
        return number
    span = _span(field)
    return number - span if span // 2 <= number < span else number


def is_scaled(field: Field) -> bool:
    """Whether the shown number is another than the one on the wire."""
    return field.scale != 1 or field.bias != 0


def to_shown(fields: Sequence[Field], values: Mapping[str, Any]) -> dict[str, Any]:
    """Wire values as shown."""
    return _converted(fields, values, shown_number)


def to_wire(fields: Sequence[Field], values: Mapping[str, Any]) -> dict[str, Any]:
    """Shown values as on the wire.

    Raises:
        EncodeError: an integer on the wire cannot hold a value exactly.
    """
    return _converted(fields, values, _wire_number)


def shown_number(field: Field, number: Any, record: Mapping[str, Any] | None = None) -> Any:
    """One number as shown; with its record, by the meaning that it has there."""
    row = field if record is None else meant(field, record)
    number = number if record is None else signed_number(field, number, record)
    if not is_scaled(row):
        return number
    return float(f"{number * row.scale + row.bias:.12g}")


def _wire_number(field: Field, number: Any, record: Mapping[str, Any]) -> Any:
    row = meant(field, record)
    if is_scaled(row):
        wire = (number - row.bias) / row.scale
        if np.dtype(row.dtype).kind in "iu":
            if not abs(wire - round(wire)) <= STEP_TOLERANCE * max(1.0, abs(wire)):
                step = f"{row.scale:g} {row.unit}".strip()
                raise EncodeError(f"{field.name} is a multiple of {step}, given {number:g}", field.name)
            wire = round(wire)
        number = wire
    if _is_signed(field, record) and isinstance(number, int) and -_span(field) // 2 <= number < 0:
        number += _span(field)
    return number


def _is_signed(field: Field, record: Mapping[str, Any]) -> bool:
    value = record.get(field.meaning_of) if field.meaning_of else None
    return next((one.signed for one in field.meanings if not one.values or value in one.values), False)


def _span(field: Field) -> int:
    return 1 << 8 * np.dtype(field.dtype).itemsize


def _converted(
    fields: Sequence[Field], values: Mapping[str, Any], convert: Callable[[Field, Any, Mapping[str, Any]], Any]
) -> dict[str, Any]:
    rows = {field.name: field for field in fields}

    def of(field: Field, value: Any) -> Any:
        if isinstance(value, (list, tuple)):
            return [of(field, one) for one in value]
        if isinstance(value, Mapping):
            return _converted(field.fields, value, convert) if field.fields else value
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            return value
        return convert(field, value, values)

    return {name: of(rows[name], value) if name in rows else value for name, value in values.items()}
