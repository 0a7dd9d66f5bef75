"""pytest plugin: where the time of each test goes (`tests/check.py --profile`).

    IMUSCOPE_PROFILE=FOLDER pytest -p tests.checking.time_profile …

Each pytest process writes FOLDER/WORKER-PROCESS.jsonl. The first line of the one that collects holds its processor time
until the first test (imports, collecting, compiled code), each other line is a test:

    {"test", "setup", "call", "teardown": seconds that passed, "own", "begun", "browser": seconds of a processor}

`own` is pytest's process with all its threads, `begun` what runs in processes that it began (servers, commands), and
`browser` Chromium; their time counts for the test during which it was spent.
"""

import json
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import pytest

from tests.checking.machine import descendants, name_of, processor_seconds
from tests.support import server_process


class TimeProfile:
    """Writes one line per test."""

    def __init__(self, file: IO[str], *, is_forked: bool = False) -> None:
        self._file = file
        self._phases: dict[str, float] = {}
        self._before = (0.0, 0.0, 0.0)
        self._is_first = not is_forked

    @pytest.hookimpl(optionalhook=True, trylast=True)
    def pytest_before_workers(self) -> None:
        self._spend({"start": True})

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        if self._is_first:
            self._is_first = False
            self._spend({"start": True})
        self._phases = {}
        result = yield
        self._spend({"test": item.nodeid, **self._phases})
        return result

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._phases[report.when or ""] = round(report.duration, 4)

    def _spend(self, line: dict[str, Any]) -> None:
        now = (time.process_time(), *self._begun())
        # less than nothing: a browser that has ended, and was not waited for
        spent = [round(max(0.0, after - before), 3) for after, before in zip(now, self._before, strict=True)]
        self._before = now
        self._file.write(json.dumps({**line, **dict(zip(("own", "begun", "browser"), spent, strict=True))}) + "\n")
        self._file.flush()

    def _begun(self) -> tuple[float, float]:
        """Processor time so far of what was begun: other processes, and Chromium."""
        reaped = os.times()
        others, browser = reaped.children_user + reaped.children_system, 0.0
        for pid in descendants(os.getpid()):
            if name_of(pid).startswith("chrom"):
                browser += processor_seconds(pid)
            else:
                others += processor_seconds(pid)
        for child in server_process.forked():  # by a process of all workers, for this one
            living = (child.pid, *descendants(child.pid)) if child.returncode is None else ()
            others += child.processor_s + sum(map(processor_seconds, living))
        # a browser that has ended counts for the process that waited for it
        ended = max(0.0, self._before[2] - browser)
        return others - ended, browser + ended


def pytest_configure(config: pytest.Config) -> None:
    _register(config, "main", is_forked=False)


@pytest.hookimpl(optionalhook=True)
def pytest_worker_begins(config: pytest.Config, name: str) -> None:
    config.pluginmanager.unregister(name="time_profile_lines")
    _register(config, name, is_forked=True)


def _register(config: pytest.Config, name: str, *, is_forked: bool) -> None:
    if folder := os.environ.get("IMUSCOPE_PROFILE"):
        file = (Path(folder) / f"{name}-{os.getpid()}.jsonl").open("w")
        config.pluginmanager.register(TimeProfile(file, is_forked=is_forked), "time_profile_lines")
        config.add_cleanup(file.close)
