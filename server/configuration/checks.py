"""Check of values against the rows of a table, each problem in words at its path."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from protocols.layouts import EncodeError
from protocols.schema import Field
from protocols.validation import find_problems
from server.configuration.api_models import FieldProblem
from server.configuration.value_format import head_of


def problems_of(fields: Iterable[Field], values: Mapping[str, Any], *, partial: bool = False) -> list[FieldProblem]:
    """Everything that is wrong with values, each at its path."""
    found = find_problems(tuple(fields), values, partial=partial)
    return [FieldProblem(problem.path, full(problem.message)) for problem in found]


def unlike(problems: Iterable[FieldProblem], values: Mapping[str, Any], held: Mapping[str, Any]) -> list[FieldProblem]:
    """Those that are not at a value which the device has: what it has may stay, whatever the tables allow."""
    left = []
    for one in problems:
        head = head_of(one.path, values)[0]
        if head not in held or held[head] != values.get(head):
            left.append(one)
    return left


def sentence(error: EncodeError) -> str:
    return full(str(error))


def full(text: str) -> str:
    """With a capital and a full stop, unless it begins with a field's name."""
    return text if text.endswith((".", "!", "?")) else text + "."
