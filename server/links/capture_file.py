"""A capture (raw bytes of any protocol we know) played as if the device were there.

The pace comes from the device's own clock, see recordings/capture_timing.py. `speed=4` plays four times as fast;
`loop=1` begins again at the end, and says so with the first bytes of each turn (`Chunk.anew`): clocks and counters
begin again by our doing, and a jump of the device's clock or a loss it is not.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import stat
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

from protocols.events import Decoder
from recordings.capture_timing import BLIND_RATE, BLOCK_BYTES, LONGEST_PAUSE_NS, CaptureTiming, TimedBytes, play
from server.links.base import Chunk, Link, LinkError, LinkSettings, Progress
from server.links.detection_text import describe_bytes
from server.links.reader_thread import ChunkQueue, closed
from server.links.text import progress_line

FULL_BYTES = 1 << 20  # so much waiting in the inbox: the session is slower than the pace, and the file waits
EXAMINED_BYTES = 1 << 18
AT_ONCE_BYTES = 1 << 24  # a tenth of a second; a larger file is examined while it plays
SPEEDS = (0.01, 1000.0)
TURN_S = 0.1  # between two turns of a loop: the lines of a plot break there, and must not run into each other


class FileLink(Link):
    """A file of raw bytes.

    Args:
        speed: factor on the device's own pace.
        loop: begin again at the end; else reading ends with LinkError "ended".
    """

    kind = "file"

    def __init__(self, source: str, settings: LinkSettings, path: str, speed: float = 1.0, loop: bool = False) -> None:
        super().__init__(source, settings)
        self.path = Path(path)
        self.speed = speed
        self.loop = loop
        self._protocol = ""
        self._inbox: ChunkQueue | None = None
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._examiner: threading.Thread | None = None
        self._said: list[str] = []  # notices
        self._mixed: list[str] = []

    async def open(self, progress: Progress | None = None) -> None:
        await self.close()
        head = self._head()
        heard = describe_bytes(head)
        self._protocol = self.settings.protocol or (heard.protocol if heard.recognised else "")
        progress_line(progress, self.path.name, heard.words)
        self._stop.clear()
        self._mixed = []
        self._remark([] if self._protocol else [f"{self.path.name}: {_blind_words()}"])
        if self._protocol and self.path.stat().st_size <= AT_ONCE_BYTES:
            await asyncio.to_thread(self._examine)
        elif self._protocol:
            self._examiner = threading.Thread(target=self._examine, name=f"examining {self.source}", daemon=True)
            self._examiner.start()
        self._inbox = ChunkQueue(self)
        self._thread = threading.Thread(target=self._run, args=(self._inbox,), name=f"link {self.source}", daemon=True)
        self._thread.start()

    def _head(self) -> bytes:
        """The first block, to judge the protocol by."""
        try:
            mode = self.path.stat().st_mode
            if not stat.S_ISREG(mode) and not stat.S_ISDIR(
                mode
            ):  # opening a pipe waits for its writer, reading for ever
                hint = "Give a capture, or hand what the pipe gives to a tcp-listen:// or udp:// source."
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
            raise LinkError("refused", f"{self.path} cannot be read: {error.strerror}.", "Is the disk there?") from None
        if not head:
            raise LinkError("ended", f"{self.path} is empty.", "Give a capture with something in it.")
        return head

    def _examine(self) -> None:
        """Say so where the file holds frames of another protocol, of which playing it may show nothing."""
        from protocols.mixed_protocols import MixedProtocolDetector
        from protocols.registry import PROTOCOLS

        mixture = MixedProtocolDetector(self._protocol)
        with contextlib.suppress(OSError), self.path.open("rb") as file:  # playing it finds that out, and says so
            while (block := file.read(EXAMINED_BYTES)) and not self._stop.is_set():
                mixture.feed(block)
            mixture.feed(b"", final=True)
        if others := [PROTOCOLS[name].title for name in mixture.others]:
            here = PROTOCOLS[self._protocol].title
            words = f"{self.path.name} holds messages of {' and '.join(others)} too; it is read as {here}."
            self._mixed = [f"{words} Choose the other protocol to see them."]
            self._remark(self._said)

    def _remark(self, said: list[str]) -> None:
        """What playing the file has to say, and what examining it found."""
        self._said = said
        self.notices = [*said, *self._mixed]

    def _run(self, inbox: ChunkQueue) -> None:
        """The thread: play, as often as asked."""
        turns = 0
        try:
            while not self._stop.is_set():
                self._play_once(inbox, anew=turns > 0)
                turns += 1
                if self.loop and self._stop.wait(TURN_S):
                    return
                if not self.loop:
                    ended = f"{self.path.name} has been played to its end."
                    inbox.fail(LinkError("ended", ended, "Play again, or add ?loop=1 to repeat."))
                    return
        except OSError as error:
            inbox.fail(
                LinkError("gone", f"{self.path} cannot be read any more: {error.strerror}.", "Is the disk there?")
            )

    def _play_once(self, inbox: ChunkQueue, *, anew: bool) -> None:
        from protocols import registry

        decoder: Decoder | None = registry.permissive_decoder(self._protocol) if self._protocol else None
        with self.path.open("rb") as file:
            pace = CaptureTiming(file, decoder, LONGEST_PAUSE_NS)
            for piece in play(self._told(pace), self.settings.now_ns, self._wait_for(inbox), self.speed):
                inbox.put(Chunk(piece.data, self.settings.now_ns(), anew))
                anew = False
                inbox.flush()
                inbox.wait(FULL_BYTES, self._stop.wait)
        inbox.flush()

    def _told(self, pace: CaptureTiming) -> Iterator[TimedBytes]:
        """The pieces; what is not as in the capture is said in a notice."""
        for piece in pace:
            if piece.blind or pace.skipped_ns:
                notices = [f"{self.path.name}: {_blind_words()}"] if piece.blind else []
                if pace.skipped_ns:
                    notices.append(f"Pauses of {pace.skipped_ns / 1e9:.0f} s in {self.path.name} are skipped.")
                self._remark(notices)
            yield piece

    def _wait_for(self, inbox: ChunkQueue) -> Callable[[float], bool]:
        """Sleep until a piece is due, waking the loop on the way for what has been put already."""

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
        if self._inbox is None:
            raise closed(self.source)
        return await self._inbox.take()

    def read_now(self) -> list[Chunk]:
        return [] if self._inbox is None else self._inbox.take_now()

    @property
    def waits(self) -> bool:
        return True

    @property
    def held(self) -> int:
        return 0 if self._inbox is None else self._inbox.held

    async def write(self, data: bytes) -> None:
        raise LinkError("refused", "A file cannot be written to as a device.", "Connect the device itself, or a twin.")

    async def close(self) -> None:
        self._stop.set()
        if self._examiner is not None:
            self._examiner.join()
            self._examiner = None
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        if self._inbox is not None:
            self._inbox.fail(closed(self.source))
            self._inbox = None


def _blind_words() -> str:
    return f"no device clock is known in it, so it is played at {BLIND_RATE} B/s, a full line at 115 200 Bd."
