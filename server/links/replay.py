"""Replay of a recording as if its devices were connected: the same bytes with their original timing.

    drive.mcap                                    the only device of a recording
    drive.mcap?device=2&speed=4&loop=1            one of several, four times as fast, repeated
    drive.mcap?from=12.5&to=20                    a time range, seconds from its beginning

Each device of a file is a separate link (`split_devices`); links opened together stay synchronised, because they start
at the same time of the same clock. Any importable file is played this way if a time range or device is given;
otherwise a capture without times is played by its device's own clock (server/links/capture_file.py).
"""

import asyncio
import os
import stat
import threading
from pathlib import Path
from urllib.parse import quote

from imuscope.protocols.messages.family import NAME as MESSAGES
from imuscope.protocols.registry.families import OF_FILES
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.mcap.records import MAGIC
from imuscope.recordings.mcap.writer import is_simulated
from imuscope.recordings.replay import ReplayClock
from imuscope.server.links.base import Chunk, LinkError, LinkSettings, Progress
from imuscope.server.links.capture_file import FULL_BYTES, SPEED_RANGE, FileLink
from imuscope.server.links.played_file import PlayedFile
from imuscope.server.links.reader_thread import ChunkQueue
from imuscope.server.links.source_url import SourceUrl, bad
from imuscope.server.links.text import progress_line

TOGETHER_NS = 1_000_000_000  # links of one file opened within this time start together
LONGEST_S = 1e7
DESCRIBE_NS = 2_000_000_000  # between two definitions of the channels of messages, for a decoder that starts later
OPTIONS = ("speed", "loop", "device", "from", "to")

_began: dict[tuple[str, float, bool, float, float], int] = {}  # file and options → start time


