"""Worker processes of servers (server/system/workers.py), forked by the nursery of the tests instead of started.

Such a process takes a second to import what it needs, and works for some hundredths of one. Every server of the tests
gets its workers so: one in the test's process, and one that the nursery forked. Modules that the nursery does not know,
and servers that are started afresh, start interpreters.
"""

from __future__ import annotations

import asyncio
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from imuscope.server.system.workers import Worker
from tests.support.forking.fork_server import Child, ForkServer
from tests.support.forking.nursery_modules import HEAVY, WORKERS, worker_name

_start = Worker.create_process


class ForkedProcess:
    """As much of `asyncio.subprocess.Process` as `Worker` uses."""

    def __init__(self, child: Child) -> None:
        self.pid = child.pid
        self.stdin: asyncio.StreamWriter | None = None
        self.stdout: asyncio.StreamReader | None = None
        self.stderr: asyncio.StreamReader | None = None
        self._child = child
        self._has_ended = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._descriptor = child.fileno()
        self._loop.add_reader(self._descriptor, self._end)

    def terminate(self) -> None:
        self._child.terminate()
        self._check()

    def kill(self) -> None:
        self._child.kill()
        self._check()

    def _check(self) -> None:
        """What is sent a signal may be found to have ended, which is told once only."""
        if self._child.returncode is not None and not self._has_ended.is_set():
            self._end()

    def _end(self) -> None:
        self._loop.remove_reader(self._descriptor)
        self._child.wait(0)
        self._has_ended.set()

    @property
    def returncode(self) -> int | None:
        return self._child.returncode

    async def wait(self) -> int:
        await self._has_ended.wait()
        return self._child.wait(0)


def install(nursery: ForkServer) -> None:
    """Have the workers of this process forked by `nursery`."""

    async def create(python: str, flag: str, module: str, *words: str, **streams: Any) -> Any:
        if module not in WORKERS and module not in HEAVY:
            return await _start(python, flag, module, *words, **streams)
        return await _forked(nursery, module, words, **streams)

    Worker.create_process = staticmethod(create)


def workers_of(server: int, module: str) -> list[int]:
    """Processes that run a module for a server, forked or started, by their parent and their name."""
    results = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            line, command = stat.read_text(), (stat.parent / "cmdline").read_text()
        except OSError:
            continue  # gone meanwhile
        name, _, rest = line.partition("(")[2].rpartition(")")
        state, parent = rest.split()[:2]
        started = int(parent) == server and module in command.split("\0")
        if state != "Z" and (started or name == worker_name(module, server)):
            results.append(int(stat.parent.name))
    return results


@contextmanager
def started_afresh() -> Iterator[None]:
    """Within it workers are interpreters of their own, as for users."""
    before = Worker.create_process
    Worker.create_process = staticmethod(_start)
    try:
        yield
    finally:
        Worker.create_process = staticmethod(before)


async def _forked(
    nursery: ForkServer,
    module: str,
    words: tuple[str, ...],
    *,
    stdin: int,
    stdout: int,
    stderr: int | None,
    **more: Any,
) -> ForkedProcess:
    assert stdout == subprocess.PIPE
    loop = asyncio.get_running_loop()
    theirs, ours = [], []
    for is_piped, is_read in ((stdin == subprocess.PIPE, False), (True, True), (stderr == subprocess.PIPE, True)):
        if is_piped:
            read, written = os.pipe()
            ours.append(read if is_read else written)
            theirs.append(written if is_read else read)
        else:
            ours.append(-1)
            theirs.append(os.dup(2) if is_read else os.dup(stdin) if stdin >= 0 else os.open(os.devnull, os.O_RDONLY))
    starting = asyncio.ensure_future(asyncio.to_thread(nursery.start, words, *theirs, module=module))
    try:
        child = await asyncio.shield(starting)
    except asyncio.CancelledError:  # the first of its kind is imported for a second: nobody waits for it any more
        child = await starting
        child.kill()
        await asyncio.to_thread(child.wait)
        for one in ours:
            if one >= 0:
                os.close(one)
        raise
    finally:
        for one in theirs:
            os.close(one)
    process = ForkedProcess(child)
    if ours[0] >= 0:
        transport, protocol = await loop.connect_write_pipe(asyncio.streams.FlowControlMixin, os.fdopen(ours[0], "wb"))
        process.stdin = asyncio.StreamWriter(transport, protocol, None, loop)
    process.stdout = await _reader(ours[1], more["limit"])
    if ours[2] >= 0:
        process.stderr = await _reader(ours[2], more["limit"])
    return process


async def _reader(descriptor: int, limit: int) -> asyncio.StreamReader:
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader(limit=limit, loop=loop)
    protocol = asyncio.StreamReaderProtocol(reader, loop=loop)
    await loop.connect_read_pipe(lambda: protocol, os.fdopen(descriptor, "rb"))
    return reader
