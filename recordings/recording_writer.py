"""What is recorded is on the disk at once, whoever is busy meanwhile: a queue, and the threads that empty it.

    any thread ──put──> queue (never full, never drops) ──> writer thread: one write for all that waits, every few ms
                                                                  │ a part is full, or old enough
                                                                  v
                                           part 1 │ part 2 │ part 3 …        files of their own, one after the other
                                                │
    sync thread: fdatasync once a second; is the file still there?; ends the parts that are full

Writing goes to the memory of the kernel, which a killed process leaves behind: at most `GATHER_S` of what had been put
is lost with it. Waiting for the disk itself is for the other thread, so that a slow disk holds up nothing: what waits
is in `behind_s`. A part begins with everything that is known (devices, configurations), names its predecessor, and its
first chunk is the one that follows the predecessor's last.

When the disk fails the tape ends by itself: `trouble` says why, what was written until then is kept whole.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from recordings.mcap_writer import Direction, McapWriter, RecordingError

log = logging.getLogger("imuscope.tape")

GATHER_S = 0.008  # one write for what comes within; a killed process may lose 20 ms, 9 of them in its link
SYNC_S = 1.0
MOST_WAITING = 256 << 20  # bytes
HOLD_S = 0.05
_BATCH = 4096  # chunks written at once, so that a part ends near its size

Kind = Literal["chunk", "event", "note", "snapshot", "device", "split"]


@dataclass(frozen=True, slots=True)
class Limits:
    """When a part is full; 0 for never.

    Args:
        split_bytes: largest size of a part.
        split_s: longest duration of a part.
    """

    split_bytes: int = 0
    split_s: float = 0.0


@dataclass(slots=True)
class Preamble:
    """What every part begins with."""

    devices: dict[str, dict[str, Any]] = field(default_factory=dict)
    snapshots: dict[str, tuple[Mapping[str, Any], int]] = field(default_factory=dict)


class RecordingWriter:
    """One recording that is being made, in one part or several.

    Args:
        name: makes the path of part 1, 2, 3 …, whose file does not exist yet.
        about: the recording's own metadata; each part adds `part` and `previous`.
        now_ns: the clock in which chunks have their arrival.
        on_part: called (in a thread) with the path of each part that is finished.
        on_notice: called (in a thread) with a sentence about what others did to a file, and the recording survived.
        shift_ns: added to every time that is put, where the wall clock was set after `now_ns` began.
    Raises:
        RecordingError: the first part cannot be made.
    """

    def __init__(
        self,
        name: Callable[[int], Path],
        about: Mapping[str, Any],
        now_ns: Callable[[], int],
        limits: Limits = Limits(),
        on_part: Callable[[Path], None] = lambda path: None,
        on_notice: Callable[[str], None] = lambda text: None,
        shift_ns: int = 0,
    ) -> None:
        self._name = name
        self._about = dict(about)
        self._now_ns = now_ns
        self._limits = limits
        self._on_part = on_part
        self._on_notice = on_notice
        self.shift_ns = shift_ns
        self._shortened: McapWriter | None = None
        self._queue: deque[tuple[Any, ...]] = deque()
        self._wake = threading.Event()
        self._counting = threading.Lock()
        self._put_bytes = self._taken_bytes = 0
        self._stopping = False
        self._known = Preamble()
        self._full: deque[McapWriter] = deque()
        self._oldest_ns: int | None = None
        self._written = threading.Event()  # the writing thread is through
        self._sync_now = threading.Event()
        self._done_bytes = 0
        self._part = 0
        self._began_ns = 0
        self.trouble: RecordingError | None = None
        self._writer = self._next_part(None)
        self._threads = [
            threading.Thread(target=self._write_forever, name="recording", daemon=True),
            threading.Thread(target=self._sync_forever, name="recording to disk", daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    # ── in, from any thread ──────────────────────────────────────────────────────────────────────────────────────────

    def chunk(self, device: str, direction: Direction, data: bytes, arrival_ns: int) -> None:
        """Bytes that came or were sent. Never waits."""
        if self.trouble is not None:
            return
        with self._counting:
            self._put_bytes += len(data)
        self._queue.append(("chunk", arrival_ns + self.shift_ns, device, direction, data))
        if not self._wake.is_set():
            self._wake.set()

    def room(self) -> None:
        """Hold whoever puts back for a moment while too much waits: not in a thread that others wait for.

        What is put is never dropped. But a disk that is slower than a link for minutes must not fill the memory; held
        back, a link fills its own buffers, and TCP its sender's.
        """
        if self._put_bytes - self._taken_bytes > MOST_WAITING:
            time.sleep(HOLD_S)

    def event(self, event: Mapping[str, Any], time_ns: int) -> None:
        """Something that happened."""
        self._put("event", time_ns, event)

    def note(self, kind: Literal["marker", "note"], text: str, time_ns: int, device: str = "") -> None:
        """A marker or a sentence."""
        self._put("note", time_ns, kind, text, device)

    def snapshot(self, device: str, body: Mapping[str, Any], time_ns: int) -> None:
        """The configuration of a device."""
        self._put("snapshot", time_ns, device, body)

    def device(self, device: str, about: Mapping[str, Any]) -> None:
        """What is known about a device; what is told later adds to it."""
        self._put("device", self._now_ns(), device, dict(about))

    def set_clock(self, shift_ns: int) -> None:
        """The wall clock was set: go on in a new part, whose times follow it."""
        self.shift_ns = shift_ns
        self._put("split", self._now_ns())

    def _put(self, kind: Kind, time_ns: int, *what: Any) -> None:
        self._queue.append((kind, time_ns + self.shift_ns, *what))
        self._wake.set()

    # ── how it is ────────────────────────────────────────────────────────────────────────────────────────────────────

    @property
    def path(self) -> Path:
        """Of the part that is written now, or was last."""
        return self._writer.path

    @property
    def bytes(self) -> int:
        """Written so far, over all parts."""
        return self._done_bytes + self._writer.size

    @property
    def behind_s(self) -> float:
        """Age of the oldest of what waits."""
        oldest = self._oldest_ns
        if oldest is None:
            try:
                oldest = int(self._queue[0][1])
            except IndexError:
                return 0.0
        return max(0.0, (self._now_ns() + self.shift_ns - oldest) / 1e9)

    @property
    def running(self) -> bool:
        """False once it has been stopped, or has stopped by itself."""
        return not self._stopping and self.trouble is None

    def stop(self) -> None:
        """Write all that waits, end the file; returns when the disk has it."""
        self._stopping = True
        self._wake.set()
        self._sync_now.set()
        for thread in self._threads:
            thread.join()

    # ── the writing thread ───────────────────────────────────────────────────────────────────────────────────────────

    def _write_forever(self) -> None:
        try:
            while True:
                if not self._queue:  # while more comes all the time, sleeping is cheaper than being woken
                    self._wake.clear()
                    if not (self._queue or self._stopping or self.trouble):
                        self._wake.wait()
                if not self._stopping:
                    time.sleep(GATHER_S)
                while self._queue and self.trouble is None:
                    self._write_some()
                if self._stopping or self.trouble is not None:
                    return
        except RecordingError as error:
            self._fail(error)
        except Exception as error:  # the thread's top: a recording must never end without a word
            log.exception("recording failed")
            self._fail(RecordingError(f"A fault in imuscope ended the recording: {error}.", "The log has details."))
        finally:
            self._written.set()
            self._sync_now.set()

    def _fail(self, error: RecordingError) -> None:
        self.trouble = self.trouble or error
        self._wake.set()

    def _write_some(self) -> None:
        """The chunks up to the next other thing in one write; that one then."""
        if self._is_full():
            self._split()
        queue = self._queue
        self._oldest_ns = queue[0][1]  # what has been taken out waits, too
        chunks: list[tuple[str, Direction, bytes, int]] = []
        while queue and queue[0][0] == "chunk" and len(chunks) < _BATCH:
            _, time_ns, device, direction, data = queue.popleft()
            self._taken_bytes += len(data)
            chunks.append((device, direction, data, time_ns))
        if chunks:
            self._writer.chunks(chunks)
        else:
            self._write_one(queue.popleft())
        self._oldest_ns = None

    def _write_one(self, item: tuple[Any, ...]) -> None:
        kind, time_ns, *what = item
        match kind:
            case "split":
                self._split()
            case "event":
                self._writer.event(what[0], time_ns)
            case "note":
                self._writer.note(what[0], what[1], time_ns, what[2])
            case "snapshot":
                device, body = what
                self._known.snapshots[device] = (body, time_ns)
                self._writer.snapshot(device, body, time_ns)
            case "device":
                device, about = what
                told = self._known.devices.setdefault(device, {})
                if told | about != told:
                    told.update(about)
                    self._writer.device(device, told)

    # ── parts ────────────────────────────────────────────────────────────────────────────────────────────────────────

    def _is_full(self) -> bool:
        limits = self._limits
        if self._shortened is self._writer:
            return True
        if limits.split_bytes and self._writer.size >= limits.split_bytes:
            return True
        return bool(limits.split_s and self._now_ns() - self._began_ns >= limits.split_s * 1e9)

    def _split(self) -> None:
        """Go on in a new part; the one before is ended where nobody waits for it."""
        old = self._writer
        self._writer = self._next_part(old.path)
        self._done_bytes += old.size
        self._full.append(old)
        self._sync_now.set()

    def _next_part(self, previous: Path | None) -> McapWriter:
        self._part += 1
        path = self._name(self._part)
        self._began_ns = self._now_ns()
        about = {**self._about, "part": self._part, "previous": previous.stem if previous is not None else ""}
        writer = McapWriter(path, about)
        for device, told in self._known.devices.items():
            writer.device(device, told)
        for device, (body, time_ns) in self._known.snapshots.items():
            writer.snapshot(device, body, time_ns)
        return writer

    # ── the thread that waits for the disk ───────────────────────────────────────────────────────────────────────────

    def _sync_forever(self) -> None:
        while not self._written.is_set():
            self._sync_now.wait(SYNC_S)
            self._sync_now.clear()
            self._end(self._take_full())
            self._sync()
        self._end(self._take_full())
        self._end([self._writer])

    def _take_full(self) -> list[McapWriter]:
        found = []
        while self._full:
            found.append(self._full.popleft())
        return found

    def _end(self, parts: Iterable[McapWriter]) -> None:
        for part in parts:
            try:
                part.close()
            except RecordingError as error:
                self._fail(error)
                part.give_up()
            self._on_part(part.path)

    def _sync(self) -> None:
        writer = self._writer
        try:
            writer.sync()
        except RecordingError as error:
            if writer is self._writer and self.running:
                self._fail(error)
        if writer is not self._writer or not self.running:
            return
        if not writer.is_there():
            self._gone(writer)
        elif writer is not self._shortened and writer.is_shortened():
            self._cut_by_others(writer)

    def _gone(self, writer: McapWriter) -> None:
        """Its name is no more: removed, or moved. What is in it is put back where that is possible."""
        path = writer.path
        said = f"{path.name} was removed or moved while it was being recorded."
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            kept = _put_back(writer)
            where = "was put back" if kept == path else f"was put back as {kept.name}"
            self._fail(RecordingError(said, f"What had been recorded {where}; start anew to go on."))
        except OSError:
            self._fail(RecordingError(said, "It could not be put back. Is the folder still there?"))

    def _cut_by_others(self, writer: McapWriter) -> None:
        """Another program truncated the file: what comes goes into a new one, and what is left of this one stays."""
        self._shortened = writer
        self._on_notice(
            f"{writer.path.name} was shortened by another program while it was being recorded; "
            "the recording continues in a new file."
        )


def _put_back(writer: McapWriter) -> Path:
    """Write the file again under its own name, or under one like it where another file has taken that."""
    path, count = writer.path, 1
    while True:
        try:
            writer.copy_to(path)
            return path
        except FileExistsError:
            count += 1
            path = writer.path.with_name(f"{writer.path.stem}-{count}{writer.path.suffix}")
