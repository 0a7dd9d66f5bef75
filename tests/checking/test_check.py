"""The check command: a failure is one, a hang ends, the quick part takes what is near, the table adds up."""

from __future__ import annotations

import argparse
import json
import os
import sys
import textwrap
import threading
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests import check
from tests.check import run_part
from tests.checking import affected, hang_report, parts, time_table
from tests.checking.machine import descendants, memory_of, state
from tests.checking.parts import Part
from tests.checking.stress import busy_loops, stress

FLAKY = """
import pathlib, sys
seen = pathlib.Path(sys.argv[1])
first = not seen.exists()
seen.touch()
print("FAILED tests/test_x.py::test_y[a b] - AssertionError: no" if first else "")
print("1 failed in 0.1s" if first else "1 passed in 0.1s")
sys.exit(first)
"""
OPTIONS = argparse.Namespace(fix=False)


def python(script: str, *words: str, alone: bool = False, lane: str = "narrow") -> Part:
    """A part that runs a script."""

    def command(_: argparse.Namespace) -> list[str]:
        return [sys.executable, "-c", script, *words]

    return Part("tests", command, alone=command if alone else None, lane=lane)


def test_a_test_that_fails_once_and_passes_alone_has_failed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    outcome = run_part(python(FLAKY, str(tmp_path / "seen"), alone=True, lane="wide"), OPTIONS, {})
    assert outcome.status == 1
    assert outcome.closing == "1 failed in 0.1s"
    assert outcome.failed == ("tests/test_x.py::test_y[a b]",)
    assert "alone: 1 passed" in capsys.readouterr().out


def test_a_failure_states_what_to_run_again(capsys: pytest.CaptureFixture[str]) -> None:
    check.report([parts.Outcome("pytest", 1, 2.0, 3.0, "1 failed", ("tests/test_x.py::test_y[a b]",))], 10**9)
    printed = capsys.readouterr().out
    assert "-m pytest 'tests/test_x.py::test_y[a b]'\n" in printed
    assert "3 s of a processor, 1.0 GB of memory at most" in printed
    assert printed.endswith("\n1 failed\n")  # CI reads pytest's closing line


def test_the_report_repeats_the_end_of_a_part_that_failed(capsys: pytest.CaptureFixture[str]) -> None:
    """CI kept the end of the log: that all 1074 tests had passed, and not what failed beside them."""
    script = "print('1 error'); print('Tests 9 passed'); raise SystemExit(1)"
    outcome = parts.run(python(script), [sys.executable, "-c", script], {})
    capsys.readouterr()
    check.report([outcome], 0)
    assert "tests ended with:\n  1 error\n  Tests 9 passed\n" in capsys.readouterr().out


def test_a_part_that_goes_silent_is_ended_with_what_it_began(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(parts, "SILENT_S", 0.0)
    begins = "import subprocess, sys; subprocess.run([sys.executable, '-c', 'import signal; signal.pause()'])"
    outcome = parts.run(python(begins), [sys.executable, "-c", begins], {})
    assert outcome.status < 0
    assert "nothing printed" in capsys.readouterr().out


def test_a_test_that_hangs_is_named_with_its_stack_and_given_up() -> None:
    read, written = os.pipe()
    is_given_up = threading.Event()
    watch = hang_report.HangReport(written, is_given_up.set, long_s=0.01)
    protocol = watch.pytest_runtest_protocol(Item("tests/test_x.py::test_hangs"))  # type: ignore[arg-type]
    next(protocol)
    printed = ""
    while "memory" not in printed or not is_given_up.is_set():  # the end of a report, which comes again and again
        printed += os.read(read, 1 << 16).decode()
    with pytest.raises(StopIteration):
        protocol.send(None)
    watch.close()
    os.close(read)
    assert "tests/test_x.py::test_hangs has been running" in printed
    assert "in test_a_test_that_hangs_is_named_with_its_stack_and_given_up" in printed


@dataclass
class Item:
    nodeid: str


def test_processor_time_is_that_of_everything_a_part_began() -> None:
    burn = "import time\nwhile time.process_time() < 0.2: pass"
    script = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {burn!r}])"
    assert parts.run(python(script), [sys.executable, "-c", script], {}).processor >= 0.2


