"""Source files of the project, read and parsed once for all tests that look at them."""

from __future__ import annotations

import ast
import functools
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


@functools.cache
def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


@functools.cache
def tree_of(path: Path) -> ast.Module:
    """The parsed file, shared and read-only."""
    return ast.parse(text_of(path))


@functools.cache
def nodes_of(path: Path) -> Sequence[ast.AST]:
    """All nodes of the file, in the order of `ast.walk`."""
    return tuple(ast.walk(tree_of(path)))


def module_docstring(path: Path) -> str | None:
    """The docstring of the module; a file that opens with it is not parsed."""
    if found := re.match(r'(?:#.*\n)*"""((?:[^\\]|\\.)*?)"""', text_of(path)):
        return found[1]
    return ast.get_docstring(tree_of(path))


def documented_nodes(path: Path) -> Iterator[ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef]:
    """The module, its classes and its functions: statements only are looked through, not what is in them."""
    waiting: list[ast.AST] = [tree_of(path)]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield node
        for block in ("body", "orelse", "handlers", "finalbody", "cases"):
            waiting += getattr(node, block, ()) if not isinstance(node, ast.Lambda | ast.IfExp) else ()


@functools.cache
def python_files(*folders: str) -> Sequence[Path]:
    """Sources of these folders."""
    return tuple(path for folder in folders for path in sorted((ROOT / folder).rglob("*.py")))
