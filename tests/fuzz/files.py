"""Fuzzing of damaged files: each is refused with a message, or opened as far as it is intact.

    a whole file of each kind ──> mutated ──> the very functions that read it ──> documented error, or what it holds
         SEEDS                     _mutated        READERS

A kind is a row of READERS: what a file of it is handed to, and which exception says no. Files come from the disk (an
upload, a folder shared with others) or from a person (a snapshot, a schema, a body for the scene). For every case:

    - no other exception, and an end within `PATIENCE_S`
    - no memory that the file's own size does not explain: lengths that lie are written on purpose, and all runs within
      `MAX_BYTES` bytes of address space more than there were when it began
    - a recording that was cut off says so

What breaks is made smaller and kept under findings/files/.
"""

from __future__ import annotations

import contextlib
import functools
import io
import json
import lzma
import re
import resource
import shutil
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any

from mcap.writer import CompressionType
from mcap.writer import Writer as LibraryWriter

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.library.probe import probe
from imuscope.recordings.mcap.compaction import compact
from imuscope.recordings.mcap.records import MAGIC
from imuscope.recordings.mcap.writer import McapWriter
from imuscope.recordings.sidecar import VERSION, Edits
from imuscope.server.configuration.snapshot_text import from_text
from imuscope.server.configuration.snapshots import SnapshotError
from imuscope.server.devices.decode.decode_options import DecodeOptionError, checked_options
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.extensions.viser import meshes
from imuscope.server.library.decode import decode
from imuscope.server.settings.config import ConfigError, load
from tests.fuzz.cases import BrokenError, Case, where
from tests.fuzz.reader_files import WHOLE, whole_files
from tests.fuzz.search import CorpusSearch as Decoders
from tests.fuzz.search import Smallest
from tests.support.read_library import ReadLibrary

if TYPE_CHECKING:
    from tests.fuzz.reading import Reading

PATIENCE_S = 60  # no case takes a second on a quiet machine
MAX_BYTES = 1 << 30  # bytes; a case holds some kB. What threads reserve at once is in it
LOGS = Path(__file__).parents[1] / "golden" / "isb" / "logs"
LOG = "LOG_SN60339_20261120_120000_0001"
START = 1_760_000_000_000_000_000

# -- readers -----------------------------------------------------------------------------------------------------------


def _recording(path: Path, cut: bool) -> None:
    """As the list, the library and the decoder meet it."""
    observed = probe(path)
    source = None
    try:
        source = open_file(path)
        columns = decode(source, path.parent / "store", all_protocols())
        json.dumps(columns.manifest, ensure_ascii=False).encode()  # as it is sent to a page
    except RecordingError as error:
        _sentence(error.message)
        return
    if cut and path.suffix == ".mcap":
        report = bool(source.damage) or (observed is not None and observed.damaged)
        if not report:
            raise BrokenError("silent", "a recording that was cut off is taken as whole")


def _listed(path: Path, cut: bool) -> None:
    """Files beside a recording: user-given names and cached findings."""
    library = ReadLibrary(path.parent)
    for entry in library.all("drive"):
        library.edit(entry.id, Edits(title="again"))
    messages = [
        [entry.title, entry.edits.notes, entry.edits.tags, *map(asdict, entry.edits.markers)] for entry in library.all()
    ]
    json.dumps(messages, ensure_ascii=False).encode()  # as it is sent to a page


def _refused(read: Callable[[Path], Any], *errors: type[Exception]) -> Callable[[Path, bool], None]:
    """Reader of a file that may be refused with one of these errors, which says why."""

    def reader(path: Path, cut: bool) -> None:
        try:
            read(path)
        except errors as refusal:
            _sentence(str(refusal))

    return reader


def _text(path: Path) -> str:
    return path.read_bytes().decode("utf-8", "replace")


def _snapshot(path: Path) -> None:
    json.dumps(from_text(_text(path)).body("x").values)


def _schema(path: Path) -> None:
    checked_options("", {"schema": _text(path)})


def _mesh(path: Path) -> None:
    mesh = meshes.read(path.name, path.read_bytes())
    if not 0 < mesh.scale < 1e12:
        raise BrokenError("scale", f"a body of scale {mesh.scale}")


def _sentence(text: str) -> None:
    if not text.strip() or len(text) > 1000 or "Traceback" in text:
        raise BrokenError("words", f"{text!r:.300}")


