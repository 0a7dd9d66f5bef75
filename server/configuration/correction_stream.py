"""Corrections for a receiver: from a caster, a network address or a file, in whole messages, into a device.

    ntrip://user:password@host:2101/MOUNT ──┐
    tcp://host:port                       ──┼─> RtcmFramer ── whole RTCM 3 messages, CRC checked ──> session.send
    a file, at the pace it was made with  ──┘                                              MTi: in ForwardGnssData
                                                                                           IMX, GPX: as they are

A stream that ends is opened again, after 1 s, then twice as long each time up to a minute. What goes through is counted
by message number; what is no message, and what the device refuses, too. `age_s` is what a person watches: how old is
the last message that the device got? The device's log says where it begins and ends (correction_log.py).

A virtual reference station wants to know where the receiver is. What the device itself says (a GGA sentence, or a
position in its own protocol) is sent to the caster when the stream begins and every `REPORT_S` after that.

The password is a secret: it is in no answer, event or log.
"""

from __future__ import annotations

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

from protocols.events import Event, Reply
from protocols.isb.encoder import sentence
from protocols.rtcm import RtcmFramer, epoch_ms
from protocols.xbus.frames import MASTER
from protocols.xbus.frames import build as xbus_frame
from server.configuration.api_models import Corrections
from server.configuration.correction_log import CorrectionLog, LogSink, ignore
from server.configuration.ntrip import CONNECT_S, READ, TRIED, Caster, CasterStream, CorrectionError, connect
from server.devices.member import AnyDevice, address_of
from server.devices.position_tracker import Position, PositionTracker
from server.links.base import LinkError
from server.links.source_url import is_host, is_printable
from server.wire import DeviceInfo

log = logging.getLogger("imuscope.corrections")

FIRST_RETRY_S, LAST_RETRY_S = 1.0, 60.0
SILENT_S = 60.0  # a caster that says nothing for so long is asked again
REPORT_S = 10.0
RATE_S = 10.0  # over which bytes/s is told
FORWARD_GNSS_DATA, ERROR = 0xE2, 0x42
ANSWER_S = 1.0  # an error so soon after a message is an answer to it
FILE_GAP_S = 10.0  # a longer pause in a file is cut to this
UNTIMED_S = 0.2  # between the messages of a file without times
HINT = "Corrections come from ntrip://user:password@host:2101/MOUNT, tcp://host:port, or a file."


class CorrectionTarget(Protocol):
    """What is needed of a session."""

    @property
    def info(self) -> DeviceInfo: ...

    async def send(self, data: bytes) -> None: ...

    async def idle(self) -> None: ...

    def listen(self, callback: Callable[[Event], None]) -> Callable[[], None]: ...


class CorrectionSource(Protocol):
    """Where corrections come from."""

    async def open(self, gga: bytes) -> None: ...

    def chunks(self) -> AsyncIterator[bytes]: ...

    async def report(self, gga: bytes) -> None: ...

    async def close(self) -> None: ...


class _Caster:
    """An NTRIP caster."""

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
    """A base that serves whoever connects."""

    def __init__(self, host: str, port: int) -> None:
        self._host, self._port = host, port
        self._streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None

    async def open(self, gga: bytes) -> None:
        where = f"{self._host}:{self._port}"
        try:
            self._streams = await asyncio.wait_for(asyncio.open_connection(self._host, self._port), CONNECT_S)
        except TimeoutError:
            raise CorrectionError(f"{where} does not answer.", "Is the address right?") from None
        except OSError as error:
            raise CorrectionError(f"{where} cannot be reached: {error.strerror or error}.", "Is it right?") from None

    async def chunks(self) -> AsyncIterator[bytes]:
        assert self._streams is not None
        while data := await self._streams[0].read(READ):
            yield data
        raise CorrectionError(f"{self._host}:{self._port} ended the stream.", TRIED)

    async def report(self, gga: bytes) -> None:
        """A plain address asks for nothing."""

    async def close(self) -> None:
        if self._streams is not None:
            self._streams[1].close()
            self._streams = None


class _File:
    """A file, at the pace of the times in its messages."""

    def __init__(self, path: Path) -> None:
        self.path = path

    async def open(self, gga: bytes) -> None:
        if not self.path.is_file():
            raise CorrectionError(f"There is no file {self.path}.", HINT, over=True)

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
            log.info("%s: %d stretches are no messages", self.path, splitter.rejected)
        raise CorrectionError(f"{self.path.name} has been played.", "Forward it again to play it again.", over=True)

    async def report(self, gga: bytes) -> None:
        """A file asks for nothing."""

    async def close(self) -> None:
        """Nothing is held open."""


