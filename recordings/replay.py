"""Replay clock: the chunks that are due now. Time is passed in.

    clock = ReplayClock(source, now_ns)                  at the beginning, playing
    clock.due_chunks()                                   chunks that are due, oldest first
    clock.wait_ns()                                      until the next; None: paused, or at the end
    clock.pause()  .play()  .seek(ns)  .speed = 4

    recorded   a────b──c─────────d        a chunk is due when the clock has advanced, times the speed,
    clock      └ speed 2: a──b─c────d     as far as the recording

Several devices of a file play in step, because one clock drives them all; the bytes of each device come in file order.
A recorded time that runs backwards counts as the one before it. Within a range the replay begins at its start and stops
at its end, or starts over (`loop`): the first chunks of each turn are `restart`.

Pure: no thread, no sleep. Memory is bounded by one part of the file (recordings/sources.py) of each device.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from imuscope.recordings.sources import ChunkBlock, Source

TURN_NS = 100_000_000  # between two turns of a loop: plot lines break there


@dataclass(frozen=True, slots=True)
class ReplayedChunk:
    """A chunk that is due.

    Args:
        time_ns: recorded time.
        restart: the first of its device in a new turn, or after a jump: it does not continue earlier chunks.
    """

    device: str
    direction: Literal["rx", "tx"]
    data: bytes
    time_ns: int
    restart: bool = False


class ReplayClock:
    """One recording being played.

    Args:
        source: the file.
        now_ns: a clock that does not step.
        speed: 2 plays twice as fast.
        start_ns, stop_ns: the range, in recorded time; None for the beginning, the end.
        devices: devices to play; None for all.
        ways: "rx" bytes received from a device, "tx" bytes sent to it.
        began_ns: clock time of the beginning, to keep step with other replays; None: now.
    """

    def __init__(
        self,
        source: Source,
        now_ns: Callable[[], int],
        *,
        speed: float = 1.0,
        loop: bool = False,
        start_ns: int | None = None,
        stop_ns: int | None = None,
        devices: Sequence[str] | None = None,
        ways: Sequence[str] = ("rx",),
        began_ns: int | None = None,
    ) -> None:
        self._source = source
        self._now_ns = now_ns
        self._speed = speed
        self.loop = loop
        self._start_ns, self._stop_ns = start_ns, stop_ns
        self._devices = devices
        self._directions = ways
        self._next: ReplayedChunk | None = None
        self._fresh: set[str] = set()  # devices with a chunk since the last jump
        self._jumped = False
        self._paused = False
        self._clock_ns = now_ns() if began_ns is None else began_ns  # the clock was here …
        self._at_ns: int | None = None  # … when the recording was here; None before the first chunk
        self._chunks = self._from(start_ns)
        self._advance()

    # ── playback ─────────────────────────────────────────────────────────────────────────────────────────────────────

    @property
    def has_ended(self) -> bool:
        """Whether nothing is left to play."""
        return self._next is None

    @property
    def position_ns(self) -> int | None:
        """Current recorded time of the replay; None if the recording is empty."""
        if self._at_ns is None or self._paused:
            return self._at_ns
        return self._at_ns + round((self._now_ns() - self._clock_ns) * self._speed)

    @property
    def speed(self) -> float:
        return self._speed

    @speed.setter
    def speed(self, speed: float) -> None:
        self._anchor()
        self._speed = speed

    def pause(self) -> None:
        """Hold the current position."""
        self._anchor()
        self._paused = True

    def play(self) -> None:
        """Continue from the current position."""
        if self._paused:
            self._clock_ns = self._now_ns()
            self._paused = False

    def seek(self, time_ns: int) -> None:
        """Continue from another moment; chunks due before it are skipped."""
        self._begin(time_ns)
        if self._next is not None:
            self._at_ns = time_ns

    def note_stall(self) -> None:
        """Report that the consumer was held up, so that the time does not count. Call it after the last
        `due_chunks`.
        """
        if self._next is not None and self._at_ns is not None:
            position = self.position_ns
            assert position is not None
            self._at_ns = min(position, self._next.time_ns)
            self._clock_ns = self._now_ns()

    def _anchor(self) -> None:
        self._at_ns = self.position_ns
        self._clock_ns = self._now_ns()

    # ── chunks ───────────────────────────────────────────────────────────────────────────────────────────────────────

    def due_chunks(self, most: int = 4096) -> list[ReplayedChunk]:
        """Chunks that are due, oldest first, up to a limit."""
        chunks: list[ReplayedChunk] = []
        position = self.position_ns
        if self._paused or position is None:
            return chunks
        while (one := self._next) is not None and one.time_ns <= position and len(chunks) < most:
            chunks.append(one)
            self._advance()
        if chunks and self.has_ended and self.loop:
            self._loop(chunks[-1].time_ns)
        return chunks

    def wait_ns(self) -> int | None:
        """Time until the next chunk is due, 0 if one is; None while paused or at the end."""
        position = self.position_ns
        if self._paused or self._next is None or position is None:
            return None
        return max(0, round((self._next.time_ns - position) / self._speed))

    def _loop(self, last_ns: int) -> None:
        """Start over when the range ends, even if this device has nothing more in it earlier."""
        assert self._at_ns is not None
        end_ns = max(last_ns, self._stop_ns if self._stop_ns is not None else last_ns)
        over_ns = self._clock_ns + round((end_ns - self._at_ns) / self._speed)
        self._begin(self._start_ns)
        self._clock_ns = over_ns + TURN_NS

    def _begin(self, time_ns: int | None) -> None:
        self._chunks = self._from(time_ns)
        self._jumped, self._fresh = True, set()
        self._at_ns = None
        self._clock_ns = self._now_ns()
        self._advance()

    def _advance(self) -> None:
        self._next = next(self._chunks, None)
        if self._next is not None and self._at_ns is None:
            # In step with replays of other devices of the same range: the range's own start leads, if given.
            self._at_ns = self._next.time_ns if self._start_ns is None else min(self._start_ns, self._next.time_ns)

    def _from(self, start_ns: int | None) -> Iterator[ReplayedChunk]:
        """The chunks of the range from a moment on, in arrival order."""
        low = start_ns if start_ns is not None else -(1 << 62)
        high = self._stop_ns if self._stop_ns is not None else 1 << 62
        for parts in _blocks(self._source.parts(start_ns, self._stop_ns)):
            selected = [part for part in parts if part.direction in self._directions and self._is_selected(part.device)]
            for part, first, end, time in _merged(selected):
                if low <= time < high:
                    restart = self._jumped and part.device not in self._fresh
                    self._fresh.add(part.device)
                    yield ReplayedChunk(part.device, part.direction, part.data[first:end], time, restart)

    def _is_selected(self, device: str) -> bool:
        return self._devices is None or device in self._devices


def extent(source: Source) -> tuple[int, int] | None:
    """Times of the first and last chunk of a file, ns; None if it has none."""
    first = last = None
    if indexed := getattr(source, "indexed", ()):
        for parts in _blocks(source.parts()):
            first = min(int(part.times[0]) for part in parts)
            break
        ends = sorted(indexed, reverse=True)
        for end in ends:  # the last block that holds chunks
            times = [int(part.times.max()) for part in source.parts(end, None)]
            if times:
                last = max(times)
                break
    else:
        for part in source.parts():
            first = int(part.times[0]) if first is None else min(first, int(part.times[0]))
            last = int(part.times.max()) if last is None else max(last, int(part.times.max()))
    return (first, last) if first is not None and last is not None else None


def _blocks(parts: Iterator[ChunkBlock]) -> Iterator[list[ChunkBlock]]:
    """Group the parts that were read together."""
    block: list[ChunkBlock] = []
    for part in parts:
        if block and part.done != block[0].done:
            yield block
            block = []
        block.append(part)
    if block:
        yield block


def _merged(parts: list[ChunkBlock]) -> Iterator[tuple[ChunkBlock, int, int, int]]:
    """(part, start, end, time) of the chunks of several parts, by time; in order within a part."""
    if not parts:
        return
    times = [np.maximum.accumulate(part.times) for part in parts]
    which = np.repeat(np.arange(len(parts)), [len(one) for one in times])
    every = np.concatenate(times)
    ends = np.concatenate([part.ends for part in parts])
    starts = np.concatenate([np.concatenate(([0], part.ends[:-1])) for part in parts])
    order = np.argsort(every, kind="stable")
    columns = (which[order].tolist(), starts[order].tolist(), ends[order].tolist(), every[order].tolist())
    for number, start, end, time in zip(*columns, strict=True):
        yield parts[number], start, end, time
