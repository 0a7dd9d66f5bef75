"""Recording without a page: `imuscope record SOURCE … -o FILE.mcap [--duration S]`.

    $ imuscope record /dev/ttyUSB0 -o drive.mcap
    12.3 s, 1.24 MB, MTi-630, 400 samples/s                      (one line that is updated, on a terminal)
    ^C
    drive.mcap: 12.9 s, 1.30 MB of MTi-630, 0.9 MB on disk

It uses the link, decoder and recorder of the server; the decoder identifies the device and measures its rate, the file
contains its bytes. Ctrl-C, SIGTERM, SIGHUP or the end of a played file stop it. Without any data there is no file, and
the exit status is 1.
"""

import asyncio
import contextlib
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from imuscope.recordings.file_names import SUFFIX
from imuscope.recordings.mcap.compaction import compact
from imuscope.server import wire
from imuscope.server.configuration.controllers import ControllerRegistry
from imuscope.server.configuration.timings import ConfigurationTimings
from imuscope.server.devices.decode import protocol_set
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.decode.sequence_store import SequenceStore
from imuscope.server.devices.link.session import Session
from imuscope.server.devices.link.session_listeners import Direction
from imuscope.server.devices.link.sessions import Sessions
from imuscope.server.errors import UsageError
from imuscope.server.library.recorder import Recorder, RecordingOptions
from imuscope.server.links.base import Chunk, LinkSettings, steady_clock
from imuscope.server.links.source_url import open_link
from imuscope.server.streaming.telemetry import Telemetry
from imuscope.server.system.end_signals import end_signals, ending_by_exception
from imuscope.server.text.printable import json_text, printable

POLL_S = 0.25
MAX_MESSAGES = 20
QUIET_ROUNDS = 8  # without data, before the reason is printed


@dataclass(slots=True)
class RecordStatus:
    """Data received from the device so far."""

    size: int = 0
    first_ns: int = 0
    last_ns: int = 0
    is_over: bool = False

    def update(self, chunks: Sequence[Chunk], way: Direction) -> None:
        if way == "rx" and not self.is_over:
            self.first_ns = self.first_ns or chunks[0].arrival_ns
            self.last_ns = chunks[-1].arrival_ns
            self.size += sum(len(chunk.data) for chunk in chunks)

    @property
    def seconds(self) -> float:
        return (self.last_ns - self.first_ns) / 1e9


@dataclass(frozen=True, slots=True)
class RecordRequest:
    """Request for `imuscope record`.

    Args:
        sources: each with its decode options.
        duration_s: seconds of data; None to record until stopped.
        data: the data folder, for known settings of the device.
        patience_s: longest wait for the first byte; None to wait until stopped.
    """

    sources: tuple[tuple[str, DecodeOptions], ...]
    path: Path
    duration_s: float | None
    data: Path
    patience_s: float | None = None


def record(request: RecordRequest, notes: TextIO, *, as_json: bool = False) -> str:
    """Record until the end, then compact the file.

    Returns:
        A one-line summary, for people or as JSON.

    Raises:
        LinkError: the source is invalid.
        UsageError, RecordingError: nothing was recorded, or recording ended early.
    """
    if request.path.suffix != SUFFIX:
        raise UsageError(f"The name of a recording must end with {SUFFIX}; {request.path.name} does not.")
    if not request.path.parent.is_dir():
        raise UsageError(f"Folder not found: {request.path.parent}. Name another with -o.")
    status, name = asyncio.run(_record(request, notes))
    tty = notes.isatty()
    with ending_by_exception():  # it removes the packed copy, and the recording stays as it is
        compact(request.path, progress=(lambda share: _show(notes, f"packing {share:.0%}")) if tty else None)
    _show(notes, "")
    size = request.path.stat().st_size
    if as_json:
        body = {"file": str(request.path), "source": name, "seconds": status.seconds, "received_bytes": status.size}
        return json_text({**body, "bytes": size})
    return printable(f"{request.path}: {status.seconds:.1f} s, {amount(status.size)} of {name}, {amount(size)} on disk")


