"""Selection of the tests that a change touches, for `tests/check.py --quick`.

A test is touched by a changed module if it imports it, itself or through others. In the end nearly every test imports
nearly every module, so the nearest are taken first (the fewest imports between), until what they took in the last whole
run fills the time. How many were left out is said.
"""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.support.cache_folder import cache_folder
from tests.support.source_files import PACKAGE, ROOT, python_files, text_of

SOURCES = ("protocols", "recordings", "server", "tests")
RULES = tuple(f"tests/rules/test_{name}.py" for name in ("english", "architecture", "page_state", "rooms", "mirror"))
"""Tests that read all sources, so that no import leads to them; they take fifteen seconds, and are always run."""
UNKNOWN_S = 2.0  # a file of tests that was never timed
NOT_RUN = ("bench", "browser", "interop")  # folders of tests/ without tests, or with slow ones

_IMPORT = re.compile(r"^[ \t]*(?:from ([\w.]+) )?import (\([^)]*\)|[^\n(]*)", re.M)


@dataclass(frozen=True)
class Affected:
    """Files of tests to run, and how many more a change touches from further away."""

    files: tuple[str, ...]
    left_out: int


def changed_files(since: str = "") -> list[str]:
    """Paths that differ from a commit, with those that git does not know yet.

    Args:
        since: a commit; "" for the last one, or the one before it if nothing has changed since.
    """

    def differing(commit: str) -> list[str]:
        return _git("diff", "--name-only", "--diff-filter=d", commit)

    untracked = _git("ls-files", "--others", "--exclude-standard")
    return [*differing(since or "HEAD"), *untracked] or differing("HEAD~1")


def affected_tests(changed: Iterable[str], seconds: float) -> Affected:
    """The rules, and files of tests that import what changed, the nearest first, as many as fit into some seconds."""
    modules = {_module(path): path for path in python_files(*SOURCES)}
    importers: dict[str, set[str]] = {name: set() for name in modules}
    for name, path in modules.items():
        for imported in imports_of(path):
            if imported in importers:
                importers[imported].add(name)
    reached = [name for path in changed if (name := _module(ROOT / path)) in modules]
    results: list[str] = []
    visited = set(reached)
    while reached:
        results += sorted(name for name in reached if _is_test(modules[name]))
        nearer, reached = reached, []
        for name in nearer:
            reached += sorted(importers[name] - visited)
            visited |= importers[name]
    timed = durations()
    files: list[str] = []
    paths = [path for name in results if (path := str(modules[name].relative_to(ROOT))) not in RULES]
    for path in paths:
        seconds -= timed.get(path, UNKNOWN_S)
        if seconds < 0 and files:
            break
        files.append(path)
    return Affected((*RULES, *files), len(paths) - len(files))


def imports_of(path: Path) -> set[str]:
    """Names of modules that a file may import, wherever in it; of `from a import b` both `a` and `a.b`; of our
    own without `imuscope.`, as their folders.
    """
    results = set()
    for of, names in _IMPORT.findall(text_of(path)):
        parts = re.findall(r"([\w.]+)(?:\s+as\s+\w+)?", names)
        results |= {of, *(f"{of}.{name}" for name in parts)} if of else set(parts)
    return {name.removeprefix(f"{PACKAGE}.") for name in results}


def durations() -> dict[str, float]:
    """Seconds of each file of tests in the last run that was timed."""
    try:
        document = json.loads((cache_folder("durations") / "durations.json").read_text())
    except (OSError, ValueError):
        return {}
    return {str(name): float(seconds) for name, seconds in document.items()}


def note_durations(seconds: dict[str, float]) -> None:
    """Keep the seconds of files that were run; others stay as they were known."""
    place = cache_folder("durations") / "durations.json"
    aside = place.with_suffix(".new")
    aside.write_text(json.dumps({**durations(), **seconds}, indent=0))
    aside.replace(place)


def _is_test(path: Path) -> bool:
    inside = path.relative_to(ROOT).parts
    return inside[0] == "tests" and path.name.startswith("test_") and inside[1] not in NOT_RUN


def _module(path: Path) -> str:
    inside = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(inside[:-1] if inside[-1] == "__init__" else inside)


def _git(*words: str) -> list[str]:
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True)
    return done.stdout.split("\n")[:-1] if done.returncode == 0 else []


def page_files(changed: Sequence[str]) -> list[str]:
    """Sources of the page among changed files, as vitest takes them."""
    return [str(ROOT / path) for path in changed if path.startswith("web/src/") and path.endswith((".ts", ".tsx"))]
