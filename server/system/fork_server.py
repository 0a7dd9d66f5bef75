"""Fork server: runs each job in a process of its own, which is there within milliseconds.

    ForkServer ── control: one descriptor per job ──> `python -m MODULE`, which has imported what its jobs need
        │                                                 │ fork
        └── a socket per job:  job ──>  <── answer ── child: within its limits, killed when the socket is closed

To start an interpreter that imports numpy and scipy takes a second of a core, to fork one that has them 5 ms. The
process has one thread and no work of its own, so it is safe to fork; it starts with the first job and ends after IDLE_S
without one, unless it is kept. A job is a picklable object; its arrays cross the socket as they are (pickle protocol 5,
out of band).

    control  READY from the process, then a byte with a descriptor for each job
    job      u32 number of buffers + 1, u64 size of each, pickle, buffers
    answer   one line of JSON with `length`, then so many bytes; or, if `length` is null, pieces: u32 size, so many
             bytes; after one of size 0 comes a line of JSON

Both ends belong to one program of one user, so a job may be a pickle; the answer, which comes from a process that has
read what others wrote, is not.

Source: PEP 574; fcntl(2), F_SETOWN and O_ASYNC; unix(7), SCM_RIGHTS.
"""

import asyncio
import contextlib
import fcntl
import gc
import json
import os
import pickle
import select
import signal
import socket
import struct
import sys
import traceback
from collections.abc import AsyncGenerator, AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from imuscope.recordings.system.parent_death import die_with_parent
from imuscope.server.system.workers import Worker

IDLE_S = 300.0
MAX_LINE = 1 << 20
STANDARD_INPUT, STANDARD_OUTPUT, STANDARD_ERROR = range(3)
READY = b"r"
FIRST_TO_BE_KILLED = "1000"  # oom_score_adj, proc(5): where memory runs out, a job ends and not what records


class JobAnswer(NamedTuple):
    """Answer of a job: facts for the line of JSON, and bytes; or a function that writes pieces and returns facts."""

    facts: Mapping[str, Any]
    body: bytes | Callable[[Callable[[bytes], None]], Mapping[str, Any]]


Answerer = Callable[[Callable[[], Any]], JobAnswer]
"""Answers a job, which it gets from what it is given: to read it may exceed a limit, too."""


class JobLostError(Exception):
    """The process of a job ended without an answer."""


