"""Viewers in a subprocess, fed with samples: a process that is a client of the wire.

    ClientFanout ──> SendQueue ──> stdin of the process:   u32 size (little-endian) │ u8 kind │ body
                                               sort 0: a text frame of server/wire/
                                               sort 1: sample frames of server/wire/
                                               sort 2: JSON from the server's side of the view
    server's side of the view <── stdout:      JSON lines

So it receives the messages of a browser, and the same rules apply: data that it does not accept waits in its own send
queue, where the oldest samples are dropped; it cannot slow a device. Samples are sent `FRAMES_PER_S` times at most,
regardless of the device's rate: a viewer does not draw more often, and one with playout needs less. They are not
decoded more often either, because decoding 125 times a second, as for a browser, would cost more than all the rest.

Messages on its standard output, besides those of its view:

    {"op": "subscribe", "channels": [ids], "past": [ids], "history": s}     past: channels with history

A process that ends before it was stopped has crashed: `on_crash` is called. Restarting it is up to the view; one that
runs as long as the server is a KeptProcess.
"""

import asyncio
import contextlib
import json
import logging
import math
import struct
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from imuscope.server import wire
from imuscope.server.concurrency.backoff import Backoff
from imuscope.server.concurrency.heartbeat import UNWATCHED_S
from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.errors import DomainError
from imuscope.server.streaming.clients import ClientFanout
from imuscope.server.streaming.send_queue import SendQueue
from imuscope.server.system.workers import Worker

HEAD = struct.Struct("<IB")
TEXT, SAMPLES, OURS = 0, 1, 2
FRAMES_PER_S = 60.0
INTERVAL_SHARE = 0.95  # samples are decoded a little sooner than sent, so that some are always available
STOP_S = 0.8  # from the end of its input until it is killed; it has no data that could be lost
LAST_LINES = 6  # lines of its standard error that are reported after a crash

log = logging.getLogger("imuscope.views")


