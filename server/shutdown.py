"""How does the server end within two seconds of being asked to, with nothing lost? (SIGTERM, Ctrl-C)

    0 s      no new connections; every browser is told to close
    GRACE_S  who has not closed by then is cut off: a browser that takes nothing, a download of an hour
    CUT_S    requests that still run are cancelled
             everything of the server ends at once, not in turn:
                 the recording   is written to its end and forced to disk: waited for, however long it takes
                 all else        views, exports, devices: each has PART_S, and is left behind if it needs longer
    then     threads that are still at work (a zip of gigabytes, a port whose other side takes no bytes) have LINGER_S;
             the process ends over them, which harms nothing: what they make is swept at the next start

The two seconds are those of a healthy disk and a processor that is to be had.
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
    """Close everything beside each other.

    Args:
        saved: done when what was recorded is on disk; waited for without a limit.
        parts: all else, each with what it is called in the log.
    """
    await asyncio.gather(
        _told("the recording", saved, None), *(_told(name, part, PART_S) for name, part in parts.items())
    )


async def close_sequentially(*parts: Awaitable[None]) -> None:
    """One after the other, for parts of which one needs the next."""
    for part in parts:
        await part


async def _told(name: str, part: Awaitable[None], limit_s: float | None) -> None:
    """A fault of one part must keep no other from ending."""
    try:
        await asyncio.wait_for(part, limit_s)
    except TimeoutError:
        log.warning("%s did not end within %g s and was left behind.", name, PART_S)
    except Exception:
        log.exception("%s did not end as it should", name)


def make_executor(loop: asyncio.AbstractEventLoop) -> ThreadPoolExecutor:
    """Threads for a loop's `to_thread`, which can be told to finish without being waited for."""
    found = ThreadPoolExecutor(thread_name_prefix="work")
    loop.set_default_executor(found)
    return found


def exit_process(work: ThreadPoolExecutor, status: int = 0) -> None:
    """Return when no thread is at work any more; end the process over those that are."""
    work.shutdown(wait=False, cancel_futures=True)
    end = time.monotonic() + LINGER_S
    while busy := [one.name for one in threading.enumerate() if one is not threading.main_thread() and not one.daemon]:
        if time.monotonic() > end:
            log.warning("Ended while %d threads were still at work (%s).", len(busy), ", ".join(busy))
            logging.shutdown()
            sys.stdout.flush()
            os._exit(status)
        time.sleep(0.01)
