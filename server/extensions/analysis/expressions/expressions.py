"""Evaluation of expressions over columns, live and recorded alike."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches

import numpy as np

from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.expressions.expression_functions import DELAYED, FUNCTIONS, Context
from imuscope.server.extensions.analysis.expressions.expression_operators import OPERATORS, operate
from imuscope.server.extensions.analysis.expressions.expression_syntax import Call, ExpressionError, Name, Node, Number
from imuscope.server.extensions.analysis.signals.quantities import Quantity, number
from imuscope.server.extensions.analysis.signals.signals import SignalColumn, angles_named, columns_named
from imuscope.server.wire import ChannelInfo

Resolve = Callable[[str], Quantity]


def names_in(node: Node) -> Iterator[Name]:
    """All signals and channels that an expression names, in order."""
    if isinstance(node, Name):
        yield node
    elif isinstance(node, Call):
        for argument in node.arguments:
            yield from names_in(argument)


def columns_of(infos: Sequence[ChannelInfo], name: Name, device: str = "") -> tuple[list[SignalColumn], str | None]:
    """The columns of a name, and the Euler angle that is computed from them, "" for all; None: they are the signal.

    Args:
        device: as for `columns_named`.

    Raises:
        ExpressionError: there is no such signal, or its columns differ in their units.
    """
    with _placed(name):
        if derived := angles_named(infos, name.name, device):
            return derived
        columns = columns_named(infos, [name.name], device)
    if len({column.info.columns[column.at].unit for column in columns}) > 1:
        hint = f"Name one: {', '.join(column.name for column in columns):.400}."
        raise ExpressionError(f"The columns of {name.name} differ in their units.", name.begin, name.end, hint)
    return columns, None


@contextmanager
def _placed(name: Name) -> Iterator[None]:
    """Add the place of a name to a DomainError about it."""
    try:
        yield
    except DomainError as error:
        raise ExpressionError(error.message, name.begin, name.end, error.hint) from None


def evaluate(node: Node, resolve: Resolve, context: Context) -> Quantity:
    """The value of an expression.

    Args:
        resolve: gives the signal, or the channel with all its columns, of a name.

    Raises:
        ExpressionError: a name, a function or a unit does not fit; says where.
    """
    with np.errstate(all="ignore"):  # a division by zero has no finite result, which plots leave out
        return _value(node, resolve, context, {})


def _value(node: Node, resolve: Resolve, context: Context, known: dict[str, Quantity]) -> Quantity:
    if isinstance(node, Number):
        return number(node.value, node.unit)
    if isinstance(node, Name):
        if node.name not in known:
            with _placed(node):
                known[node.name] = resolve(node.name)
        return known[node.name]
    is_function = node.name not in OPERATORS
    if is_function and node.name not in FUNCTIONS:
        close = get_close_matches(node.name, FUNCTIONS, 1)
        hint = f"Did you mean {close[0]}?" if close else f"Functions: {', '.join(FUNCTIONS)}."
        raise ExpressionError(f"There is no function {node.name}.", node.begin, node.end, hint)
    arguments = [_value(argument, resolve, context, known) for argument in node.arguments]
    return FUNCTIONS[node.name].apply(arguments, node, context) if is_function else operate(node, arguments)


def notes_of(node: Node, context: Context) -> list[str]:
    """Sentences about functions that differ between live and recorded."""
    used = sorted({one for one in _calls(node) if one in DELAYED})
    if not used:
        return []
    how = "without delay, forwards and backwards" if context.zero_phase else "causal: they use the past only"
    return [f"Computed {how}: {', '.join(used)}."]


def _calls(node: Node) -> Iterator[str]:
    if isinstance(node, Call):
        yield node.name
        for argument in node.arguments:
            yield from _calls(argument)
