"""One case per protocol for shared tests: oracle, JSON values, vectors, and comparable events.

The properties (test_properties.py) and the fuzz target (tests/fuzz) stand on this; a protocol is one row of SPEAKERS.
"""

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from imuscope.protocols.embedded import ubx
from imuscope.protocols.events import Batch, ClockStep, Event, RejectedFrame, Reply, SampleGap, Text
from imuscope.protocols.idtp import frames as idtp
from imuscope.protocols.idtp.json_codec import frame_from_json as idtp_frame_of
from imuscope.protocols.idtp.json_codec import frame_to_json as idtp_plain
from imuscope.protocols.isb import frames as isb
from imuscope.protocols.isb.json_codec import frame_from_json as isb_packet_of
from imuscope.protocols.isb.json_codec import frame_to_json as isb_plain
from imuscope.protocols.registry.families import PROTOCOLS, ProtocolInfo
from imuscope.protocols.xbus.frames import MAX_FRAME
from imuscope.protocols.xbus.json_codec import frame_from_json, frame_to_json
from tests.oracles import idtp as idtp_oracle
from tests.oracles import isb as isb_oracle
from tests.oracles import mip as mip_oracle
from tests.oracles import xbus as oracle
from tests.protocols import mip_vectors
from tests.protocols.idtp import idtp_vectors
from tests.protocols.isb import isb_vectors
from tests.protocols.xbus.xbus_vectors import everything, flat

UNFINISHED_TEXT = 1024
Expected = tuple[list[tuple[int, Any]], list[tuple[int, str]]]
"""Frames as (offset, values or number), and failed candidates as (offset, reason)."""


@dataclass(frozen=True)
class ProtocolCase:
    """One protocol, as these tests need it."""

    name: str
    longest: int  # bytes that may be held back, but for an unfinished text
    preamble: bytes
    plain: Callable[[bytes], dict[str, Any]]
    again: Callable[..., bytes]  # of a listed line, and a key where there are keys
    expected: Callable[..., Expected]  # of bytes, and the decoder's settings
    of_line: Callable[[dict[str, Any]], str]  # a listed line's values, as `expected` spells them
    everything: Callable[[], Iterable[bytes]]
    message_of: Callable[[dict[str, Any]], str] = lambda line: line["message"]  # name of the event of a listed line

    @property
    def family(self) -> ProtocolInfo:
        """Its family, including that of the plug-in."""
        return PROTOCOLS.get(self.name) or mip_vectors.FAMILY


# -- Xbus --------------------------------------------------------------------------------------------------------------


def xbus_expected(data: bytes) -> Expected:
    """Frames and failed candidates, as the oracle sees them: MTData2 as values by name, others as their number."""
    results = oracle.scan(data, final=True)
    frames = [
        (frame.offset, canonical_values(oracle.mtdata2(frame.payload)[0]) if frame.mid == 0x36 else frame.mid)
        for frame in results.frames
    ]
    return frames, results.rejects


# -- ISB ---------------------------------------------------------------------------------------------------------------


def isb_expected(data: bytes) -> Expected:
    """Packets and failed candidates according to the oracle; unknown data sets as values."""
    results = isb_oracle.scan(data, final=True)
    return [(one.offset, isb_values(one)) for one in results.packets], results.rejects


def isb_steady(did: int) -> bool:
    """Has this data set the same structure in every firmware?"""
    return did in {4, 5, 13, 30, 39, 48, 52, 53, 58, 65, 66}


def isb_values(one: isb_oracle.OracleIsbPacket) -> Any:
    row = isb_vectors.FORMATS.get(str(one.did))
    if one.kind != isb.DATA or one.part or not isb_steady(one.did) or not row or len(one.payload) != row["size"]:
        return one.did
    return canonical_values(isb_oracle.values(row["fields"], one.payload))


# -- IDTP --------------------------------------------------------------------------------------------------------------

KEY = idtp_vectors.KEY
IDTP_HEADER = {"timestamp", "sequence", "device_id", "version", "mode"}


def idtp_expected(
    data: bytes,
    *,
    key: bytes | None = None,
    min_mode: int | None = None,
    replay_check: bool = True,
    show_unverified: bool = False,
) -> Expected:
    """Frames that count as values by name, and the others, as the oracle sees them."""
    least = min_mode if min_mode is not None else idtp_oracle.LITE if key is None else idtp_oracle.SECURE
    results = idtp_oracle.scan(data, final=True, key=key, min_mode=least, unverified=show_unverified)
    good, bad = [(one, 0) for one in results.frames], []
    if replay_check:
        good, bad = idtp_oracle.judge(results.frames, keyed=key is not None)
    return [(one.offset, idtp_values(one)) for one, _ in good], sorted(results.rejects + bad)


def idtp_values(one: idtp_oracle.OracleIdtpFrame) -> str:
    values = idtp_oracle.values(one)
    if values is not None:
        return canonical_values({name: [value] for name, value in values.items()})
    described = one.kind in idtp_oracle.TYPES and one.version % 16
    return canonical_values({"data": list(one.payload)} if one.payload or described else {})


