"""NTRIP client: corrections from a caster.

    GET /MOUNT HTTP/1.1                            ──>   HTTP/1.1 200 OK, perhaps chunked, then RTCM        version 2
    Ntrip-Version: Ntrip/2.0                             ICY 200 OK, then RTCM                               version 1
    User-Agent: NTRIP imuscope/…                         SOURCETABLE 200 OK: unknown mount point             version 1
    Authorization: Basic …                               200, gnss/sourcetable: unknown mount point          version 2
                                                         401, "ERROR - Bad Password": name or password

If a caster closes the connection without an answer, or rejects the request, the request is repeated as version 1. A
caster answers a request for an unknown mount point with its source table; the error names the nearest mount points.
Virtual reference stations need the receiver's position: `report` sends a GGA sentence upstream.

Source: RTCM 10410.1 (NTRIP 2.0); RTCM paper 200-2004/SC104-STD (NTRIP 1.0).
"""

import asyncio
import base64
import contextlib
import difflib
import ssl
import string
from collections.abc import AsyncIterator
from dataclasses import dataclass
from urllib.parse import quote, unquote, urlsplit

import h11

from imuscope.recordings.errors import ExplainedError
from imuscope.server.links.source_url import is_host
from imuscope.server.version import VERSION

CONNECT_S = 10.0
HEAD_S = 15.0
MAX_HEAD = 16_384
MAX_TABLE = 262_144
TABLE_S = 15.0
READ_BYTES = 4096
MAX_NAMED = 5  # mount points listed in an error
NTRIP_PORT, NTRIP_TLS_PORT = 2101, 443
TRIED = "imuscope keeps retrying; no action is needed."


class CorrectionError(ExplainedError):
    """The reason why corrections are missing, and what to do."""

    def __init__(self, message: str, hint: str = "", *, over: bool = False) -> None:
        super().__init__(message, hint)
        self.over = over  # no retry: a file has been played