@dataclass(frozen=True)
class FileKind:
    """A kind of file.

    Args:
        name: under which it is read: what the suffix says, and what lies beside it.
        read: (path, whether it was cut at its end) → raises what is wrong.
        beside: name → bytes, of files that belong to it.
        is_foreign: whether a server reads it in another process.
    """

    name: str
    read: Callable[[Path, bool], None]
    beside: tuple[str, ...] = ()

    @property
    def is_foreign(self) -> bool:
        return self.read is _recording


KINDS = {
    "mcap": FileKind("drive.mcap", _recording),
    "packed": FileKind("drive.mcap", _recording),
    "lz4": FileKind("drive.mcap", _recording),
    "json": FileKind("drive.mcap", _recording),
    "raw": FileKind(f"{LOG}.raw", _recording),
    "idx": FileKind(f"{LOG}.idx", lambda path, cut: _recording(path.with_suffix(".raw"), False), ("raw",)),
    "dat": FileKind(f"{LOG}.dat", _recording),
    "mtb": FileKind("drive.mtb", _recording),
    "bin": FileKind("drive.bin", _recording),
    "csv": FileKind("drive.csv", _recording),
    "sidecar": FileKind("drive.mcap.json", _listed, ("packed",)),
    "snapshot": FileKind("a.yaml", _refused(_snapshot, SnapshotError)),
    "schema": FileKind("a.toml", _refused(_schema, DecodeOptionError)),
    "configuration": FileKind("a.toml", _refused(lambda path: load(path).reading(), ConfigError, DecodeOptionError)),
    "glb": FileKind("a.glb", _refused(_mesh, meshes.MeshError)),
    "stl": FileKind("a.stl", _refused(_mesh, meshes.MeshError)),
    "text-stl": FileKind("a.stl", _refused(_mesh, meshes.MeshError)),
    **{kind: FileKind(name, _recording) for kind, (name, _) in WHOLE.items()},
}

# -- whole files -------------------------------------------------------------------------------------------------------


def _streams(protocol: str) -> list[bytes]:
    return [b"".join(pieces) for pieces in Decoders(protocol, seed=0, captures=False).corpus[:12]]


def _ours(path: Path, streams: list[bytes]) -> None:
    writer = McapWriter(path, {"title": "A drive"})
    writer.device("1", {"protocol": "xbus", "name": "MTi-630", "baud": "115200", "link": "serial"})
    for number, data in enumerate(streams):
        for at in range(0, len(data), 200):
            writer.chunk("1", "rx", data[at : at + 200], START + number * 50_000_000 + at * 10_000)
    event = {"device": "1", "kind": "link", "level": "info", "text": "here", "time": START / 1e9, "data": {}}
    writer.event(event, START)
    writer.write_note("marker", "kerb", START + 5, "1")
    writer.snapshot("1", {"values": {"OptionFlags": {"set": 1}}, "taken": START / 1e9}, START + 6)
    writer.close()


def _theirs(compression: CompressionType) -> bytes:
    out = io.BytesIO()
    writer = LibraryWriter(out, chunk_size=2000, compression=compression)
    writer.start("", "other")
    schema = writer.register_schema("Imu", "jsonschema", b"{}")
    channel = writer.register_channel("/imu", "json", schema)
    for number in range(80):
        body = {"position": {"x": number / 7, "y": -number}, "covariance": [0, 1.5, number], "text": "on"}
        writer.add_message(channel, START + number * 10**7, json.dumps(body).encode(), START + number * 10**7)
    writer.finish()
    return out.getvalue()


