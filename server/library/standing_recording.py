"""Recording of all devices from the start of the server (`record = true`), resumed after a full disk has room again.

    begin ──> recording ── the disk is full ──> waiting ── room ──> recording
                  │ a user stops it              │ a user stops it
                  └──> over                        └──> over

A robot has no operator to press the button again. There is room when a part of the disk is free (`room_for`), so that a
disk around its limit does not fill a folder with short files; and each attempt waits longer than the one before, until
a recording lasts. Between attempts the disk is looked at every CHECK_S. A recording that is resumed begins with what is
missing, as far as it is in memory.
"""

import asyncio
import contextlib
import shutil
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

from imuscope.recordings.errors import RecordingError
from imuscope.server import wire
from imuscope.server.concurrency.backoff import Backoff
from imuscope.server.errors import DomainError

FIRST_S, LONGEST_S = 5.0, 300.0
CHECK_S = 1.0
OVERLAP_S = 1.0  # of two files: the bytes that were to be written when the disk was full
LASTS_S = 600.0  # a recording that is longer was not a failed attempt
FREE_SPACE_DIVISOR, MAX_FREE_BYTES = 20, 500 * 10**6
"""One part in so many of the disk has to be free, and no more than so much."""


def room_for(total: int) -> int:
    """Bytes that have to be free on a disk of this size."""
    return min(total // FREE_SPACE_DIVISOR, MAX_FREE_BYTES)


class StandingRecording:
    """The wish that all devices are recorded.

    Args:
        folder: of the recordings.
        start: starts a recording of all devices; `words`: for its name; `before_s`: of memory, to begin with.
        is_running: whether there is a recording, this one or another.
        report: publishes an event.
    """

    def __init__(
        self,
        folder: Path,
        start: Callable[..., Awaitable[object]],
        is_running: Callable[[], bool],
        report: Callable[[wire.Level, str, str], None],
    ) -> None:
        self._folder, self._start, self._is_running, self._report = folder, start, is_running, report
        self._is_wanted = False
        self._words = ""
        self._backoff = Backoff(FIRST_S, LONGEST_S)
        self._started = -LASTS_S
        self._missing_since: float | None = None  # monotonic, s; None: nothing was recorded before
        self._waiting: asyncio.Task[None] | None = None

    @property
    def is_waiting(self) -> bool:
        """Whether a recording begins when there is room."""
        return self._waiting is not None and not self._waiting.done()

    async def begin(self, words: str) -> RecordingError | None:
        """Record from now on; returns the reason if that is not possible."""
        self._is_wanted, self._words = True, words
        return await self._attempt()

    def ended(self, why: RecordingError, behind_s: float = 0.0) -> str:
        """Take note that the recording has ended by an error; returns the sentence on when it is resumed, or "".

        Args:
            behind_s: age of the oldest bytes that were not written.
        """
        if not (self._is_wanted and why.is_full):
            return ""
        if self._missing_since is None:
            self._missing_since = time.monotonic() - behind_s - OVERLAP_S
        if not self.is_waiting:
            if time.monotonic() - self._started > LASTS_S:
                self._backoff.reset()
            self._waiting = asyncio.get_running_loop().create_task(self._wait(), name="standing recording")
        with contextlib.suppress(OSError):
            room = room_for(shutil.disk_usage(self._folder).total)
            return f"Recording is resumed by itself when {_size(room)} are free."
        return "Recording is resumed by itself when there is room."

    def drop(self) -> bool:
        """Record no more by itself: a user has stopped it, or the server ends. Returns whether it was waiting."""
        was_waiting, self._is_wanted = self.is_waiting, False
        if self._waiting is not None:
            self._waiting.cancel()
        return was_waiting

    async def _wait(self) -> None:
        pause = self._backoff.next()
        while self._is_wanted:
            await asyncio.sleep(pause)
            if self._is_running():  # a user was faster; if that one ends by the full disk, too, `ended` is called
                return
            pause = CHECK_S
            if await asyncio.to_thread(self._has_room):
                if await self._attempt() is None:
                    self._report("warning", "The disk has room again: recording has been resumed.", "")
                    return
                pause = self._backoff.next()

    def _has_room(self) -> bool:
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            disk = shutil.disk_usage(self._folder)
        except OSError:
            return False
        return disk.free >= room_for(disk.total)

    async def _attempt(self) -> RecordingError | None:
        try:
            missing_s = time.monotonic() - self._missing_since if self._missing_since is not None else 0.0
            await self._start(words=self._words, before_s=missing_s)
        except RecordingError as error:
            return error
        except DomainError:  # a user was faster
            return None
        self._started, self._missing_since = time.monotonic(), None
        return None


def _size(count: int) -> str:
    return f"{count / 1e6:.0f} MB" if count >= 10**7 else f"{count / 1e3:.0f} kB"
