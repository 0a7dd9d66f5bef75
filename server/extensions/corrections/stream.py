"""Forwarding of corrections from a caster, a network address or a file, in whole messages, to a receiver.

    ntrip://user:password@host:2101/MOUNT ──┐
    tcp://host:port                       ──┼─> RtcmFramer ── whole RTCM 3 messages, CRC checked ──> session.send
    a file, with its original timing      ──┘                                              MTi: in ForwardGnssData
                                                                                           IMX, GPX: unchanged

A stream that ends is opened again after 1 s, then with doubled delays up to a minute. Forwarded messages are counted by
number; invalid data and messages that the device rejects are counted too. `age_s` is the age of the last message that
the device received, for display. The device's log has the start and end of the stream (correction_log.py).

A virtual reference station needs the position of the receiver. The position that the device reports (a GGA sentence, or
a position in its own protocol) is sent to the caster when the stream begins and every `REPORT_S` after that.

The password is a secret: no answer, event or log contains it.
"""

import asyncio
import contextlib
import logging
import time
from collections import deque
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Protocol
from urllib.parse import unquote, urlsplit

from imuscope.protocols.embedded.nmea import sentence
from imuscope.protocols.embedded.rtcm import RtcmFramer, epoch_ms
from imuscope.protocols.events import Event, Reply
from imuscope.protocols.family.info import CorrectionInput, PositionFix
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.server.concurrency.backoff import Backoff
from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.configuration.api_models import Corrections
from imuscope.server.devices.device.position_tracker import PositionTracker
from imuscope.server.extensions.corrections.log import CorrectionLog, LogSink, ignore
from imuscope.server.extensions.corrections.ntrip import (
    CONNECT_S,
    READ_BYTES,
    TRIED,
    Caster,
    CasterStream,
    CorrectionError,
    connect,
)
from imuscope.server.links.base import LinkError
from imuscope.server.links.source_url import is_host, is_printable
from imuscope.server.wire import DeviceInfo

log = logging.getLogger("imuscope.corrections")

FIRST_RETRY_S, LAST_RETRY_S = 1.0, 60.0
SILENT_S = 60.0  # reconnect to a caster that sends nothing for this long
REPORT_S = 10.0
RATE_S = 10.0  # averaging time of bytes/s
ANSWER_S = 1.0  # an error this soon after a message is taken as its answer
FILE_GAP_S = 10.0  # a longer pause in a file is cut to this
UNTIMED_S = 0.2  # between the messages of a file without times
HINT = "Corrections come from ntrip://user:password@host:2101/MOUNT, tcp://host:port, or a file."


class CorrectionTarget(Protocol):
    """Session interface that a correction stream uses."""

    @property
    def info(self) -> DeviceInfo: ...

    @property
    def address(self) -> int | None: ...

    async def send(self, data: bytes) -> int | None: ...

    async def wait_idle(self) -> None: ...

    def listen(self, callback: Callable[[Event], None]) -> Callable[[], None]: ...


class CorrectionSource(Protocol):
    """Interface of sources of corrections, such as an NTRIP caster."""

    async def open(self, gga: bytes) -> None: ...

    def chunks(self) -> AsyncIterator[bytes]: ...

    async def report(self, gga: bytes) -> None: ...

    async def close(self) -> None: ...


class _Caster:
    def __init__(self, caster: Caster) -> None:
        self._caster = caster
        self._stream: CasterStream | None = None

    async def open(self, gga: bytes) -> None:
        self._stream = await connect(self._caster, gga)

    async def chunks(self) -> AsyncIterator[bytes]:
        assert self._stream is not None
        async for data in self._stream.chunks():
            yield data

    async def report(self, gga: bytes) -> None:
        if self._stream is not None:
            await self._stream.report(gga)

    async def close(self) -> None:
        if self._stream is not None:
            await self._stream.close()
            self._stream = None


class _Tcp:
    """A base station that sends to every TCP client."""

    def __init__(self, host: str, port: int) -> None:
        self._host, self._port = host, port
        self._streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None

    async def open(self, gga: bytes) -> None:
        where = f"{self._host}:{self._port}"
        try:
            async with asyncio.timeout(CONNECT_S):
                self._streams = await asyncio.open_connection(self._host, self._port)
        except TimeoutError:
            raise CorrectionError(f"{where} does not answer.", "Check the address.") from None
        except OSError as error:
            raise CorrectionError(
                f"{where} cannot be reached: {error.strerror or error}.", "Check the address."
            ) from None

    async def chunks(self) -> AsyncIterator[bytes]:
        assert self._streams is not None
        while data := await self._streams[0].read(READ_BYTES):
            yield data
        raise CorrectionError(f"{self._host}:{self._port} ended the stream.", TRIED)

    async def report(self, gga: bytes) -> None:
        """Ignore the position; a plain TCP source does not use it."""

    async def close(self) -> None:
        if self._streams is not None:
            self._streams[1].close()
            self._streams = None


