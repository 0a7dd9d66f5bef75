"""Shutdown on SIGTERM or Ctrl-C within two seconds, without loss.

    0 s      no new connections; every browser is asked to close
    GRACE_S  connections still open are closed: a stalled browser, a download of an hour
    CUT_S    running requests are cancelled
             all services close concurrently:
                 recording       written completely and synced to disk, without a time limit
                 others          viewers, exports, devices: abandoned after PART_S each
    then     busy threads (a zip of gigabytes, a port whose peer accepts no bytes) have LINGER_S, then the process
             exits; this is safe, because their partial output is removed at the next start

Two seconds assume a healthy disk and a processor that is not overloaded.
"""

from __future__ import annotations

import asyncio
import logging
import os
import sys
import threading
import time
from collections.abc import Awaitable, Mapping
from concurrent.futures import ThreadPoolExecutor

log = logging.getLogger("imuscope.ending")

GRACE_S = 0.3
CUT_S = 0.6
PART_S = 1.0
LINGER_S = 0.2


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
    try:
        async with asyncio.timeout(limit_s):
            await part
    except TimeoutError:
        log.warning("%s did not close within %g s and was abandoned.", name, PART_S)
    except Exception:
        log.exception("%s failed to close", name)


def make_executor(loop: asyncio.AbstractEventLoop) -> ThreadPoolExecutor:
    """Thread pool for the loop's `to_thread`; it can be shut down without waiting for its threads."""
    pool = ThreadPoolExecutor(thread_name_prefix="work")
    loop.set_default_executor(pool)
    return pool


def exit_process(work: ThreadPoolExecutor, status: int = 0) -> None:
    """Return when no thread is busy any more; exit the process if some are still busy after LINGER_S."""
    work.shutdown(wait=False, cancel_futures=True)
    end = time.monotonic() + LINGER_S
    while busy := [one.name for one in threading.enumerate() if one is not threading.main_thread() and not one.daemon]:
        if time.monotonic() > end:
            log.warning("Exited while %d threads were still at work (%s).", len(busy), ", ".join(busy))
            logging.shutdown()
            sys.stdout.flush()
            os._exit(status)
        time.sleep(0.01)
