"""Syntax of expressions: text to a tree of allowed operations. Nothing of it is ever evaluated as a program.

norm(Acceleration) > 3 g and RateOfTurn.z < 10 °/s

or          lowest binding
and
not
< <= > >= == !=
+ -
* /
- +         as signs
^           also **; binds to the right
names       Acceleration.x; "2/Rate of turn.x" in quotation marks where a name has spaces, a slash or a device
numbers     9.81, 1e-3, with a unit where they have one: 3 g, 20 ms, 5 °/s, 0.5 m/s²
functions   norm(Acceleration)
"""

import re
from dataclasses import dataclass
from typing import NamedTuple, NoReturn

from imuscope.protocols.schema.units import NO_UNIT, SPELLINGS, SYMBOLS, Unit
from imuscope.server.errors import DomainError

MAX_LENGTH = 4000
MAX_DEPTH = 60  # of parentheses
MAX_HEIGHT = 150  # of the tree: a sum of so many terms, or so many signs


class ExpressionError(DomainError):
    """A mistake in an expression, and where it is: characters begin ≤ i < end."""

    def __init__(self, message: str, begin: int, end: int, hint: str = "") -> None:
        super().__init__("bad-expression", f"{message} (character {begin + 1})", hint)
        self.begin, self.end = begin, end


@dataclass(frozen=True, slots=True)
class Number:
    """A constant with its unit."""

    value: float
    unit: Unit
    begin: int
    end: int


@dataclass(frozen=True, slots=True)
class Name:
    """A signal, or a channel with all its columns."""

    name: str
    begin: int
    end: int


@dataclass(frozen=True, slots=True)
class Call:
    """A function, or an operator by its sign, with its arguments."""

    name: str
    arguments: "tuple[Node, ...]"
    begin: int
    end: int


Node = Number | Name | Call


class _Token(NamedTuple):
    kind: str
    text: str
    begin: int
    end: int


_SYMBOL = "|".join(sorted(map(re.escape, [*SYMBOLS, *SPELLINGS]), key=len, reverse=True))
_POWER = r"(?:\^-?\d+|[⁻⁰¹²³⁴-⁹]+)?"
_WORD = r"[^\W\d]\w*"
_TOKENS = re.compile(
    rf"""
    (?P<space>\s+)
  | (?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)
  | (?P<quoted>"[^"]*"|'[^']*')
  | (?P<name>{_WORD}(?:\.\w+)*)
  | (?P<sign><=|>=|==|!=|\*\*|[-+*/^()<>,=])
    """,
    re.VERBOSE,
)
_UNIT = re.compile(rf"[ ]?(?:{_SYMBOL}){_POWER}(?:[·/](?:{_SYMBOL}){_POWER})*(?![\w.(])")
_COMPARISONS = ("<", "<=", ">", ">=", "==", "!=")
_NAMES = ("and", "or", "not")


