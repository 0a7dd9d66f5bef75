"""Catalogue of all user-facing errors, with message and hint.

    python -m tests.rules.error_catalog          lists them all, by the part that says them

They are found in the source: every call of a constructor in SHAPES, anywhere in server/ and recordings/, with its words
as they are written; what is filled in stands in braces. Words that were put into a variable are looked up in the
function (all that it is given there) and in the module. A call that passes on the words of another error is not listed
again: that other one is, and of the call only the kind is looked at (server/errors.py). So a new error is in the
list by being written, and its test (tests/rules/test_errors.py) reads it.
"""

from __future__ import annotations

import ast
import functools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.support.source_files import ROOT, python_files, text_of, tree_of

FOLDERS = ("server", "recordings")


@dataclass(frozen=True)
class Shape:
    """Position of the texts in a call; None: the call has no such part."""

    kind: int | None
    message: int
    hint: int | None
    around: str = "{}"  # how the message is completed
    hinted: bool = True  # it can have a hint
    stop: bool = False  # a full stop is put behind it where it has none (server/cli.py)


SHAPES = {
    "DomainError": Shape(0, 1, 2),
    "RefusedError": Shape(0, 1, 2),
    "problem": Shape(1, 2, 3),
    "Problem": Shape(0, 1, 2),
    "LinkError": Shape(0, 1, 2),
    "ControlError": Shape(0, 1, 2),
    "JobError": Shape(None, 0, 1),
    "RecordingError": Shape(None, 0, 1),
    "NamingError": Shape(None, 0, 1),
    "ExportError": Shape(None, 0, 1),
    "SnapshotError": Shape(None, 0, 1),
    "CorrectionError": Shape(None, 0, 1),
    "ViewError": Shape(None, 0, 1),
    "WireError": Shape(None, 0, 1),
    "bad": Shape(None, 1, 2, "The source {source} cannot be used: {}."),
    "DecodeOptionError": Shape(None, 0, None, "{}.", hinted=False),  # HTTP puts SETTINGS_HINT beside it
    "MeshError": Shape(None, 0, None, hinted=False),  # a notice in the scene: a sentence or two
    "ConfigError": Shape(None, 0, None, hinted=False),  # one line on standard error, as all that follow
    "UsageError": Shape(None, 0, None, hinted=False, stop=True),
    "ComposeError": Shape(None, 0, None, hinted=False, stop=True),
}
CALLED = re.compile(rf"\b(?:{'|'.join(SHAPES)})\(")
DEFAULT_HINTS = {"bad": "Write a source as /dev/ttyUSB0, tcp://host:port, …"}


@dataclass(frozen=True)
class ErrorText:
    """One error.

    Args:
        hint: "" for none; None where a call passes one on.
    """

    where: str
    sort: str
    kind: str
    message: str
    hint: str | None

    @property
    def hinted(self) -> bool:
        """Should it have a hint?"""
        return SHAPES[self.sort].hinted


@dataclass(frozen=True)
class _Call:
    """A call of one of the constructors, and values of the names that it can use."""

    node: ast.Call
    known: dict[str, list[ast.expr]]


@functools.cache
def _calls(path: Path) -> Sequence[_Call]:
    """Calls in a file, in its order."""
    if not CALLED.search(text_of(path)):
        return ()  # most files: they are not parsed
    tree = tree_of(path)
    module = _assigned(tree.body, deep=False)
    results: list[_Call] = []

    def walk(node: ast.AST, known: dict[str, list[ast.expr]]) -> None:
        if isinstance(node, ast.Call) and _name(node.func) in SHAPES:
            results.append(_Call(node, known))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):  # of several, the innermost counts
            known = {**module, **_assigned(node.body, deep=True)}
        for child in ast.iter_child_nodes(node):
            walk(child, known)

    walk(tree, module)
    return tuple(results)


@functools.cache
def everything() -> Sequence[ErrorText]:
    """Every error in the source, in the order of the files."""
    results = []
    for folder in FOLDERS:
        for path in python_files(folder):
            results += list(_of_module(path))
    return tuple(dict.fromkeys(results))