class _File:
    """A file, played with the timing of its messages."""

    def __init__(self, path: Path) -> None:
        self.path = path

    async def open(self, gga: bytes) -> None:
        if not self.path.is_file():
            raise CorrectionError(f"File not found: {self.path}.", HINT, over=True)

    async def chunks(self) -> AsyncIterator[bytes]:
        splitter = RtcmFramer()
        last: int | None = None
        try:
            with self.path.open("rb") as file:
                while data := await asyncio.to_thread(file.read, 1 << 16):
                    for one in splitter.feed(data):
                        frame = bytes.fromhex(one.line)
                        epoch = epoch_ms(int(one.fields["number"]), frame)
                        await asyncio.sleep(_pause(last, epoch))
                        last = epoch if epoch is not None else last
                        yield frame
        except OSError as error:
            raise CorrectionError(f"{self.path} cannot be read: {error.strerror}.", HINT, over=True) from None
        if splitter.rejected:
            log.info("%s: %d byte ranges are not messages", self.path, splitter.rejected)
        raise CorrectionError(f"{self.path.name} has finished.", "Forward it again to play it again.", over=True)

    async def report(self, gga: bytes) -> None:
        """Ignore the position; a file does not use it."""

    async def close(self) -> None:
        """No-op; the file is closed after each pass."""


def _pause(last: int | None, epoch: int | None) -> float:
    """Delay before the next message of a file, s."""
    if epoch is None:
        return UNTIMED_S if last is None else 0.0  # among messages with times, it belongs to the previous one
    if last is None:
        return 0.0
    return min(max(epoch - last, 0) / 1000, FILE_GAP_S) if abs(epoch - last) < 3_600_000 else 0.0


def source_of(source: str) -> CorrectionSource:
    """Parse the address of a correction source.

    Raises:
        CorrectionError: invalid source.
    """
    scheme = source.partition("://")[0] if "://" in source else ""
    if not is_printable(unquote(source)):
        raise CorrectionError("The address contains a control character.", HINT)
    if scheme in ("ntrip", "ntrips"):
        return _Caster(Caster.of(source))
    if scheme == "tcp":
        try:
            parts = urlsplit(source)
            host, port = parts.hostname, parts.port
        except ValueError:
            host, port = None, None
        if not host or not port or not is_host(host):
            raise CorrectionError("A network address is tcp://host:port.", HINT)
        return _Tcp(host, port)
    if scheme and scheme != "file":
        raise CorrectionError(f"Corrections are not available from {scheme:.40}://.", HINT)
    path = source.removeprefix("file://")
    if not path.strip():
        raise CorrectionError("No source is given.", HINT)
    try:
        return _File(Path(path).expanduser())
    except RuntimeError:  # ~user of an unknown user
        raise CorrectionError(f"Folder not found: {path.partition('/')[0]:.40}.", HINT) from None


def file_of(source: str) -> Path | None:
    """The file that a source names; None for a network source.

    Raises:
        CorrectionError: invalid source.
    """
    parsed_source = source_of(source)
    return parsed_source.path if isinstance(parsed_source, _File) else None


def without_password(source: str) -> str:
    """A source with its password replaced, for display and logs."""
    scheme, mark, rest = source.partition("://")
    login, at, place = rest.rpartition("@")
    if not mark or not at:
        return source
    return f"{scheme}://{login.split(':')[0]}{':…' if ':' in login else ''}@{place}"


@dataclass(slots=True)
class _Counts:
    """Counters of forwarded messages."""

    rejected: int = 0
    refused: int = 0
    sent_at: float | None = None  # time of the last sent message, to relate errors to it
    forwarded_at: float | None = None