def parse(text: str) -> Node:
    """The tree of an expression.

    Raises:
        ExpressionError: it is too long or too deep, or something is missing or not allowed.
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"The expression has {len(text)} characters.", 0, len(text), f"At most {MAX_LENGTH}.")
    return _Parser(text).whole()


class _Parser:
    """Recursive descent, one method for each level of binding."""

    def __init__(self, text: str) -> None:
        self._tokens = _tokens(text)
        self._at = 0
        self._depth = 0

    def whole(self) -> Node:
        node = self._or()
        if self._token.kind != "end":
            self._fail(
                f"{self._token.text} was not expected.", "An operator is missing before it, or a “)” is too many."
            )
        _check_height(node)
        return node

    @property
    def _token(self) -> _Token:
        return self._tokens[self._at]

    def _fail(self, message: str, hint: str = "") -> NoReturn:
        raise ExpressionError(message, self._token.begin, max(self._token.end, self._token.begin + 1), hint)

    def _take(self, *texts: str) -> _Token | None:
        token = self._token
        if token.text not in texts or token.kind not in ("sign", "name"):
            return None
        self._at += 1
        return token

    def _or(self) -> Node:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            self._fail("The expression is nested too deeply.", f"At most {MAX_DEPTH} levels.")
        node = self._and()
        while self._take("or"):
            node = _call("or", node, self._and())
        self._depth -= 1
        return node

    def _and(self) -> Node:
        node = self._not()
        while self._take("and"):
            node = _call("and", node, self._not())
        return node

    def _not(self) -> Node:
        signs = []
        while token := self._take("not"):
            signs.append(token)
        node = self._comparison()
        for token in reversed(signs):
            node = Call("not", (node,), token.begin, node.end)
        return node

    def _comparison(self) -> Node:
        node = self._sum()
        if sign := self._take(*_COMPARISONS):
            node = _call(sign.text, node, self._sum())
            if self._token.text in _COMPARISONS:
                self._fail("Comparisons cannot be chained.", "Write a < b and b < c.")
        elif self._token.text == "=":
            self._fail("= assigns nothing here.", "Write == to compare.")
        return node

    def _sum(self) -> Node:
        node = self._product()
        while sign := self._take("+", "-"):
            node = _call(sign.text, node, self._product())
        return node

    def _product(self) -> Node:
        node = self._signed()
        while sign := self._take("*", "/"):
            node = _call(sign.text, node, self._signed())
        return node

    def _signed(self) -> Node:
        signs = []
        while token := self._take("-", "+"):
            signs.append(token)
        node = self._power()
        for token in reversed(signs):
            if token.text == "-":
                node = Call("negative", (node,), token.begin, node.end)
        return node

    def _power(self) -> Node:
        parts = [self._primary()]
        while self._take("^", "**"):
            minus = self._take("-")
            exponent = self._primary()
            parts.append(Call("negative", (exponent,), minus.begin, exponent.end) if minus else exponent)
        node = parts.pop()
        while parts:
            node = _call("^", parts.pop(), node)
        return node

    def _primary(self) -> Node:
        token = self._token
        self._at += 1
        if token.kind == "number":
            if self._token.kind == "unit":
                unit = self._token
                self._at += 1
                return Number(float(token.text), Unit.parse(unit.text), token.begin, unit.end)
            return Number(float(token.text), NO_UNIT, token.begin, token.end)
        if token.kind == "quoted":
            return Name(token.text[1:-1], token.begin, token.end)
        if token.kind == "name" and token.text not in _NAMES:
            return self._function(token) if self._take("(") else Name(token.text, token.begin, token.end)
        if token.text == "(":
            node = self._or()
            if not self._take(")"):
                self._fail("A “)” is missing.")
            return node
        self._at -= 1
        if token.kind == "end":
            self._fail("The expression ends where a value is expected.", "Name a signal, or write a number.")
        self._fail(f"{token.text} stands where a value is expected.", "Name a signal, or write a number.")

    def _function(self, name: _Token) -> Node:
        arguments = []
        if not self._take(")"):
            arguments.append(self._or())
            while self._take(","):
                arguments.append(self._or())
            if not self._take(")"):
                self._fail(f"A “)” is missing after the arguments of {name.text}.")
        return Call(name.text, tuple(arguments), name.begin, self._tokens[self._at - 1].end)


def _check_height(root: Node) -> None:
    """Raise ExpressionError if what walks the tree, level by level, could run out of levels."""
    open_nodes = [(root, 1)]
    while open_nodes:
        node, height = open_nodes.pop()
        if height > MAX_HEIGHT:
            message = f"The expression has more than {MAX_HEIGHT} operations one within the other."
            raise ExpressionError(message, root.begin, root.end, "Put parentheses around parts of it, or divide it.")
        if isinstance(node, Call):
            open_nodes += [(one, height + 1) for one in node.arguments]


def _call(name: str, left: Node, right: Node) -> Call:
    return Call(name, (left, right), left.begin, right.end)


def _tokens(text: str) -> list[_Token]:
    tokens, at = [], 0
    while at < len(text):
        match = _TOKENS.match(text, at)
        if match is None:
            hint = "The quotation mark is not closed." if text[at] in "\"'" else ""
            raise ExpressionError(f"{text[at]} is not allowed.", at, at + 1, hint)
        kind = match.lastgroup or ""
        if kind != "space":
            tokens.append(_Token(kind, match[0], at, match.end()))
        at = match.end()
        if kind == "number" and (unit := _UNIT.match(text, at)):
            tokens.append(_Token("unit", unit[0].strip(), at, unit.end()))
            at = unit.end()
    return [*tokens, _Token("end", "", len(text), len(text))]