def is_recording(place: str) -> bool:
    """Whether this is an MCAP file."""
    try:
        if not stat.S_ISREG(os.stat(place).st_mode):
            return False  # opening a pipe waits for its writer
        with open(place, "rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except (OSError, ValueError):
        return False


async def split_devices(text: str) -> list[str]:
    """One source for each device of a recording; any other source unchanged."""
    try:
        source = SourceUrl.parse(text)
    except LinkError:
        return [text]
    if source.kind != "file" or "device" in source.options or not is_recording(source.place):
        return [text]
    try:
        file = await _opened(Path(source.place))
    except (RecordingError, OSError):
        return [text]
    devices = file.devices
    await file.end()
    if len(devices) < 2:
        return [text]
    options = [f"{name}={value}" for name, value in source.options.items()]
    sources = []
    for device in devices.values():
        mine = [*options, f"device={quote(device.id)}"]
        if device.protocol and "protocol" not in source.options:
            mine.append(f"protocol={device.protocol}")
        sources.append(f"{source.place}?{'&'.join(mine)}")
    return sources


async def _opened(path: Path, protocol: str = "") -> PlayedFile:
    """A file in a process of its own. RecordingError, OSError: it cannot be read."""
    file = await PlayedFile.start(path)
    try:
        await asyncio.to_thread(file.open, protocol)
    except BaseException:
        await file.end()
        raise
    return file


class ReplayLink(FileLink):
    """One device of a recording.

    Args:
        device: of the file; "" for the only one.
        begin_s, end_s: time range, seconds from the beginning of the file.
    """

    def __init__(self, source: str, settings: LinkSettings, parsed: SourceUrl) -> None:
        speed = parsed.number("speed", 1, *SPEED_RANGE)
        super().__init__(source, settings, parsed.place, speed, parsed.switch("loop"))
        self.device = parsed.options.get("device", "")
        self.begin_s = parsed.number("from", 0, 0, LONGEST_S, "s")
        self.end_s = parsed.number("to", LONGEST_S, 0, LONGEST_S, "s")
        self._file: PlayedFile | None = None
        if self.end_s <= self.begin_s:
            raise bad(source, f"it would end ({self.end_s:g} s) before it begins ({self.begin_s:g} s)")

    async def open(self, progress: Progress | None = None) -> None:
        await self.close()
        self._head()  # raises a LinkError with the reason if it cannot be read
        try:
            self._file = file = await _opened(self.path, self.settings.protocol)
        except RecordingError as error:
            raise LinkError("refused", error.message, error.hint or "Give another recording.") from None
        except OSError as error:
            words = (error.strerror or str(error)).lower()
            raise LinkError("refused", f"No process can be started for the file: {words}.", "Try again.") from None
        try:
            await self._start(file, progress)
        except BaseException:
            await self.close()
            raise

    async def _start(self, file: PlayedFile, progress: Progress | None) -> None:
        span = file.span
        if span is None:
            raise LinkError("ended", f"{self.path.name} holds no bytes of a device.", "Give another recording.")
        device = self._chosen(file)
        if (known := file.devices.get(device)) is not None:
            self.is_simulated = is_simulated(known.identity)
        if known is not None and known.protocol in (MESSAGES, *OF_FILES):
            self.protocol = known.protocol
        if self.protocol == MESSAGES:
            self.preamble = file.preamble(device)
        progress_line(progress, self.path.name, f"{(span[1] - span[0]) / 1e9:.1f} s of device {device}")
        self.notices = [damage.words for damage in file.damage[:1]]
        self._stop.clear()
        self._queue = ChunkQueue(self)
        replay = await asyncio.to_thread(
            ReplayClock,
            file,
            self.settings.now_ns,
            speed=self.speed,
            loop=self.loop,
            start_ns=span[0] + round(self.begin_s * 1e9),
            stop_ns=min(span[1] + 1, span[0] + round(self.end_s * 1e9)),
            devices=[device],
            began_ns=self._together(),
        )
        arguments = (self._queue, replay)
        self._thread = threading.Thread(target=self._play, args=arguments, name=f"link {self.source}", daemon=True)
        self._thread.start()

    async def close(self) -> None:
        self._stop.set()
        file, self._file = self._file, None
        if file is not None:
            file.cut()
        await super().close()
        if file is not None:
            await file.end()

    def _chosen(self, file: PlayedFile) -> str:
        """Device whose bytes are replayed."""
        known = list(file.devices)
        if not self.device and len(known) > 1:
            hint = f"Choose one with ?device=; available: {', '.join(known)}."
            raise LinkError("bad-source", f"{self.path.name} holds {len(known)} devices.", hint)
        if self.device and known and self.device not in known:
            raise LinkError("bad-source", f"{self.path.name} holds no device {self.device!r}.", f"It has: {known}.")
        return self.device or (known[0] if known else "1")

    def _together(self) -> int:
        """Start time, shared with other replays of the same file that have just started."""
        what = (str(self.path), self.speed, self.loop, self.begin_s, self.end_s)
        now = self.settings.now_ns()
        began = _began.get(what, 0)
        if not 0 <= now - began < TOGETHER_NS:
            began = now
        _began.clear()  # older entries are not needed
        _began[what] = began
        return began

    def _play(self, inbox: ChunkQueue, replay: ReplayClock) -> None:
        wait_for = self._wait_for(inbox)
        describe_ns = 0
        try:
            while not self._stop.is_set():
                for one in replay.due_chunks():
                    now_ns = self.settings.now_ns()
                    data = one.data
                    if self.preamble and (one.restart or now_ns >= describe_ns):
                        data, describe_ns = self.preamble + data, now_ns + DESCRIBE_NS
                    inbox.put(Chunk(data, now_ns, one.restart))
                inbox.flush()
                inbox.wait(FULL_BYTES, self._stop.wait)
                wait_ns = replay.wait_ns()
                if wait_ns is None:
                    ended = f"{self.path.name} has been played to its end."
                    inbox.fail(LinkError("ended", ended, "Play again, or add ?loop=1 to repeat."))
                    return
                if wait_for(wait_ns / 1e9):
                    return
        except RecordingError as error:
            inbox.fail(LinkError("gone", error.message, error.hint or "Give another recording."))
