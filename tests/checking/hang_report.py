"""pytest plugin: a test that runs for long says which it is, and where each of its threads stands.

The report comes every 50 s: on a busy machine a test may take that long and be well. After ten minutes the worker ends,
which fails the test, and another one goes on; by hand, where a person may be debugging, nothing ends. pytest's own
report (faulthandler_timeout) is made without the lock of the interpreter, and has crashed a process that was only slow.
"""

import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator

import pytest

from tests.checking import machine
from tests.support import each_row

LONG_S = 50.0
MOST_REPORTS = 12  # until the process ends


class HangReport:
    """Watches the test that runs in this process.

    Args:
        descriptor: of the file to write to, which is not the one that a test's output is captured from.
        give_up: called when a test hangs.
        long_s: between two reports.
    """

    def __init__(self, descriptor: int, give_up: Callable[[], object], *, long_s: float = LONG_S) -> None:
        self._descriptor = descriptor
        self._give_up = give_up
        self._long_s = long_s
        self._begun = threading.Condition()
        self._test = ""
        self._is_over = False
        self._thread = threading.Thread(target=self._watch, name="hang report", daemon=True)
        self._thread.start()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self._begin(item.nodeid)
        try:
            return (yield)
        finally:
            self._begin("")

    def _begin(self, test: str) -> None:
        with self._begun:
            self._test = test
            self._begun.notify()

    def close(self) -> None:
        """End the thread."""
        with self._begun:
            self._is_over = True
            self._begun.notify()
        self._thread.join()
        os.close(self._descriptor)

    def _watch(self) -> None:
        reports = 0
        with self._begun:
            while not self._is_over:
                if self._begun.wait(self._long_s):
                    reports = 0
                elif self._test:
                    reports += 1
                    os.write(self._descriptor, self._report(reports * self._long_s).encode())
                    if reports == MOST_REPORTS:
                        self._give_up()

    def _report(self, seconds: float) -> str:
        names = {thread.ident: thread.name for thread in threading.enumerate()}
        row = f", row {each_row.current}" if each_row.current else ""
        lines = [f"\n{self._test}{row} has been running for {seconds:.0f} s and more:\n"]
        for ident, frame in sys._current_frames().items():
            if ident != self._thread.ident:
                lines += [f"thread {names.get(ident, ident)}:\n", *traceback.format_stack(frame)[-MOST_FRAMES:]]
        return "".join([*lines, machine.state(), "\n"])


MOST_FRAMES = 12  # of each thread, the innermost


def pytest_configure(config: pytest.Config) -> None:
    if config.option.workers == 1:
        _register(config, lambda: None)


@pytest.hookimpl(optionalhook=True)
def pytest_worker_begins(config: pytest.Config) -> None:
    _register(config, lambda: os.kill(os.getpid(), signal.SIGKILL))  # a thread is not forked


def _register(config: pytest.Config, give_up: Callable[[], object]) -> None:
    report = HangReport(os.dup(2), give_up)
    config.pluginmanager.register(report, "hang_report_watch")
    config.add_cleanup(report.close)
