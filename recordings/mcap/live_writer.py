"""Recording writer: a queue and its threads, so that every chunk reaches the disk at once.

    any thread ──put──> queue (unbounded, never drops) ──> writer thread: one write for everything queued, at intervals
    memory of live links ─────────────────────────────────> the same thread, in machine code (direct_writer.py)
                                                                  │ a part is full, or old enough
                                                                  v
                                           part 1 │ part 2 │ part 3 …        consecutive files
                                                │
    sync thread: fdatasync once in `sync_s`; checks that the file still exists; finishes the parts that are full

Writes go to the kernel's memory, which survives a killed process: at most `TURN_S` of the received data is lost with
it. One wake-up serves all links whose memory can be shared; when all are silent, the next bytes wake the thread. Only
the sync thread waits for the disk, so that a slow disk delays nothing else: `behind_s` is the age of what waits. A
power cut loses what came after the last fdatasync: at most `sync_s` and the time that the disk takes, or, if that is
left to the system, what the kernel has not written by itself yet. A finished part is always forced to disk.

A part begins with all that is known (devices, configurations) and names its predecessor; its first chunk is the one
that follows the predecessor's last.

When the disk fails the recording ends by itself: `error` gives the cause; data written until then is kept.
"""

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from imuscope.protocols.messages.records import Definitions
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.mcap.direct_writer import DirectWriter
from imuscope.recordings.mcap.read_memory import NEVER_NS, ReadFollower
from imuscope.recordings.mcap.writer import Direction, McapWriter

log = logging.getLogger("imuscope.recording")

GATHER_S = 0.005  # between two writes, at least
TURN_S = 0.015  # between two writes from the memory of links; a killed process may lose 20 ms
TURNS_S = 1.0  # after which new links and the limits of a part are looked at
SYNC_S = 1.0
CHECK_S = 1.0  # at most, between two checks of the file
MAX_WAITING = 256 << 20  # bytes
HOLD_S = 0.05
_BATCH_CHUNKS = 4096  # chunks per write, so that a part ends near its size