def kinds() -> list[tuple[str, str, int]]:
    """Every kind that is written in the source: where, which, and with which status of HTTP (0: none is written there).

    Also of calls that pass on another error's words.
    """
    results = []
    for folder in FOLDERS:
        for path in python_files(folder):
            for node in (call.node for call in _calls(path)):
                shape = SHAPES[_name(node.func)]
                if shape.kind is None:
                    continue
                status = node.args[0] if shape.kind == 1 and node.args else None
                report = status.value if isinstance(status, ast.Constant) and isinstance(status.value, int) else 0
                where = f"{path.relative_to(ROOT)}:{node.lineno}"
                results += [(where, kind, report) for kind in _texts(_part(node, shape.kind, "kind"), {})]
    return results


def _of_module(path: Path) -> Iterator[ErrorText]:
    for call in _calls(path):
        yield from _texts_of(
            call.node, _name(call.node.func), call.known, f"{path.relative_to(ROOT)}:{call.node.lineno}"
        )


def _texts_of(call: ast.Call, name: str, known: dict[str, list[ast.expr]], where: str) -> Iterator[ErrorText]:
    shape = SHAPES[name]
    kinds = _texts(_part(call, shape.kind, "kind"), known) if shape.kind is not None else [""]
    hints: list[str | None] = [""]
    if shape.hint is not None:
        node = _part(call, shape.hint, "hint")
        hints = list(_texts(node, known)) or [None]
        if node is None:
            hints = [DEFAULT_HINTS.get(name, "")]
    for message in _texts(_part(call, shape.message, "message"), known):
        words = shape.around.replace("{}", message)
        if shape.stop and not words.endswith((".", "?")):
            words += "."
        hint = max(hints, key=lambda one: one is None or len(one)) if len(hints) > 1 and "" not in hints else hints[0]
        yield ErrorText(where, name, "/".join(str(kind) for kind in kinds), words, hint)


def _part(call: ast.Call, place: int, name: str) -> ast.expr | None:
    if place < len(call.args):
        return call.args[place]
    return next((word.value for word in call.keywords if word.arg == name), None)


def _name(node: ast.expr) -> str:
    return node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""


def _assigned(body: list[ast.stmt], *, deep: bool) -> dict[str, list[ast.expr]]:
    """Values assigned to names; for a function, all of them."""
    results: dict[str, list[ast.expr]] = {}
    nodes = [node for statement in body for node in ast.walk(statement)] if deep else list(body)
    for node in nodes:
        if not isinstance(node, ast.Assign):
            continue
        for target in node.targets:
            if isinstance(target, ast.Name):
                results.setdefault(target.id, []).append(node.value)
            elif isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                for one, value in zip(target.elts, node.value.elts, strict=False):
                    if isinstance(one, ast.Name):
                        results.setdefault(one.id, []).append(value)
    return results


def _texts(node: ast.expr | None, known: dict[str, list[ast.expr]], depth: int = 0) -> list[str]:
    """The texts that an expression can be; none where its words are another's."""
    match node:
        case ast.Constant(value=str(text)):
            return [text]
        case ast.JoinedStr(values=parts):
            return ["".join(_piece(part, known, depth) for part in parts)]
        case ast.BinOp(op=ast.Add(), left=left, right=right):
            return [a + b for a in _texts(left, known, depth) for b in _texts(right, known, depth)]
        case ast.IfExp(body=body, orelse=other):
            return _texts(body, known, depth) + _texts(other, known, depth)
        case ast.Name(id=name) if name in known and depth < 4:
            return [text for value in known[name] for text in _texts(value, known, depth + 1)]
        case ast.Subscript(value=ast.Name(id=name)) if name in known and depth < 4:
            values = [one for one in known[name] if isinstance(one, ast.Dict)]
            return [text for one in values for value in one.values for text in _texts(value, known, depth + 1)]
    return []


def _piece(part: ast.expr, known: dict[str, list[ast.expr]], depth: int) -> str:
    if isinstance(part, ast.Constant):
        return str(part.value)
    assert isinstance(part, ast.FormattedValue)
    if isinstance(part.value, ast.Name) and depth < 2:
        results = _texts(part.value, known, depth + 2)
        if len(results) == 1:
            return results[0]
    name = re.sub(r"\(.*|\[.*", "", ast.unparse(part.value)).rpartition(".")[2]
    return f"{{{name}}}"


def main() -> None:
    """Print the list."""
    last = ""
    for output in everything():
        part = output.where.partition(":")[0]
        if part != last:
            print(f"\n{part}")
            last = part
        kind = f"[{output.kind}] " if output.kind else ""
        print(f"  {kind}{output.message}")
        if output.hint:
            print(f"      → {output.hint}")


if __name__ == "__main__":
    main()
