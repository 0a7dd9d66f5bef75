"""Record without a page: `imuscope record SOURCE … -o FILE.mcap [--duration S]`.

    $ imuscope record /dev/ttyUSB0 -o drive.mcap
    12.3 s, 1.24 MB, MTi-630, 400 samples/s                      (one line that changes, on a terminal)
    ^C
    drive.mcap: 12.9 s, 1.30 MB of MTi-630, 0.9 MB on disk

The same link, decoder and recorder as of the server; the decoder tells who the device is and how it fares, the file
holds its bytes. Ctrl-C and SIGTERM end it; so does the end of a file that is played. Nothing came: no file, status 1.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from recordings.compaction import compact
from recordings.mcap_writer import SUFFIX, RecordingError
from server import wire
from server.configuration.controllers import ControllerRegistry
from server.devices import protocol_set
from server.devices.decode_options import DecodeOptions
from server.devices.sequence_store import SequenceStore
from server.devices.session import Session
from server.devices.sessions import Sessions
from server.library.recorder import Recorder, RecordingOptions
from server.links import open_link
from server.links.base import LinkSettings, steady_clock
from server.printable import printable
from server.streaming.hub import Hub

LOOK_S = 0.25
MOST_TOLD = 20
PATIENT_LOOKS = 8  # without a byte, before it is said what is waited for


class RecordError(Exception):
    """Why it came to nothing, or ended early, in one sentence."""


@dataclass(slots=True)
class RecordStatus:
    """What has come from the device."""

    size: int = 0
    first_ns: int = 0
    last_ns: int = 0
    over: bool = False

    def take(self, data: bytes, time_ns: int, way: str) -> None:
        if way == "rx" and not self.over:
            self.first_ns = self.first_ns or time_ns
            self.last_ns = time_ns
            self.size += len(data)

    @property
    def seconds(self) -> float:
        return (self.last_ns - self.first_ns) / 1e9


@dataclass(frozen=True, slots=True)
class RecordRequest:
    """What is to be recorded.

    Args:
        sources: and how each is read.
        duration_s: of what comes; None until somebody ends it.
        data: the data folder, for settings of the device that are known.
    """

    sources: tuple[tuple[str, DecodeOptions], ...]
    path: Path
    duration_s: float | None
    data: Path


def record(wish: RecordRequest, notes: TextIO) -> str:
    """Record until the end, then pack.

    Returns:
        What came of it, in a line.
    Raises:
        LinkError: the source is written wrongly.
        RecordError: nothing was recorded, or it ended before its time.
    """
    if wish.path.suffix != SUFFIX:
        raise RecordError(f"A recording is a file {SUFFIX}; {wish.path.name} is not.")
    if not wish.path.parent.is_dir():
        raise RecordError(f"There is no folder {wish.path.parent}; name another with -o.")
    try:
        heard, name = asyncio.run(_record(wish, notes))
        tty = notes.isatty()
        compact(wish.path, progress=(lambda share: _say(notes, f"packing {share:.0%}")) if tty else None)
    except RecordingError as error:
        raise RecordError(f"{error.message} {error.hint}".rstrip()) from None
    _say(notes, "")
    size = wish.path.stat().st_size
    return printable(f"{wish.path}: {heard.seconds:.1f} s, {amount(heard.size)} of {name}, {amount(size)} on disk")


async def _record(wish: RecordRequest, notes: TextIO) -> tuple[RecordStatus, str]:
    now_ns = steady_clock()
    hub = Hub(lambda: now_ns() / 1e9, history_s=1)
    sessions = Sessions(
        hub, open_link, protocol_set.speech(), LinkSettings(now_ns=now_ns), sequences=SequenceStore(wish.data)
    )
    desks = ControllerRegistry(hub, sessions, wish.data, 20)
    recorder = Recorder(
        hub, sessions, desks, RecordingOptions(wish.path.parent, follow_clock=False), None, time.time_ns
    )
    heard = RecordStatus()
    sessions.on_added(lambda session: _listen(session, heard))
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, ended.set)
    sessions.start()
    try:
        await recorder.start(title="", path=wish.path)
        try:
            for source, reading in wish.sources:
                sessions.add(source, reading)
            await _until_end(wish, recorder, sessions.all, heard, ended, notes)
            name = ", ".join(info.name for info in sessions.infos if info.last_arrival is not None)
            info = sessions.all[0].info
            why = f"{info.message} {info.hint}".strip()
        finally:
            heard.over = True
            if recorder.state.running:
                await recorder.stop()
            if not heard.size:
                with contextlib.suppress(OSError):
                    wish.path.unlink()
    finally:
        await recorder.close()
        await sessions.close()
    state = recorder.state
    if state.message:
        raise RecordError(f"{state.message} {state.hint}".rstrip())
    if not heard.size:
        raise RecordError(f"Nothing came, so nothing was recorded. {why}")
    return heard, name


def _listen(session: Session, heard: RecordStatus) -> None:
    session.chunks(heard.take)


async def _until_end(
    wish: RecordRequest,
    recorder: Recorder,
    sessions: list[Session],
    heard: RecordStatus,
    ended: asyncio.Event,
    notes: TextIO,
) -> None:
    """Return when somebody ends it, its time is over, every file is, or the disk fails. Without a terminal only what
    a source waits for is said, once."""
    told: set[str] = set()
    looks = 0

    def say() -> None:
        if notes.isatty():
            _say(notes, progress(sessions, heard, recorder.state))
            return
        if heard.size or looks < PATIENT_LOOKS:
            return
        for session in sessions:
            text = f"{session.info.message} {session.info.hint}".strip()
            if session.info.status != "live" and text and text not in told and len(told) < MOST_TOLD:
                told.add(text)
                print(f"imuscope: {printable(text)}", file=notes, flush=True)

    while not ended.is_set():
        left = LOOK_S
        if wish.duration_s is not None and heard.first_ns:
            left = min(left, heard.first_ns / 1e9 + wish.duration_s - recorder.now())
        if left <= 0:
            return
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(ended.wait(), left)
        if all(one.info.status in ("ended", "idle") for one in sessions) or not recorder.state.running:
            return
        looks += 1
        say()


def progress(sessions: Sequence[Session], heard: RecordStatus, state: wire.RecorderState) -> str:
    """How it goes, in a line."""
    parts = [f"{heard.seconds:.1f} s", amount(state.bytes)]
    for session in sessions:
        info = session.info
        if info.status == "live":
            health = session.health(heard.last_ns / 1e9)
            parts += [info.name, f"{health.rate:.0f} samples/s"]
            if health.lost:
                parts.append(f"{health.lost} lost")
        else:
            parts.append(info.message)
    if state.behind_s > 1:
        parts.append(f"the disk is {state.behind_s:.0f} s behind")
    return ", ".join(part for part in parts if part)


def amount(size: int) -> str:
    """912 B, 1.24 MB."""
    value, unit = float(size), "B"
    for unit in ("B", "kB", "MB", "GB"):  # noqa: B007 - the last one holds
        if value < 1000:
            break
        value /= 1000
    return f"{size} B" if unit == "B" else f"{value:.2f} {unit}"


def _say(notes: TextIO, text: str) -> None:
    """One line that changes."""
    if notes.isatty():
        notes.write(f"\r\x1b[K{printable(text)}")
        notes.flush()