class ForkServer:
    """Client of a fork server; the process starts with the first job.

    Args:
        module: runs `serve`.
        arguments: of its command line.
        idle_s: the process ends after this time without a job.
    """

    def __init__(self, module: str, *arguments: str, idle_s: float = IDLE_S) -> None:
        self._module, self._arguments, self._idle_s = module, arguments, idle_s
        self._worker: Worker | None = None
        self._control: socket.socket | None = None
        self._starting = asyncio.Lock()
        self._running = 0
        self._ending: asyncio.Future[int] | None = None
        self._idle_end: asyncio.TimerHandle | None = None
        self._is_closed = False
        self.is_kept: Callable[[], bool] = lambda: False  # whether it stays, though no job has come for long

    @property
    def pid(self) -> int | None:
        """Its process; None if it does not run."""
        return None if self._worker is None else self._worker.pid

    async def run(self, job: object) -> tuple[Mapping[str, Any], bytes]:
        """The facts and the bytes of a job's answer. Its process ends when this is cancelled.

        Raises:
            JobLostError: the process ended without an answer.
            OSError: the fork server cannot be started.
        """
        async with self._answering(job) as (facts, reader):
            return facts, await reader.readexactly(facts["length"])

    async def stream(self, job: object) -> AsyncGenerator[bytes | Mapping[str, Any]]:
        """The pieces of a job's answer, then its facts. Its process ends when this is closed.

        Raises:
            JobLostError: the process ended before the facts.
            OSError: the fork server cannot be started.
        """
        async with self._answering(job) as (facts, reader):
            if facts["length"] is not None:
                yield facts
                return
            while size := int.from_bytes(await reader.readexactly(4), "little"):
                yield await reader.readexactly(size)
            yield json.loads(await reader.readline())

    @asynccontextmanager
    async def _answering(self, job: object) -> AsyncIterator[tuple[dict[str, Any], asyncio.StreamReader]]:
        async with self._connected() as line:
            with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # then it has an answer, or is lost
                await _send(line, job)
            reader, writer = await asyncio.open_connection(sock=line, limit=MAX_LINE)
            try:
                yield json.loads(await reader.readline()), reader
            except (ValueError, asyncio.IncompleteReadError, ConnectionResetError):
                raise JobLostError from None
            finally:
                writer.close()

    async def prepare(self) -> None:
        """Start the process in advance, unless it runs."""
        async with self._starting:
            if self._worker is None or not self._worker.is_running:
                await self._start()
        self._wait_for_jobs()

    async def close(self) -> None:
        """End the process; its jobs end with it."""
        self._is_closed = True
        if self._idle_end is not None:
            self._idle_end.cancel()
        if self._worker is not None:
            await self._worker.end()  # it may be starting, for which `_starting` is held
        async with self._starting:
            await self._end()

    @asynccontextmanager
    async def _connected(self) -> AsyncIterator[socket.socket]:
        """A socket to a new child."""
        ours, theirs = socket.socketpair()
        with ours:
            ours.setblocking(False)
            with theirs:
                self._running += 1
                try:
                    await self._hand_over(theirs)
                except BaseException:
                    self._running -= 1
                    raise
            try:
                yield ours
            finally:
                self._running -= 1
                self._wait_for_jobs()

    async def _hand_over(self, line: socket.socket) -> None:
        async with self._starting:
            if self._idle_end is not None:
                self._idle_end.cancel()
            if self._worker is None or not self._worker.is_running:
                await self._start()
            assert self._control is not None
            try:
                socket.send_fds(self._control, [b"."], [line.fileno()])
            except (BrokenPipeError, ConnectionResetError):  # it was killed just now
                await self._start()
                socket.send_fds(self._control, [b"."], [line.fileno()])

    async def _start(self) -> None:
        await self._end()
        if self._is_closed:
            raise ConnectionAbortedError("the server is shutting down")
        ours, theirs = socket.socketpair()
        ours.setblocking(False)
        with theirs:
            try:
                self._worker = await Worker.start(self._module, *self._arguments, control=theirs.fileno())
            except BaseException:
                ours.close()
                raise
        self._control = ours
        if await asyncio.get_running_loop().sock_recv(ours, 1) != READY:
            await self._end()
            raise ConnectionAbortedError("it ended while it started")

    async def _end(self) -> None:
        control, self._control = self._control, None
        worker, self._worker = self._worker, None
        if control is not None:
            control.close()
        if worker is not None:
            await worker.end()

    def _wait_for_jobs(self) -> None:
        if self._idle_end is not None:
            self._idle_end.cancel()
        if not self._running and not self._is_closed:
            self._idle_end = asyncio.get_running_loop().call_later(self._idle_s, self._dismiss)

    def _dismiss(self) -> None:
        """End it by closing its control socket; `_start` reaps its remains."""
        if self.is_kept():
            self._wait_for_jobs()
            return
        if not self._running and self._control is not None and not self._starting.locked():
            self._control.close()
            self._control, worker, self._worker = None, self._worker, None
            if worker is not None:
                self._ending = asyncio.ensure_future(worker.wait())


async def _send(line: socket.socket, job: object) -> None:
    buffers: list[pickle.PickleBuffer] = []
    head = pickle.dumps(job, protocol=5, buffer_callback=buffers.append)
    parts = [memoryview(head), *(one.raw() for one in buffers)]
    sizes = struct.pack(f"<I{len(parts)}Q", len(parts), *(one.nbytes for one in parts))
    loop = asyncio.get_running_loop()
    for part in (memoryview(sizes), *parts):
        await loop.sock_sendall(line, part)


