"""Fuzz targets, one per protocol: structure of frames, initial cases, settings.

A protocol is one more class here, and one more row of TARGETS.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from random import Random
from typing import Any

from imuscope.protocols.idtp.simulator import IdtpSimulator
from imuscope.protocols.isb.dataset_loader import SETS
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from tests.fuzz.mutations import Pieces
from tests.oracles import idtp as idtp_oracle
from tests.oracles import isb as isb_oracle
from tests.oracles import mip as mip_oracle
from tests.oracles import xbus as xbus_oracle
from tests.oracles.checksums import fletcher
from tests.protocols import mip_vectors
from tests.protocols.idtp import idtp_vectors
from tests.protocols.isb import isb_vectors
from tests.protocols.protocol_cases import KEY, SPEAKERS, ProtocolCase
from tests.protocols.xbus import xbus_vectors
from tests.support.faulty_line import FaultyLine

GOLDEN = Path(__file__).parents[1] / "golden"
CAPTURES = Path(__file__).parents[3] / "shared"
_A_CASE = 8  # frames that a seed of the corpus has
_WINDOW = 1500  # bytes of a capture or of a simulator in one
_LENGTHS = (0, 1, 2, 3, 254, 255, 256, 972, 973, 1024, 1025, 2040, 2041, 2048, 8185, 8186, 0x8000, 0xFFFF)
_FLOATS = tuple(
    struct.pack(order + kind, value)
    for value in (float("nan"), float("inf"), -float("inf"), -0.0, 1e300 * 1e-265, 3.4e38, 1.0)
    for order, kind in (("<", "f"), (">", "f"), ("<", "d"))
)


class FuzzTarget:
    """One protocol."""

    speaker: ProtocolCase
    words: Sequence[bytes]
    captures: Sequence[str] = ()  # under the shared folder

    def mend(self, frame: bytes, random: Random, *, length: bool) -> bytes:
        """See mutations.Frames, as `lie`, `make` and `body`."""
        begin, end = self.body(frame)
        return self._mended(frame, begin, end, random, length=length) if begin else frame

    def lie(self, frame: bytes, random: Random) -> bytes:
        return self._lying(frame, random) if self.body(frame)[0] else frame

    def make(self, random: Random) -> bytes:
        raise NotImplementedError

    def body(self, frame: bytes) -> tuple[int, int]:
        """Also (0, its end) of what has no whole header."""
        raise NotImplementedError

    def _mended(self, frame: bytes, begin: int, end: int, random: Random, *, length: bool) -> bytes:
        raise NotImplementedError

    def _lying(self, frame: bytes, random: Random) -> bytes:
        raise NotImplementedError

    def frames(self, data: bytes) -> Iterator[tuple[int, int]]:
        """Begin and size of the frames in `data`, by the oracle."""
        raise NotImplementedError

    def simulator(self, seed: int) -> bytes:
        """First output of a simulator, with faults."""
        raise NotImplementedError

    def settings(self, random: Random) -> dict[str, Any]:
        """Settings of the decoder in a case."""
        return {}

    def pieces(self, data: bytes) -> Pieces:
        """Frames, and what is between them."""
        results: Pieces = []
        at = 0
        for begin, size in self.frames(data):
            results += [data[at:begin]] * (begin > at) + [data[begin : begin + size]]
            at = begin + size
        return results + [data[at:]] * (at < len(data))

    def seeds(self, *, captures: bool) -> list[Pieces]:
        """Initial corpus: golden vectors, the simulator and, with `captures`, recordings beside the project."""
        vectors = list(self.speaker.everything())
        seeds = [vectors[at : at + _A_CASE] for at in range(0, len(vectors), _A_CASE)]
        streams = [self.simulator(seed) for seed in range(3)]
        for name in self.captures if captures else ():
            streams += [path.read_bytes() for path in sorted(CAPTURES.glob(name))]
        for stream in streams:
            starts = range(0, len(stream), max(_WINDOW, len(stream) // 12))
            seeds += [self.pieces(stream[at : at + _WINDOW]) for at in starts]
        return seeds


class Xbus(FuzzTarget):
    speaker = SPEAKERS["xbus"]
    captures = ("captures/xbus/*.bin", "vectors/xbus/*.mtb")
    words = (
        *(
            b"\xfa",
            b"\xfa\xff",
            b"\xfa\xff\x36",
            b"\xfa\xff\x36\xff",
            b"\xfa\x00\x00",
            b"\x00\x00",
            b"\xff\xff",
            b"\xff",
        ),
        *(
            b"\x10\x20\x02",
            b"\x10\x60\x04",
            b"\x10\x70\x04",
            b"\x10\x10\x0c",
            b"\xe0\x20\x04",
            b"\xa0\x80\xff",
            b"\x70\x20",
        ),
        *(b"\x00\x90", b":", b"$", b"\r\n", b"\x20\x10\x10", b"\x20\x1f\x10", b"\x1f\xf9", *_FLOATS),
    )

    def body(self, frame: bytes) -> tuple[int, int]:
        begin = 6 if frame[3:4] == b"\xff" else 4
        return (begin, len(frame) - 1) if frame[:1] == b"\xfa" and len(frame) > begin else (0, len(frame))

    def _mended(self, frame: bytes, begin: int, end: int, random: Random, *, length: bool) -> bytes:
        if length:
            payload = frame[begin:end]
            long = len(payload) > 254 or begin == 6
            size = b"\xff" + (len(payload) & 0xFFFF).to_bytes(2, "big") if long else bytes([len(payload)])
            frame = frame[:3] + size + payload + b"\0"
        return frame[:-1] + bytes([-sum(frame[1:-1]) % 256])

    def _lying(self, frame: bytes, random: Random) -> bytes:
        length = random.choice((*_LENGTHS, random.randrange(300)))
        if random.random() < 0.5:
            return frame[:3] + bytes([length & 0xFF]) + frame[4:]
        return frame[:3] + b"\xff" + length.to_bytes(2, "big") + frame[4:]

    def make(self, random: Random) -> bytes:
        if random.random() < 0.3:
            payload = random.randbytes(random.choice((0, 1, 2, 3, 4, 8, 20, 44, 118, 260)))
            return xbus_oracle.build(random.randrange(1, 256), payload, random.choice((0xFF, 0xFF, 0, 1)))
        payload = b""
        for _ in range(random.randint(0, 6)):
            item = xbus_vectors.frame(random.choice(xbus_vectors.COMPUTED["items"]))[4:-1]
            if random.random() < 0.3:
                item = item[:2] + bytes([random.randrange(30)]) + item[3:]
            if random.random() < 0.3:
                identifier = int.from_bytes(item[:2], "big") ^ random.choice((1, 2, 3, 4, 8, 12, 0x10, 0x8000))
                item = identifier.to_bytes(2, "big") + item[2:]
            payload += item
        if random.random() < 0.1:
            blob = b"\xa0\x80\xff" + random.randbytes(255)
            payload += blob * random.randint(1, 3) + b"\xa0\x80\x03abc"
        counter = b"\x10\x20\x02" + random.choice((0, 1, 2, 65535, random.randrange(65536))).to_bytes(2, "big")
        ticks = random.choice((0, 100, 200, 863_999_999, 864_000_000, 2**32 - 1, random.randrange(2**32)))
        clock = random.choice(
            (b"", b"\x10\x60\x04" + ticks.to_bytes(4, "big"), b"\x10\x70\x04" + ticks.to_bytes(4, "big"))
        )
        return xbus_oracle.build(0x36, counter * (random.random() < 0.7) + clock + payload)

    def frames(self, data: bytes) -> Iterator[tuple[int, int]]:
        return ((one.offset, one.size) for one in xbus_oracle.scan(data, final=True).frames)

    def simulator(self, seed: int) -> bytes:
        product = ("MTi-630", "MTi-680G", "MTi-G-710")[seed % 3]
        device = FaultyLine("xbus", XbusSimulator(product, seed=seed), drop=0.05, corrupt=0.05, seed=seed)
        return device.advance(10**9) + device.receive(b"\xfa\xff\x30\x00\xd1\xfa\xff\x00\x00\x01", 1_010_000_000)


class Isb(FuzzTarget):
    speaker = SPEAKERS["isb"]
    captures = ("vectors/isb/logs/*.raw", "vectors/isb/logs/*.dat")
    words = (
        *(
            b"\xef\x49",
            b"\xef",
            b"\x49",
            b"\xef\x49\x04\x04",
            b"\xef\x49\x24\x04",
            b"\xef\x49\x04\x45",
            b"\x00\x00",
            b"\xff\xff",
        ),
        *(
            b"\x58\x09\x00\x00",
            b"\x00\x00\x00\x00",
            b"\x08\x00",
            b"\x01\x00\x00\x00",
            b"\x02\x07\x01\x00",
            b"\x02\x00\x03\x00",
        ),
        *(b"\xb5\x62", b"\xd3", b"$", b"\r\n", b"\x00\x80", *_FLOATS),
    )

    def body(self, frame: bytes) -> tuple[int, int]:
        return (6, len(frame) - 2) if frame[:2] == b"\xef\x49" and len(frame) >= 8 else (0, len(frame))

    def _mended(self, frame: bytes, begin: int, end: int, random: Random, *, length: bool) -> bytes:
        head = frame[:end]
        if length:
            head = head[:4] + ((end - begin) & 0xFFFF).to_bytes(2, "little") + head[6:]
        return head + fletcher(head)

    def _lying(self, frame: bytes, random: Random) -> bytes:
        return frame[:4] + random.choice((*_LENGTHS, random.randrange(300))).to_bytes(2, "little") + frame[6:]

    def make(self, random: Random) -> bytes:
        kind = random.choice((4, 4, 4, 4, 4, 5, 3, 1, 2, 6, 7, 8))
        if kind not in (4, 5):
            body = random.choice(
                (b"", bytes(9), bytes([4, 0, 0, 0, 0, 0, 1, 0]), random.randbytes(random.randrange(14)))
            )
            return isb_oracle.build(kind | random.choice((0, 0, 0x10, 0x80)), random.randrange(256) * (kind == 7), body)
        did = random.choice((*SETS, 4, 4, 13, 13, 58, 58, 15, 30, 69, 1, 200))
        body = self._payload(did, random)
        change = random.random()
        if change < 0.2:
            body = body[: random.randint(0, len(body))]
        elif change < 0.3:
            body += random.randbytes(random.choice((1, 4, 40)))
        if random.random() < 0.3:
            offset = random.choice((0, 1, 4, 8, 20, len(body) // 2, 1022, 1024, 2000, 0xFFFF))
            body = body[offset : offset + random.choice((1, 4, 12, 40))] or body[:4]
            return isb_oracle.build(kind | 0x20, did, offset.to_bytes(2, "little") + body)
        return isb_oracle.build(kind, did, body)

    def _payload(self, did: int, random: Random) -> bytes:
        """A set with random contents, or nearly empty, and a clock that makes sense or not."""
        row = SETS.get(did)
        size = row.struct.size if row and row.struct else random.randrange(60)
        body = bytearray(random.randbytes(size) if random.random() < 0.5 else size)
        up, week = random.choice((0.5, 1.0, 1.25, 2.0, 500.0, 1e9, -1.0)), random.choice((0, 2392, 2392, 2393, 7, 9000))
        tow = random.choice((1.0, 432_000.0, 432_000.2, 604_799.9, 0.0))
        clock = {
            "week+timeOfWeek": struct.pack("<Id", week, tow),
            "week+timeOfWeekMs": struct.pack("<II", week, int(tow * 1000)),
            "timeOfWeekMs": struct.pack("<I", int(tow * 1000)),
            "timeOfWeek": struct.pack("<d", tow),
            "time": struct.pack("<d", up),
        }.get(row.clock if row else "", b"")
        body[: len(clock)] = clock[:size]
        if did == 13 and size >= 88:
            body[80:88] = struct.pack("<d", random.choice((431_999.0, 431_000.0, 0.0, -5.0)))
        if did in (15, 16, 69, 60, 70) and size > 8:
            body[0:4] = random.choice((bytes(body[:4]), bytes([1, random.randrange(8), random.randrange(16), 0])))
            body[4:8] = random.choice((0, 1, 3, 50, 51, 255, 2**32 - 1)).to_bytes(4, "little")
        return bytes(body)

    def frames(self, data: bytes) -> Iterator[tuple[int, int]]:
        return ((one.offset, one.size) for one in isb_oracle.scan(data, final=True).packets)

    def simulator(self, seed: int) -> bytes:
        device = FaultyLine("isb", IsbSimulator(seed=seed), drop=0.05, corrupt=0.05, seed=seed)
        return device.advance(1_500_000_000) + device.receive(
            isb_vectors.packet(isb_vectors.COMMANDS[0]), 1_510_000_000
        )


class Idtp(FuzzTarget):
    speaker = SPEAKERS["idtp"]
    words = (
        *(
            b"IDTP",
            b"IDTP",
            b"INDT",
            b"ID",
            b"I",
            b"\x21\x00\x06",
            b"\x21\x01\x00",
            b"\x21\x02\x05",
            b"\x00\x00\x00\x00",
        ),
        *(b"\xff\xff\xff\xff", b"\xff\xff", b"\xcc\x03", b"\xcd\x03", b"\x20", b"\x22", b"\x31", *_FLOATS),
    )

    def body(self, frame: bytes) -> tuple[int, int]:
        if frame[:4] != b"IDTP" or len(frame) < 20:
            return 0, len(frame)
        trailer = {0: 0, 1: 4, 2: 32}.get(frame[17], 0)
        return 20, max(20, len(frame) - trailer)

    def _mended(self, frame: bytes, begin: int, end: int, random: Random, *, length: bool) -> bytes:
        head, payload, mode = frame[:19], frame[20:end], frame[17]
        if length:
            head = head[:14] + (len(payload) & 0xFFFF).to_bytes(2, "little") + head[16:]
        return self._sealed(head, payload, mode, random)

    @staticmethod
    def _sealed(head: bytes, payload: bytes, mode: int, random: Random) -> bytes:
        frame = head + bytes([idtp_oracle.crc8(head)]) + payload
        if mode == idtp_oracle.SAFETY:
            return frame + struct.pack("<I", idtp_oracle.crc32(frame))
        if mode == idtp_oracle.SECURE:
            key = KEY if random.random() < 0.9 else b"another"
            return frame + idtp_oracle.hmac.digest(key, frame, "sha256")
        return frame

    def _lying(self, frame: bytes, random: Random) -> bytes:
        return frame[:14] + random.choice((*_LENGTHS, random.randrange(80))).to_bytes(2, "little") + frame[16:]

    def make(self, random: Random) -> bytes:
        kind = random.choice((0, 1, 2, 3, 4, 5, 6, 6, 7, 0x7F, 0x80, 0x91, 0xFF))
        size = 4 * len(idtp_oracle.TYPES.get(kind, ())) or random.choice((0, 1, 12, 200, 972, 973))
        size = max(0, size + random.choice((0, 0, 0, 0, -1, -4, 1, 4)))
        payload = b"".join(random.choice(_FLOATS[::3]) for _ in range(size // 4 + 1))[:size]
        if random.random() < 0.5:
            payload = random.randbytes(size)
        mode = random.choice((0, 0, 1, 1, 2))
        near = random.choice((0, 1, 2, 3, 5, 100, 65_537, 70_000, 70_001, 2**31, 2**31 + 1, 2**32 - 1))
        sequence = near if random.random() < 0.8 else random.randrange(2**32)
        head = struct.pack(
            "<4sIIHHBBB",
            b"IDTP" if random.random() < 0.95 else b"INDT",
            random.choice((0, 1000, 2000, 2**31, 2**32 - 1, random.randrange(2**32))),
            sequence,
            random.choice((1, 1, 2, 0xFFFF)),
            size,
            random.choice((0x21, 0x21, 0x21, 0x21, 0x20, 0x22, 0x2F, 0x11, 0x30)),
            mode if random.random() < 0.95 else 3,
            kind,
        )
        return self._sealed(head, payload, mode, random)

    def frames(self, data: bytes) -> Iterator[tuple[int, int]]:
        return ((one.offset, one.size) for one in idtp_oracle.scan(data, final=True, key=KEY).frames)

    def simulator(self, seed: int) -> bytes:
        device = IdtpSimulator(7, seed=seed, mode=seed % 3, key=KEY)
        return FaultyLine("idtp", device, drop=0.05, corrupt=0.05, seed=seed).advance(250_000_000)

    def settings(self, random: Random) -> dict[str, Any]:
        choices: tuple[dict[str, Any], ...] = (
            *({}, {}, {"key": KEY, "min_mode": 0}, {"key": KEY, "min_mode": 0}, {"key": KEY}, {"min_mode": 1}),
            *({"key": KEY, "min_mode": 1, "replay_check": False}, {"replay_check": False}, {"show_unverified": True}),
            {"key": b"another", "min_mode": 0},
        )
        return dict(random.choice(choices))


class Mip(FuzzTarget):
    """The family of the plug-in."""

    speaker = SPEAKERS["mip"]
    words = (
        b"\x75\x65",
        b"\x75",
        b"\x65",
        b"\x75\x65\x80",
        b"\x75\x65\x82",
        b"\x02",
        b"\x0e\x04",
        b"\x0e\x05",
        *_FLOATS,
    )

    def body(self, frame: bytes) -> tuple[int, int]:
        return (4, len(frame) - 2) if frame[:2] == b"\x75\x65" and len(frame) > 6 else (0, len(frame))

    def _mended(self, frame: bytes, begin: int, end: int, random: Random, *, length: bool) -> bytes:
        head = frame[:end]
        if length:
            head = head[:3] + bytes([(end - begin) & 0xFF]) + head[4:]
        return head + fletcher(head)

    def _lying(self, frame: bytes, random: Random) -> bytes:
        return frame[:3] + bytes([random.choice((*_LENGTHS, random.randrange(256))) & 0xFF]) + frame[4:]

    def make(self, random: Random) -> bytes:
        number = random.choice((0x80, 0x80, 0x82, 0x82, 0x01, 0x0C, 0x0D, random.randrange(256)))
        body = b""
        for _ in range(random.randint(0, 6)):
            known = [(descriptor, rows) for (of, descriptor), rows in mip_oracle.DATA.items() if of == number]
            descriptor, rows = random.choice(known) if known else (random.randrange(256), [])
            size = struct.calcsize(">" + "".join(kind for _, kind in rows)) or random.randrange(20)
            size = max(0, size + random.choice((0, 0, 0, 0, 0, 1, -1)))
            data = random.randbytes(size) if random.random() < 0.5 else random.choice(_FLOATS) * 8
            body += bytes((size + 2, descriptor)) + data[:size].ljust(size, b"\0")
        head = b"\x75\x65" + bytes((number, len(body[:255]))) + body[:255]
        return head + fletcher(head)

    def frames(self, data: bytes) -> Iterator[tuple[int, int]]:
        return ((offset, len(packet)) for offset, packet in mip_oracle.scan(data)[0])

    def simulator(self, seed: int) -> bytes:
        device = mip_vectors.MipSimulator(rate=100)
        stream = bytearray(
            device.advance(10**9) + device.receive(mip_vectors.build(0x01, [(0x01, b"")]), 1_010_000_000)
        )
        random = Random(seed)
        for _ in range(len(stream) // 200):
            stream[random.randrange(len(stream))] ^= 1 << random.randrange(8)
        return bytes(stream)


TARGETS: dict[str, FuzzTarget] = {"xbus": Xbus(), "isb": Isb(), "idtp": Idtp(), "mip": Mip()}
assert TARGETS.keys() == SPEAKERS.keys()
assert idtp_vectors.KEY == KEY