def _pause(last: int | None, epoch: int | None) -> float:
    """How long to wait before a message of a file, s."""
    if epoch is None:
        return UNTIMED_S if last is None else 0.0  # between messages that have a time it belongs to the one before
    if last is None:
        return 0.0
    return min(max(epoch - last, 0) / 1000, FILE_GAP_S) if abs(epoch - last) < 3_600_000 else 0.0


def source_of(source: str) -> CorrectionSource:
    """What a source is, as it is written.

    Raises:
        CorrectionError: it is none.
    """
    scheme = source.partition("://")[0] if "://" in source else ""
    if not is_printable(unquote(source)):
        raise CorrectionError("The source holds a character that is none.", HINT)
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
        raise CorrectionError(f"Corrections cannot be had from {scheme:.40}://.", HINT)
    path = source.removeprefix("file://")
    if not path.strip():
        raise CorrectionError("No source is given.", HINT)
    try:
        return _File(Path(path).expanduser())
    except RuntimeError:  # ~somebody who is not there
        raise CorrectionError(f"There is no folder {path.partition('/')[0]:.40}.", HINT) from None


def file_of(source: str) -> Path | None:
    """The file that a source names; None for one of the network.

    Raises:
        CorrectionError: it is no source.
    """
    found = source_of(source)
    return found.path if isinstance(found, _File) else None


def without_password(source: str) -> str:
    """A source as it may be told."""
    scheme, mark, rest = source.partition("://")
    login, at, place = rest.rpartition("@")
    if not mark or not at:
        return source
    return f"{scheme}://{login.split(':')[0]}{':…' if ':' in login else ''}@{place}"


@dataclass(slots=True)
class _Counts:
    """What went through."""

    rejected: int = 0
    refused: int = 0
    asked_at: float | None = None  # when the last message was sent: an error after it answers it
    forwarded_at: float | None = None


