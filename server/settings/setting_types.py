"""Types of settings that say which values are allowed, in standard annotations.

    rollback_s: Annotated[float, Interval(ge=1, le=600), Unit("s")] = 20.0
    log_format: Annotated[str, one_of("text", "json")] = "text"

Errors and the table of the guide take their words from here.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, get_args, get_origin

from annotated_types import Ge, GroupedMetadata, Gt, Interval, Le, Lt, Predicate, Unit


@dataclass(frozen=True)
class Form(Predicate):
    """A condition on a setting.

    Args:
        func: whether a value is allowed.
        words: error text after the value if it is not.
    """

    words: str = ""


def zero_or(low: float, high: float, unit: str, zero: str = "no limit") -> Form:
    """Zero, with the meaning `zero`, or a value in a range."""
    words = f"is neither 0 ({zero}) nor {_span(low, high)} {unit}"
    return Form(lambda value: value == 0 or low <= value <= high, words)


def one_of(*names: str) -> Form:
    """One of some words."""
    return Form(names.__contains__, f"is not valid; allowed: {', '.join(names)}")


def empty_or(is_allowed: Callable[[str], object], words: str) -> Form:
    """Nothing, or a text of a certain form."""
    return Form(lambda text: not text or bool(is_allowed(text)), words)


def is_of_type(value: object, kind: Any) -> bool:
    """Whether a value has the type of a setting, strictly: neither text nor true is a number."""
    if kind in (int, float):
        return isinstance(value, (int, kind)) and not isinstance(value, bool)
    origin, args = get_origin(kind), get_args(kind)
    if origin is tuple:
        return isinstance(value, tuple) and all(is_of_type(one, args[0]) for one in value)
    if origin is dict:
        return isinstance(value, Mapping) and all(
            is_of_type(name, args[0]) and is_of_type(one, args[1]) for name, one in value.items()
        )
    return isinstance(value, kind)


def is_allowed(value: Any, annotated: Any) -> bool:
    """Whether a value of its type is one that the annotations of the setting allow."""
    return all(_holds(value, one) for one in _constraints(get_args(annotated)[1:]))


def _constraints(annotations: Iterable[object]) -> Iterator[object]:
    for one in annotations:
        if isinstance(one, GroupedMetadata):
            yield from _constraints(one)
        else:
            yield one


def _holds(value: Any, constraint: object) -> bool:
    match constraint:
        case Gt():
            return bool(value > constraint.gt)
        case Ge():
            return bool(value >= constraint.ge)
        case Lt():
            return bool(value < constraint.lt)
        case Le():
            return bool(value <= constraint.le)
        case Predicate():
            return bool(constraint.func(value))
    return True


def refusal_of(annotated: Any) -> str:
    """Error text after a value that is not allowed; "" of a type that allows all of its values."""
    constraints = get_args(annotated)[1:]
    unit = next((f" {one.unit}" for one in constraints if isinstance(one, Unit)), "")
    for one in constraints:
        if isinstance(one, Form):
            return one.words
        if isinstance(one, Interval):
            return f"is outside {_span(one.gt if one.ge is None else one.ge, one.le)}{unit}"
    return ""


def allowed_by(annotated: Any) -> str:
    """Allowed values of a setting, for a table; "" if its type allows all of its values."""
    words = re.sub(
        r"^(is outside|is not valid; allowed:|is neither|is not|must be|must have) ", "", refusal_of(annotated)
    )
    return words.replace(" nor ", " or ")


def _span(low: Any, high: Any) -> str:
    return f"{_number(low)} … {_number(high)}"


def _number(value: float) -> str:
    """A round number in groups of three digits; a port or a power of two as people write it."""
    return f"{value:_.0f}".replace("_", " ") if value >= 10_000 and value % 100 == 0 else f"{value:.10g}"


_ADDRESS = re.compile(r"(?:tcp|udp|tls|quic|ws)/(?:\[[0-9a-fA-F:.]+\]|[^\s/:\[\]#?]+):(\d{1,5})(?:[?#]\S*)?")


def is_router_address(text: str) -> bool:
    """Whether a text is an address of a router: tcp/HOST:PORT."""
    match = _ADDRESS.fullmatch(text)
    return match is not None and 0 < int(match[1]) <= 65_535