class ViewError(DomainError):
    """A viewer that is not running."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__("no-view", message, hint)


class ViewerProcess:
    """One process that receives the same data as a browser.

    Args:
        module: module to run, as `python -m module`.
        on_message: called with each line of its output, as an object.
        on_crash: called with its last output if it ended by itself.
        per_s: maximum rate at which samples are sent.
        draws: whether it only draws, so that it gets them later while decoding is behind.
    """

    def __init__(
        self,
        clients: ClientFanout,
        module: str,
        on_message: Callable[[Mapping[str, Any]], None],
        on_crash: Callable[[str], None],
        per_s: float = FRAMES_PER_S,
        *,
        draws: bool = True,
    ) -> None:
        self._draws = draws
        self._clients = clients
        self._module = module
        self._on_message = on_message
        self._on_crash = on_crash
        self._pause_s = 1 / per_s
        self._wake_event, self._has_reported = asyncio.Event(), asyncio.Event()
        self._queue = SendQueue(self._wake_event.set)
        self._queue.interval_s = UNWATCHED_S
        self._queue.is_browser = False
        self._socket: deque[bytes] = deque()
        self._worker: Worker | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._stopping = False
        self._last_lines: deque[str] = deque(maxlen=LAST_LINES)

    @property
    def pid(self) -> int | None:
        return None if self._worker is None else self._worker.pid

    async def start(self) -> None:
        """Start the process and begin to feed it.

        Raises:
            OSError: the process cannot be started.
        """
        worker = self._worker = await Worker.start(self._module, capture_stderr=True)
        self._clients.attach(self._queue)
        self._tasks = [
            asyncio.create_task(self._feed(worker), name=f"{self._module}: input"),
            asyncio.create_task(self._listen(worker), name=f"{self._module}: output"),
            asyncio.create_task(self._watch_output(worker), name=f"{self._module}: errors"),
        ]

    def send(self, **words: Any) -> None:
        """Send a message to the process, before all queued data."""
        self._socket.append(json.dumps(words).encode())
        self._wake_event.set()
        self._has_reported.set()

    async def stop(self) -> None:
        """Stop the process, and wait until it has ended. Idempotent."""
        self._stopping = True
        self._clients.detach(self._queue)
        worker, self._worker = self._worker, None
        if worker is not None:
            worker.dismiss()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(STOP_S):
                    await worker.wait()
            await worker.end()
        me = asyncio.current_task()
        others = [task for task in self._tasks if task is not me]
        await end_tasks(*others)

    async def _feed(self, worker: Worker) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        with contextlib.suppress(ConnectionError):
            while True:
                if not self._socket and loop.time() < due:
                    await self._rest(due)
                    continue
                sort, body = self._next()
                if body is None:
                    self._wake_event.clear()
                    await self._wake_event.wait()
                    continue
                await worker.write(HEAD.pack(len(body), sort) + body)
                if sort == SAMPLES:
                    due = max(due + self._pause(), loop.time())  # even intervals, regardless of the time for writing

    def _pause(self) -> float:
        return self._pause_s * (self._clients.shedding.picture_factor if self._draws else 1.0)

    async def _rest(self, until: float) -> None:
        """Wait until then, or until a message of ours is queued."""
        self._has_reported.clear()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout_at(until):
                await self._has_reported.wait()

    def _next(self) -> tuple[int, bytes | None]:
        if self._socket:
            return OURS, self._socket.popleft()
        message = self._queue.pop()
        if message is None:
            message = self._queue.take_history(self._clients.now())
        if isinstance(message, str):
            return TEXT, message.encode()
        return SAMPLES, message

    async def _listen(self, worker: Worker) -> None:
        async for line in worker.output:
            try:
                message = json.loads(line)
                if message["op"] == "subscribe":
                    self._subscribe(message["channels"], set(message["past"]), float(message["history"]))
                else:
                    self._on_message(message)
            except (ValueError, KeyError, TypeError) as error:
                log.warning("%s sent an invalid message: %s", self._module, error)
        status = await worker.wait()
        if not self._stopping:
            await asyncio.sleep(0)  # so that its last lines are read
            self._clients.detach(self._queue)
            words = " ".join(self._last_lines) or f"exit status {status}"
            log.warning("%s ended by itself: %s", self._module, words)
            self._on_crash(words)

    def _subscribe(self, channels: list[int], past: set[int], history: float) -> None:
        """Subscribe, with history of some channels only: a track needs its past, an attitude does not."""
        self._queue.interval_s = INTERVAL_SHARE * self._pause_s if channels else UNWATCHED_S
        self._clients.subscribe(self._queue, wire.Subscribe(history, channels), past)

    async def _watch_output(self, worker: Worker) -> None:
        async for line in worker.errors:
            words = line.decode(errors="replace").strip()
            if words:
                self._last_lines.append(words)
                log.debug("%s: %s", self._module, words)


class KeptProcess:
    """A viewer's process that is started again whenever it has ended, with growing delays.

    Args:
        begin: called when it runs; sends its first messages.
        end: called when it has ended.
        make: the process, given what it is to call after a crash with its last output.
        backoff: delays before it is started again.
        steady_s: after running this long, the next end counts as the first.
    """

    def __init__(
        self,
        make: Callable[[Callable[[str], None]], ViewerProcess],
        begin: Callable[[], None],
        on_crash: Callable[[str], None],
        backoff: Backoff,
        *,
        end: Callable[[], None] = lambda: None,
        steady_s: float = math.inf,
    ) -> None:
        self._make, self._begin, self._on_crash, self._end = make, begin, on_crash, end
        self._backoff, self._steady_s = backoff, steady_s
        self._process: ViewerProcess | None = None
        self._task: asyncio.Task[None] | None = None
        self._has_ended = asyncio.Event()

    @property
    def pid(self) -> int | None:
        """Process ID; None while it is not running."""
        return None if self._process is None else self._process.pid

    def start(self) -> None:
        self._task = asyncio.create_task(self._keep_running(), name="kept process")

    async def close(self) -> None:
        """Stop the process, and wait until it has ended."""
        await end_tasks(self._task)

    def send(self, **words: Any) -> None:
        """Send a message to the process, if it runs."""
        if self._process is not None:
            self._process.send(**words)

    def restart(self) -> None:
        """End the process that runs, after a failure of its own."""
        self._has_ended.set()

    def _crashed(self, words: str) -> None:
        self._on_crash(words)
        self.restart()

    async def _keep_running(self) -> None:
        loop = asyncio.get_running_loop()
        while True:
            began = loop.time()
            self._has_ended.clear()
            process = self._process = self._make(self._crashed)
            try:
                with contextlib.suppress(OSError):
                    await process.start()
                    self._begin()
                    await self._has_ended.wait()
            finally:
                self._process = None
                await process.stop()
                self._end()
            if loop.time() - began > self._steady_s:
                self._backoff.reset()
            await asyncio.sleep(self._backoff.next())