# -- in the process that forks, and in its children --------------------------------------------------------------------


def serve(limit: Callable[[], None], answer: Answerer) -> None:
    """Fork a child for each descriptor that standard input, a socket, brings, until that is closed.

    Args:
        limit: limits the resources of a child.
        answer: takes what reads the job; an exception ends the child without an answer.
    """
    die_with_parent()
    os.dup2(STANDARD_ERROR, STANDARD_OUTPUT)  # which has no reader
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # children leave nothing behind
    gc.collect()
    gc.freeze()  # a collection would copy the memory of all objects in every child
    with socket.socket(fileno=os.dup(STANDARD_INPUT)) as control:
        control.sendall(READY)
        while True:
            try:
                word, descriptors, _, _ = socket.recv_fds(control, 1, 1)
            except OSError:
                word, descriptors = b"", []
            if not word:
                return
            for descriptor in descriptors:
                with socket.socket(fileno=descriptor) as line:
                    if _fork() == 0:
                        control.close()
                        _run_child(line, limit, answer)


def _run_child(line: socket.socket, limit: Callable[[], None], answer: Answerer) -> NoReturn:
    """Answer one job and end, without the cleaning up that would copy the memory of all modules."""
    status = 1
    try:
        with Path(os.devnull).open("rb") as nothing:
            os.dup2(nothing.fileno(), STANDARD_INPUT)
        limit()
        _answer_one(line, answer)
        status = 0
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(status)


def _fork() -> int:
    """As os.fork; -1 if the system has no process left: then the socket is closed unanswered."""
    parent = os.getpid()
    try:
        pid = os.fork()
    except OSError:
        return -1
    if pid == 0:
        die_with_parent()
        if os.getppid() != parent:
            os._exit(1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        with contextlib.suppress(OSError):
            Path("/proc/self/oom_score_adj").write_text(FIRST_TO_BE_KILLED)
    return pid


def _answer_one(line: socket.socket, answer: Answerer) -> None:
    def job() -> Any:
        request = _received(line)
        _end_with(line)
        return request

    facts, body = answer(job)
    fcntl.fcntl(line, fcntl.F_SETFL, fcntl.fcntl(line, fcntl.F_GETFL) & ~os.O_ASYNC)  # room to write is a signal, too
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):
        length = len(body) if isinstance(body, bytes) else None
        line.sendall(json.dumps({**facts, "length": length}).encode() + b"\n")
        if isinstance(body, bytes):
            line.sendall(body)
        else:
            last = body(lambda piece: line.sendall(len(piece).to_bytes(4, "little") + piece))
            line.sendall(bytes(4) + json.dumps(last).encode() + b"\n")


def _received(line: socket.socket) -> Any:
    [count] = struct.unpack("<I", _read(line, 4))
    sizes = struct.unpack(f"<{count}Q", _read(line, 8 * count))
    head, *buffers = [_read(line, size) for size in sizes]
    return pickle.loads(head, buffers=buffers)


def _read(line: socket.socket, size: int) -> bytearray:
    buffer = bytearray(size)
    left = memoryview(buffer)
    while left:
        count = line.recv_into(left)
        if not count:
            os._exit(0)  # the client disconnected
        left = left[count:]
    return buffer


def _end_with(line: socket.socket) -> None:
    """Let the system kill this process, whatever it does, when the other end closes the socket."""
    if sys.platform != "linux":  # where the signal is ignored otherwise
        signal.signal(signal.SIGIO, lambda *_: os._exit(1))
    fcntl.fcntl(line, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(line, fcntl.F_SETFL, fcntl.fcntl(line, fcntl.F_GETFL) | os.O_ASYNC)
    if select.select([line], [], [], 0)[0]:  # it was closed before
        os._exit(0)
