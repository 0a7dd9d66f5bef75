"""Playback of a capture (raw bytes of any known protocol) as if the device were connected.

The timing comes from the device's own clock, see recordings/capture_timing.py. `speed=4` plays four times as
fast; `loop=1` starts again at the end, and marks the first bytes of each pass (`Chunk.restart`), so that the restart of
clocks and counters is not reported as a clock jump or a loss.
"""

import asyncio
import contextlib
import os
import stat
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

from imuscope.protocols.events import Decoder
from imuscope.protocols.registry import families as registry
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.registry.mixed_protocols import MixedProtocolDetector
from imuscope.recordings.capture_timing import (
    BLIND_RATE,
    BLOCK_BYTES,
    LONGEST_PAUSE_NS,
    CaptureTiming,
    TimedBytes,
    play,
)
from imuscope.server.links.base import Chunk, Link, LinkError, LinkSettings, Progress
from imuscope.server.links.detection_text import describe_bytes
from imuscope.server.links.reader_thread import ChunkQueue, closed
from imuscope.server.links.text import progress_line

FULL_BYTES = 1 << 20  # queued bytes at which playing waits, because the session is too slow
EXAMINED_BYTES = 1 << 18
AT_ONCE_BYTES = 1 << 24  # examined within a tenth of a second; a larger file is examined while it plays
SPEED_RANGE = (0.01, 1000.0)
TURN_S = 0.1  # between two passes of a loop, so that plotted lines break there


