"""Check of values against the rows of a table; each problem is a text at its path."""

from collections.abc import Iterable, Mapping
from typing import Any

from imuscope.protocols.schema.fields import Field
from imuscope.protocols.schema.layouts import EncodeError
from imuscope.protocols.schema.validation import find_problems
from imuscope.server.configuration.api_models import FieldProblem
from imuscope.server.configuration.value_format import head_of


def problems_of(fields: Iterable[Field], values: Mapping[str, Any], *, partial: bool = False) -> list[FieldProblem]:
    """Problems of values, each with its path."""
    problems = find_problems(tuple(fields), values, partial=partial)
    return [FieldProblem(problem.path, full(problem.message)) for problem in problems]


def without_current_values(
    problems: Iterable[FieldProblem], values: Mapping[str, Any], current: Mapping[str, Any]
) -> list[FieldProblem]:
    """Problems without those of values that the device already has, which may stay whatever the tables allow, whatever
    else of the setting is changed.
    """
    return [one for one in problems if not is_reported(one.path, values, current)]


def is_reported(path: str, values: Any, current: Any) -> bool:
    """Whether the device has the value at a path: there, in a record that it has, or in one of the same kind."""
    if isinstance(values, Mapping) and isinstance(current, Mapping) and path:
        head, rest = head_of(path, values)
        return head in current and head in values and is_reported(rest, values[head], current[head])
    if values == current:
        return True
    if not (isinstance(values, list) and isinstance(current, list)):
        return False
    place, _, leaf = path.partition(".")
    if not place.isdecimal() or int(place) >= len(values):
        return False
    entry = values[int(place)]
    if not isinstance(entry, Mapping):
        return current[int(place) : int(place) + 1] == [entry]
    first = next(iter(entry), "")  # names what the record is about
    is_named = leaf == first and any(one.get(first) == entry[first] for one in current)
    return entry in current or is_named


def sentence(error: EncodeError) -> str:
    return full(str(error))


def full(text: str) -> str:
    """The text with a full stop at its end."""
    return text if text.endswith((".", "!", "?")) else text + "."
