"""Source files of the project, read and parsed once for all tests that look at them."""

from __future__ import annotations

import ast
import functools
import gc
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = "imuscope"  # its folders are links to those at the top level
OWN = f"{PACKAGE}."
BLOCKS = ("body", "orelse", "handlers", "finalbody", "cases")


@functools.cache
def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def tree_of(path: Path) -> ast.Module:
    """The parsed file. Let go of it: what is found in it is small, and a tree is thousands of objects, which are looked
    through whenever Python looks for garbage; so it does not while it parses.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        return ast.parse(text_of(path))
    finally:
        if was_enabled:
            gc.enable()


@dataclass(frozen=True)
class SourceFacts:
    """What the statements of a file say.

    Args:
        imports: line and full name of every module imported anywhere; of our own without `imuscope.`, as their folders.
        classes: line and name.
        docstrings: line of the module, class or function, and text.
        prose: lines of docstrings, and of other texts that are statements.
    """

    imports: Sequence[tuple[int, str]]
    classes: Sequence[tuple[int, str]]
    docstrings: Sequence[tuple[int, str]]
    prose: frozenset[int]


@functools.cache
def facts_of(path: Path) -> SourceFacts:
    """The file, looked through once for all that ask."""
    imports: list[tuple[int, str]] = []
    classes: list[tuple[int, str]] = []
    docstrings: list[tuple[int, str]] = []
    prose: set[int] = set()
    for node in _statements(tree_of(path)):
        match node:
            case ast.Import():
                imports += ((node.lineno, alias.name.removeprefix(OWN)) for alias in node.names)
            case ast.ImportFrom():
                package = path.relative_to(ROOT).with_suffix("").parts[:-1]
                above = package[: len(package) - node.level + 1] if node.level else ()
                base = ".".join([*above, *([node.module] if node.module else [])])
                base = "" if base == PACKAGE else base.removeprefix(OWN)
                imports += [
                    (node.lineno, base),
                    *((node.lineno, f"{base}.{alias.name}".lstrip(".")) for alias in node.names),
                ]
            case ast.ClassDef():
                classes.append((node.lineno, node.name))
            case ast.Expr(value=ast.Constant(value=str())):
                prose |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and (
            text := ast.get_docstring(node)
        ):
            docstrings.append((getattr(node, "lineno", 1), text))
    return SourceFacts(imports, classes, docstrings, frozenset(prose))


def _statements(tree: ast.Module) -> Iterator[ast.AST]:
    """The module and all its statements, also within functions; expressions are not looked into."""
    waiting: list[ast.AST] = [tree]
    while waiting:
        yield (node := waiting.pop())
        for block in BLOCKS:
            inner = getattr(node, block, ())
            if isinstance(inner, list):  # a lambda and a conditional have one expression
                waiting += inner


def module_docstring(path: Path) -> str | None:
    """The docstring of the module; a file that opens with it is not parsed."""
    if hit := re.match(r'(?:#.*\n)*"""((?:[^\\]|\\.)*?)"""', text_of(path)):
        return hit[1]
    return ast.get_docstring(tree_of(path))


@functools.cache
def python_files(*folders: str) -> Sequence[Path]:
    """Sources of these folders."""
    return tuple(path for folder in folders for path in sorted((ROOT / folder).rglob("*.py")))