def idtp_line(line: dict[str, Any]) -> str:
    return of_line({"fields": {name: value for name, value in line["fields"].items() if name not in IDTP_HEADER}})


# -- MIP, of the plug-in -----------------------------------------------------------------------------------------------


def mip_expected(data: bytes) -> Expected:
    """Packets and failed candidates according to the oracle; unknown data sets as values."""
    packets, rejects = mip_oracle.scan(data)
    frames: list[tuple[int, Any]] = []
    for offset, packet in packets:
        values = mip_oracle.values(packet)
        frames.append((offset, packet[2] if values is None else canonical_values(values)))
    return frames, rejects


# -- plain values, comparable ------------------------------------------------------------------------------------------


def of_line(line: dict[str, Any]) -> str:
    """The values of a listed line, as the oracle spells them."""
    values = {}
    for name, value in line["fields"].items():
        numbers = list(bytes.fromhex(value)) if isinstance(value, str) else spelled(value)
        values[name] = numbers
    return canonical_values(values)


def spelled(value: Any) -> list[Any]:
    """Flat numbers; a float that is not finite from its spelling."""
    if isinstance(value, dict) and set(value) <= {"f32", "f64"}:
        ((kind, digits),) = value.items()
        return [float(np.frombuffer(bytes.fromhex(digits), f">f{int(kind[1:]) // 8}")[0])]
    if isinstance(value, dict):
        return [number for part in value.values() for number in spelled(part)]
    if isinstance(value, list):
        return [number for part in value for number in spelled(part)]
    return flat(value)


# -- events, comparable ------------------------------------------------------------------------------------------------


def canonical_values(values: dict[str, list[Any]]) -> str:
    return json.dumps({name: [str(number) for number in numbers] for name, numbers in values.items()})


def canonical(events: Sequence[Event]) -> list[str]:
    """One text per frame, reply, text, reject, gap and step; what depends on chunks (batches, arrival) is left out."""
    lines = []
    for event in events:
        if isinstance(event, Batch):
            for i, offset in enumerate(event.offset.tolist()):
                row = {name: np.asarray(event.columns[name][i]).tobytes().hex() for name in event.columns}
                time = None if event.time_ns is None else int(event.time_ns[i])
                ids = [field.id for field in event.message.fields]
                lines.append(f"{offset:08} batch {event.message.name} {ids} {row} {time}")
        elif isinstance(event, Reply):
            lines.append(f"{event.offset:08} reply {event.message.name} {event.size} {dict(event.values)}")
        elif isinstance(event, Text):
            lines.append(f"{event.offset:08} text {event.name} {event.line}")
        elif isinstance(event, RejectedFrame):
            lines.append(f"{event.offset:08} reject {event.size} {event.reason}")
        elif isinstance(event, SampleGap):
            lines.append(f"{event.offset:08} gap {event.missing} {event.time_ns}")
        elif isinstance(event, ClockStep):
            lines.append(f"{event.offset:08} step {event.kind} {event.by_ns}")
    return sorted(lines)


def run(speaker: ProtocolCase, chunks: Sequence[bytes]) -> list[Event]:
    decoder = speaker.family.decoding.decoder()
    events: list[Event] = []
    for arrival, chunk in enumerate(chunks):
        decoder.feed(chunk, arrival)
        events += decoder.drain()
        assert decoder.buffered <= speaker.longest + UNFINISHED_TEXT
    events += decoder.drain(stalled=True)
    assert decoder.buffered == 0
    return events


def cut(data: bytes, places: Sequence[int]) -> list[bytes]:
    edges = [0, *sorted(place % (len(data) + 1) for place in places), len(data)]
    return [data[a:b] for a, b in pairwise(edges)]


# -- the protocols -----------------------------------------------------------------------------------------------------

SPEAKERS = {
    "xbus": ProtocolCase(
        "xbus",
        MAX_FRAME,
        b"\xfa",
        frame_to_json,
        frame_from_json,
        xbus_expected,
        lambda line: of_line(line),
        everything,
    ),
    "isb": ProtocolCase(
        "isb",
        isb.MAX_PACKET + ubx.MAX_PAYLOAD_BYTES,
        b"\xef\x49",
        isb_plain,
        isb_packet_of,
        isb_expected,
        lambda line: canonical_values(isb_vectors.leaves(line["fields"])),
        isb_vectors.everything,
    ),
    "idtp": ProtocolCase(
        "idtp",
        idtp.MAX_FRAME,
        b"IDTP",
        idtp_plain,
        lambda record, key=KEY: idtp_frame_of(record, key),
        idtp_expected,
        idtp_line,
        idtp_vectors.everything,
    ),
    "mip": ProtocolCase(
        "mip",
        mip_vectors.MAX_PACKET + ubx.MAX_PAYLOAD_BYTES,
        b"\x75\x65",
        mip_vectors.plain,
        mip_vectors.packet_of,
        mip_expected,
        lambda line: of_line(line),
        mip_vectors.everything,
        lambda line: mip_vectors.DATA.get(line["id"], line["message"]),
    ),
}
