"""Typed C expressions, and what Python's operators are in C.

Integers are of 64 bits and wrap; `//` and `%` round down, as in Python. An integer that is written as a number takes
the type of what it is combined with, so `unsigned_index + 1` stays unsigned.
"""

import ast
import operator as op
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from imuscope.protocols.native.kernels import ArrayType, Kind, NumberType, TupleType, fence, short

INT, UNSIGNED, SHORT, FLOAT, FLAG = (NumberType(name) for name in ("int64", "uint64", "uint16", "float64", "bool"))
C_NAMES = {"int64": "i64", "uint64": "u64", "uint16": "uint16_t", "float64": "f64", "bool": "bool", "void": "void"}
ITEMS = {
    **{f"{sign}int{bits}": f"{sign}int{bits}_t" for sign in ("", "u") for bits in (8, 16, 32, 64)},
    "float64": "f64",
    "float32": "float",
}
"""Items of arrays, as C has them."""
_OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.BitAnd: "&", ast.BitOr: "|", ast.BitXor: "^"}
_COMPARISONS = {ast.Eq: "==", ast.NotEq: "!=", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}
_BITWISE = (ast.BitAnd, ast.BitOr, ast.BitXor)


class TranslateError(Exception):
    """Something in a kernel that has no translation; names the place."""


@dataclass(frozen=True)
class Value:
    """An expression in C.

    Args:
        number: its value where it is written as a number.
    """

    kind: Kind
    text: str
    number: int | float | None = None


def c_type(kind: Kind) -> str:
    if isinstance(kind, NumberType):
        return C_NAMES[kind.name]
    if isinstance(kind, ArrayType):
        return f"array_{kind.item}_{kind.dimensions}{'' if kind.contiguous else '_strided'}"
    return f"tuple_{''.join(_letter(one) for one in kind.kinds)}"


def _letter(kind: Kind) -> str:
    if isinstance(kind, TupleType):
        return f"T{''.join(_letter(one) for one in kind.kinds)}e"
    return C_NAMES[kind.name][0] if isinstance(kind, NumberType) else c_type(kind)


def type_definition(kind: Kind) -> str:
    """Definition of an array's or a tuple's type in C."""
    if isinstance(kind, TupleType):
        members = " ".join(f"{c_type(one)} m{k};" for k, one in enumerate(kind.kinds))
        return f"typedef struct {{ {members} }} {c_type(kind)};"
    if not isinstance(kind, ArrayType):
        return ""
    steps = "" if kind.contiguous else f" i64 steps[{kind.dimensions}];"
    return f"typedef struct {{ {ITEMS[kind.item]} *data; i64 shape[{kind.dimensions}];{steps} }} {c_type(kind)};"


def number(value: int | float | bool) -> Value:
    if isinstance(value, bool):
        return Value(FLAG, "1" if value else "0", int(value))
    if isinstance(value, float):
        return Value(FLOAT, f"({value.hex()})" if value - value == 0 else str(value), value)
    if value >= 1 << 63:
        return Value(UNSIGNED, f"{value}ull", value)
    return Value(INT, f"{value}ll" if value >= 0 else f"(-{-value - 1}ll - 1)", value)


def common(a: Value | Kind, b: Value | Kind) -> Kind:
    """The type that two values are combined in."""
    first, second = (one.kind if isinstance(one, Value) else one for one in (a, b))
    if first == second:
        return first
    if not isinstance(first, NumberType) or not isinstance(second, NumberType):
        raise TranslateError(f"{c_type(first)} and {c_type(second)} do not go together")
    kinds = {first, second}
    if FLOAT in kinds:
        return FLOAT
    if kinds == {INT, UNSIGNED}:
        signed = a if first == INT else b
        written = isinstance(signed, Value) and signed.number is not None and signed.number >= 0
        return UNSIGNED if written else INT
    if kinds == {INT, SHORT}:
        wide = a if first == INT else b
        return SHORT if isinstance(wide, Value) and wide.number is not None else INT
    return UNSIGNED if UNSIGNED in kinds else INT


def cast(value: Value, kind: Kind) -> Value:
    """The value in another type."""
    if value.kind == kind:
        return value
    if not isinstance(kind, NumberType) or not isinstance(value.kind, NumberType):
        raise TranslateError(f"{c_type(value.kind)} where {c_type(kind)} is expected")
    if kind == FLAG:
        return Value(FLAG, f"({value.text} != 0)")
    return Value(kind, f"(({c_type(kind)}){value.text})", value.number if kind != FLOAT else None)


def truth(value: Value) -> str:
    """A condition."""
    if not isinstance(value.kind, NumberType):
        raise TranslateError("only a number is true or false")
    return value.text if value.kind == FLAG else f"({value.text} != 0)"


