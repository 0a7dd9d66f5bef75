"""`python -m tests.fault_injection.watched_server WORDS`: `imuscope WORDS`, which counts what holds its event loop.

A beat every BEAT_S reads the processor time of the process. What it used between two beats held the loop: a callback of
its own, or a thread that kept the interpreter to itself. Time that other processes take is not counted. SIGUSR1 starts
the count anew; the longest is printed at the end.
"""

import asyncio
import signal
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from imuscope.server.cli import main
from imuscope.server.services.services import Services

BEAT_S = 0.005
_running = Services.running
_longest_s = 0.0


async def _watch() -> None:
    global _longest_s
    before = time.process_time()
    while True:
        await asyncio.sleep(BEAT_S)
        now = time.process_time()
        _longest_s = max(_longest_s, now - before)
        before = now


def _restart(*_: object) -> None:
    global _longest_s
    _longest_s = 0.0


@asynccontextmanager
async def _watched(services: Services) -> AsyncIterator[None]:
    async with _running(services):
        signal.signal(signal.SIGUSR1, _restart)
        watching = asyncio.create_task(_watch())
        try:
            yield
        finally:
            watching.cancel()
            print(f"held at most {_longest_s * 1e3:.1f} ms", flush=True)


if __name__ == "__main__":
    Services.running = _watched  # type: ignore[method-assign, assignment]
    raise SystemExit(main())
