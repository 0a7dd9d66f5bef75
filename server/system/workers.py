"""Worker process: runs one of our modules in a subprocess, so that live devices are not slowed down.

    start ──> request: one JSON object on its standard input ──> messages, one JSON object per line ──> wait
                                                                                    or ──> end, at any time

It lowers its own priority, and ends when the server is killed (recordings/system/parent_death.py). A worker that has
arguments reads no standard input. Its standard error goes to that of the server.
"""

import asyncio
import contextlib
import json
import sys
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Self

from imuscope.recordings.errors import RecordingError

ROOT = Path(__file__).absolute().parents[3]  # holds imuscope/
MAX_LINE = 1024 * 1024


class Worker:
    """A worker process, running or ended, created by `start`; iterate over it for its messages.

    Attributes:
        create_process: `asyncio.create_subprocess_exec`; tests have processes forked instead.
    """

    create_process: ClassVar[Callable[..., Awaitable[Any]]] = staticmethod(asyncio.create_subprocess_exec)

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process
        self.pid = process.pid

    @classmethod
    async def start(
        cls, module: str, *arguments: str, capture_stderr: bool = False, control: int | None = None
    ) -> Self:
        """Start `python -m module ARGUMENTS`.

        Args:
            capture_stderr: whether standard error is read through `errors`.
            control: descriptor of a socket that becomes its standard input; it takes no request.

        Raises:
            OSError: the process cannot be created.
        """
        process = await cls.create_process(
            *(sys.executable, "-m", module, *arguments),
            cwd=ROOT,
            stdin=_standard_input(arguments, control),
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE if capture_stderr else None,
            limit=MAX_LINE,
        )
        return cls(process)

    @property
    def is_running(self) -> bool:
        return self._process.returncode is None

    def request(self, body: Mapping[str, Any]) -> None:
        """Send the request; call it once."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(body).encode())
        self._process.stdin.close()

    async def write(self, data: bytes) -> None:
        """Write bytes to its standard input, waiting if it is slow. ConnectionError: the process has ended."""
        assert self._process.stdin is not None
        self._process.stdin.write(data)
        await self._process.stdin.drain()

    @property
    def output(self) -> asyncio.StreamReader:
        """Its standard output as bytes, instead of messages."""
        assert self._process.stdout is not None
        return self._process.stdout

    @property
    def errors(self) -> asyncio.StreamReader:
        """Its standard error, if started with `capture_stderr`."""
        assert self._process.stderr is not None
        return self._process.stderr

    def dismiss(self) -> None:
        """Close its standard input, which ends a worker that waits for a request or reads its data there."""
        if self._process.stdin is not None:
            self._process.stdin.close()

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> dict[str, Any]:
        """Return the next message; discards a line cut off by a kill.

        Raises:
            RecordingError: the worker reported a failure, with message and hint.
        """
        line = await self.output.readline()
        if not line.endswith(b"\n"):
            raise StopAsyncIteration
        message: dict[str, Any] = json.loads(line)
        if "message" in message and "hint" in message:
            raise RecordingError(message["message"], message["hint"])
        return message

    async def wait(self) -> int:
        """Wait for its end; returns the exit status."""
        return await self._process.wait()

    async def end(self, patience_s: float = 0.0) -> None:
        """Terminate it if it still runs, and wait for its end.

        Args:
            patience_s: time to clean up; 0: killed at once.
        """
        with contextlib.suppress(ProcessLookupError):
            if self.is_running and patience_s > 0:
                self._process.terminate()
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(patience_s):
                        await self._process.wait()
            if self.is_running:
                self._process.kill()
        await self._process.wait()


def _standard_input(arguments: tuple[str, ...], control: int | None) -> int:
    if control is not None:
        return control
    return asyncio.subprocess.DEVNULL if arguments else asyncio.subprocess.PIPE
