"""A worker process: one of our modules, run aside for the library, so that live devices do not feel what it does.

    start ──> ask: a wish, one JSON object on its standard input ──> what it tells, a JSON line at a time ──> wait
                                                                                          or ──> end, at any moment

It lowers its own priority, and ends when the server is killed (recordings/parent_death.py). One that is given words on
its command line reads no standard input. What it writes to standard error goes into the server's.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

from recordings.mcap_writer import RecordingError

ROOT = Path(__file__).resolve().parents[2]


class Worker:
    """A process that runs, or ran; iterate over it for what it tells. Made by `start`."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process

    @classmethod
    async def start(cls, module: str, *words: str) -> Self:
        """Begin `python -m module words…`.

        Raises:
            OSError: the system gives no process.
        """
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", module, *words),
            cwd=ROOT,
            stdin=asyncio.subprocess.DEVNULL if words else asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
        )
        return cls(process)

    @property
    def is_running(self) -> bool:
        return self._process.returncode is None

    def ask(self, wish: Mapping[str, Any]) -> None:
        """Tell it what to do; once."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(wish).encode())
        self._process.stdin.close()

    def dismiss(self) -> None:
        """Let one go that was never asked: it ends by itself."""
        if self._process.stdin is not None:
            self._process.stdin.close()

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> dict[str, Any]:
        """What it tells next; a line that it was killed in the middle of is not told.

        Raises:
            RecordingError: what it tells is a message and a hint: it cannot do it.
        """
        assert self._process.stdout is not None
        line = await self._process.stdout.readline()
        if not line.endswith(b"\n"):
            raise StopAsyncIteration
        told: dict[str, Any] = json.loads(line)
        if "message" in told and "hint" in told:
            raise RecordingError(told["message"], told["hint"])
        return told

    async def wait(self) -> int:
        """Its exit status, as soon as it has ended."""
        return await self._process.wait()

    async def end(self, patience_s: float = 0.0) -> None:
        """End it if it still runs, and wait until it is gone.

        Args:
            patience_s: how long it may take to clean up after itself; 0: it is killed at once.
        """
        with contextlib.suppress(ProcessLookupError):
            if self.is_running and patience_s > 0:
                self._process.terminate()
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._process.wait(), patience_s)
            if self.is_running:
                self._process.kill()
        await self._process.wait()