async def _record(request: RecordRequest, notes: TextIO) -> tuple[RecordStatus, str]:
    now_ns = steady_clock()
    bus = Telemetry.create(lambda: now_ns() / 1e9, history_s=1).bus
    sessions = Sessions(
        bus, open_link, protocol_set.all_protocols(), LinkSettings(now_ns=now_ns), sequences=SequenceStore(request.data)
    )
    controllers = ControllerRegistry(bus, sessions, request.data, ConfigurationTimings())
    recorder = Recorder(
        bus, sessions, controllers, RecordingOptions(request.path.parent, follow_clock=False), None, time.time_ns
    )
    status = RecordStatus()
    sessions.on_added(lambda session: _count_bytes(session, status))
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in end_signals():
        loop.add_signal_handler(number, ended.set)
    sessions.start()
    try:
        await recorder.start(title="", path=request.path)
        try:
            for source, reading in request.sources:
                sessions.add(source, reading)
            await _until_end(request, recorder, sessions.all, status, ended, notes)
            name = ", ".join(info.name for info in sessions.infos if info.last_arrival is not None)
            info = sessions.all[0].info
            why = f"{info.message} {info.hint}".strip()
        finally:
            status.is_over = True
            if recorder.state.running:
                await recorder.stop()
            if not status.size:
                with contextlib.suppress(OSError):
                    request.path.unlink()
    finally:
        await recorder.close()
        await sessions.close()
    state = recorder.state
    if state.message:
        raise UsageError(state.message, state.hint)
    if not status.size:
        result = "No data was received" + (", so nothing was recorded" if request.patience_s is None else "")
        raise UsageError(f"{result}. {why}")
    return status, name


def _count_bytes(session: Session, status: RecordStatus) -> None:
    session.listeners.chunks(status.update)


async def _until_end(
    request: RecordRequest,
    recorder: Recorder,
    sessions: list[Session],
    status: RecordStatus,
    ended: asyncio.Event,
    notes: TextIO,
) -> None:
    """Return when recording is stopped, its time is over, all files have ended, or the disk fails. Without a terminal,
    only the reason why a source is not live is printed, once.
    """
    printed_texts: set[str] = set()
    rounds = 0

    def print_status() -> None:
        if notes.isatty():
            _show(notes, progress(sessions, status, recorder.state))
            return
        if status.size or rounds < QUIET_ROUNDS:
            return
        for session in sessions:
            text = f"{session.info.message} {session.info.hint}".strip()
            if (
                session.info.status != "live"
                and text
                and text not in printed_texts
                and len(printed_texts) < MAX_MESSAGES
            ):
                printed_texts.add(text)
                print(f"imuscope: {printable(text)}", file=notes, flush=True)

    began = recorder.now()
    while not ended.is_set():
        wait_s = POLL_S
        if request.patience_s is not None and not status.first_ns:
            wait_s = min(wait_s, began + request.patience_s - recorder.now())
        if request.duration_s is not None and status.first_ns:
            wait_s = min(wait_s, status.first_ns / 1e9 + request.duration_s - recorder.now())
        if wait_s <= 0:
            return
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(wait_s):
                await ended.wait()
        if (
            all(one.info.status in ("ended", "idle") and not one.info.is_open for one in sessions)
            or not recorder.state.running
        ):
            return
        rounds += 1
        print_status()


def progress(sessions: Sequence[Session], status: RecordStatus, state: wire.RecorderState) -> str:
    parts = [f"{status.seconds:.1f} s", amount(state.bytes)]
    for session in sessions:
        info = session.info
        if info.status == "live":
            health = session.health(status.last_ns / 1e9)
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


def _show(notes: TextIO, text: str) -> None:
    """Show a line that is updated in place, on a terminal."""
    if notes.isatty():
        notes.write(f"\r\x1b[K{printable(text)}")
        notes.flush()
