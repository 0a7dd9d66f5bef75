"""Floods by clients, faulty devices and hostile files, each for as long as somebody says.

    of bytes       of a device's link, over TCP and UDP at once: noise, valid frames, beginnings of frames and sentences
    of senders     thousands of IDTP devices, of names of sentences, of UDP ports
    of strangers   connections that stay silent, heads that do not come, answers that nobody reads, WebSockets
    of questions   requests, and tables of long recordings
    of files       pipes as sources, recordings made to do harm

FLOODS has them by name: tests/fault_injection/test_floods.py runs each until the server has answered a few times beside
it, tests/bench/floods.py for so many seconds.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import select
import socket
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import httpx
import zstandard
from mcap.writer import CompressionType, IndexType, Writer
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection
from websockets.typing import Subprotocol

from imuscope.protocols.embedded.nmea import sentence
from imuscope.protocols.idtp.frames import build
from imuscope.recordings.mcap.reader import CHUNK, LARGEST_CHUNK
from imuscope.recordings.mcap.records import MAGIC
from imuscope.server import wire
from tests.bench.support.serial_device import frame
from tests.support.timeouts import PATIENCE_S, connect, http_client
from tests.support.waiting import block_until

DATAGRAMS = 1400, 60_000  # bytes, in turn
PIECE = 1 << 20  # bytes sent over TCP
SILENT, DEAF, CHATTY = 1200, 100, 12  # connections
RECORDING = "long"  # id of a longer recording, to be requested


@dataclass
class Place:
    """A server that is flooded.

    Args:
        url: of the server.
        data: its data folder.
        lasts: called when a flood begins; returns what tells whether it is over.
    """

    url: str
    data: Path
    lasts: Callable[[], Callable[[], bool]]
    _is_over: Callable[[], bool] = lambda: False

    def begin(self) -> None:
        """Start the flood."""
        self._is_over = self.lasts()

    @property
    def over(self) -> bool:
        """It has lasted for long enough."""
        return self._is_over()

    def until_over(self) -> None:
        """Wait for that."""
        block_until(lambda: self.over, "the end of the flood", seconds=float("inf"))

    @property
    def address(self) -> tuple[str, int]:
        host, _, port = self.url.removeprefix("http://").rpartition(":")
        return host, int(port)

    def connected(self) -> socket.socket:
        """A connection."""
        return socket.create_connection(self.address, PATIENCE_S)


Flood = Callable[[Place], None]
FLOODS: dict[str, Flood] = {}


def flood(run: Flood) -> Flood:
    """Have it in FLOODS, by its name."""
    FLOODS[run.__name__] = run
    return run


# -- bytes of a link ---------------------------------------------------------------------------------------------------


def _names() -> bytes:
    """Sentences of names that no two share."""
    letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
    names = (f"P{a}{b}{c}" for a in letters for b in letters for c in letters)
    return b"".join(sentence(f"{name},1,2,3") for name in names)


def _senders() -> bytes:
    """A frame of each of many devices."""
    return b"".join(build(1, bytes(12), device=number, sequence=1) for number in range(8000))


BYTES: dict[str, tuple[str, bytes | Callable[[], bytes]]] = {
    "noise": ("xbus", lambda: random.Random(7).randbytes(PIECE)),
    "zeros": ("xbus", b"\0"),
    "xbus frames": ("xbus", lambda: b"".join(frame(n, 2000.0) for n in range(2000))),
    "xbus preambles": ("xbus", b"\xfa"),
    "longest xbus frames": ("xbus", bytes.fromhex("faff36ff0800")),
    "isb preambles": ("isb", b"\xef\x49"),
    "isb heads": ("isb", bytes.fromhex("ef4904040007")),
    "idtp preambles": ("idtp", b"IDTP"),
    "idtp senders": ("idtp", _senders),
    "sentence heads": ("xbus", b"$GPGGA,"),
    "sentence names": ("xbus", _names),
    "ubx heads": ("isb", bytes.fromhex("b5620107ff1f")),
    "rtcm heads": ("isb", bytes.fromhex("d303ff")),
}
"""What is flooded with → the protocol of the link, and the bytes that are repeated."""


def of_bytes(name: str) -> Flood:
    """A flood of these, over TCP and UDP at once."""

    def run(place: Place) -> None:
        protocol, source = BYTES[name]
        piece = source if isinstance(source, bytes) else source()
        data = (piece * (PIECE // len(piece) + 1))[:PIECE]
        with sources(place, protocol) as (tcp, udp):
            place.begin()
            with contextlib.suppress(OSError), socket.create_connection(tcp, PATIENCE_S) as stream:
                stream.setblocking(False)
                _pour(place, stream, udp, data)

    return run


def _pour(place: Place, stream: socket.socket, udp: tuple[str, int], data: bytes) -> None:
    """Send as fast as both links take it."""
    at = sent = 0
    view = memoryview(data)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        while not place.over:
            size = DATAGRAMS[sent % 2]
            first = sent * size % (len(data) - size)
            sender.sendto(view[first : first + size], udp)
            sent += 1
            with contextlib.suppress(BlockingIOError):
                at = (at + stream.send(view[at:])) % len(data)


@contextlib.contextmanager
def sources(place: Place, protocol: str) -> Iterator[tuple[tuple[str, int], tuple[str, int]]]:
    """The addresses of a TCP and a UDP source, open until the block ends."""
    addresses = {"tcp-listen": _free(socket.SOCK_STREAM), "udp": _free(socket.SOCK_DGRAM)}
    with http_client(base_url=place.url) as http:
        made = []
        for kind, (host, port) in addresses.items():
            body = {"source": f"{kind}://{host}:{port}", "protocol": protocol}
            made.append(http.post("/api/devices", json=body).raise_for_status().json()["id"])
        block_until(
            lambda: all(one["is_open"] for one in http.get("/api/devices").json() if one["id"] in made),
            "the sources are open",
        )
        try:
            yield addresses["tcp-listen"], addresses["udp"]
        finally:
            for device in made:
                http.delete(f"/api/devices/{device}").raise_for_status()


def _free(kind: socket.SocketKind) -> tuple[str, int]:
    with socket.socket(socket.AF_INET, kind) as result:
        result.bind(("127.0.0.1", 0))
        address: tuple[str, int] = result.getsockname()
        return address


for _name in BYTES:
    FLOODS[_name] = of_bytes(_name)


@flood
def ports(place: Place) -> None:
    """Send each datagram from a different port."""
    with sources(place, "xbus") as (_, udp):
        place.begin()
        number = 0
        while not place.over:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
                sender.sendto(frame(number, 2000.0), udp)
            number += 1


# -- strangers ---------------------------------------------------------------------------------------------------------


@flood
def silent_connections(place: Place) -> None:
    """Open more connections than allowed, none of which sends a request."""
    place.begin()
    with contextlib.ExitStack() as held:
        for _ in range(SILENT):
            with contextlib.suppress(OSError):
                held.enter_context(place.connected())
        place.until_over()


@flood
def endless_heads(place: Place) -> None:
    """Requests with endless headers, some in large pieces and some byte by byte."""
    place.begin()
    while not place.over:
        with contextlib.ExitStack() as held:
            streams = [held.enter_context(place.connected()) for _ in range(20)]
            with contextlib.suppress(OSError):
                for stream in streams:
                    stream.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n")
                for step in range(200):
                    for number, stream in enumerate(streams):
                        stream.sendall(b"X-%d: " % step + b"y" * 300 + b"\r\n" if number % 2 else b"y")


@flood
def unread_answers(place: Place) -> None:
    """Request large answers without reading them."""
    place.begin()
    with contextlib.ExitStack() as held:
        for _ in range(DEAF):
            stream = held.enter_context(place.connected())
            stream.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            with contextlib.suppress(OSError):
                stream.sendall(b"GET /openapi.json HTTP/1.1\r\nHost: localhost\r\n\r\n" * 4)
        place.until_over()


def _browser(place: Place) -> ClientConnection:
    url = f"{place.url.replace('http', 'ws', 1)}/ws"
    return connect(url, subprotocols=[Subprotocol(wire.SUBPROTOCOL)], compression=None, max_size=None, close_timeout=0)


@flood
def websocket_requests(place: Place) -> None:
    """Browsers that subscribe repeatedly, with all history, and read nothing."""
    place.begin()
    with contextlib.ExitStack() as held:
        browsers = [held.enter_context(_browser(place)) for _ in range(CHATTY)]
        while not place.over:
            for browser in browsers:
                with contextlib.suppress(ConnectionClosed, OSError):
                    browser.send('{"op": "subscribe", "history": 600}')


@flood
def websocket_pieces(place: Place) -> None:
    """Messages of endless empty pieces, and pings."""
    host, port = place.address
    request = (
        f"GET /ws HTTP/1.1\r\nHost: {host}:{port}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
        f"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n"
        f"Sec-WebSocket-Protocol: {wire.SUBPROTOCOL}\r\n\r\n"
    )
    begun, piece, ping = (bytes.fromhex(one) for one in ("01810000000020", "008000000000", "898000000000"))
    place.begin()
    while not place.over:
        for data in (piece, ping):
            with contextlib.suppress(OSError), place.connected() as browser:
                browser.sendall(request.encode())
                browser.recv(4096)
                browser.sendall(begun + data * 5000)


# -- questions ---------------------------------------------------------------------------------------------------------


@flood
def requests(place: Place) -> None:
    """One after the other on many connections, as fast as they are taken; answers are thrown away."""
    place.begin()
    request = b"GET /api/devices HTTP/1.1\r\nHost: localhost\r\n\r\n" * 50
    with contextlib.ExitStack() as held:
        streams = [held.enter_context(place.connected()) for _ in range(20)]
        for stream in streams:
            stream.setblocking(False)
        while not place.over:
            for number, stream in enumerate(streams):
                try:
                    with contextlib.suppress(BlockingIOError):
                        stream.send(request)
                    with contextlib.suppress(BlockingIOError):
                        while stream.recv(1 << 20):
                            pass
                except OSError:
                    streams[number] = held.enter_context(place.connected())
                    streams[number].setblocking(False)
            select.select(streams, [], [], PATIENCE_S)


@flood
def tables(place: Place) -> None:
    """Whole channels of a long recording, several at once, as JSON and as Arrow."""
    with contextlib.ExitStack() as held:
        readers = [held.enter_context(http_client(base_url=place.url)) for _ in range(4)]
        recording = f"/api/recordings/{RECORDING}"
        block_until(lambda: readers[0].get(recording).status_code != 202, "it is decoded, or cannot be")
        place.begin()
        path = f"{recording}/query?channel=Acceleration"
        while not place.over:
            answers = [
                held.enter_context(reader.stream("GET", f"{path}&format={'json' if n % 2 else 'arrow'}"))
                for n, reader in enumerate(readers)
            ]
            for answer in answers:
                read(answer, place)


def read(answer: httpx.Response, place: Place) -> None:
    """Take an answer, as long as the flood lasts."""
    for _ in answer.iter_raw():
        if place.over:
            return


# -- files -------------------------------------------------------------------------------------------------------------


@flood
def pipes(place: Place) -> None:
    """Sources that are pipes, and files that wait for ever when they are read."""
    pipe = place.data / "recordings" / "pipe"
    if not pipe.exists():
        os.mkfifo(pipe)
    place.begin()
    with http_client(base_url=place.url) as http:
        while not place.over:
            for path in (pipe, Path("/proc/kmsg"), Path("/dev/zero"), Path("/dev/stdin")):
                answer = http.post("/api/devices", json={"source": f"{path}?protocol=xbus"})
                if answer.status_code == 201:
                    http.delete(f"/api/devices/{answer.json()['id']}").raise_for_status()


@flood
def hostile_files(place: Place) -> None:
    """Recordings made to do harm lie in the library, and are listed and opened."""
    folder = place.data / "recordings"
    for name, write in HOSTILE.items():
        if not (folder / name).exists():
            write(folder / name)
    place.begin()
    with http_client(base_url=place.url) as http:
        while not place.over:
            listed = {one["id"] for one in http.get("/api/recordings").json()}
            for name in HOSTILE:
                if (recording := name.partition(".")[0]) in listed:
                    http.get(f"/api/recordings/{recording}")


def _metadata(path: Path) -> None:
    """Very many records with almost no content."""
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, index_types=IndexType.ALL)
        writer.start()
        for number in range(20_000):
            writer.add_metadata(f"device/{number}", {"product": "MTi-630"})
        writer.finish()  # type: ignore[no-untyped-call]


def _channels(path: Path) -> None:
    """Very many channels, with a message in each."""
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start()
        schema = writer.register_schema("schema", "jsonschema", b'{"type":"object"}')
        for number in range(10_000):
            channel = writer.register_channel(f"/{number}", "json", schema)
            writer.add_message(channel, number, b'{"x":1}', number)
        writer.finish()  # type: ignore[no-untyped-call]


def _bomb(path: Path) -> None:
    """A small chunk that unpacks to very much."""
    data = bytes(LARGEST_CHUNK + 1)
    body = zstandard.compress(data)
    head = struct.pack("<QQQI", 0, 0, len(data), 0) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(body))
    path.write_bytes(MAGIC + struct.pack("<BQ", CHUNK, len(head) + len(body)) + head + body)


def _nested(path: Path) -> None:
    """Metadata of a recording, nested deeper than any reader supports."""
    path.write_bytes(frame(0, 100.0) * 100)
    path.with_name(f"{path.name}.json").write_text(json.dumps({"title": "x"})[:-1] + ',"tags":' + "[" * 50_000)


HOSTILE: dict[str, Callable[[Path], None]] = {
    "metadata.mcap": _metadata,
    "channels.mcap": _channels,
    "bomb.mcap": _bomb,
    "nested.bin": _nested,
}
