"""pytest plugin: tests in several processes that are forked once all are collected (`--workers N`).

    imported, collected ── fork ──> workers 1 … N: the tests of a file, or of the rules, at a time
            ^                           │
            └──────── reports ──────────┘

To import and collect takes 9 s of a processor and 600 MB, which is spent once in place of once for each worker. At most
BROWSERS files with a real browser run at a time: a page that is open costs half a core, however little is asked of it.

A worker that dies is reported as the failure of its test; another one goes on with the rest of the file.
"""

import gc
import os
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from multiprocessing.connection import Connection, Pipe, wait
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn

import pytest

from tests.support.forking import fork_server

BROWSERS = 2
TOGETHER = "rules"  # a folder whose tests parse the same thousand files, which each worker would do again
Group = list[pytest.Item]


def unit_of(path: Path) -> Path:
    """What one worker runs of the tests: a file, or a folder."""
    return path.parent if path.parent.name == TOGETHER else path


class Hooks:
    """What other plugins may do around the forking."""

    def pytest_before_workers(self, config: pytest.Config) -> None:
        """Called once before the first worker is forked: what all of them need may be loaded."""

    def pytest_worker_begins(self, config: pytest.Config, name: str) -> None:
        """Called in each worker."""

    def pytest_worker_ends(self, config: pytest.Config) -> None:
        """Called in each worker, before it ends without the clean-up of an interpreter."""


@dataclass
class _Worker:
    """A worker, as the process that distributes knows it."""

    name: str
    pid: int
    line: Connection
    group: Group = field(default_factory=list)  # what is not reported yet of the file that it runs
    following: Group = field(default_factory=list)


