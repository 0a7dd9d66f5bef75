"""Running the parts of the check: each a process whose output is passed on, timed, and ended if it goes silent."""

from __future__ import annotations

import argparse
import codecs
import os
import re
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from tests.support.source_files import ROOT

SILENT_S = 300.0  # a part that prints nothing for so long hangs; a test that hangs is reported (hang_report.py)

LAST_LINES = 40  # that the report repeats

ABORT_S = 5.0  # to print that
INHERITED: tuple[int, ...] = ()  # descriptors of this process that parts keep


@dataclass(frozen=True)
class Part:
    """One runner."""

    name: str
    command: Callable[[argparse.Namespace], list[str]]
    closing: str = ""  # pattern of the start of the line with the result; "" for the last line
    alone: Callable[[argparse.Namespace], list[str]] | None = None  # repeats the tests that failed beside other work
    lane: str = "narrow"  # parts of one lane run one after the other
    folder: Path = ROOT  # where it runs


@dataclass(frozen=True)
class Outcome:
    """Result of one part."""

    name: str
    status: int
    seconds: float  # that passed
    processor: float  # seconds of a processor
    closing: str
    failed: tuple[str, ...] = ()  # names of tests
    last_lines: tuple[str, ...] = ()  # of a narrow part that failed: often only the end of a log is kept


def run(part: Part, command: list[str], env: dict[str, str]) -> Outcome:
    """Pass its output on immediately; that of a narrow part after its end, and only if it failed."""
    title = f"\n── {part.name} {'─' * (76 - len(part.name))}\n"
    is_wide = part.lane == "wide"
    held: list[str] = []
    send = (lambda text: print(text, end="", flush=True)) if is_wide else held.append
    send(title)
    began = time.monotonic()
    lines: list[str] = []
    process = subprocess.Popen(
        command,
        cwd=part.folder,
        env=env,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        pass_fds=INHERITED,
    )
    assert process.stdout
    watch = _SilenceWatch(process)
    decoder, rest = codecs.getincrementaldecoder("utf-8")("replace"), ""
    while data := os.read(process.stdout.fileno(), 1 << 16):  # not by lines: a test prints a dot
        watch.printed()
        text = decoder.decode(data)
        send(text)
        *whole, rest = (rest + text).split("\n")
        lines += [line.strip() for line in whole if line.strip()]
    lines += [rest.strip()] if rest.strip() else []
    process.stdout.close()
    _, waited, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(waited)
    if watch.end():
        lines.append(f"nothing printed for {SILENT_S:.0f} s: ended; above is what each test was doing")
        send(f"{lines[-1]}\n")
    if not is_wide:
        shown = "".join(held) if process.returncode or not lines else f"{title}{lines[-1]}\n"
        print(shown, end="", flush=True)
    closing = [line for line in lines if re.match(part.closing, line)] or lines
    closing = closing or [f"exit status {process.returncode}" if process.returncode else "no complaint"]
    failed = tuple(hit[2] for line in lines if (hit := re.match(r"(FAILED|ERROR) (\S.*?)(?: - .*)?$", line)))
    seconds, processor = time.monotonic() - began, usage.ru_utime + usage.ru_stime
    end = tuple(lines[-LAST_LINES:]) if process.returncode and not is_wide else ()
    return Outcome(part.name, process.returncode, seconds, processor, closing[-1], failed if is_wide else (), end)


class _SilenceWatch:
    """Ends a process, and what it began, that prints nothing any more."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._process = process
        self._ended = threading.Event()
        self._last = time.monotonic()
        self._is_killed = False
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def printed(self) -> None:
        self._last = time.monotonic()

    def _watch(self) -> None:
        while not self._ended.wait(1.0):
            if time.monotonic() - self._last > SILENT_S:
                self._is_killed = True
                os.killpg(self._process.pid, signal.SIGABRT)  # pytest's processes print where they stand
                self._ended.wait(ABORT_S)
                with suppress(ProcessLookupError):
                    os.killpg(self._process.pid, signal.SIGKILL)
                return

    def end(self) -> bool:
        """Whether it had to end the process."""
        self._ended.set()
        self._thread.join()
        return self._is_killed
