"""Logs of the vendor's logger, decoded as by the vendor's own code.

A .raw log is the port's bytes. A .dat log holds data sets without packets, in chunks:

    32 EA 05 FC  VERSION  34  …  DATA SIZE (4)  ~DATA SIZE (4)  …      40 bytes, then DATA SIZE bytes of
    ID (1)  SIZE (2)  OFFSET (2)  SIZE bytes                           records

It is taken apart here, plainly, and each record is put into a packet. An .idx has for some moments where the .raw was.
"""

import json
import lzma
import math
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from imuscope.protocols.events import Batch, Text
from imuscope.protocols.isb import frames
from imuscope.protocols.isb.decoder import IsbDecoder
from imuscope.protocols.isb.frames import build
from imuscope.protocols.isb.json_codec import frame_from_json, frame_to_json
from tests.oracles import isb as oracle
from tests.protocols.isb.isb_vectors import GOLDEN

LOGS = GOLDEN / "logs"
CHUNK_HEADER, RECORD = struct.Struct("<I12xII16x"), struct.Struct("<BHH")


def read(name: str) -> bytes:
    return lzma.decompress((LOGS / f"{name}.xz").read_bytes())


def rows(name: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in read(name).splitlines()]


def records(data: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Data set, offset and payload of each record of a .dat log."""
    at = 0
    while at < len(data):
        marker, size, inverse = CHUNK_HEADER.unpack_from(data, at)
        assert (marker, size ^ inverse) == (0xFC05EA32, 0xFFFFFFFF)
        at += CHUNK_HEADER.size
        end = at + size
        while at < end:
            did, length, offset = RECORD.unpack_from(data, at)
            at += RECORD.size
            yield did, offset, data[at : at + length]
            at += length
        assert at == end


def same(message: dict[str, Any], expected: dict[str, Any], where: object) -> None:
    """The vendor wrote the main fields of each record, with 9 digits for a float32."""
    for name, value in expected.items():
        if name == "manufacturer":
            assert message[name] == value, where
            continue
        target = list(flat(value))
        got = list(flat(message[name]))[: len(target)]
        for one, other in zip(got, target, strict=True):
            assert math.isclose(one, other, rel_tol=2e-7) or (one != one and other != other), (name, where)


def flat(value: Any) -> Iterator[float]:
    """The numbers of a field, in order."""
    if isinstance(value, list):
        for one in value:
            yield from flat(one)
    else:
        yield value


def test_every_record_of_a_dat_log() -> None:
    expected = rows("dat.values.jsonl")
    results = list(records(read("log.dat")))
    assert [(did, offset, len(payload)) for did, offset, payload in results] == [
        (row["did"], row["offset"], row["size"]) for row in expected
    ]
    for (did, offset, payload), row in zip(results, expected, strict=True):
        packet = build(frames.DATA, did, payload, offset=offset)
        message = frame_to_json(packet)
        assert message["message"] == row["did_name"]
        same(message["fields"], row["fields"], row["n"])
        assert frame_from_json(message) == packet


def test_every_record_of_a_raw_log() -> None:
    """In order, with its values; the decoder merges parts of a set into its last value."""
    data, expected = read("log.raw"), rows("raw.values.jsonl")
    results = oracle.scan(data, final=True)
    sets = [row for row in expected if "did" in row]
    assert [(p.did, p.part or 0, len(p.payload)) for p in results.packets] == [
        (row["did"], row["offset"], row["size"]) for row in sets
    ]
    for one, row in zip(results.packets, sets, strict=True):
        same(frame_to_json(data[one.offset : one.offset + one.size])["fields"], row["fields"], row["n"])
    decoder = IsbDecoder()
    decoder.feed(data, 0)
    events = decoder.drain(stalled=True)
    ins = [event for event in events if isinstance(event, Batch) and event.message.name == "DID_INS_1"]
    found_rows = sorted((int(offset), batch, i) for batch in ins for i, offset in enumerate(batch.offset))
    attitudes = [row for row in sets if row["did"] == 4]
    assert len(found_rows) == len(attitudes)
    last: dict[str, Any] = {}
    for (_, batch, i), row in zip(found_rows, attitudes, strict=True):
        last.update(row["fields"])
        assert (batch.time_ns is None) == (row["offset"] > 0)
        np.testing.assert_allclose(batch.columns["theta"][i], last["theta"], rtol=1e-6)
        assert batch.columns["lla"][i].tolist() == pytest.approx(last["lla"], rel=1e-14)
    others = [row for row in expected if "did" not in row]
    texts = [event for event in events if isinstance(event, Text)]
    rejects = [event for event in events if getattr(event, "reason", "")]
    assert len(texts) + len(rejects) == len(others)


def test_the_index_points_at_packets() -> None:
    """Each entry (ms, offset, message count) is the start of a packet, up to the first written block of 128 KiB; after
    it the vendor's logger counts offsets from another origin, and only times and counts remain valid.
    """
    data, index = read("log.raw"), read("log.idx")
    starts = {packet.offset for packet in oracle.scan(data, final=True).packets}
    entries = list(struct.iter_unpack("<IIII", index))
    assert len(entries) == 51
    assert entries == sorted(entries, key=lambda entry: (entry[0], entry[2]))
    offsets = [offset for _, offset, _, _ in entries]
    first = next(i for i, offset in enumerate(offsets) if i and offset <= offsets[i - 1])
    assert first == 12
    assert set(offsets[:first]) <= starts