class ForkedTests:
    """Runs the tests of a session in workers."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._groups: list[Group] = []
        self._workers: list[_Worker] = []
        self._begun = 0
        self._status: int | None = None

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool | None:
        """Distribute them, unless pytest has something else to do."""
        if session.testsfailed or session.config.option.collectonly:
            return None
        self._groups = [list(items) for _, items in groupby(session.items, key=lambda item: unit_of(item.path))]
        if len(self._groups) < 2:
            return None
        session.config.hook.pytest_before_workers(config=session.config)
        gc.collect()
        gc.freeze()  # otherwise each worker would copy the memory that its collections look at
        gc.set_threshold(20_000, 20, 20)  # by default, a twentieth of a worker's time is spent on looking for garbage
        try:
            for _ in range(min(self._count, len(self._groups))):
                self._begin(session)
            while self._workers:
                self._listen(session)
                if session.shouldfail:
                    raise session.Failed(session.shouldfail)
                if session.shouldstop:
                    raise session.Interrupted(session.shouldstop)
            if self._groups:
                raise RuntimeError(f"no worker is left for {self._groups[0][0].nodeid} and what comes after it")
        finally:
            for worker in self._workers:
                with suppress(ProcessLookupError):
                    os.kill(worker.pid, signal.SIGKILL)
                os.waitpid(worker.pid, 0)
        return True

    def pytest_sessionfinish(self, exitstatus: int) -> None:
        self._status = int(exitstatus)

    @pytest.hookimpl(trylast=True)
    def pytest_unconfigure(self) -> None:
        """End here: what follows frees everything that was collected, and a library lists what it leaks."""
        if self._status is not None:
            fork_server.end(self._status)

    def _begin(self, session: pytest.Session) -> None:
        """Fork a worker with a file to run, if one is left for it."""
        group = self._take()
        if not group:
            return
        self._begun += 1
        name = f"worker{self._begun}"
        folders = session.config._tmp_path_factory  # type: ignore[attr-defined]
        base = folders.getbasetemp()
        ours, theirs = Pipe()
        sys.stdout.flush()
        pid = os.fork()
        if pid == 0:
            ours.close()
            for other in self._workers:
                other.line.close()
            folders._basetemp = base / name
            folders._basetemp.mkdir()
            _work(session, name, theirs, group)
        theirs.close()
        self._workers.append(_Worker(name, pid, ours, group))

    def _take(self, leaving: _Worker | None = None) -> Group:
        """The next file for a worker; empty when none is left, or only browsers' while enough of them run.

        One worker has a browser from the beginning, and keeps it: tests without one wait for half of their time.

        Args:
            leaving: the worker that asks at its last test of a file; absent: a new one.
        """
        others = [worker for worker in self._workers if worker is not leaving]
        browsers = sum(_needs_browser(worker.following or worker.group) for worker in others)
        has_browser = _needs_browser(leaving.group) if leaving else browsers == 0
        for expected in (has_browser, not has_browser):
            if expected and browsers >= BROWSERS:
                continue
            for at, group in enumerate(self._groups):
                if _needs_browser(group) is expected:
                    return self._groups.pop(at)
        return []

    def _listen(self, session: pytest.Session) -> None:
        for line in wait([worker.line for worker in self._workers]):
            [worker] = [one for one in self._workers if one.line is line]
            try:
                kind, report = worker.line.recv()
            except (EOFError, ConnectionError):
                self._end(session, worker)
                continue
            if kind == "report":
                self._report(session, worker, report)
            elif kind == "ended":
                worker.group.pop(0)
                if not worker.group:
                    worker.group, worker.following = worker.following, []
            elif kind == "next":
                worker.following = self._take(leaving=worker)
                worker.line.send([session.items.index(item) for item in worker.following])
            else:
                raise RuntimeError(f"{worker.name} failed outside of a test:\n{report}")

    def _report(self, session: pytest.Session, worker: _Worker, notice: dict[str, Any]) -> None:
        config = session.config
        report = config.hook.pytest_report_from_serializable(config=config, data=notice)
        # as pytest's terminal asks where a test ran
        report.node = SimpleNamespace(gateway=SimpleNamespace(id=worker.name), _workerinfocache=f"[{worker.name}]")
        config.hook.pytest_runtest_logreport(report=report)

    def _end(self, session: pytest.Session, worker: _Worker) -> None:
        _, status = os.waitpid(worker.pid, 0)
        self._workers.remove(worker)
        worker.line.close()
        if not worker.group:
            return
        lost, *rest = worker.group
        why = f"{worker.name} ended with status {os.waitstatus_to_exitcode(status)} during this test"
        session.config.hook.pytest_runtest_logreport(
            report=pytest.TestReport(lost.nodeid, lost.location, {}, "failed", why, "call")
        )
        self._groups[:0] = [group for group in (rest, worker.following) if group]
        self._begin(session)


def _needs_browser(group: Group) -> bool:
    return bool(group) and group[0].get_closest_marker("browser") is not None


class _Sender:
    """Passes on what is reported in a worker."""

    def __init__(self, config: pytest.Config, send: Callable[[object], None]) -> None:
        self._config = config
        self._send = send

    @pytest.hookimpl(trylast=True)
    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        data = self._config.hook.pytest_report_to_serializable(config=self._config, report=report)
        self._send(("report", data))


def _work(session: pytest.Session, name: str, line: Connection, group: Group) -> NoReturn:
    """Run what the distributing process gives, until it gives nothing; ends the process."""
    config = session.config
    status = 0
    try:
        config.pluginmanager.unregister(name="terminalreporter")
        config.pluginmanager.register(_Sender(config, line.send), "sender")
        capture: Any = config.pluginmanager.get_plugin("capturemanager")
        capture.stop_global_capturing()  # its files are those of all workers
        capture.start_global_capturing()
        capture.suspend_global_capture()
        config.hook.pytest_worker_begins(config=config, name=name)
        for item, following in _in_order(session, line, group):
            config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            line.send(("ended", None))
        config.hook.pytest_worker_ends(config=config)
        sys.stdout.flush()
    except BaseException:
        with suppress(OSError):
            line.send(("failed", traceback.format_exc()))
        status = 1
    os._exit(status)


def _in_order(
    session: pytest.Session, line: Connection, group: Group
) -> Iterator[tuple[pytest.Item, pytest.Item | None]]:
    """Each test with the one after it, which decides what of the fixtures stays."""
    while group:
        yield from pairwise(group)
        line.send(("next", None))
        after = [session.items[number] for number in line.recv()]
        yield group[-1], after[0] if after else None
        group = after


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--workers", type=int, default=1, help="processes that run tests")


def pytest_addhooks(pluginmanager: pytest.PytestPluginManager) -> None:
    pluginmanager.add_hookspecs(Hooks)


def pytest_configure(config: pytest.Config) -> None:
    if config.option.workers > 1 and hasattr(os, "fork"):
        config.pluginmanager.register(ForkedTests(config.option.workers), "forked_tests")