class CorrectionForwarder:
    """One device's stream of corrections.

    Args:
        source: as given, with its password.
        device_exists: whether the server still has the device.
        log_sink: receives entries for the device's log.

    Raises:
        CorrectionError: the source is invalid.
    """

    def __init__(
        self,
        session: CorrectionTarget,
        source: str,
        device_exists: Callable[[], bool] = lambda: True,
        log_sink: LogSink = ignore,
        *,
        first_retry_s: float = FIRST_RETRY_S,
    ) -> None:
        self._session = session
        self._device_exists = device_exists
        self._source = source_of(source)
        self._public_source = without_password(source)
        self._backoff = Backoff(first_retry_s, LAST_RETRY_S)
        self._position = PositionTracker()
        self._counts = _Counts()
        self._log = CorrectionLog(self._public_source, log_sink)
        self._recent: deque[tuple[float, int]] = deque()
        self._message, self._hint = f"Opening {self._public_source}.", ""
        self._running = True
        self._is_forwarding = False
        self._splitter = RtcmFramer()
        self._unsubscribe = session.listen(self._on_events)
        self._task = asyncio.get_running_loop().create_task(self._run(), name=f"corrections {session.info.id}")

    # -- state ---------------------------------------------------------------------------------------------------------

    def state(self) -> Corrections:
        """State as the page shows it."""
        now = time.monotonic()
        self._forget(now)
        at = self._counts.forwarded_at
        return Corrections(
            source=self._public_source,
            running=self._running,
            forwarding=self._running and self._is_forwarding,
            message=self._message,
            hint=self._hint,
            age_s=None if at is None else max(now - at, 0.0),
            bytes_per_s=sum(size for _, size in self._recent) / RATE_S,
            messages=dict(self._log.messages),
            rejected=self._counts.rejected + self._splitter.rejected,
            refused=self._counts.refused,
        )

    def _forget(self, now: float) -> None:
        while self._recent and self._recent[0][0] < now - RATE_S:
            self._recent.popleft()

    async def close(self) -> None:
        self._unsubscribe()
        await end_tasks(self._task)
        if self._running:
            self._running = False
            self._log.log_end()

    # -- the stream ----------------------------------------------------------------------------------------------------

    async def _run(self) -> None:
        while self._running:
            try:
                await self._forward_once()
            except CorrectionError as error:
                self._is_forwarding = False
                self._message, self._hint = error.message, error.hint
                self._running = not error.over
                (self._log.log_end if error.over else self._log.stopped)(error.message)
            except Exception:  # top of this task: an internal error must be reported
                log.exception("corrections of %s failed", self._session.info.source)
                self._is_forwarding = False
                self._message, self._hint = "An internal error of imuscope ended the stream.", "The log has details."
                self._log.stopped(self._message)
            finally:
                await self._source.close()
            if self._running:
                wait = self._backoff.next()
                self._hint = self._hint or f"Retrying in {wait:.0f} s."
                await asyncio.sleep(wait)

    async def _forward_once(self) -> None:
        """Forward one connection until it ends."""
        self._counts.rejected += self._splitter.rejected
        self._splitter = RtcmFramer()
        await self._source.open(self._gga())
        self._is_forwarding = False
        self._message, self._hint = f"Open, no message yet from {self._public_source}.", ""
        reporting = asyncio.get_running_loop().create_task(self._report())
        try:
            chunks = self._source.chunks()
            while True:
                try:
                    async with asyncio.timeout(SILENT_S):
                        data = await anext(chunks)
                except TimeoutError:
                    raise CorrectionError(f"No data received for {SILENT_S:.0f} s.", TRIED) from None
                except StopAsyncIteration:
                    return
                except OSError as error:
                    raise CorrectionError(f"The stream broke: {error.strerror or error}.", TRIED) from None
                for one in self._splitter.feed(data):
                    await self._forward(one.name, bytes.fromhex(one.line))
        finally:
            await end_tasks(reporting)

    async def _forward(self, name: str, message: bytes) -> None:
        if not self._device_exists():
            raise CorrectionError(
                "The device has been removed.", "Forward the corrections to another device.", over=True
            )
        await self._session.wait_idle()  # the device rejects a message between a setting and its acknowledgement
        self._counts.sent_at = time.monotonic()  # before sending: a simulator answers at once
        corrections = self._input()
        frame = corrections.wrap(message, self._address()) if corrections is not None else message
        try:
            await self._session.send(frame)
        except LinkError as error:
            self._is_forwarding = False
            self._message, self._hint = f"Not forwarded: {error.message}", error.hint
            self._counts.refused += 1
            self._log.stopped(error.message)
            return
        now = time.monotonic()
        self._backoff.reset()
        self._counts.forwarded_at = now
        self._recent.append((now, len(message)))
        self._forget(now)
        self._log.forwarded(name, frame, len(message))
        self._is_forwarding = True
        self._message, self._hint = f"Forwarding from {self._public_source}.", ""

    def _input(self) -> CorrectionInput | None:
        family = PROTOCOLS.get(self._session.info.protocol)
        return family.configuration.corrections if family is not None else None

    def _address(self) -> int | None:
        """Bus address of a device that shares its line."""
        return self._session.address

    # -- the device ----------------------------------------------------------------------------------------------------

    def _on_events(self, event: Event) -> None:
        self._position.update(event, self._session.info.protocol)
        corrections = self._input() if isinstance(event, Reply) else None
        if isinstance(event, Reply) and corrections is not None and corrections.is_rejection(event):
            at = self._counts.sent_at
            if at is not None and time.monotonic() - at < ANSWER_S:
                self._counts.refused += 1
                self._log.refused()

    def _gga(self) -> bytes:
        place = self._position.place
        return gga(place, datetime.now(UTC)) if place is not None else b""

    async def _report(self) -> None:
        while True:
            await asyncio.sleep(REPORT_S)
            if line := self._gga():
                with contextlib.suppress(OSError):
                    await self._source.report(line)


def gga(place: PositionFix, now: datetime) -> bytes:
    """GGA sentence of a position, as casters of virtual reference stations expect it."""

    def angle(value: float, width: int, names: str) -> str:
        minutes = round(abs(value) * 60, 5)
        return f"{int(minutes // 60):0{width}d}{minutes % 60:08.5f},{names[value < 0]}"

    words = (
        "GPGGA",
        f"{now:%H%M%S}.{now.microsecond // 10_000:02d}",
        angle(place.latitude, 2, "NS"),
        angle(place.longitude, 3, "EW"),
        "1",
        f"{10 if place.satellites is None else place.satellites:02d}",
        "1.0",
        f"{place.height or 0.0:.2f},M",
        "0.0,M",
        "",
        "",
    )
    return sentence(",".join(words))
