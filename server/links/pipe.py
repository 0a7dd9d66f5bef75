"""A pipe, or standard input, read as it comes: `ssh robot cat /dev/ttyUSB0 | imuscope serve -`, `zcat a.bin.gz | …`.

    nothing waits behind it    it is given out at once: a device is at the other end
    more waits behind it       a capture comes faster than it was made: it is played by the device's own clock

So a live stream is never held back, and a file that is poured in looks as if its device were there (see
recordings/capture_timing.py). A recording does not come through a pipe: its index is at its end, and each
of its devices is a source.
"""

from __future__ import annotations

import contextlib
import os
import select
import stat
import threading
import time
from collections.abc import Callable
from typing import BinaryIO, cast

from protocols.events import Decoder
from recordings.capture_timing import LONGEST_PAUSE_NS, CaptureTiming
from recordings.mcap_reader import MAGIC
from server.links.base import Chunk, LinkError, Progress
from server.links.capture_file import FULL_BYTES, FileLink
from server.links.detection_text import describe_bytes
from server.links.reader_thread import ChunkQueue
from server.links.text import progress_line

STDIN = "/dev/stdin"
HEAD_BYTES, HEAD_S = 1024, 0.4  # what the protocol is judged by; so long after the first byte with fewer
LOOK_MS = 100  # how soon a reader that waits notices that the link is closed


def is_pipe(place: str) -> bool:
    """Is this a pipe (or a terminal that standard input is), and no file or port?"""
    try:
        mode = os.stat(place).st_mode
    except (OSError, ValueError):
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode) or (place == STDIN and not stat.S_ISREG(mode))


class _Pipe:
    """The reading end. Reading waits for bytes, and ends when `stop` is set.

    Args:
        flush: of the inbox: has the loop woken for what was put; called while reading waits.
    Raises:
        OSError: it cannot be opened or read.
    """

    def __init__(self, place: str, stop: threading.Event, flush: Callable[[], float | None]) -> None:
        self._flush = flush
        self._fd = os.dup(0) if place == STDIN else os.open(place, os.O_RDONLY | os.O_NONBLOCK)
        self._stop = stop
        self._poll = select.poll()
        self._poll.register(self._fd, select.POLLIN)
        self._first = b""

    def close(self) -> None:
        os.close(self._fd)

    @property
    def is_ready(self) -> bool:
        """Would reading not wait? Also at its end."""
        return bool(self._first) or bool(self._poll.poll(0))

    def read(self, most: int) -> bytes:
        """Some bytes; b"" at its end."""
        if self._first:
            data, self._first = self._first[:most], self._first[most:]
            return data
        while not self._stop.is_set():
            flush_s = self._flush()
            if self._poll.poll(LOOK_MS if flush_s is None else min(1e3 * flush_s, LOOK_MS)):
                return os.read(self._fd, most)
        return b""

    def head(self) -> bytes:
        """Its first bytes, which are read again."""
        head = self.read(HEAD_BYTES)
        until = time.monotonic() + HEAD_S
        while head and len(head) < HEAD_BYTES and (left := until - time.monotonic()) > 0:
            if self._poll.poll(1e3 * left):
                more = os.read(self._fd, HEAD_BYTES - len(head))
                if not more:
                    break
                head += more
        self._first = head
        return head


class PipeLink(FileLink):
    """A link that reads a pipe to its end."""

    async def open(self, progress: Progress | None = None) -> None:
        await self.close()
        self._stop.clear()
        self._remark([])
        self._inbox = ChunkQueue(self)
        progress_line(progress, self.path.name, "open")
        self._thread = threading.Thread(target=self._run, args=(self._inbox,), name=f"link {self.source}", daemon=True)
        self._thread.start()

    def _run(self, inbox: ChunkQueue) -> None:
        """The thread."""
        try:
            with contextlib.closing(_Pipe(str(self.path), self._stop, inbox.flush)) as pipe:
                head = pipe.head()
                if head.startswith(MAGIC):
                    refusal = f"{self.path.name} gives a recording, which is not served from a pipe."
                    inbox.fail(LinkError("bad-source", refusal, "Write it into a file, and name that."))
                    return
                heard = describe_bytes(head)
                self._protocol = self.settings.protocol or (heard.protocol if heard.recognised else "")
                self._play(pipe, inbox)
        except OSError as error:
            words = f"{self.path} cannot be read any more: {error.strerror}."
            inbox.fail(LinkError("gone", words, "Is its writer there?"))
            return
        hint = "Start the server again to read more." if str(self.path) == STDIN else "Play again waits for a writer."
        inbox.fail(LinkError("ended", f"{self.path.name} has ended.", hint))

    def _play(self, pipe: _Pipe, inbox: ChunkQueue) -> None:
        """Give out what comes, at once or when it is due."""
        from protocols import registry

        decoder: Decoder | None = registry.permissive_decoder(self._protocol) if self._protocol else None
        reader = _Reader(pipe, lambda data: self._give(inbox, data))
        wait = self._wait_for(inbox)
        now_ns = self.settings.now_ns
        start_ns = 0  # when the first byte was due; moved as long as nothing waits
        for piece in CaptureTiming(cast(BinaryIO, reader), decoder, LONGEST_PAUSE_NS):
            given = reader.take(len(piece.data))
            now = now_ns()
            if given == len(piece.data) or not start_ns or not pipe.is_ready:
                start_ns = now - piece.due_ns
            elif wait((start_ns + piece.due_ns - now) / 1e9 if start_ns + piece.due_ns > now else 0.0):
                return
            if given < len(piece.data):
                self._give(inbox, piece.data[given:])

    def _give(self, inbox: ChunkQueue, data: bytes) -> None:
        inbox.put(Chunk(data, self.settings.now_ns()))
        inbox.flush()
        inbox.wait(FULL_BYTES, self._stop.wait)


class _Reader:
    """Input of a CaptureTiming. While nothing comes, what it holds back is released: a frame does not wait for the
    next one to begin."""

    def __init__(self, pipe: _Pipe, give: Callable[[bytes], None]) -> None:
        self._pipe = pipe
        self._give = give
        self._held = bytearray()  # read, and neither given out nor taken
        self._ahead = 0  # given out before the pace told when they were due

    def read(self, most: int) -> bytes:
        if self._held and not self._pipe.is_ready:
            self._give(bytes(self._held))
            self._ahead += len(self._held)
            self._held.clear()
        data = self._pipe.read(most)
        self._held += data
        return data

    def take(self, size: int) -> int:
        """The next `size` bytes are due; how many of them have been given out."""
        given = min(self._ahead, size)
        self._ahead -= given
        del self._held[: size - given]
        return given