def _glb() -> bytes:
    points = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(points)}],
        "bufferViews": [{"buffer": 0, "byteLength": len(points)}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "images": [{"uri": "data:image/png;base64,AAAA"}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(points), b"BIN\0") + points
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


_SNAPSHOT = """# Settings of an MTi-630
imuscope: 1
title: "Before this change"
taken: "2026-11-21T04:43:24Z"
protocol: "xbus"
product: "MTi-630-8A1G6"
pinned: false
settings:
  OutputConfiguration:
    outputs:
      - {data_identifier: 8208, output_frequency: 100}  # Quaternion, 100 Hz
  FilterProfile:
    profile: "Responsive/VRU"
    gain: 1.0e-3
missing:
  CanConfig: "message unknown"
"""
_SCHEMA = """[[message]]
type = 0x80
name = "W"
doc = "Wheels"
[[message.field]]
name = "V"
type = "i16"
unit = "m/s"
scale = 0.01
count = 4
"""
_CONFIGURATION = """host = "127.0.0.1"
port = 8080
sources = ["/dev/ttyUSB0", "tcp://10.0.0.7:4000"]
key = "00112233"
view_token = "aaaaaaaaaaaa"
control_token = "bbbbbbbbbbbb"
record = true
split_mb = 2000
history_s = 60.5
[map]
tiles = "http://maps.local/{z}/{x}/{y}.png"
"""


def seeds(folder: Path) -> dict[str, bytes]:
    """A whole file of each kind."""
    xbus, isb, idtp = (_streams(name) for name in ("xbus", "isb", "idtp"))
    path = folder / "a.mcap"
    _ours(path, xbus)
    loose = path.read_bytes()
    compact(path)
    rows = "".join(f"{1760000000 + i / 100:.2f},{i / 7:.3f},{i % 5}\n" for i in range(60))
    triangles = b"".join(struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, i, 0) for i in range(6))
    edits = {"imuscope": VERSION, "title": "A drive", "tags": ["kerb"], "notes": "x", "pinned": True}
    marker = {"id": 1, "time": 1.76e9, "kind": "note", "text": "x", "device": "1"}
    raw = b"".join(isb)
    return {
        "mcap": loose,
        "packed": path.read_bytes(),
        "lz4": _theirs(CompressionType.LZ4),
        "json": _theirs(CompressionType.NONE),
        "raw": raw,
        "idx": struct.pack("<40I", *(part for i in range(10) for part in (i * 100, i * len(raw) // 10, i, 0))),
        "dat": lzma.decompress((LOGS / "log.dat.xz").read_bytes())[:20_000],
        "mtb": b"".join(xbus),
        "bin": b"".join(idtp),
        "csv": f"time (s),Acceleration.x (m/s²),Temperature [°C]\n{rows}".encode(),
        "sidecar": json.dumps({**edits, "markers": [marker]}).encode(),
        "snapshot": _SNAPSHOT.encode(),
        "schema": _SCHEMA.encode(),
        "configuration": _CONFIGURATION.encode(),
        "glb": _glb(),
        "stl": bytes(80) + struct.pack("<I", 6) + triangles,
        "text-stl": b"solid a\nfacet normal 0 0 1\nouter loop\n"
        + b"".join(b"vertex %d %d 0\n" % (i % 2, i // 2) for i in range(3))
        + b"endloop\nendfacet\nendsolid a\n",
        **whole_files(folder),
    }


# -- damage ------------------------------------------------------------------------------------------------------------

_NUMBERS = (
    0,
    1,
    2,
    0x7F,
    0x80,
    0xFF,
    0x7FFF,
    0xFFFF,
    0x7FFF_FFFF,
    0x8000_0000,
    0xFFFF_FFFF,
    2**63 - 1,
    2**63,
    2**64 - 1,
)
_TOKENS = (
    b"nan", b"inf", b"-inf", b"1e999", b"9" * 400, b"-1", b"0x80", b"true", b"null", b'""', b"{}", b"[]", b"[" * 3000,
    b"{" * 3000, b'{"a":' * 3000, b"&a [*a]", b"!!python/object:os.system", b"\x00", b'"\\ud800"', b"\xff\xfe",
    b"\xed\xa0\x80",
    b"\r\n", b",", b";" * 2000, b'"', b"'", b"#", b"x" * 5000, b"2026-13-45T99:99:99Z", b"0001-01-01", b"12:30:45",
    b"- - - - -", b"[[message]]", b"[message]", b"~", b"1_000", b"0o17", b"4294967295", b"18446744073709551616",
    b"1e308", b"http://other.example/x", b"<<: *a", b"? :", b"|\n ", b">\n ", b"\t", b"\xe2\x88\x9e",
)  # fmt: skip
_WORD = re.compile(rb"[\w.+-]+|[^\w\s]")
TEXTS = ("csv", "sidecar", "snapshot", "schema", "configuration", "text-stl", "glb", "json")


def _turned(data: bytearray, random: Random) -> None:
    for _ in range(random.choice((1, 1, 2, 8))):
        data[random.randrange(len(data))] ^= 1 << random.randrange(8)


def _lied(data: bytearray, random: Random) -> None:
    """A number where it may be a length."""
    size = random.choice((1, 2, 4, 4, 8, 8))
    at = random.randrange(max(1, len(data) - size))
    value = random.choice(_NUMBERS) if random.random() < 0.7 else len(data) + random.randrange(-9, 9)
    data[at : at + size] = (value % (1 << 8 * size)).to_bytes(size, random.choice(("little", "little", "big")))


def _lost(data: bytearray, random: Random) -> None:
    at = random.randrange(len(data))
    del data[at : at + random.choice((1, 3, 9, 100, 1000))]


def _doubled(data: bytearray, random: Random) -> None:
    at = random.randrange(len(data))
    piece = data[at : at + random.choice((1, 9, 40, 400))]
    data[at:at] = piece * random.choice((1, 1, 2, 30))


def _filled(data: bytearray, random: Random) -> None:
    at, size = random.randrange(len(data)), random.choice((4, 8, 64, 512))
    data[at : at + size] = random.choice((bytes(size), b"\xff" * size, random.randbytes(size)))


def _worded(data: bytearray, random: Random) -> None:
    words = list(_WORD.finditer(bytes(data)))
    if words:
        word = random.choice(words)
        other = random.choice(_TOKENS) if random.random() < 0.7 else random.choice(words)[0]
        data[word.start() : word.end()] = other


def _mutated(kind: str, whole: bytes, random: Random) -> Case:
    data = bytearray(whole)
    ways = [_turned, _lied, _lied, _lost, _doubled, _filled]
    if kind in TEXTS:
        ways += [_worded] * 8
    for _ in range(random.choice((1, 1, 1, 2, 4))):
        if data:
            random.choice(ways)(data, random)
    if kind in ("mcap", "packed", "lz4", "json") and random.random() < 0.4:
        data = _resealed(data, random)
    cut = bool(data) and random.random() < 0.15
    if cut:
        del data[random.randrange(len(data)) :]
    if kind == "glb" and len(data) >= 12 and random.random() < 0.7:
        data[8:12] = len(data).to_bytes(4, "little")  # else nothing behind its head is looked at
    return Case(bytes(data), (), {"kind": kind, "cut": cut})


def _resealed(data: bytearray, random: Random) -> bytearray:
    """With the checksum of the summary right again, or none: what is behind it is believed."""
    footer = len(data) - len(MAGIC) - 29
    if footer > 0 and data[-len(MAGIC) :] == MAGIC and data[footer] == 2:
        (start,) = struct.unpack_from("<Q", data, footer + 9)
        report = zlib.crc32(data[start : footer + 25]) if start < footer and random.random() < 0.5 else 0
        struct.pack_into("<I", data, footer + 25, report)
    return data


# -- the search --------------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def bounded(room: int = MAX_BYTES) -> Iterator[None]:
    """Limit the address space to this many bytes above current use; available on Linux only."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[0])
    except OSError:
        yield
        return
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + room, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


class FileSearch:
    """Cases of every kind in turn; the same seed gives the same cases.

    Args:
        folder: for the files; emptied for each case.
    """

    def __init__(self, folder: Path, seed: int, kinds: tuple[str, ...] = tuple(KINDS)) -> None:
        self.cases = 0
        self.refused = 0
        self._folder = folder
        self._random = Random(seed)
        self._kinds = kinds
        made = folder / "seeds"
        made.mkdir(parents=True)
        self.whole = seeds(made)

    @functools.cached_property
    def reading(self) -> Reading:
        """The process in whose forks files from outside are read."""
        from tests.fuzz.reading import Reading  # which imports this module

        return Reading()

    def close(self) -> None:
        """End what reads."""
        if "reading" in vars(self):
            self.reading.close()

    def case(self) -> Case:
        """The next one."""
        kind = self._kinds[self.cases % len(self._kinds)]
        self.cases += 1
        return _mutated(kind, self.whole[kind], self._random)

    def check(self, case: Case) -> None:
        """Hand a case to its reader.

        Raises:
            BrokenError: what should not have happened.
        """
        kind = KINDS[case.settings["kind"]]
        place = self._folder / "case"
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir()
        path = place / kind.name
        path.write_bytes(case.data)
        for other in kind.beside:
            (place / KINDS[other].name).write_bytes(self.whole[other])
        if kind.is_foreign:
            self.reading.check(path, case.settings["kind"], cut=case.settings["cut"])
        else:
            attempt(kind, path, case.settings["kind"], cut=case.settings["cut"])

    def smaller(self, case: Case, broken: BrokenError, attempts: int = 150) -> tuple[Case, BrokenError]:
        """The minimal case that still breaks."""
        smallest = Smallest(self.check, case, broken, attempts)
        smallest.shorten()
        return smallest.case, smallest.broken


def attempt(kind: FileKind, path: Path, name: str, *, cut: bool) -> None:
    """Hand a file to its reader.

    Raises:
        BrokenError: what should not have happened.
    """
    try:
        kind.read(path, cut)
    except BrokenError:
        raise
    except MemoryError:
        raise BrokenError("memory", f"a {name} of {path.stat().st_size} bytes took too much") from None
    except Exception as error:
        raise BrokenError(type(error).__name__, f"{error!s:.300} ({where(error)})") from error