class CorrectionForwarder:
    """One device's stream of corrections.

    Args:
        source: as given, with its password.
        is_there: whether the device is still one of the server's.
        tell: takes down what the device's log says of it.
    Raises:
        CorrectionError: the source is written wrongly.
    """

    def __init__(
        self,
        session: CorrectionTarget,
        source: str,
        is_there: Callable[[], bool] = lambda: True,
        tell: LogSink = ignore,
        *,
        first_retry_s: float = FIRST_RETRY_S,
    ) -> None:
        self._session = session
        self._is_there = is_there
        self._source = source_of(source)
        self._told = without_password(source)
        self._retry_s = self._first_retry_s = first_retry_s
        self._places = PositionTracker()
        self._counts = _Counts()
        self._diary = CorrectionLog(self._told, tell)
        self._recent: deque[tuple[float, int]] = deque()
        self._message, self._hint = f"Opening {self._told}.", ""
        self._running = True
        self._is_forwarding = False
        self._splitter = RtcmFramer()
        self._off = session.listen(self._hear)
        self._task = asyncio.get_running_loop().create_task(self._run(), name=f"corrections {session.info.id}")

    # -- what is told --------------------------------------------------------------------------------------------------

    def state(self) -> Corrections:
        """As the page shows it."""
        now = time.monotonic()
        while self._recent and self._recent[0][0] < now - RATE_S:
            self._recent.popleft()
        at = self._counts.forwarded_at
        return Corrections(
            source=self._told,
            running=self._running,
            forwarding=self._running and self._is_forwarding,
            message=self._message,
            hint=self._hint,
            age_s=None if at is None else max(now - at, 0.0),
            bytes_per_s=sum(size for _, size in self._recent) / RATE_S,
            messages=dict(self._diary.messages),
            rejected=self._counts.rejected + self._splitter.rejected,
            refused=self._counts.refused,
        )

    async def close(self) -> None:
        """Stop."""
        self._off()
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        if self._running:
            self._running = False
            self._diary.ended()

    # -- the stream ----------------------------------------------------------------------------------------------------

    async def _run(self) -> None:
        while self._running:
            try:
                await self._once()
            except CorrectionError as error:
                self._is_forwarding = False
                self._message, self._hint = error.message, error.hint
                self._running = not error.over
                (self._diary.ended if error.over else self._diary.stopped)(error.message)
            except Exception:  # the top of this task: a fault must not become silence
                log.exception("corrections of %s failed", self._session.info.source)
                self._is_forwarding = False
                self._message, self._hint = "A fault in imuscope ended the stream.", "The log has details."
                self._diary.stopped(self._message)
            finally:
                await self._source.close()
            if self._running:
                wait, self._retry_s = self._retry_s, min(2 * self._retry_s, LAST_RETRY_S)
                self._hint = self._hint or f"It is tried again in {wait:.0f} s."
                await asyncio.sleep(wait)

    async def _once(self) -> None:
        """One connection, until it ends."""
        self._counts.rejected += self._splitter.rejected
        self._splitter = RtcmFramer()
        await self._source.open(self._gga())
        self._is_forwarding = False
        self._message, self._hint = f"Open, no message yet from {self._told}.", ""
        reporting = asyncio.get_running_loop().create_task(self._report())
        try:
            chunks = self._source.chunks()
            while True:
                try:
                    data = await asyncio.wait_for(anext(chunks), SILENT_S)
                except TimeoutError:
                    raise CorrectionError(f"Nothing came for {SILENT_S:.0f} s.", TRIED) from None
                except StopAsyncIteration:
                    return
                except OSError as error:
                    raise CorrectionError(f"The stream broke: {error.strerror or error}.", TRIED) from None
                for one in self._splitter.feed(data):
                    await self._forward(one.name, bytes.fromhex(one.line))
        finally:
            reporting.cancel()
            await asyncio.gather(reporting, return_exceptions=True)

    async def _forward(self, name: str, message: bytes) -> None:
        """One whole message to the device."""
        if not self._is_there():
            raise CorrectionError("The device was removed.", "Forward them to another.", over=True)
        xbus = self._session.info.protocol == "xbus"
        await self._session.idle()  # a message between a setting and its acknowledgement would be answered with Error
        self._counts.asked_at = time.monotonic()  # before: a twin answers at once
        frame = xbus_frame(FORWARD_GNSS_DATA, message, self._bus()) if xbus else message
        try:
            await self._session.send(frame)
        except LinkError as error:
            self._is_forwarding = False
            self._message, self._hint = f"Not forwarded: {error.message}", error.hint
            self._counts.refused += 1
            self._diary.stopped(error.message)
            return
        now = time.monotonic()
        self._retry_s = self._first_retry_s
        self._counts.forwarded_at = now
        self._recent.append((now, len(message)))
        self._diary.forwarded(name, frame, len(message))
        self._is_forwarding = True
        self._message, self._hint = f"Forwarding from {self._told}.", ""

    def _bus(self) -> int:
        """The bus identifier of an MTi."""
        address = address_of(self._session) if isinstance(self._session, AnyDevice) else None
        return MASTER if address is None else address

    # -- the device ----------------------------------------------------------------------------------------------------

    def _hear(self, event: Event) -> None:
        """Where the device is, and whether it refused."""
        self._places.hear(event)
        if isinstance(event, Reply) and event.message.id == ERROR and self._session.info.protocol == "xbus":
            at = self._counts.asked_at
            if at is not None and time.monotonic() - at < ANSWER_S:
                self._counts.refused += 1
                self._diary.refused()

    def _gga(self) -> bytes:
        place = self._places.place
        return gga(place, datetime.now(UTC)) if place is not None else b""

    async def _report(self) -> None:
        while True:
            await asyncio.sleep(REPORT_S)
            if line := self._gga():
                with contextlib.suppress(OSError):
                    await self._source.report(line)


def gga(place: Position, now: datetime) -> bytes:
    """A GGA sentence of a place, as a caster of virtual reference stations wants it."""

    def angle(value: float, width: int, names: str) -> str:
        minutes = round(abs(value) * 60, 5)
        return f"{int(minutes // 60):0{width}d}{minutes % 60:08.5f},{names[value < 0]}"

    words = (
        "GPGGA",
        f"{now:%H%M%S}.{now.microsecond // 10_000:02d}",
        angle(place.latitude, 2, "NS"),
        angle(place.longitude, 3, "EW"),
        "1",
        f"{place.satellites:02d}",
        "1.0",
        f"{place.height:.2f},M",
        "0.0,M",
        "",
        "",
    )
    return sentence(",".join(words))
