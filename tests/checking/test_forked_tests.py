"""Tests in forked workers: each one is reported once, and one that takes its process with it is named."""

import re
import subprocess
import sys
from dataclasses import dataclass
from multiprocessing import Pipe
from pathlib import Path

from tests.checking import forked_tests
from tests.support.source_files import ROOT

DIES = """
import os, signal, pytest

@pytest.fixture(scope="module")
def shared():
    print("begins")
    yield
    print("ends")

def test_has_a_folder(shared, tmp_path):
    assert not list(tmp_path.iterdir())

def test_wrong(shared):
    assert 1 == 2

def test_dies(shared):
    os.kill(os.getpid(), signal.SIGKILL)

def test_after(shared):
    pass
"""
OTHER = """
import pytest

def test_passes():
    pass

def test_skipped():
    pytest.skip("no")
"""


def run(folder: Path, *words: str) -> str:
    plain = ("-p", "no:cacheprovider", "-p", "no:schemathesis", "-p", "tests.checking.forked_tests", "-c", "/dev/null")
    command = [sys.executable, "-m", "pytest", *plain, "-q", "--color=no", "--rootdir", str(folder), *words]
    done = subprocess.run([*command, str(folder)], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 1  # some fail
    return done.stdout + done.stderr


def test_a_test_that_ends_its_process_is_named_and_the_others_run(tmp_path: Path) -> None:
    (tmp_path / "test_dies.py").write_text(DIES)
    (tmp_path / "test_other.py").write_text(OTHER)
    printed = run(tmp_path, "--workers", "2")
    assert "2 failed, 3 passed, 1 skipped" in printed
    assert "ended with status -9 during this test" in printed
    assert re.search(r"_ test_wrong _+\n\[worker1\]", printed)
    assert "E       assert 1 == 2" in printed


def test_the_first_failure_ends_all_workers_on_request(tmp_path: Path) -> None:
    (tmp_path / "test_fails.py").write_text("def test_fails():\n    assert False\n")
    (tmp_path / "test_waits.py").write_text("import signal\n\ndef test_waits():\n    signal.pause()\n")
    assert "1 failed" in run(tmp_path, "--workers", "2", "-x")


def test_files_that_parse_the_same_sources_run_in_one_worker(tmp_path: Path) -> None:
    """Each of six workers parsed all of them again: 10 s of a processor."""
    (tmp_path / "rules").mkdir()
    for path in (*(tmp_path / "rules" / f"test_{n}.py" for n in range(3)), tmp_path / "test_other.py"):
        path.write_text("def test_fails():\n    assert False\n")
    workers = dict(
        re.findall(r"\[(worker\d)\]\n[^[]*?(rules|other)\S*: AssertionError", run(tmp_path, "--workers", "3"))
    )
    assert sorted(workers.values()) == ["other", "rules"]


@dataclass
class Item:
    """As much of a test as the distribution looks at."""

    name: str

    def get_closest_marker(self, mark: str) -> str | None:
        return mark if "browser" in self.name else None


def test_one_worker_keeps_a_browser_and_two_have_one_at_the_end() -> None:
    tests = forked_tests.ForkedTests(3)
    names = ("plain 1", "plain 2", "plain 3", "browser 1", "browser 2", "browser 3", "browser 4")
    tests._groups = [[Item(name)] for name in names]  # type: ignore[list-item]
    workers = []
    for number in range(3):
        workers.append(forked_tests._Worker(f"worker{number}", 0, Pipe()[0], tests._take()))
        tests._workers = list(workers)
    assert [worker.group[0].name for worker in workers] == ["browser 1", "plain 1", "plain 2"]
    batches = []
    for number in (0, 1, 2, 1, 0):
        worker = workers[number]
        worker.group = tests._take(worker) or worker.group
        batches.append(worker.group[0].name)
    assert batches == ["browser 2", "plain 3", "browser 3", "plain 3", "browser 4"]
    assert tests._take(workers[2]) == []
