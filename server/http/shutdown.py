"""Shutdown on SIGTERM or Ctrl-C within two seconds, without loss.

    0 s      no new connections; every browser receives a request to close
    GRACE_S  connections still open are closed: a stalled browser, a download of an hour
    CUT_S    running requests are cancelled
             all services close concurrently:
                 recording       written completely and synced to disk, until DEADLINE_S
                 others          viewers, exports, devices: abandoned after PART_S each
    then     busy threads (a zip of gigabytes, a port whose peer accepts no bytes) have LINGER_S, then the process
             exits; this is safe, because their partial output is removed at the next start
    DEADLINE_S  the process exits in any case, and names what held it: a start that hangs, a disk that does not answer

Two seconds assume a healthy disk and a processor that is not overloaded. The deadline is kept by a thread that the
system wakes at the signal (`ShutdownDeadline`), so that neither a busy event loop nor one that hangs delays it. What of
a recording is not on disk by then is lost; the file is readable at any moment.

Source: signal.set_wakeup_fd.
"""

import asyncio
import logging
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Awaitable, Collection, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

log = logging.getLogger("imuscope.ending")

GRACE_S = 0.3
CUT_S = 0.6
PART_S = 1.0
LINGER_S = 0.2
DEADLINE_S = 9.0  # precedent: container engines kill ten seconds after SIGTERM
LOG_S = 0.5

_held_by: list[str] = []
"""Names of what the end of the process waits for."""
_abandoned: list[str] = []


@contextmanager
def waiting_for(name: str) -> Iterator[None]:
    """Name what the end of the process would wait for in the meantime."""
    _held_by.append(name)
    try:
        yield
    finally:
        _held_by.remove(name)


async def close_all(saved: Awaitable[None], parts: Mapping[str, Awaitable[None]]) -> None:
    """Close everything concurrently.

    Args:
        saved: done when the recording is on disk; awaited without a limit.
        parts: all others, by their names in the log.
    """
    await asyncio.gather(
        _close("the recording", saved, None), *(_close(name, part, PART_S) for name, part in parts.items())
    )


async def close_sequentially(*parts: Awaitable[None]) -> None:
    """Close parts one after the other, for parts that depend on the next."""
    for part in parts:
        await part


async def _close(name: str, part: Awaitable[None], limit_s: float | None) -> None:
    """Await the closing of a part and log its failure, so that the others close in any case."""
    closing = asyncio.ensure_future(part)
    with waiting_for(name):
        await asyncio.wait({closing}, timeout=limit_s)
        if not closing.done():
            log.warning("%s did not close within %g s and was abandoned.", name, limit_s)
            closing.cancel()
            await asyncio.wait({closing}, timeout=LINGER_S)  # one that does not even end then is not waited for
    if not closing.done():
        _abandoned.append(name)
    elif not closing.cancelled() and (error := closing.exception()) is not None:
        log.error("%s failed to close", name, exc_info=error)


def make_executor(loop: asyncio.AbstractEventLoop) -> ThreadPoolExecutor:
    """Thread pool for the loop's `to_thread`; it can be shut down without waiting for its threads."""
    pool = ThreadPoolExecutor(thread_name_prefix="work")
    loop.set_default_executor(pool)
    return pool


class ShutdownDeadline:
    """Exit of this process DEADLINE_S after one of the signals, whatever holds it. Create it in the main thread."""

    def __init__(self, signals: Collection[int]) -> None:
        self._limit_s, self._signals = DEADLINE_S, {*signals}
        self._read, self._write = socket.socketpair()
        self._write.setblocking(False)
        signal.set_wakeup_fd(self._write.fileno(), warn_on_full_buffer=False)
        threading.Thread(target=self._watch, name="deadline", daemon=True).start()

    def _watch(self) -> None:
        while not self._signals.intersection(self._read.recv(64)):
            pass
        time.sleep(self._limit_s)  # the process ends in the meantime, and this thread with it
        logger = threading.Thread(target=self._report, daemon=True)  # the log may be what hangs
        logger.start()
        logger.join(LOG_S)
        os._exit(1)

    def _report(self) -> None:
        held = ", ".join(dict.fromkeys(reversed(_held_by))) or "nothing that has a name"
        words = "The process had not ended %g s after the signal and was ended. It waited for: %s; its main thread: %s."
        log.error(words, self._limit_s, held, _place_of_main_thread())
        logging.shutdown()


def _place_of_main_thread() -> str:
    frame = sys._current_frames().get(threading.main_thread().ident or 0)  # noqa: SLF001 - documented
    if frame is None:
        return "ended"
    return f"{Path(frame.f_code.co_filename).name}, line {frame.f_lineno}, in {frame.f_code.co_name}"


def exit_process(work: ThreadPoolExecutor) -> None:
    """Return when no thread is busy any more; exit the process if some are still busy after LINGER_S, or if a part was
    abandoned whose task does not end.
    """
    work.shutdown(wait=False, cancel_futures=True)
    if _abandoned:
        log.warning("Exited while %s did not end.", ", ".join(_abandoned))
        _exit_now(0)
    end = time.monotonic() + LINGER_S
    while busy := [one.name for one in threading.enumerate() if one is not threading.main_thread() and not one.daemon]:
        if time.monotonic() > end:
            log.warning("Exited while %d threads were still at work (%s).", len(busy), ", ".join(busy))
            _exit_now(0)
        time.sleep(0.01)


def _exit_now(status: int) -> NoReturn:
    logging.shutdown()
    sys.stdout.flush()
    os._exit(status)
