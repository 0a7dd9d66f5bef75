"""Pipe or standard input as a stream: `ssh robot cat /dev/ttyUSB0 | imuscope serve -`, `zcat a.bin.gz | …`.

    no more data waiting       live: a device is at the other end, bytes are passed on at once
    more data waiting          a capture arrives faster than recorded: it is played by the device's own clock

So a live stream is never delayed, and a capture is played as if its device were connected (see
recordings/capture_timing.py). A recording cannot be read from a pipe: its index is at its end, and each of
its devices is a separate source.
"""

import contextlib
import os
import select
import stat
import threading
import time
from collections.abc import Callable
from typing import BinaryIO, cast

from imuscope.protocols.events import Decoder
from imuscope.protocols.registry import families as registry
from imuscope.recordings.capture_timing import LONGEST_PAUSE_NS, CaptureTiming
from imuscope.recordings.mcap.records import MAGIC
from imuscope.server.links.base import Chunk, LinkError, Progress
from imuscope.server.links.capture_file import FULL_BYTES, FileLink
from imuscope.server.links.detection_text import describe_bytes
from imuscope.server.links.reader_thread import ChunkQueue
from imuscope.server.links.text import progress_line

STDIN = "/dev/stdin"
HEAD_BYTES, HEAD_S = 1024, 0.4  # bytes for protocol detection; longest wait for them after the first byte
POLL_MS = 100  # period at which a waiting reader checks whether the link is closed


def is_pipe(place: str) -> bool:
    """Whether this is a pipe (or a terminal as standard input) instead of a file or port."""
    try:
        mode = os.stat(place).st_mode
    except (OSError, ValueError):
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode) or (place == STDIN and not stat.S_ISREG(mode))


class _Pipe:
    """The reading end. Reading waits for bytes, and ends when `stop` is set.

    Args:
        flush: `ChunkQueue.flush`, called while reading waits.

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
        """Whether reading would not block. Also true at its end."""
        return bool(self._first) or bool(self._poll.poll(0))

    def read(self, most: int) -> bytes:
        """Read up to `most` bytes; b"" at its end."""
        if self._first:
            data, self._first = self._first[:most], self._first[most:]
            return data
        while not self._stop.is_set():
            flush_s = self._flush()
            if self._poll.poll(POLL_MS if flush_s is None else min(1e3 * flush_s, POLL_MS)):
                return os.read(self._fd, most)
        return b""

    def head(self) -> bytes:
        """The first bytes; `read` returns them again."""
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
        self._notice([])
        self._queue = ChunkQueue(self)
        progress_line(progress, self.path.name, "open")
        self._thread = threading.Thread(target=self._run, args=(self._queue,), name=f"link {self.source}", daemon=True)
        self._thread.start()

    def _run(self, inbox: ChunkQueue) -> None:
        try:
            with contextlib.closing(_Pipe(str(self.path), self._stop, inbox.flush)) as pipe:
                head = pipe.head()
                if head.startswith(MAGIC):
                    refusal = f"{self.path.name} is a recording, which cannot be read from a pipe."
                    inbox.fail(LinkError("bad-source", refusal, "Write it to a file and open that."))
                    return
                detected = describe_bytes(head)
                self._protocol = self.settings.protocol or (detected.protocol if detected.recognised else "")
                self._play(pipe, inbox)
        except OSError as error:
            words = f"{self.path} cannot be read any more: {error.strerror}."
            inbox.fail(LinkError("gone", words, "Check that its writer is running."))
            return
        hint = "Start the server again to read more." if str(self.path) == STDIN else "Play again waits for a writer."
        inbox.fail(LinkError("ended", f"{self.path.name} has ended.", hint))

    def _play(self, pipe: _Pipe, inbox: ChunkQueue) -> None:
        """Queue the received bytes, at once or when they are due."""
        decoder: Decoder | None = registry.permissive_decoder(self._protocol) if self._protocol else None
        reader = _PipeReader(pipe, lambda data: self._give(inbox, data))
        wait = self._wait_for(inbox)
        now_ns = self.settings.now_ns
        start_ns = 0  # when the first byte was due; moved while no more data is waiting
        for piece in CaptureTiming(cast(BinaryIO, reader), decoder, LONGEST_PAUSE_NS):
            size = reader.take(len(piece.data))
            now = now_ns()
            if size == len(piece.data) or not start_ns or not pipe.is_ready:
                start_ns = now - piece.due_ns
            elif wait((start_ns + piece.due_ns - now) / 1e9 if start_ns + piece.due_ns > now else 0.0):
                return
            if size < len(piece.data):
                self._give(inbox, piece.data[size:])

    def _give(self, inbox: ChunkQueue, data: bytes) -> None:
        inbox.put(Chunk(data, self.settings.now_ns()))
        inbox.flush()
        inbox.wait(FULL_BYTES, self._stop.wait)


class _PipeReader:
    """Input of a CaptureTiming. Bytes that it holds back are released if no more data is waiting, so that a frame does
    not wait for the beginning of the next one.
    """

    def __init__(self, pipe: _Pipe, give: Callable[[bytes], None]) -> None:
        self._pipe = pipe
        self._give = give
        self._held = bytearray()  # read, but neither released nor taken
        self._ahead = 0  # number of bytes released before their due time was known

    def read(self, most: int) -> bytes:
        if self._held and not self._pipe.is_ready:
            self._give(bytes(self._held))
            self._ahead += len(self._held)
            self._held.clear()
        data = self._pipe.read(most)
        self._held += data
        return data

    def take(self, size: int) -> int:
        """Take the next `size` bytes, which are due; return how many of them were released before."""
        amount = min(self._ahead, size)
        self._ahead -= amount
        del self._held[: size - amount]
        return amount