Kind = Literal["chunks", "messages", "event", "note", "snapshot", "signals", "device", "gone", "split"]


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a part; 0 for none.

    Args:
        split_bytes: largest size of a part.
        split_s: longest duration of a part.
    """

    split_bytes: int = 0
    split_s: float = 0.0


@dataclass(slots=True)
class Preamble:
    """Metadata at the start of every part."""

    devices: dict[str, dict[str, Any]] = field(default_factory=dict)
    snapshots: dict[str, tuple[Mapping[str, Any], int]] = field(default_factory=dict)
    signals: dict[str, tuple[Mapping[str, Any], int]] = field(default_factory=dict)
    definitions: dict[str, Definitions] = field(default_factory=dict)
    gone: list[str] = field(default_factory=list)  # devices that the next part still names: it may begin with their end

    def leave_out(self, device: str) -> None:
        """Leave out a device that is gone, and those on its link."""
        for known in (self.snapshots, self.signals, self.definitions):
            _drop(known, device)
        self.gone.append(device)

    def begun(self) -> None:
        """Forget the devices that were gone before a part began."""
        for device in self.gone:
            _drop(self.devices, device)
        self.gone.clear()


def _drop(known: dict[str, Any], device: str) -> None:
    for one in [one for one in known if one.partition(".")[0] == device]:
        del known[one]


class RecordingWriter:
    """One recording in progress, in one part or several.

    Args:
        name: makes the path of part 1, 2, 3 …, which does not exist yet.
        about: the recording's own metadata; each part adds `part` and `previous`.
        now_ns: the clock of the chunks' arrival times.
        on_part: called (in a thread) with the path of each finished part.
        on_notice: called (in a thread) with a sentence about another program's change to a file.
        shift_ns: added to every time given, if the wall clock was set after `now_ns` began.
        sync_s: time between two fdatasyncs of an unfinished part; 0 to leave writing to the system.

    Attributes:
        follow: called (in the writer's thread) about once a second: devices and their links' memory from now on.

    Raises:
        RecordingError: the first part cannot be created.
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
        sync_s: float = SYNC_S,
    ) -> None:
        self._name = name
        self._header = dict(about)
        self._now_ns = now_ns
        self._limits = limits
        self._on_part = on_part
        self._on_notice = on_notice
        self.shift_ns = shift_ns
        self.sync_s = sync_s
        self.follow: Callable[[], Iterable[tuple[str, ReadFollower]]] = tuple
        self._direct = DirectWriter()
        self._shortened: McapWriter | None = None
        self._queue: deque[tuple[Any, ...]] = deque()
        self._wake_event = threading.Event()
        self._counting = threading.Lock()
        self._queued_bytes = self._written_bytes = 0
        self._stopping = False
        self._preambles = Preamble()
        self._full: deque[McapWriter] = deque()
        self._oldest_ns: int | None = None
        self._written = threading.Event()  # set when the writer thread has finished
        self._sync_now = threading.Event()
        self._done_bytes = 0
        self._part = 0
        self._began_ns = 0
        self.error: RecordingError | None = None
        self._writer = self._next_part(None)
        self._threads = [
            threading.Thread(target=self._write_forever, name="recording", daemon=True),
            threading.Thread(target=self._sync_forever, name="recording to disk", daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    # ── input, from any thread ───────────────────────────────────────────────────────────────────────────────────────

    def chunk(self, device: str, direction: Direction, data: bytes, arrival_ns: int) -> None:
        """Queue bytes received or sent. Never waits."""
        self.chunks(device, direction, ((data, arrival_ns),))

    def chunks(
        self, device: str, direction: Direction, chunks: Sequence[tuple[bytes, int]], *, late: bool = False
    ) -> None:
        """Queue chunks, at least one: (bytes, arrival in ns) each. Never waits.

        Args:
            late: they arrived before the recording began, so their age is not a delay of the disk.
        """
        if self.error is not None:
            return
        size = 0
        for data, _ in chunks:
            size += len(data)
        with self._counting:
            self._queued_bytes += size
        shift_ns = self.shift_ns
        if shift_ns:
            chunks = [(data, arrival_ns + shift_ns) for data, arrival_ns in chunks]
        queued_ns = self._now_ns() + shift_ns if late else chunks[0][1]
        self._queue.append(("chunks", queued_ns, device, direction, chunks, size))
        self._wake()

    def messages(self, device: str, chunks: Sequence[tuple[bytes, int]], *, late: bool = False) -> None:
        """Queue messages received from a device; see McapWriter.messages, and `chunks`. Never waits."""
        if self.error is not None:
            return
        size = sum(len(data) for data, _ in chunks)
        with self._counting:
            self._queued_bytes += size
        queued_ns = self._now_ns() if late else chunks[0][1]
        self._put("messages", queued_ns, device, [(data, time + self.shift_ns) for data, time in chunks], size)

    def room(self) -> None:
        """Delay the caller briefly while too much is queued; not for a thread that others wait for.

        Queued data is never dropped. But a disk that is slower than a link for minutes must not fill the memory; when
        delayed, a link fills its own buffers, and TCP its sender's.
        """
        is_too_much = self._queued_bytes - self._written_bytes > MAX_WAITING
        if is_too_much and threading.current_thread() is not self._threads[0]:
            time.sleep(HOLD_S)

    def event(self, event: Mapping[str, Any], time_ns: int) -> None:
        self._put("event", time_ns, event)

    def note(self, kind: Literal["marker", "note"], text: str, time_ns: int, device: str = "") -> None:
        """Queue a marker or a note."""
        self._put("note", time_ns, kind, text, device)

    def snapshot(self, device: str, body: Mapping[str, Any], time_ns: int) -> None:
        """Queue the configuration of a device."""
        self._put("snapshot", time_ns, device, body)

    def computed_signals(self, device: str, body: Mapping[str, Any], time_ns: int) -> None:
        """Queue the definitions of the computed signals of a device."""
        self._put("signals", time_ns, device, body)

    def device(self, device: str, about: Mapping[str, Any]) -> None:
        """Add to the metadata of a device."""
        self._put("device", self._now_ns(), device, dict(about))

    def forget(self, device: str) -> None:
        """Leave a device that is gone, and those on its link, out of the metadata of later parts."""
        self._put("gone", self._now_ns(), device)

    def set_clock(self, shift_ns: int) -> None:
        """Continue in a new part after the wall clock was set; its times follow the new clock."""
        self.shift_ns = shift_ns
        self._put("split", self._now_ns())

    def _put(self, kind: Kind, time_ns: int, *what: Any) -> None:
        self._queue.append((kind, time_ns + self.shift_ns, *what))
        self._wake()

    def _wake(self) -> None:
        self._direct.stop_flag[0] = 1
        if not self._wake_event.is_set():
            self._wake_event.set()

    # ── state ────────────────────────────────────────────────────────────────────────────────────────────────────────

    @property
    def path(self) -> Path:
        """Path of the current or last part."""
        return self._writer.path

    @property
    def bytes(self) -> int:
        """Bytes written so far, over all parts."""
        return self._done_bytes + self._writer.size + self._direct.written

    @property
    def behind_s(self) -> float:
        """Age of the oldest queued item."""
        oldest = self._oldest_ns
        if oldest is None:
            try:
                oldest = int(self._queue[0][1])
            except IndexError:
                oldest = NEVER_NS
        oldest = min(oldest, self._direct.oldest_ns + self.shift_ns + round(TURN_S * 1e9))
        return max(0.0, (self._now_ns() + self.shift_ns - oldest) / 1e9)

    @property
    def running(self) -> bool:
        """False once it has been stopped, or has ended by itself."""
        return not self._stopping and self.error is None

    def stop(self) -> None:
        """Write everything queued and finish the file; returns when it is on disk."""
        self._stopping = True
        self._wake()
        self._sync_now.set()
        for thread in self._threads:
            thread.join()

    # ── the writer thread ────────────────────────────────────────────────────────────────────────────────────────────

    def _write_forever(self) -> None:
        due = 0.0
        is_busy = False
        try:
            while True:
                if not (self._queue or is_busy):
                    self._wake_event.clear()
                    if not (self._queue or self._stopping or self.error) and self._direct.sleep():
                        self._wake_event.wait()
                if not self._stopping and (wait := due - time.monotonic()) > 0:
                    time.sleep(wait)
                due = time.monotonic() + GATHER_S
                self._direct.stop_flag[0] = 0
                for device, follower in self.follow():
                    follower.wake = self._wake
                    self._direct.add(device, follower)
                while self._queue and self.error is None:
                    self._write_some()
                is_busy = bool(self._direct) and self.error is None and self._write_direct()
                has_all = not self._queue and self._direct.oldest_ns == NEVER_NS
                if (self._stopping and has_all) or self.error is not None:
                    return
        except RecordingError as error:
            self._fail(error)
        except Exception as error:  # the thread's top: the end of a recording must always be reported
            log.exception("recording failed")
            self._fail(RecordingError(f"A fault in imuscope ended the recording: {error}.", "The log has details."))
        finally:
            self._written.set()
            self._sync_now.set()

    def _fail(self, error: RecordingError) -> None:
        self.error = self.error or error
        self._wake_event.set()

    def _write_direct(self) -> bool:
        """Write from the memory of links for a while; whether anything came lately."""
        if self._is_full():
            self._split()
        split_bytes, split_s = self._limits.split_bytes, self._limits.split_s
        most = split_bytes - self._writer.size if split_bytes else NEVER_NS
        longest_s = 0.0 if self._stopping else min(TURNS_S, split_s or TURNS_S)
        turn_ns = round(TURN_S * 1e9)
        return self._direct.write(self._writer, self.shift_ns, turn_ns, round(longest_s * 1e9), most)

    def _write_some(self) -> None:
        """Write the chunks up to the next other item at once, then that item."""
        if self._is_full():
            self._split()
        queue = self._queue
        self._oldest_ns = queue[0][1]  # items taken out are still waiting
        runs: list[tuple[str, Direction, Sequence[tuple[bytes, int]]]] = []
        count = 0
        while queue and queue[0][0] == "chunks" and count < _BATCH_CHUNKS:
            _, _, device, direction, chunks, size = queue.popleft()
            self._written_bytes += size
            count += len(chunks)
            runs.append((device, direction, chunks))
        if runs:
            self._writer.runs(runs)
        else:
            self._write_one(queue.popleft())
        self._oldest_ns = None

    def _write_one(self, item: tuple[Any, ...]) -> None:
        kind, time_ns, *what = item
        match kind:
            case "split":
                self._split()
            case "messages":
                self._written_bytes += what[2]
                self._writer.messages(what[0], what[1])
            case "event":
                self._writer.event(what[0], time_ns)
            case "note":
                self._writer.write_note(what[0], what[1], time_ns, what[2])
            case "snapshot":
                device, body = what
                self._preambles.snapshots[device] = (body, time_ns)
                self._writer.snapshot(device, body, time_ns)
            case "signals":
                device, body = what
                self._preambles.signals[device] = (body, time_ns)
                self._writer.computed_signals(device, body, time_ns)
            case "device":
                device, about = what
                known = self._preambles.devices.setdefault(device, {})
                if known | about != known:
                    known.update(about)
                    self._writer.device(device, known)
            case "gone":
                self._preambles.leave_out(what[0])

    # ── parts ────────────────────────────────────────────────────────────────────────────────────────────────────────

    def _is_full(self) -> bool:
        limits = self._limits
        if self._shortened is self._writer:
            return True
        if limits.split_bytes and self._writer.size >= limits.split_bytes:
            return True
        return bool(limits.split_s and self._now_ns() - self._began_ns >= limits.split_s * 1e9)

    def _split(self) -> None:
        """Continue in a new part; the sync thread finishes the one before."""
        old = self._writer
        self._writer = self._next_part(old.path)
        self._done_bytes += old.size
        self._full.append(old)
        self._sync_now.set()

    def _next_part(self, previous: Path | None) -> McapWriter:
        self._part += 1
        path = self._name(self._part)
        self._began_ns = self._now_ns()
        about = {**self._header, "part": self._part, "previous": previous.stem if previous is not None else ""}
        writer = McapWriter(path, about, self._preambles.definitions)
        for device, known in self._preambles.devices.items():
            writer.device(device, known)
        for device, (body, time_ns) in self._preambles.snapshots.items():
            writer.snapshot(device, body, time_ns)
        for device, (body, time_ns) in self._preambles.signals.items():
            writer.computed_signals(device, body, time_ns)
        self._preambles.begun()
        return writer

    # ── the sync thread ──────────────────────────────────────────────────────────────────────────────────────────────

    def _sync_forever(self) -> None:
        period = self.sync_s or math.inf
        due = time.monotonic() + period
        while not self._written.is_set():
            self._sync_now.wait(min(CHECK_S, max(0.0, due - time.monotonic())))
            self._sync_now.clear()
            self._end(self._take_full())
            if time.monotonic() >= due:
                self._sync()
                due = time.monotonic() + period
            self._check()
        self._end(self._take_full())
        self._end([self._writer])

    def _take_full(self) -> list[McapWriter]:
        blocks = []
        while self._full:
            blocks.append(self._full.popleft())
        return blocks

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

    def _check(self) -> None:
        """Look after the file, which another program may have removed or cut."""
        writer = self._writer
        if writer is not self._writer or not self.running:
            return
        if not writer.is_there():
            self._file_lost(writer)
        elif writer is not self._shortened and writer.is_shortened():
            self._cut_by_others(writer)

    def _file_lost(self, writer: McapWriter) -> None:
        """Handle a removed or moved file: put its contents back where possible."""
        path = writer.path
        cause = f"{path.name} was removed or moved while it was being recorded."
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            restored = _put_back(writer)
            where = "was put back" if restored == path else f"was put back as {restored.name}"
            self._fail(RecordingError(cause, f"The recorded part {where}; start a new recording to go on."))
        except OSError:
            self._fail(RecordingError(cause, "It could not be put back. Is the folder still there?"))

    def _cut_by_others(self, writer: McapWriter) -> None:
        """Handle a file truncated by another program: new data goes to a new file, and the rest of this one stays."""
        self._shortened = writer
        self._on_notice(
            f"{writer.path.name} was shortened by another program while it was being recorded; "
            "the recording continues in a new file."
        )


def _put_back(writer: McapWriter) -> Path:
    """Write the file again under its own name, or under a similar one if that is taken."""
    path, count = writer.path, 1
    while True:
        try:
            writer.copy_to(path)
            return path
        except FileExistsError:
            count += 1
            path = writer.path.with_name(f"{writer.path.stem}-{count}{writer.path.suffix}")
