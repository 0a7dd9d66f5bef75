"""Check of values against the rows of a table; each problem is a text at its path."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from imuscope.protocols.layouts import EncodeError
from imuscope.protocols.schema import Field
from imuscope.protocols.validation import find_problems
from imuscope.server.configuration.api_models import FieldProblem
from imuscope.server.configuration.value_format import head_of


def problems_of(fields: Iterable[Field], values: Mapping[str, Any], *, partial: bool = False) -> list[FieldProblem]:
    """Problems of values, each with its path."""
    problems = find_problems(tuple(fields), values, partial=partial)
    return [FieldProblem(problem.path, full(problem.message)) for problem in problems]


def without_current_values(
    problems: Iterable[FieldProblem], values: Mapping[str, Any], current: Mapping[str, Any]
) -> list[FieldProblem]:
    """Problems without those of values that the device already has, which may stay whatever the tables allow."""
    left = []
    for one in problems:
        head = head_of(one.path, values)[0]
        if head not in current or current[head] != values.get(head):
            left.append(one)
    return left


def sentence(error: EncodeError) -> str:
    return full(str(error))


def full(text: str) -> str:
    """The text with a full stop at its end."""
    return text if text.endswith((".", "!", "?")) else text + "."