def binary(operator: ast.operator, left: Value, right: Value) -> Value:
    """`left operator right`."""
    if isinstance(left.number, int) and isinstance(right.number, int) and left.kind == right.kind == INT:
        folded = _folded(operator, left.number, right.number)
        if folded is not None:
            return number(folded)
    kind = common(left, right)
    if kind == FLAG and not isinstance(operator, _BITWISE):
        kind = INT
    if isinstance(operator, ast.Div):
        return Value(FLOAT, f"divide({cast(left, FLOAT).text}, {cast(right, FLOAT).text})")
    a, b = cast(left, kind).text, cast(right, kind).text
    if type(operator) in _OPERATORS:
        text = f"({a} {_OPERATORS[type(operator)]} {b})"
        return Value(kind, f"((uint16_t){text})" if kind == SHORT else text)
    if kind == SHORT:
        raise TranslateError(f"{type(operator).__name__} of short numbers")
    if kind == FLOAT:
        raise TranslateError(f"{type(operator).__name__} of floats")
    if isinstance(operator, ast.LShift):
        return Value(kind, f"(({c_type(kind)})((u64){a} << ({b} & 63)))")
    if isinstance(operator, ast.RShift):
        return Value(kind, f"({a} >> ({b} & 63))")
    names = {ast.FloorDiv: "quotient", ast.Mod: "modulo"}
    if type(operator) not in names:
        raise TranslateError(type(operator).__name__)
    return Value(kind, f"{names[type(operator)]}_{c_type(kind)}({a}, {b})")


def _folded(operator: ast.operator, left: int, right: int) -> int | None:
    """The result, if it is that of two numbers that are written."""
    functions = {ast.Add: op.add, ast.Sub: op.sub, ast.Mult: op.mul, ast.LShift: op.lshift, ast.RShift: op.rshift}
    functions |= {ast.BitAnd: op.and_, ast.BitOr: op.or_, ast.BitXor: op.xor}
    return functions[type(operator)](left, right) if type(operator) in functions else None


def compare(operator: ast.cmpop, left: Value, right: Value) -> Value:
    """`left operator right`, of two numbers."""
    kind = common(left, right)
    if {left.kind, right.kind} == {INT, UNSIGNED} and kind == INT:
        raise TranslateError("a signed number is compared with an unsigned one")
    if type(operator) not in _COMPARISONS:
        raise TranslateError(type(operator).__name__)
    return Value(FLAG, f"({cast(left, kind).text} {_COMPARISONS[type(operator)]} {cast(right, kind).text})")


def element(array: Value, indices: list[Value]) -> str:
    """The place of an element, to which C assigns."""
    kind = array.kind
    if not isinstance(kind, ArrayType) or len(indices) != kind.dimensions:
        raise TranslateError("an index of another number of dimensions")
    for one in indices:
        if one.kind not in (INT, UNSIGNED) or (one.number is not None and one.number < 0):
            raise TranslateError("an index is a number from 0 on")
    name, item = array.text, ITEMS[kind.item]
    if not kind.contiguous:
        place = " + ".join(
            f"INSIDE((i64){one.text}, {name}.shape[{k}]) * {name}.steps[{k}]" for k, one in enumerate(indices)
        )
        return f"(*({item} *)((char *){name}.data + {place}))"
    if kind.dimensions == 1:
        return f"{name}.data[INSIDE({indices[0].text}, {name}.shape[0])]"
    row, column = (one.text for one in indices)
    first, second = f"INSIDE((i64){row}, {name}.shape[0])", f"INSIDE((i64){column}, {name}.shape[1])"
    return f"{name}.data[{first} * {name}.shape[1] + {second}]"


def load(array: Value, indices: list[Value]) -> Value:
    """An element as a number of 64 bits."""
    kind = array.kind
    place = element(array, indices)
    assert isinstance(kind, ArrayType)
    if kind.item.startswith("float"):
        return Value(FLOAT, f"((f64){place})")
    return Value(UNSIGNED if kind.item == "uint64" else INT, f"((i64){place})" if kind.item != "uint64" else place)


def row_of(array: Value, row: Value) -> Value:
    """A row of a table, which shares its memory."""
    kind = array.kind
    if not isinstance(kind, ArrayType) or kind.dimensions != 2 or not kind.contiguous:
        raise TranslateError("only a contiguous table has rows")
    one = replace(kind, dimensions=1)
    name = array.text
    at = f"INSIDE((i64){row.text}, {name}.shape[0])"
    return Value(one, f"(({c_type(one)}){{{name}.data + {at} * {name}.shape[1], {{{name}.shape[1]}}}})")


def builtin_call(called: Any, arguments: list[Value], name: str) -> Value:
    """A call of one of Python's or numpy's own functions."""
    if called is len:
        return Value(INT, f"{arguments[0].text}.shape[0]")
    if called is fence:
        return Value(INT, "(__sync_synchronize(), 0ll)")
    if called is float:
        return cast(arguments[0], FLOAT)
    if called is np.uint64:
        return cast(arguments[0], UNSIGNED)
    if called is short:
        return cast(arguments[0], SHORT)
    if called in (int, np.int64):
        value = arguments[0]
        return Value(INT, cast(value, INT).text, value.number if isinstance(value.number, int) else None)
    if called in (min, max) and len(arguments) == 2:
        kind = common(*arguments)
        a, b = (cast(one, kind).text for one in arguments)
        # Python's min(a, b) is a unless b is less
        return Value(kind, f"({b} {'<' if called is min else '>'} {a} ? {b} : {a})")
    if called is abs:
        value = arguments[0]
        return Value(value.kind, f"({value.text} < 0 ? -{value.text} : {value.text})")
    raise TranslateError(f"{name}(…) has no translation")
