"""How are corrections fetched from an NTRIP caster?

    GET /MOUNT HTTP/1.1                            ──>   HTTP/1.1 200 OK, perhaps chunked, then RTCM        version 2
    Ntrip-Version: Ntrip/2.0                             ICY 200 OK, then RTCM                               version 1
    User-Agent: NTRIP imuscope/…                         SOURCETABLE 200 OK: there is no such mount point    version 1
    Authorization: Basic …                               200, gnss/sourcetable: likewise                     version 2
                                                         401, "ERROR - Bad Password": name or password

A caster that closes the connection without a word, or that does not know the request, is asked once more as version 1.
One that has no such mount point answers with the table of those it has, and the nearest of them are named. Virtual
reference stations want to know where the receiver is: `report` sends a GGA sentence upstream.

Source: RTCM 10410.1 (NTRIP 2.0); RTCM paper 200-2004/SC104-STD (NTRIP 1.0).
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import difflib
import ssl
from collections.abc import AsyncIterator
from dataclasses import dataclass
from urllib.parse import unquote, urlsplit

from server.links.source_url import is_host
from server.version import VERSION

CONNECT_S = 10.0
HEAD_S = 15.0
MOST_HEAD = 16_384
MOST_TABLE = 262_144
READ = 4096
NAMED = 5  # mount points told
PORT, TLS_PORT = 2101, 443
TRIED = "It is tried again and again; nothing needs to be done."


class CorrectionError(Exception):
    """Why no corrections come: one sentence and what to do."""

    def __init__(self, message: str, hint: str = "", *, over: bool = False) -> None:
        super().__init__(message)
        self.message, self.hint = message, hint
        self.over = over  # nothing to be tried again: a file has been played


@dataclass(frozen=True, slots=True)
class Caster:
    """Where a stream is.

    Args:
        mount: its mount point, without a slash.
        user, password: as they were before being quoted; "" for none.
    """

    host: str
    port: int
    mount: str
    user: str = ""
    password: str = ""
    tls: bool = False

    @classmethod
    def of(cls, source: str) -> Caster:
        """ntrip://user:password@host:2101/MOUNT, or ntrips://.

        Raises:
            CorrectionError: what is missing.
        """
        try:
            parts = urlsplit(source)
            port = parts.port
        except ValueError as error:
            raise CorrectionError(f"{error}.", "A caster is ntrip://user:password@host:2101/MOUNT.") from None
        mount = unquote(parts.path).strip("/")
        if not parts.hostname or not mount or any(char in mount for char in " \r\n"):
            missing = "a host" if not parts.hostname else "a mount point"
            raise CorrectionError(f"The caster lacks {missing}.", "A caster is ntrip://user:password@host:2101/MOUNT.")
        if not is_host(parts.hostname):
            raise CorrectionError("No host is called like that.", "A caster is ntrip://user:password@host:2101/MOUNT.")
        tls = parts.scheme == "ntrips"
        user, password = unquote(parts.username or ""), unquote(parts.password or "")
        return cls(parts.hostname, port or (TLS_PORT if tls else PORT), mount, user, password, tls)

    @property
    def place(self) -> str:
        """Without the password."""
        return f"{self.host}:{self.port}/{self.mount}"


class CasterStream:
    """One connection, past its head.

    Args:
        first: bytes that came with the head.
    """

    def __init__(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, first: bytes, *, chunked: bool
    ) -> None:
        self._reader, self._writer, self._chunked = reader, writer, chunked
        self._first = first

    async def chunks(self) -> AsyncIterator[bytes]:
        """The corrections as they come.

        Raises:
            CorrectionError: the caster ended the stream.
        """
        if self._chunked:
            async for data in self._dechunked():
                yield data
        else:
            if self._first:
                yield self._first
            while data := await self._reader.read(READ):
                yield data
        raise CorrectionError("The caster ended the stream.", TRIED)

    async def _dechunked(self) -> AsyncIterator[bytes]:
        """What HTTP's chunks carry."""
        kept = self._first
        while True:
            while b"\r\n" not in kept:
                more = await self._reader.read(READ)
                if not more or len(kept) > MOST_HEAD:
                    return
                kept += more
            head, _, kept = kept.partition(b"\r\n")
            try:
                size = int(head.split(b";")[0] or b"-", 16)
            except ValueError:
                raise CorrectionError("The caster sent something that is no HTTP.", "Is it a caster?") from None
            if size <= 0 or size > 1 << 24:
                return
            while len(kept) < size + 2:
                more = await self._reader.read(READ)
                if not more:
                    return
                kept += more
            yield kept[:size]
            kept = kept[size + 2 :]

    async def report(self, gga: bytes) -> None:
        """Tell where the receiver is."""
        self._writer.write(gga)
        with contextlib.suppress(OSError):
            await self._writer.drain()

    async def close(self) -> None:
        self._writer.close()
        with contextlib.suppress(OSError, TimeoutError, ssl.SSLError):
            await asyncio.wait_for(self._writer.wait_closed(), 1)


async def connect(caster: Caster, gga: bytes = b"") -> CasterStream:
    """A stream of corrections.

    Args:
        gga: where the receiver is, if that is known.
    Raises:
        CorrectionError: why not.
    """
    stream = await _attempt(caster, gga, version=2)
    if stream is None:
        stream = await _attempt(caster, gga, version=1)
    if stream is None:
        raise CorrectionError(
            f"{caster.host}:{caster.port} closed the connection without an answer.", "Is it an NTRIP caster?"
        )
    if gga:
        await stream.report(gga)
    return stream