class FileLink(Link):
    """A file of raw bytes.

    Args:
        speed: factor on the device's own timing.
        loop: start again at the end; otherwise reading ends with LinkError "ended".
    """

    kind = "file"

    def __init__(self, source: str, settings: LinkSettings, path: str, speed: float = 1.0, loop: bool = False) -> None:
        super().__init__(source, settings)
        self.path = Path(path)
        self.speed = speed
        self.loop = loop
        self._protocol = ""
        self._queue: ChunkQueue | None = None
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._examiner: threading.Thread | None = None
        self._playback_notices: list[str] = []  # notices
        self._mixed_notices: list[str] = []

    async def open(self, progress: Progress | None = None) -> None:
        await self.close()
        head = self._head()
        detected = describe_bytes(head)
        self._protocol = self.settings.protocol or (detected.protocol if detected.recognised else "")
        progress_line(progress, self.path.name, detected.words)
        self._stop.clear()
        self._mixed_notices = []
        self._notice([] if self._protocol else [f"{self.path.name}: {_undecoded_text()}"])
        if self._protocol and self.path.stat().st_size <= AT_ONCE_BYTES:
            await asyncio.to_thread(self._examine)
        elif self._protocol:
            self._examiner = threading.Thread(target=self._examine, name=f"examining {self.source}", daemon=True)
            self._examiner.start()
        self._queue = ChunkQueue(self)
        self._thread = threading.Thread(target=self._run, args=(self._queue,), name=f"link {self.source}", daemon=True)
        self._thread.start()

    def _head(self) -> bytes:
        """The first block, for protocol detection."""
        try:
            mode = self.path.stat().st_mode
            # Opening a pipe would wait for its writer, and reading it for ever.
            if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
                hint = "Give a capture, or send the output of the pipe to a tcp-listen:// or udp:// source."
                raise LinkError("bad-source", f"{self.path} is a pipe or a device, not a file.", hint)
            with self.path.open("rb") as file:
                head = file.read(BLOCK_BYTES)
        except IsADirectoryError:
            raise LinkError("not-found", f"{self.path} is a folder.", "Give one capture in it.") from None
        except FileNotFoundError:
            raise LinkError(
                "not-found", f"There is no file {self.path}.", f"This server runs in {os.getcwd()}."
            ) from None
        except PermissionError:
            hint = f"`chmod a+r {self.path}`, or start the server as a user who may read it."
            raise LinkError("denied", f"No permission to read {self.path}.", hint) from None
        except OSError as error:
            raise LinkError("refused", f"{self.path} cannot be read: {error.strerror}.", "Check the disk.") from None
        if not head:
            raise LinkError("ended", f"{self.path} is empty.", "Give a capture that contains data.")
        return head

    def _examine(self) -> None:
        """Add a notice if the file contains frames of another protocol, which playback may not show."""
        mixture = MixedProtocolDetector(self._protocol)
        with contextlib.suppress(OSError), self.path.open("rb") as file:  # playback reports such an error
            while (block := file.read(EXAMINED_BYTES)) and not self._stop.is_set():
                mixture.feed(block)
            mixture.feed(b"", final=True)
        if others := [PROTOCOLS[name].title for name in mixture.others]:
            here = PROTOCOLS[self._protocol].title
            words = f"{self.path.name} holds messages of {' and '.join(others)} too; it is read as {here}."
            self._mixed_notices = [f"{words} Choose the other protocol to see them."]
            self._notice(self._playback_notices)

    def _notice(self, notices: list[str]) -> None:
        """Set the notices about playback; those of the examination are added."""
        self._playback_notices = notices
        self.notices = [*notices, *self._mixed_notices]

    def _run(self, inbox: ChunkQueue) -> None:
        """Body of the thread: play once, or repeatedly with `loop`."""
        passes = 0
        try:
            while not self._stop.is_set():
                self._play_once(inbox, restart=passes > 0)
                passes += 1
                if self.loop and self._stop.wait(TURN_S):
                    return
                if not self.loop:
                    ended = f"{self.path.name} has been played to its end."
                    inbox.fail(LinkError("ended", ended, "Play again, or add ?loop=1 to repeat."))
                    return
        except OSError as error:
            inbox.fail(LinkError("gone", f"{self.path} cannot be read any more: {error.strerror}.", "Check the disk."))

    def _play_once(self, inbox: ChunkQueue, *, restart: bool) -> None:
        decoder: Decoder | None = registry.permissive_decoder(self._protocol) if self._protocol else None
        with self.path.open("rb") as file:
            timing = CaptureTiming(file, decoder, LONGEST_PAUSE_NS)
            for piece in play(self._with_notices(timing), self.settings.now_ns, self._wait_for(inbox), self.speed):
                inbox.put(Chunk(piece.data, self.settings.now_ns(), restart))
                restart = False
                inbox.flush()
                inbox.wait(FULL_BYTES, self._stop.wait)
        inbox.flush()

    def _with_notices(self, timing: CaptureTiming) -> Iterator[TimedBytes]:
        """The pieces; deviations from the timing of the capture are reported in a notice."""
        for piece in timing:
            if piece.blind or timing.skipped_ns:
                notices = [f"{self.path.name}: {_undecoded_text()}"] if piece.blind else []
                if timing.skipped_ns:
                    notices.append(f"Pauses of {timing.skipped_ns / 1e9:.0f} s in {self.path.name} are skipped.")
                self._notice(notices)
            yield piece

    def _wait_for(self, inbox: ChunkQueue) -> Callable[[float], bool]:
        """Function that sleeps until a piece is due and in the meantime wakes the loop for queued chunks."""

        def wait(seconds: float) -> bool:
            flush_s = inbox.flush()
            if flush_s is not None and flush_s < seconds:
                if self._stop.wait(flush_s):
                    return True
                inbox.flush()
                seconds -= flush_s
            return self._stop.wait(seconds)

        return wait

    async def read(self) -> list[Chunk]:
        if self._queue is None:
            raise closed(self.source)
        return await self._queue.take()

    def read_now(self, again_ns: int) -> list[Chunk]:
        return [] if self._queue is None else self._queue.take_now(again_ns)

    @property
    def waits(self) -> bool:
        return True

    @property
    def backlog(self) -> int:
        return 0 if self._queue is None else self._queue.backlog

    async def write(self, data: bytes) -> None:
        raise LinkError(
            "refused", "A file cannot be written to as a device.", "Connect the device itself, or a simulator."
        )

    async def close(self) -> None:
        self._stop.set()
        if self._examiner is not None:
            self._examiner.join()
            self._examiner = None
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        if self._queue is not None:
            self._queue.fail(closed(self.source))
            self._queue = None


def _undecoded_text() -> str:
    return f"no device clock is known in it, so it is played at {BLIND_RATE} B/s, a full line at 115 200 Bd."
