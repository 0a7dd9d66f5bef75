"""Agreement of the IDTP decoder with the reference implementation, and coverage of its tables."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
import pytest

from imuscope.protocols.clocks.counters import TickUnwrapper
from imuscope.protocols.events import Batch, RejectedFrame, SampleGap
from imuscope.protocols.framing.checksums import crc8_autosar, crc32_autosar
from imuscope.protocols.framing.stream_buffer import REASONS
from imuscope.protocols.idtp.decoder import IdtpDecoder
from imuscope.protocols.idtp.frames import SECURE, FrameAuthenticator, build
from imuscope.protocols.idtp.inspect import IdtpFrameLister
from imuscope.protocols.idtp.json_codec import frame_from_json, frame_to_json
from imuscope.protocols.idtp.messages import MESSAGES, STATUS, WIRE
from tests.oracles import idtp as oracle
from tests.protocols.decoding import decode_chunks
from tests.protocols.idtp.idtp_vectors import ALL, KEY, NEGATIVE, VECTORS, frame, key_of
from tests.support.each_row import each_row


def name_of(vector: dict[str, Any]) -> str:
    return vector["what"][:60]


def decode(data: bytes, **options: Any) -> list[Any]:
    return decode_chunks(IdtpDecoder(**options), [(1, data)])


def batch_of(data: bytes, **options: Any) -> Batch:
    (batch,) = [event for event in decode(data, **options) if isinstance(event, Batch)]
    return batch


# -- frames ------------------------------------------------------------------------------------------------------------


@each_row("vector", VECTORS, ids=name_of)
def test_reference_frames(vector: dict[str, Any]) -> None:
    """Every number of the header, every bit of the readings; and the frame again from its values."""
    data, key, message = frame(vector), key_of(vector), vector["fields"]
    batch = batch_of(data, key=key)
    assert batch.device == str(message["device_id"])
    assert batch.time_ns is not None
    assert batch.time_ns.tolist() == [message["timestamp"] * 1000]
    record = frame_to_json(data)
    header = {name: record["fields"][name] for name in ("timestamp", "sequence", "device_id", "version", "mode")}
    assert header == {name: message[name] for name in header}
    assert record["id"] == message["payload_type"]
    for name, bits in message.get("values_f32_bits", {}).items():
        value = record["fields"][name]
        assert (value["f32"] if isinstance(value, dict) else struct.pack(">f", value).hex()) == bits
    if "values" not in message and message["payload_size"]:
        assert record["fields"]["data"] == message["payload_hex"]
    assert frame_from_json(json.loads(json.dumps(record, allow_nan=False)), key) == data


@each_row("vector", VECTORS, ids=name_of)
def test_columns(vector: dict[str, Any]) -> None:
    """Columns hold the readings as sent, except for invalid quaternions."""
    output = vector["fields"]
    if "values_f32_bits" not in output:
        return
    batch = batch_of(frame(vector), key=key_of(vector))
    status = int(batch.columns[f"{batch.message.name}Status"][0])
    for name, names in WIRE.items():
        if name not in batch.columns:
            continue
        expected = [struct.unpack(">f", bytes.fromhex(output["values_f32_bits"][one]))[0] for one in names]
        if name == "Quaternion" and abs(np.linalg.norm(expected) - 1) > 0.01:
            expected = [np.nan] * 4
            assert status & 0x10
        np.testing.assert_array_equal(np.atleast_1d(batch.columns[name][0]), np.array(expected, np.float32))
    assert status & 3 == output["mode"]
    values = output["values"].values()
    assert bool(status & 8) == any(value in ("nan", "inf", "-inf") for value in values)


@each_row("vector", NEGATIVE, ids=name_of)
def test_negative(vector: dict[str, Any]) -> None:
    """Invalid frames are refused for the given reason; unusual but valid ones are accepted and marked."""
    data, key = bytes.fromhex(vector["input_hex"]), key_of(vector)
    stream = data
    if vector["last_sequence"] is not None:
        message = oracle.scan(data, final=True, key=key).frames[0]
        stream = build(0x80, sequence=vector["last_sequence"], device=message.device, mode=message.mode, key=key) + data
    listing = IdtpFrameLister(key=key, min_mode=0)
    listing.feed(stream)
    lines = [line for line in listing.drain(stalled=True) if line["offset"] == len(stream) - len(data)]
    verdict, _, word = vector["expect"].partition(":")
    if word == "no_preamble" or not data:
        assert not lines
        return
    (line,) = lines
    if verdict == "accept":
        assert line["protocol"] == "idtp"
        assert line.get("notes", []) == [one for one in [word] if one.startswith(("undecodable", "size"))]
    else:
        assert line["reject"] == ("stale" if word == "replayed" else word or "truncated")
        assert line["reject"] in REASONS


def test_incomplete_waits() -> None:
    """In a live stream, an incomplete frame is neither accepted nor refused."""
    for vector in NEGATIVE:
        if vector["expect"] == "incomplete":
            decoder = IdtpDecoder(key=key_of(vector), min_mode=0)
            decoder.feed(bytes.fromhex(vector["input_hex"]), 1)
            assert decoder.drain() == []
            assert decoder.buffered == len(vector["input_hex"]) // 2


def test_gap_of_fifty() -> None:
    for mode in (0, 1, 2):
        data = b"".join(build(0, bytes(12), sequence=number, mode=mode, key=KEY) for number in (50, 100))
        (gap,) = [event for event in decode(data, key=KEY, min_mode=0) if isinstance(event, SampleGap)]
        assert (gap.missing, gap.offset, gap.counter, gap.device) == (49, len(data) // 2, "sequence", "0")


# -- sequences and time ------------------------------------------------------------------------------------------------


@each_row("case", ALL["sequence"], ids=lambda case: f"{case['last']}-{case['received']}")
@each_row("mode", [0, 1, 2])
def test_sequence(case: dict[str, Any], mode: int) -> None:
    """The rule of the vectors. Below Secure, a jump beyond 2^16 counts from the second frame on,
    and what it passes over, which anybody may have forged, is not lost.
    """
    last, received = case["last"], case["received"]
    frames = [build(0, bytes(12), sequence=n, mode=mode, key=KEY) for n in (last, received) if n is not None]
    far = last is not None and mode < SECURE and case["serial_accept"] and received - last > 1 << 16
    if far:
        frames.append(build(0, bytes(12), sequence=received + 1, mode=mode, key=KEY))
    events = decode(b"".join(frames), key=KEY, min_mode=0)
    accepted = sum(len(event) for event in events if isinstance(event, Batch))
    rejects = [event.reason for event in events if isinstance(event, RejectedFrame)]
    lost = sum(event.missing for event in events if isinstance(event, SampleGap))
    if far:
        assert (accepted, rejects, lost) == (2, ["far_ahead"], 0)
    else:
        assert accepted == (last is not None) + case["serial_accept"]
        assert rejects == ([] if case["serial_accept"] else ["stale"])
        assert lost == (case["lost"] or 0)


@each_row("case", ALL["timestamp_delta"], ids=str)
def test_timestamps(case: dict[str, int]) -> None:
    clock = TickUnwrapper(2**32, tick_ns=1000)
    before, after = clock.ticks(np.array([case["prev"], case["cur"]])).tolist()
    assert after - before == case["delta_us"]
    assert clock.steps == []


# -- checksums ---------------------------------------------------------------------------------------------------------


def test_check_values() -> None:
    """The published values, and the tables against the bit by bit way, over every length of block."""
    nine = np.frombuffer(b"123456789", np.uint8)
    assert f"{crc8_autosar(nine, 0, 9):02x}" == ALL["meta"]["checks"]["crc8_autosar_123456789"]
    assert f"{crc32_autosar(nine, 0, 9):08x}" == ALL["meta"]["checks"]["crc32_autosar_123456789"]
    noise = bytes((7 * i * i + 3 * i) & 0xFF for i in range(120))
    array = np.frombuffer(noise, np.uint8)
    for stop in range(1, 100):
        assert crc8_autosar(array, 1, stop) == oracle.crc8(noise[1:stop])
        assert crc32_autosar(array, 1, stop) == oracle.crc32(noise[1:stop])


def test_hmac() -> None:
    """RFC 4231, test cases 1 and 6 (a key longer than a block)."""
    assert FrameAuthenticator(b"\x0b" * 20).of(b"Hi There").hex().startswith("b0344c61d8db38535ca8afceaf0bf12b")
    text = b"Test Using Larger Than Block-Size Key - Hash Key First"
    assert FrameAuthenticator(b"\xaa" * 131).of(text).hex().startswith("60e431591ee0b67f0d8a26aacbf5b77f")
    with pytest.raises(ValueError, match="at least one byte"):
        FrameAuthenticator(b"")


# -- rows --------------------------------------------------------------------------------------------------------------


def test_every_row_has_a_vector() -> None:
    met = {(v["fields"]["payload_type"], v["mode"]) for v in VECTORS if "values" in v["fields"]}
    missing = [row.name for row in MESSAGES if row.id not in {kind for kind, _ in met}]
    assert not missing
    assert {mode for _, mode in met} == {"Lite", "Safety", "Secure"}


def test_rows_are_documented() -> None:
    for row in MESSAGES:
        assert row.doc.endswith("."), row.name
        assert row.source
        for field in row.fields:
            assert field.doc.endswith("."), (row.name, field.name)
            assert field.source
            assert len(WIRE[field.name]) == max(len(field.axes), 1)
    assert all(bits.doc.endswith(".") for bits in STATUS.bits)


def test_rows_agree_with_the_oracle() -> None:
    assert {row.id: [one for f in row.fields for one in WIRE[f.name]] for row in MESSAGES} == oracle.TYPES
