"""Count of the small mistakes that tests catch: change random lines, one at a time, and run the tests nearest to each.

    python -m tests.checking.mutation [--lines 200] [--seed 1] [--against FOLDER] [FOLDER_OF_SOURCES ...]

Not part of the check: it takes half an hour. Each mistake is made in a copy of the tree: a comparison turned round, a
sum into a difference, a number one larger, a condition negated, a result left out. `--against` runs the same mistakes
with the tests of another tree, to compare two states of the tests; only files that are the same in both are changed.
A mistake that no test catches is printed with its line: a place to look, not always a fault (a constant of a timeout).
One whose tests fail also without it is left out, and said.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import hypothesis  # noqa: F401 (in every process that is forked)
import pytest

from tests.checking.affected import affected_tests
from tests.support.source_files import ROOT, python_files

FOLDERS = ("protocols", "server/configuration")
COPIED = ("imuscope", "protocols", "recordings", "server", "tests", "docs", "web/src", "pyproject.toml", "README.md")
OURS = ("imuscope", "tests")
TESTS_S = 8.0  # of tests for each mistake
NEAREST = 3  # files of tests for each mistake
PLACES = (
    "tests/protocols/",
    "tests/server/configuration/",
    "tests/server/devices/",
    "tests/server/library/",
)  # without those that start processes and devices
HANGS_S = 240  # a mistake that makes an endless loop is caught
COMPARED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    **{ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq},
    **{ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is},
}
COMPUTED: dict[type[ast.operator], type[ast.operator]] = {
    **{ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Add, ast.FloorDiv: ast.Mult, ast.Div: ast.Mult},
    **{ast.LShift: ast.RShift, ast.RShift: ast.LShift, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd},
}


@dataclass(frozen=True)
class Mistake:
    """One changed expression."""

    path: str
    line: int
    before: str
    after: str
    text: str  # of the whole file


def mistakes_in(path: Path) -> Iterator[Mistake]:
    """Every mistake that can be made in a file, within functions only: tables are compared with the documents."""
    source = path.read_text(encoding="utf-8")
    lines = source.split("\n")
    for function in ast.walk(ast.parse(source)):
        if not isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        for node in (one for statement in function.body for one in ast.walk(statement)):
            after = _changed(node)
            if after is None or node.lineno != node.end_lineno or not hasattr(node, "end_col_offset"):
                continue
            raw = lines[node.lineno - 1].encode()
            before = raw[node.col_offset : node.end_col_offset].decode()
            changed = (raw[: node.col_offset] + after.encode() + raw[node.end_col_offset :]).decode()
            text = "\n".join([*lines[: node.lineno - 1], changed, *lines[node.lineno :]])
            yield Mistake(str(path.relative_to(ROOT)), node.lineno, before, after, text)


def _changed(node: ast.AST) -> str | None:
    match node:
        case ast.Compare(left=left, ops=[op], comparators=[right]) if type(op) in COMPARED:
            return f"({ast.unparse(ast.Compare(left, [COMPARED[type(op)]()], [right]))})"
        case ast.BinOp(left=left, op=op, right=right) if type(op) in COMPUTED and not isinstance(left, ast.Constant):
            return f"({ast.unparse(ast.BinOp(left, COMPUTED[type(op)](), right))})"
        case ast.BoolOp(op=op, values=values):
            return f"({ast.unparse(ast.BoolOp(ast.And() if isinstance(op, ast.Or) else ast.Or(), values))})"
        case ast.Constant(value=bool(value)):
            return str(not value)
        case ast.Constant(value=int(value)):
            return str(value + 1)
        case ast.Return(value=ast.expr()):
            return "return None"
    return None


def chosen(count: int, seed: int, folders: Sequence[str], against: Path | None) -> list[Mistake]:
    """Random mistakes, at most one for each line."""
    files = [path for path in python_files(*folders) if path.name != "__init__.py"]
    if against is not None:
        files = [
            path
            for path in files
            if (other := against / path.relative_to(ROOT)).exists() and other.read_bytes() == path.read_bytes()
        ]
    by_line: dict[tuple[str, int], list[Mistake]] = {}
    for path in files:
        for one in mistakes_in(path):
            by_line.setdefault((one.path, one.line), []).append(one)
    draw = random.Random(seed)
    lines = draw.sample(sorted(by_line), min(count, len(by_line)))
    return [draw.choice(by_line[line]) for line in lines]


class Tree:
    """A copy of a tree, in which one file at a time is changed."""

    def __init__(self, root: Path, folder: Path) -> None:
        self.root = root
        self.folder = folder
        self._well: set[str] = set()  # files of tests that pass without a mistake
        for name in COPIED:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            if (root / name).is_dir():
                shutil.copytree(root / name, folder / name, symlinks=True)  # those of the package
            else:
                shutil.copy(root / name, folder / name)

    def catches(self, mistake: Mistake, tests: Sequence[str]) -> bool:
        """Whether a test fails with the mistake.

        Raises:
            RuntimeError: one fails without it.
        """
        path = self.folder / mistake.path
        path.write_text(mistake.text, encoding="utf-8")
        present = [name for name in tests if (self.folder / name).exists()]
        try:
            failed = self._status(present) != 0
        finally:
            shutil.copy2(self.root / mistake.path, path)
        for name in present if failed else ():
            if name not in self._well and self._status([name]) != 0:
                raise RuntimeError(f"{self.root / name} fails without a mistake")
            self._well.add(name)
        return failed

    def _status(self, tests: Sequence[str]) -> int:
        child = os.fork()  # what is imported from elsewhere is there already
        if child == 0:
            self._run_tests(tests)
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])

    def _run_tests(self, tests: Sequence[str]) -> NoReturn:
        """In a process of its own: import this tree and run its tests."""
        status = 1
        try:
            signal.alarm(HANGS_S)
            os.setpgid(0, 0)
            nothing = os.open(os.devnull, os.O_RDWR)
            for stream in range(3):
                os.dup2(nothing, stream)
            os.chdir(self.folder)
            sys.path[:0] = [str(self.folder)]
            for name in [name for name in sys.modules if name.partition(".")[0] in OURS]:
                del sys.modules[name]
            imported = "ignore::pytest.PytestAssertRewriteWarning"  # hypothesis is there already
            status = pytest.main(["-x", "-q", "-p", "no:cacheprovider", "-W", imported, *tests])
        finally:
            os._exit(int(status))


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Make small mistakes and see whether tests catch them.")
    parser.add_argument("folders", nargs="*", default=FOLDERS)
    parser.add_argument("--lines", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--against", type=Path, help="another tree, whose tests run with the same mistakes")
    options = parser.parse_args()
    mistakes = chosen(options.lines, options.seed, options.folders, options.against)
    caught, left_out = [0, 0], 0
    with tempfile.TemporaryDirectory() as folder:
        roots = [ROOT, *([options.against.resolve()] if options.against else [])]
        trees = [Tree(root, Path(folder) / str(number)) for number, root in enumerate(roots)]
        for number, mistake in enumerate(mistakes, 1):
            near = affected_tests([mistake.path], 10 * TESTS_S).files
            tests = [name for name in near if name.startswith(PLACES)][:NEAREST]
            try:
                results = [tree.catches(mistake, tests) for tree in trees]
            except RuntimeError as error:
                print(f"left out: {mistake.path}:{mistake.line}: {error}", flush=True)
                left_out += 1
                continue
            caught = [count + one for count, one in zip(caught, [*results, False], strict=False)]
            figures = " · ".join(f"{count} of {number - left_out}" for count in caught[: len(trees)])
            if not all(results):
                words = " and ".join("here" if at == 0 else "there" for at, one in enumerate(results) if not one)
                print(f"not caught {words}: {mistake.path}:{mistake.line}  {mistake.before}  →  {mistake.after}")
            print(f"caught {figures}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