def test_the_nearest_tests_are_taken_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sources = {
        "server/clock.py": "",
        "server/device.py": "from imuscope.server import clock",
        "server/other.py": "",
        "tests/test_clock.py": "from imuscope.server.clock import (\n    tick,\n)",
        "tests/test_device.py": "import imuscope.server.device as device",
        "tests/test_other.py": "from imuscope.server.other import thing",
        "tests/bench/test_speed.py": "from imuscope.server import clock",
    }
    for name, text in sources.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(affected, "ROOT", tmp_path)
    monkeypatch.setattr(affected, "python_files", lambda *folders: [tmp_path / name for name in sources])
    monkeypatch.setattr(affected, "durations", lambda: {"tests/test_clock.py": 3.0, "tests/test_device.py": 4.0})
    near, far = "tests/test_clock.py", "tests/test_device.py"
    rules = affected.RULES
    assert affected.affected_tests(["server/clock.py"], 10) == affected.Affected((*rules, near, far), 0)
    assert affected.affected_tests(["server/clock.py"], 5) == affected.Affected((*rules, near), 1)
    assert affected.affected_tests(["server/clock.py"], 1) == affected.Affected((*rules, near), 1)  # one at least
    assert affected.affected_tests(["tests/test_other.py", "README.md"], 10).files == (*rules, "tests/test_other.py")


def test_imports_are_read_without_parsing(tmp_path: Path) -> None:
    path = tmp_path / "module.py"
    path.write_text(
        "import os, imuscope.server.app as app\nfrom tests import (\n    a,\n    b as c,\n)\n"
        "def f():\n    from x.y import z\n"
    )
    assert affected.imports_of(path) == {"os", "server.app", "tests", "tests.a", "tests.b", "x.y", "x.y.z"}


def test_tests_run_again_and_again_beside_busy_loops() -> None:
    lines: list[str] = []
    results = iter([0, 1, 0])
    assert stress(lambda: next(results), times=3, report=lines.append) == [2]
    assert lines[-1].startswith("run 3 of 3")
    assert lines[-1].endswith("1 failed")


def test_the_state_of_the_machine_names_processes() -> None:
    with busy_loops(1):
        text = state()
        assert "load" in text
        assert "GB available" in text
        assert "processes of the check" in text
        assert sum(memory_of(pid) for pid in descendants(1)) >= 0


def test_the_table_sums_what_the_processes_wrote(tmp_path: Path) -> None:
    lines = [
        {"start": True, "own": 5.0, "begun": 0.0, "browser": 0.0},
        {"test": "tests/a/test_x.py::test_1", "setup": 1, "call": 2, "teardown": 0, "own": 1, "begun": 4, "browser": 0},
        {"test": "tests/a/test_x.py::test_2", "setup": 0, "call": 1, "teardown": 1, "own": 2, "begun": 0, "browser": 6},
    ]
    (tmp_path / "gw0-1.jsonl").write_text("\n".join(map(json.dumps, lines)))
    profile = time_table.Profile.read(tmp_path)
    assert profile.seconds() == {"tests/a/test_x.py": 5}
    page = tmp_path / "page.md"
    page.write_text(f"before\n{time_table.BEGIN}\nformer\n{time_table.END}\nafter\n")
    text = time_table.table(
        [time_table.PartTime("pytest", 9, 18)],
        profile,
        passed=10,
        memory=2 * 10**9,
        date="2026-11-25",
        machine="2 cores",
    )
    time_table.write(text, page)
    written = page.read_text()
    assert written.startswith("before\n")
    assert written.endswith("\nafter\n")
    assert "former" not in written
    assert "10 s, 18 s of a processor, at most 2.0 GB" in written
    assert "| tests/a | 2 | 1 | 3 | 1 | 2 | 3 | 4 | 6 |" in written
    assert "Of pytest: 5 s of a processor" in written


def test_every_part_of_the_quick_check_exists() -> None:
    assert set(check.QUICK) <= {part.name for part in check.PARTS}
    assert textwrap.dedent(check.__doc__ or "").count("--quick") == 1


def test_a_part_that_prints_dots_is_not_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run of few tests prints no whole line for minutes."""
    records: list[str] = []
    read, written = os.pipe()
    dots = f"import os\nos.write(1, b'.')\nos.read({read}, 1)\nos.write(1, b'. 2 passed')"

    def go_on(watch: object) -> None:
        records.append("printed")
        os.write(written, b"x")  # only what was passed on without a line's end lets it go on

    monkeypatch.setattr(parts._SilenceWatch, "printed", go_on)
    os.set_inheritable(read, True)
    monkeypatch.setattr(parts, "INHERITED", (read,))
    outcome = parts.run(python(dots), [sys.executable, "-c", dots], {})
    assert outcome.closing == ".. 2 passed"
    assert records
    for descriptor in (read, written):
        os.close(descriptor)
