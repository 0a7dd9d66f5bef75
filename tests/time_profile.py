"""pytest plugin: where the time of each test goes, for `tests/check.py --profile`.

    pytest -p tests.time_profile      with IMUSCOPE_PROFILE=FOLDER in the environment

Each pytest process writes FOLDER/WORKER-PROCESS.jsonl: one line per test with seconds of set-up, call and tear-down as
they passed, and of processor time: its own process (all threads) and the processes that it began (servers, Chromium),
whose time counts for the test during which it was spent. A first line holds what the process took until its first test:
imports, collecting, compiled code.

Waiting is what remains of the time that passed when the processor time of the own process is taken away.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import pytest

TICKS = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100


def descendants(pid: int) -> Iterator[int]:
    """Processes begun by `pid`, and by those."""
    with suppress(OSError):
        for task in os.listdir(f"/proc/{pid}/task"):
            for child in Path(f"/proc/{pid}/task/{task}/children").read_text().split():
                yield int(child)
                yield from descendants(int(child))


def processor_seconds(pid: int, *, reaped: bool = True) -> float:
    """Processor time of a process and, with `reaped`, of those it has waited for."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return sum(map(int, fields[11 : 15 if reaped else 13])) / TICKS


def _begun_seconds() -> float:
    """Processor time of everything that this process began."""
    own = os.getpid()
    reaped = os.times()
    living = sum(processor_seconds(pid) for pid in descendants(own))
    return living + reaped.children_user + reaped.children_system


class TimeProfile:
    """Writes one line per test."""

    def __init__(self, file: IO[str]) -> None:
        self._file = file
        self._phases: dict[str, float] = {}
        self._own = 0.0
        self._begun = 0.0
        self._is_first = True

    def _write(self, line: dict[str, Any]) -> None:
        self._file.write(json.dumps(line) + "\n")
        self._file.flush()

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        if self._is_first:
            self._is_first = False
            self._own, self._begun = 0.0, 0.0
            self._spend({"start": True})
        self._phases = {}
        result = yield
        self._spend({"test": item.nodeid, **self._phases})
        return result

    def _spend(self, line: dict[str, Any]) -> None:
        own, begun = time.process_time(), _begun_seconds()
        self._write({**line, "own": round(own - self._own, 4), "begun": round(begun - self._begun, 2)})
        self._own, self._begun = own, begun

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._phases[report.when or ""] = round(report.duration, 4)


def pytest_configure(config: pytest.Config) -> None:
    folder = os.environ.get("IMUSCOPE_PROFILE")
    if not folder or getattr(config.option, "numprocesses", None):
        return  # the process that only distributes
    worker = os.environ.get("PYTEST_XDIST_WORKER", "main")
    name = f"{worker}-{os.getpid()}.jsonl"
    file = (Path(folder) / name).open("w")
    config.pluginmanager.register(TimeProfile(file), "time_profile_lines")
    config.add_cleanup(file.close)