async def _attempt(caster: Caster, gga: bytes, *, version: int) -> CasterStream | None:
    """One request; None where the caster does not understand it."""
    where = f"{caster.host}:{caster.port}"
    context = ssl.create_default_context() if caster.tls else None
    try:
        reader, writer = await asyncio.wait_for(
            asyncio.open_connection(caster.host, caster.port, ssl=context), CONNECT_S
        )
    except TimeoutError:
        raise CorrectionError(f"{where} does not answer.", "Is the address right, and the network there?") from None
    except ssl.SSLError as error:
        raise CorrectionError(
            f"{where} is no trusted TLS server: {error.reason}.", "ntrip:// is without TLS."
        ) from None
    except OSError as error:
        raise CorrectionError(
            f"{where} cannot be reached: {error.strerror or error}.", "Is the address right?"
        ) from None
    try:
        writer.write(_request(caster, version, gga))
        await writer.drain()
        head, first = await asyncio.wait_for(_head(reader), HEAD_S)
        stream = await _judged(caster, version, head, first, reader, writer)
    except TimeoutError:
        writer.close()
        raise CorrectionError(f"{where} took the request and does not answer.", TRIED) from None
    except OSError:
        writer.close()
        return None
    except BaseException:
        writer.close()
        raise
    if stream is None:
        writer.close()
    return stream


def _request(caster: Caster, version: int, gga: bytes) -> bytes:
    lines = [f"GET /{caster.mount} HTTP/{'1.1' if version == 2 else '1.0'}"]
    if version == 2:
        lines += [f"Host: {caster.host}:{caster.port}", "Ntrip-Version: Ntrip/2.0", "Connection: close"]
    lines += [f"User-Agent: NTRIP imuscope/{VERSION}", "Accept: */*"]
    if caster.user or caster.password:
        pair = base64.b64encode(f"{caster.user}:{caster.password}".encode()).decode()
        lines.append(f"Authorization: Basic {pair}")
    if gga and version == 2:
        lines.append(f"Ntrip-GGA: {gga.decode('ascii').strip()}")
    return ("\r\n".join(lines) + "\r\n\r\n").encode()


async def _head(reader: asyncio.StreamReader) -> tuple[list[str], bytes]:
    """The lines before the stream, and what came with them. ICY ends after its first line."""
    data = b""
    while True:
        more = await reader.read(READ)
        data += more
        line, end, rest = data.partition(b"\r\n")
        if line.startswith(b"ICY") and end:
            return [line.decode("latin-1")], rest.removeprefix(b"\r\n")
        if line.startswith(b"ERROR") and (end or not more):
            return [line.decode("latin-1")], b""
        if b"\r\n\r\n" in data:
            head, _, rest = data.partition(b"\r\n\r\n")
            return head.decode("latin-1").split("\r\n"), rest
        if not more or len(data) > MOST_HEAD:
            return (data.decode("latin-1").split("\r\n") if data.strip() else []), b""


async def _judged(
    caster: Caster,
    version: int,
    head: list[str],
    first: bytes,
    reader: asyncio.StreamReader,
    writer: asyncio.StreamWriter,
) -> CasterStream | None:
    """What a caster's answer means."""
    status = head[0] if head else ""
    headers = {name.strip().lower(): value.strip() for name, _, value in (line.partition(":") for line in head[1:])}
    words = status.split()
    code = words[1] if len(words) > 1 else ""
    if status.startswith("SOURCETABLE") or "sourcetable" in headers.get("content-type", ""):
        raise _no_mount(caster, await _table(reader, first))
    if code == "401" or "password" in status.lower():
        who = "The caster wants a name and a password" if not caster.user else "The caster refuses name or password"
        raise CorrectionError(f"{who} for {caster.mount}.", "They stand before the host: ntrip://name:password@host.")
    if code == "404":
        raise _no_mount(caster, "")
    if status.startswith("ICY") and code == "200":
        return CasterStream(reader, writer, first, chunked=False)
    if status.startswith("HTTP/") and code == "200":
        chunked = "chunked" in headers.get("transfer-encoding", "").lower()
        return CasterStream(reader, writer, first, chunked=chunked)
    if version == 2 and (not status or code in ("400", "500", "501", "505")):
        return None
    if not status:
        return None
    raise CorrectionError(f"The caster answered {status[:80]!r}.", "Is it an NTRIP caster?")


async def _table(reader: asyncio.StreamReader, first: bytes) -> str:
    """The source table, as far as it comes."""
    data = first
    with contextlib.suppress(TimeoutError, OSError):
        while b"ENDSOURCETABLE" not in data and len(data) < MOST_TABLE:
            more = await asyncio.wait_for(reader.read(READ), 5)
            if not more:
                break
            data += more
    return data.decode("latin-1")


def mounts(table: str) -> dict[str, str]:
    """Mount point → what it is, of a source table: its place and its format."""
    found = {}
    for line in table.splitlines():
        fields = line.split(";")
        if fields[0].strip() == "STR" and len(fields) > 3:
            found[fields[1]] = ", ".join(word for word in (fields[2], fields[3]) if word)
    return found


def _no_mount(caster: Caster, table: str) -> CorrectionError:
    """There is no such mount point: which there are."""
    there = mounts(table)
    message = f"The caster has no mount point {caster.mount!r}."
    if not there:
        return CorrectionError(message, "Its provider says which there are.")
    folded = {name.casefold(): name for name in there}
    close = [folded[one] for one in difflib.get_close_matches(caster.mount.casefold(), folded, NAMED, 0.3)]
    named = ", ".join(f"{name} ({there[name]})" if there[name] else name for name in (close or list(there))[:NAMED])
    more = f", and {len(there) - NAMED} more" if len(there) > NAMED else ""
    return CorrectionError(message, f"It has {named}{more}.")