@dataclass(frozen=True, slots=True)
class Caster:
    """Address of a caster and its stream.

    Args:
        mount: mount point, without a slash.
        user, password: unquoted; "" for none.
    """

    host: str
    port: int
    mount: str
    user: str = ""
    password: str = ""
    tls: bool = False

    @classmethod
    def of(cls, source: str) -> "Caster":
        """Parse ntrip://user:password@host:2101/MOUNT, or ntrips://.

        Raises:
            CorrectionError: a part is missing or invalid.
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
            raise CorrectionError("Host name not found (DNS).", "A caster is ntrip://user:password@host:2101/MOUNT.")
        tls = parts.scheme == "ntrips"
        user, password = unquote(parts.username or ""), unquote(parts.password or "")
        return cls(parts.hostname, port or (NTRIP_TLS_PORT if tls else NTRIP_PORT), mount, user, password, tls)

    @property
    def place(self) -> str:
        """Host, port and mount point, without the password."""
        return f"{self.host}:{self.port}/{self.mount}"


class CasterStream:
    """Response of a caster: HTTP, parsed by h11, or the bare bytes of version 1.

    Args:
        http: the h11 connection that sent the request.
    """

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, http: h11.Connection) -> None:
        self._reader, self._writer = reader, writer
        self._http: h11.Connection | None = http
        self._first = b""  # bytes that came with the head of version 1
        self.status = self.code = ""  # the first line, and the number in it
        self.is_table = False  # a source table follows

    async def head(self) -> None:
        """Read the head of the response; in version 1 this is one line.

        Raises:
            CorrectionError: the response begins as HTTP but is invalid.
        """
        data = b""
        while b"\r\n" not in data and len(data) <= MAX_HEAD and (more := await self._reader.read(READ_BYTES)):
            data += more
        line, _, rest = data.partition(b"\r\n")
        self.status = line.decode("latin-1")
        self.code = "".join(self.status.split()[1:2])
        self.is_table = self.status.startswith("SOURCETABLE")
        if self._http is None or not line.startswith(b"HTTP/"):
            self._http, self._first = None, rest.removeprefix(b"\r\n")
            return
        try:
            self._http.receive_data(data)
            while not isinstance(event := self._http.next_event(), h11.Response):
                if event is h11.NEED_DATA:
                    self._http.receive_data(await self._reader.read(READ_BYTES))
        except h11.RemoteProtocolError:
            if self.code == "200":
                raise CorrectionError(
                    "The caster's response is not HTTP.", "Check that the address is that of an NTRIP caster."
                ) from None
            return
        self.is_table = b"sourcetable" in dict(event.headers).get(b"content-type", b"")

    async def data(self) -> AsyncIterator[bytes]:
        """Body of the response, until the caster ends it.

        Raises:
            CorrectionError: invalid HTTP.
        """
        if self._http is None:
            if self._first:
                yield self._first
            while data := await self._reader.read(READ_BYTES):
                yield data
            return
        while True:
            try:
                event = self._http.next_event()
            except h11.RemoteProtocolError:
                raise CorrectionError(
                    "The caster's response is not HTTP.", "Check that the address is that of an NTRIP caster."
                ) from None
            if isinstance(event, h11.Data):
                yield bytes(event.data)
            elif event is not h11.NEED_DATA or not (data := await self._reader.read(READ_BYTES)):
                return
            else:
                self._http.receive_data(data)

    async def chunks(self) -> AsyncIterator[bytes]:
        """The correction stream.

        Raises:
            CorrectionError: the caster ended the stream.
        """
        async for data in self.data():
            yield data
        raise CorrectionError("The caster ended the stream.", TRIED)

    async def report(self, gga: bytes) -> None:
        """Send the position of the receiver."""
        self._writer.write(gga)
        with contextlib.suppress(OSError):
            await self._writer.drain()

    async def close(self) -> None:
        self._writer.close()
        with contextlib.suppress(OSError, TimeoutError, ssl.SSLError):
            async with asyncio.timeout(1):
                await self._writer.wait_closed()


async def connect(caster: Caster, gga: bytes = b"") -> CasterStream:
    """Connect to a caster.

    Args:
        gga: position of the receiver, if known.

    Raises:
        CorrectionError: the connection or the request failed.
    """
    stream = await _attempt(caster, gga, version=2)
    if stream is None:
        stream = await _attempt(caster, gga, version=1)
    if stream is None:
        raise CorrectionError(
            f"{caster.host}:{caster.port} closed the connection without an answer.",
            "Check that the address is that of an NTRIP caster.",
        )
    if gga:
        await stream.report(gga)
    return stream


async def _attempt(caster: Caster, gga: bytes, *, version: int) -> CasterStream | None:
    """Send one request; None if the caster does not understand it."""
    where = f"{caster.host}:{caster.port}"
    context = ssl.create_default_context() if caster.tls else None
    try:
        async with asyncio.timeout(CONNECT_S):
            reader, writer = await asyncio.open_connection(caster.host, caster.port, ssl=context)
    except TimeoutError:
        raise CorrectionError(f"{where} does not answer.", "Check the address and the network.") from None
    except ssl.SSLError as error:
        raise CorrectionError(
            f"{where} is not a trusted TLS server: {error.reason}.", "Use ntrip:// to connect without TLS."
        ) from None
    except OSError as error:
        raise CorrectionError(f"{where} cannot be reached: {error.strerror or error}.", "Check the address.") from None
    http = h11.Connection(h11.CLIENT, max_incomplete_event_size=MAX_HEAD)
    stream = CasterStream(reader, writer, http)
    try:
        writer.write(_request(caster, version, gga, http))
        await writer.drain()
        async with asyncio.timeout(HEAD_S):
            await stream.head()
        if await _is_understood(caster, version, stream):
            return stream
    except TimeoutError:
        writer.close()
        raise CorrectionError(f"{where} accepted the request but does not answer.", TRIED) from None
    except OSError:
        writer.close()
        return None
    except BaseException:
        writer.close()
        raise
    writer.close()
    return None


def _request(caster: Caster, version: int, gga: bytes, http: h11.Connection) -> bytes:
    """The bytes of a request. h11 is informed in either case; it writes that of version 2, which is HTTP/1.1."""
    headers = [("User-Agent", f"NTRIP imuscope/{VERSION}"), ("Accept", "*/*")]
    if caster.user or caster.password:
        pair = base64.b64encode(f"{caster.user}:{caster.password}".encode()).decode()
        headers.append(("Authorization", f"Basic {pair}"))
    version_2_headers = [
        ("Host", f"{caster.host}:{caster.port}"),
        ("Ntrip-Version", "Ntrip/2.0"),
        ("Connection", "close"),
    ]
    if gga:
        version_2_headers.append(("Ntrip-GGA", gga.decode("ascii").strip()))
    target = quote(f"/{caster.mount}", string.punctuation)
    request = http.send(h11.Request(method="GET", target=target, headers=version_2_headers + headers)) or b""
    http.send(h11.EndOfMessage())
    if version == 2:
        return request
    return "".join(
        [f"GET {target} HTTP/1.0\r\n", *(f"{name}: {value}\r\n" for name, value in headers), "\r\n"]
    ).encode()


async def _is_understood(caster: Caster, version: int, stream: CasterStream) -> bool:
    """Whether a correction stream follows; False if the caster does not understand the request.

    Raises:
        CorrectionError: the caster understands the request but refuses it.
    """
    status, code = stream.status, stream.code
    if stream.is_table:
        raise _no_mount(caster, await _table(stream))
    if code == "401" or "password" in status.lower():
        who = "The caster requires name and password" if not caster.user else "The caster rejects name or password"
        raise CorrectionError(f"{who} for {caster.mount}.", "Write them before the host: ntrip://name:password@host.")
    if code == "404":
        raise _no_mount(caster, "")
    if status.startswith(("ICY", "HTTP/")) and code == "200":
        return True
    if not status or (version == 2 and code in ("400", "500", "501", "505")):
        return False
    raise CorrectionError(f"The caster answered {status[:80]!r}.", "Check that the address is that of an NTRIP caster.")


async def _table(stream: CasterStream) -> str:
    """The source table, as far as it is received."""
    table = b""
    with contextlib.suppress(TimeoutError, OSError):
        async with asyncio.timeout(TABLE_S):
            async for data in stream.data():
                table += data
                if b"ENDSOURCETABLE" in table or len(table) >= MAX_TABLE:
                    break
    return table.decode("latin-1")


def mounts(table: str) -> dict[str, str]:
    """Mount points of a source table, with place and format."""
    by_name = {}
    for line in table.splitlines():
        fields = line.split(";")
        if fields[0].strip() == "STR" and len(fields) > 3:
            by_name[fields[1]] = ", ".join(word for word in (fields[2], fields[3]) if word)
    return by_name


def _no_mount(caster: Caster, table: str) -> CorrectionError:
    """Error for an unknown mount point, with the nearest ones."""
    available = mounts(table)
    message = f"The caster has no mount point {caster.mount!r}."
    if not available:
        return CorrectionError(message, "Ask its provider for the mount points.")
    by_casefold = {name.casefold(): name for name in available}
    close = [
        by_casefold[one] for one in difflib.get_close_matches(caster.mount.casefold(), by_casefold, MAX_NAMED, 0.3)
    ]
    named = ", ".join(
        f"{name} ({available[name]})" if available[name] else name for name in (close or list(available))[:MAX_NAMED]
    )
    more = f", and {len(available) - MAX_NAMED} more" if len(available) > MAX_NAMED else ""
    return CorrectionError(message, f"It has {named}{more}.")
