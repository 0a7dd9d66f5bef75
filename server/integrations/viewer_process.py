"""How does a viewer get the samples without being part of the server? It is a process, and a client of the wire.

    Hub ──> SendQueue ──> stdin of the process:   u32 size (little-endian) │ u8 sort │ body
                                               sort 0: a text frame of server/wire.py
                                               sort 1: sample frames of server/wire.py
                                               sort 2: JSON from our side of the view
    our side of the view <── stdout:           JSON lines

So it is told what a browser is told, in the same words, and what holds for a browser holds for it: what it does not
take waits in an outbox of its own, where the oldest samples are dropped; nothing it does slows a device. Samples go out
at most `PER_S` times a second, whatever the device's rate: a viewer draws no more often, and one that plays out what it
gets needs less. Nor are they decoded more often for it: what a hub does for a browser 125 times a second costs more
than all that is done here.

What it may say on standard output, besides what its view understands:

    {"op": "subscribe", "channels": [ids], "past": [ids], "history": s}     past: of which channels history is wanted

A process that ends before it was stopped has crashed: `on_crash` hears how. Starting it again is the view's affair.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import struct
import sys
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from server import wire, wire_codec
from server.streaming.hub import FLUSH_NOBODY_S, Hub
from server.streaming.send_queue import HistoryStream, SendQueue

ROOT = Path(__file__).resolve().parents[2]
HEAD = struct.Struct("<IB")
TEXT, SAMPLES, OURS = 0, 1, 2
PER_S = 60.0
EARLY = 0.95  # of the time between two: samples are made a little sooner than sent, so that there always are some
PATIENCE_S = 0.8  # from the end of its input to being killed: it holds nothing that could be lost
MOST_LINE = 1024 * 1024
LAST_WORDS = 6  # lines of its standard error that are told after a crash

log = logging.getLogger("imuscope.views")


class ViewerProcess:
    """One process that views what the hub has.

    Args:
        module: what is run, as `python -m module`.
        on_told: each line it says, as an object.
        on_crash: it ended by itself; what it said last.
        per_s: how often samples go out, at most.
    """

    def __init__(
        self,
        hub: Hub,
        module: str,
        on_told: Callable[[Mapping[str, Any]], None],
        on_crash: Callable[[str], None],
        per_s: float = PER_S,
    ) -> None:
        self._hub = hub
        self._module = module
        self._on_told = on_told
        self._on_crash = on_crash
        self._pause_s = 1 / per_s
        self._wake, self._spoken = asyncio.Event(), asyncio.Event()
        self._outbox = SendQueue(self._wake.set)
        self._outbox.interval_s = FLUSH_NOBODY_S
        self._outbox.is_browser = False
        self._ours: deque[bytes] = deque()
        self._process: asyncio.subprocess.Process | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self._stopping = False
        self._last_words: deque[str] = deque(maxlen=LAST_WORDS)

    @property
    def pid(self) -> int | None:
        return None if self._process is None else self._process.pid

    async def start(self) -> None:
        """Run it and begin to feed it.

        Raises:
            OSError: the system gives no process.
        """
        self._process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", self._module),
            cwd=ROOT,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            limit=MOST_LINE,
        )
        self._hub.attach(self._outbox)
        self._tasks = [
            asyncio.create_task(self._feed(), name=f"{self._module} is fed"),
            asyncio.create_task(self._listen(), name=f"{self._module} is heard"),
            asyncio.create_task(self._overhear(), name=f"{self._module} is overheard"),
        ]

    def say(self, **words: Any) -> None:
        """Tell the process something of ours; before all that still waits."""
        self._ours.append(json.dumps(words).encode())
        self._wake.set()
        self._spoken.set()

    async def stop(self) -> None:
        """End it, and wait until it is gone. Idempotent."""
        self._stopping = True
        self._hub.detach(self._outbox)
        process, self._process = self._process, None
        if process is not None:
            if process.stdin is not None:
                process.stdin.close()
            try:
                async with asyncio.timeout(PATIENCE_S):
                    await process.wait()
            except TimeoutError:
                with contextlib.suppress(ProcessLookupError):
                    process.kill()
                await process.wait()
        me = asyncio.current_task()
        others = [task for task in self._tasks if task is not me]
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)

    async def _feed(self) -> None:
        assert self._process is not None
        assert self._process.stdin is not None
        pipe = self._process.stdin
        loop = asyncio.get_running_loop()
        due = loop.time()
        with contextlib.suppress(ConnectionError):
            while True:
                if not self._ours and loop.time() < due:
                    await self._rest(due)
                    continue
                sort, body = self._next()
                if body is None:
                    self._wake.clear()
                    await self._wake.wait()
                    continue
                pipe.write(HEAD.pack(len(body), sort) + body)
                await pipe.drain()
                if sort == SAMPLES:
                    due = max(due + self._pause_s, loop.time())  # evenly, however long the writing took

    async def _rest(self, until: float) -> None:
        """Until then, or until there is something of ours."""
        self._spoken.clear()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout_at(until):
                await self._spoken.wait()

    def _next(self) -> tuple[int, bytes | None]:
        if self._ours:
            return OURS, self._ours.popleft()
        message = self._outbox.take()
        if message is None:
            message = self._outbox.take_history(self._hub.now())
        if isinstance(message, str):
            return TEXT, message.encode()
        return SAMPLES, message

    async def _listen(self) -> None:
        process = self._process
        assert process is not None
        assert process.stdout is not None
        async for line in process.stdout:
            try:
                told = json.loads(line)
                if told["op"] == "subscribe":
                    self._subscribe(told["channels"], set(told["past"]), float(told["history"]))
                else:
                    self._on_told(told)
            except (ValueError, KeyError, TypeError) as error:
                log.warning("%s said something that is not understood: %s", self._module, error)
        status = await process.wait()
        if not self._stopping:
            await asyncio.sleep(0)  # its last words
            self._hub.detach(self._outbox)
            words = " ".join(self._last_words) or f"exit status {status}"
            log.warning("%s ended by itself: %s", self._module, words)
            self._on_crash(words)

    def _subscribe(self, channels: list[int], past: set[int], history: float) -> None:
        """As Hub.subscribe, but with history of some channels only: a track needs its past, an attitude does not."""
        since = self._hub.now() - min(history, self._hub.history_s)
        spans = {}
        for number in set(channels) & past & self._hub.channels.keys():
            channel = self._hub.channels[number]
            start = min(channel.ring.sequence_at(since), channel.flushed)
            spans[number] = (channel.ring, start, channel.flushed)
        self._outbox.interval_s = EARLY * self._pause_s if channels else FLUSH_NOBODY_S
        self._outbox.subscribe(channels, HistoryStream(spans), wire_codec.encode_text(wire.Backfilled()))

    async def _overhear(self) -> None:
        assert self._process is not None
        assert self._process.stderr is not None
        async for line in self._process.stderr:
            words = line.decode(errors="replace").strip()
            if words:
                self._last_words.append(words)
                log.debug("%s: %s", self._module, words)
