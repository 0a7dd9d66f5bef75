"""The Rerun viewer: recordings streamed into it, and what devices send now.

    recording ──Columns──> python -m server.integrations.rrd_stream_worker ──.rrd on its standard output──> the browser
    Hub ──viewer_process.py──> python -m server.integrations.rerun_worker ──batches, base64 in JSON lines──> RerunFeed
    ──> WebSocket of each

A batch is an `.rrd` in itself, so a viewer can begin with any of them once it has been told what is static. A Feed
keeps that and the newest `KEPT_BYTES`; who comes late gets what is static, what is live, and between that the kept
batches, newest first. A browser says what its viewer has taken; one that does not keep up loses the oldest batches and
is told how many, so that it shows the present however slow it is. None slows a device, and the feed ends when nobody
has looked for `IDLE_S`.
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import logging
import sys
from collections import deque
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from server.integrations.proxy import ViewError
from server.integrations.rerun_remote import RemoteRerun
from server.integrations.viewer_process import ViewerProcess
from server.streaming.hub import Hub

log = logging.getLogger("imuscope.views")

ROOT = Path(__file__).resolve().parents[2]
STREAM, FEED = "server.integrations.rrd_stream_worker", "server.integrations.rerun_worker"
PIECE = 1 << 16
MOST_STREAMS = 4  # at once: each is a process with a hundred MB
MOST_FEEDS = 4
KEPT_BYTES = 32 << 20  # of a feed: about half a minute of three devices
MOST_LIVE = 20  # batches that wait for a browser: a second
PAST_BYTES = 16 << 20  # and of the past
AHEAD = 4  # batches that a browser is sent before it says that its viewer has them: what lies in it only grows old
IDLE_S = 10.0


async def recording_stream(wish: Mapping[str, Any], slots: asyncio.Semaphore) -> AsyncIterator[bytes]:
    """A recording as `.rrd`, piece by piece; ends its process when it is not read to its end.

    Args:
        wish: as rrd_stream_worker.py says.
        slots: how many may run at once.
    """
    async with slots:
        pipe = asyncio.subprocess.PIPE
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", STREAM), cwd=ROOT, stdin=pipe, stdout=pipe, stderr=pipe, limit=PIECE
        )
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        words = asyncio.create_task(process.stderr.read(), name="rerun stream is overheard")
        try:
            process.stdin.write(json.dumps(wish).encode())
            process.stdin.close()
            while piece := await process.stdout.read(PIECE):
                yield piece
            if await process.wait() != 0:
                log.warning("a stream for the Rerun viewer ended: %s", (await words).decode(errors="replace")[-500:])
        finally:
            if process.returncode is None:
                with contextlib.suppress(ProcessLookupError):
                    process.kill()
                await process.wait()
            words.cancel()


@dataclass(slots=True, eq=False)
class RerunViewer:
    """What waits for one browser: what is static, then what is live, then what was before."""

    wake: asyncio.Event = field(default_factory=asyncio.Event)
    still: deque[bytes] = field(default_factory=deque)  # never dropped
    live: deque[tuple[float, bytes]] = field(default_factory=deque)  # arrival of the newest sample in it, batch
    past: deque[bytes] = field(default_factory=deque)
    dropped: int = 0
    sent: int = 0
    taken: int = 0  # as the browser says
    lost: str = ""  # why the stream ended

    def offer(self, newest: float, batch: bytes) -> None:
        """A live batch; the oldest are dropped where too many wait."""
        self.live.append((newest, batch))
        while len(self.live) > MOST_LIVE:
            self.live.popleft()
            self.dropped += 1
        self.wake.set()

    def remember(self, batch: bytes) -> None:
        """A batch of the past; who cannot take it does not get it."""
        if sum(map(len, self.past)) + len(batch) <= PAST_BYTES:
            self.past.append(batch)
            self.wake.set()

    def acknowledge(self, taken: int) -> None:
        """The browser has given so many batches to its viewer."""
        self.taken = taken
        self.wake.set()

    async def take(self) -> tuple[float, bytes]:
        """The next, as soon as the browser is not too far behind: arrival of its newest sample, 0 where it is not live.

        Raises:
            ViewError: the stream has ended.
        """
        while True:
            if self.lost:
                raise ViewError(self.lost)
            if self.sent - self.taken < AHEAD:
                self.sent += 1
                if self.still:
                    return 0.0, self.still.popleft()
                if self.live:
                    return self.live.popleft()
                if self.past:
                    return 0.0, self.past.popleft()
                self.sent -= 1
            self.wake.clear()
            await self.wake.wait()


class RerunFeed:
    """One live stream and who looks at it.

    Args:
        device: id; "" for all.
    """

    def __init__(self, hub: Hub, device: str = "") -> None:
        self._hub = hub
        self._device = device
        self._aside: ViewerProcess | None = None
        self._still: list[bytes] = []
        self._kept: deque[tuple[float, bytes]] = deque()
        self._size = 0
        self.viewers: set[RerunViewer] = set()

    async def start(self) -> None:
        """Begin to stream."""
        self._aside = ViewerProcess(self._hub, FEED, self._told, self._crashed)
        try:
            await self._aside.start()
        except OSError as error:
            raise ViewError("The stream for Rerun does not start.", str(error.strerror)) from None
        self._aside.say(op="open", device=self._device, connect="")

    async def stop(self) -> None:
        """End it, and wait until it is gone."""
        for viewer in self.viewers:
            viewer.lost = viewer.lost or "The stream has ended."
            viewer.wake.set()
        if self._aside is not None:
            await self._aside.stop()

    def join(self) -> RerunViewer:
        """One more looks: what is static, then what is kept, newest first."""
        viewer = RerunViewer(still=deque(self._still))
        for _, batch in sorted(self._kept, key=lambda one: -one[0]):
            viewer.remember(batch)
        self.viewers.add(viewer)
        return viewer

    def lag_ms(self, newest: float) -> float:
        """How old the newest sample of a batch is now."""
        return max(0.0, 1000 * (self._hub.now() - newest))

    def _told(self, told: Mapping[str, Any]) -> None:
        if told["op"] != "batch":
            return
        batch, newest = base64.b64decode(told["data"]), float(told["newest"])
        if told["still"]:
            if told["anew"]:
                self._still.clear()
            self._still.append(batch)
            for viewer in self.viewers:
                viewer.still.append(batch)
                viewer.wake.set()
            return
        self._kept.append((newest, batch))
        self._size += len(batch)
        while self._size > KEPT_BYTES:
            self._size -= len(self._kept.popleft()[1])
        for viewer in self.viewers:
            if told["past"]:
                viewer.remember(batch)
            else:
                viewer.offer(newest, batch)

    def _crashed(self, words: str) -> None:
        self._hub.event("", "link", "fault", f"The stream for Rerun ended by itself: {words:.200}")
        self._aside = None
        for viewer in self.viewers:
            viewer.lost = "The stream ended by itself."
            viewer.wake.set()

    @property
    def is_running(self) -> bool:
        """False after a crash."""
        return self._aside is not None

    @property
    def pid(self) -> int | None:
        return None if self._aside is None else self._aside.pid


class Rerun:
    """All of it, for one server."""

    def __init__(self, hub: Hub, connect: str = "", idle_s: float = IDLE_S) -> None:
        self._hub = hub
        self._idle_s = idle_s
        self._starting = asyncio.Lock()
        self._elsewhere = RemoteRerun(hub, connect) if connect else None
        self.feeds: dict[str, RerunFeed] = {}
        self.slots = asyncio.Semaphore(MOST_STREAMS)

    async def start(self) -> None:
        """Stream to a viewer elsewhere, where that was asked for."""
        if self._elsewhere is not None:
            self._elsewhere.start()

    @contextlib.asynccontextmanager
    async def look(self, device: str) -> AsyncIterator[tuple[RerunFeed, RerunViewer]]:
        """A viewer of a device's stream, or of all devices', for as long as the block lasts.

        Raises:
            ViewError: there is no such device, or too many streams run.
        """
        if device and device not in self._hub.devices:
            raise ViewError(f"There is no device {device:.40}.", "Leave the device out for all that there are.", 404)
        async with self._starting:
            feed = self.feeds.get(device)
            if feed is None or not feed.is_running:
                if feed is None and len(self.feeds) >= MOST_FEEDS:
                    raise ViewError(f"{MOST_FEEDS} streams run already.", "Close one of their pages.")
                feed = RerunFeed(self._hub, device)
                await feed.start()
                self.feeds[device] = feed
        viewer = feed.join()
        try:
            yield feed, viewer
        finally:
            feed.viewers.discard(viewer)
            if not feed.viewers:
                asyncio.get_running_loop().call_later(self._idle_s, self._leave, device, feed)

    def _leave(self, device: str, feed: RerunFeed) -> None:
        if not feed.viewers and self.feeds.get(device) is feed:
            del self.feeds[device]
            self._stopping = asyncio.get_running_loop().create_task(feed.stop(), name="rerun feed stops")

    async def close(self) -> None:
        """End all streams."""
        stops = [feed.stop() for feed in self.feeds.values()]
        if self._elsewhere is not None:
            stops.append(self._elsewhere.stop())
        self.feeds.clear()
        await asyncio.gather(*stops)
