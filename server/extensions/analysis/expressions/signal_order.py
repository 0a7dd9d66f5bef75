"""Order of computed signals that use each other: each after those that it uses."""

from __future__ import annotations

from collections.abc import Sequence

from imuscope.server.extensions.analysis.expressions.expression_syntax import ExpressionError, parse
from imuscope.server.extensions.analysis.expressions.expressions import names_in
from imuscope.server.library.signal_definitions import SignalDefinition


def used_by(definition: SignalDefinition, names: Sequence[str]) -> list[str]:
    """Those of the names of computed signals that an expression uses; none if it has a mistake."""
    try:
        named = {one.name.partition(".")[0] for one in names_in(parse(definition.expression))}
    except ExpressionError:
        return []
    return [name for name in names if name in named]


def in_order(definitions: Sequence[SignalDefinition]) -> list[SignalDefinition]:
    """The definitions, each after those that it uses; those of a cycle come last, as given."""
    names = [one.name for one in definitions]
    waiting = {one.name: (one, {*used_by(one, names)}) for one in definitions}
    ordered: list[SignalDefinition] = []
    while ready := [name for name, (_, uses) in waiting.items() if uses.isdisjoint(waiting)]:
        ordered += [waiting.pop(name)[0] for name in ready]
    return ordered + [one for one, _ in waiting.values()]


def cycle_of(definition: SignalDefinition, others: Sequence[SignalDefinition]) -> list[str]:
    """Names from a definition back to itself, along what each uses; empty if there is no such way."""
    known = {one.name: one for one in others} | {definition.name: definition}
    ways = [[definition.name]]
    visited: set[str] = set()
    for way in ways:  # grows while it is walked: the shortest way comes first
        for name in used_by(known[way[-1]], list(known)):
            if name == definition.name:
                return [*way, name]
            if name not in visited:
                visited.add(name)
                ways.append([*way, name])
    return []
