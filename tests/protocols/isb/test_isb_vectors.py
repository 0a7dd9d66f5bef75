"""Agreement of every ISB row with the vendor, and coverage of the tables."""

import json
import struct
from typing import Any

import numpy as np

from imuscope.protocols.events import Batch, Reply
from imuscope.protocols.isb import frames
from imuscope.protocols.isb.dataset_loader import SETS, TABLES
from imuscope.protocols.isb.decoder import IsbDecoder
from imuscope.protocols.isb.frames import build, get_data, set_data, stop
from imuscope.protocols.isb.json_codec import frame_from_json, frame_to_json
from imuscope.protocols.isb.messages import COMMANDS, ROWS
from imuscope.protocols.schema.layouts import size_of
from tests.oracles import isb as oracle
from tests.protocols.isb.isb_vectors import COMMANDS as COMMAND_VECTORS
from tests.protocols.isb.isb_vectors import (
    COMPUTED,
    DATA,
    EVENT,
    FORMATS,
    by_did,
    everything,
    leaves,
    packet,
    vendor_fields,
)
from tests.support.each_row import each_row


def values(data: bytes) -> dict[str, Any]:
    """Columns of one packet, undone to wire values."""
    decoder = IsbDecoder()
    decoder.feed(data, 0)
    (event,) = (e for e in decoder.drain() if isinstance(e, (Batch, Reply)))
    return dict(event.values if isinstance(event, Reply) else event.columns)


@each_row("vector", DATA, ids=lambda vector: str(vector["did_name"]))
def test_vendor_values(vector: dict[str, Any]) -> None:
    message = frame_to_json(packet(vector))
    assert message["id"] == vector["did"]
    assert message["message"] == vector["did_name"]
    assert message["fields"] == vendor_fields(vector)
    assert list(message["fields"]) == list(vector["fields"])


def text_bytes(texts: list[str], size: int) -> bytes:
    """Texts (or the hex of an event) as the bytes that they were."""
    if size == 1:
        return bytes.fromhex(texts[0])
    step = size // len(texts)
    return b"".join(text.encode("latin-1").ljust(step, b"\0") for text in texts)


@each_row("vector", [*DATA, *COMPUTED], ids=lambda vector: str(vector["did_name"]))
def test_like_the_oracle(vector: dict[str, Any]) -> None:
    data = packet(vector)
    expected = oracle.values(FORMATS[str(vector["did"])]["fields"], data[6:-2])
    message = leaves(frame_to_json(data)["fields"])
    for name, numbers in expected.items():
        if name in message and isinstance(numbers[0], str):
            assert message[name] == numbers
        elif name in message and isinstance(message[name][0], str):
            assert bytes(numbers) == text_bytes(message[name], len(numbers)), name
        elif name in message:
            np.testing.assert_array_equal(message[name], numbers)
    raw = vector["did"] in (60, 69, 70)
    assert (
        raw or not expected or {name.partition("[")[0] for name in expected} == {n.partition("[")[0] for n in message}
    )


@each_row("vector", DATA, ids=lambda vector: str(vector["did_name"]))
def test_columns_are_the_values_in_shown_units_but_for_radians(vector: dict[str, Any]) -> None:
    columns = values(packet(vector))
    struct = SETS[vector["did"]].struct
    assert struct is not None
    for field, _ in struct.places:
        if field.fields or field.dtype in ("ascii", "bytes") or field.name not in columns or vector["did"] == EVENT:
            continue
        wire = np.asarray(vector["fields"][field.name], float)
        got = np.asarray(columns[field.name], float)
        scale = field.scale if isinstance(columns[field.name], np.ndarray) and not field.sent_unit else 1.0
        np.testing.assert_allclose(got.ravel(), (wire * scale).ravel(), rtol=1e-12)


@each_row("data", list(everything()), ids=lambda data: data[:4].hex())
def test_plain_values_are_the_packet(data: bytes) -> None:
    assert frame_from_json(json.loads(json.dumps(frame_to_json(data), allow_nan=False))) == data


def test_every_data_set_has_a_vector() -> None:
    met = {vector["did"] for vector in (*DATA, *COMPUTED)}
    assert met == set(SETS) == {int(did) for did in FORMATS}
    assert len(SETS) == 109
    assert {frame_to_json(packet(vector))["message"] for vector in COMMAND_VECTORS} >= {
        row.name for row in COMMANDS.values() if row.name != "STOP_DID_BROADCAST"
    }


@each_row("did", [did for did, row in SETS.items() if row.struct])
def test_the_table_is_the_structure(did: int) -> None:
    """Offsets, types and sizes are those of the facts, gaps and all."""
    struct, row = SETS[did].struct, FORMATS[str(did)]
    assert struct is not None
    assert struct.size == row["size"]
    tops: dict[str, int] = {}
    for name, _, _, offset in row["fields"]:
        tops.setdefault(name.partition("[")[0], offset)
    for field, at in struct.places:
        if field.dtype != "bytes":
            assert tops[field.name] == at, field.name
    last, at = struct.places[-1]
    assert at + size_of(last) == struct.size


def test_positions_velocities_and_attitudes_name_their_frame() -> None:
    named = {"lla", "ecef", "ned", "uvw", "vel", "ve", "theta", "qn2b", "qe2b", "refLla", "baseLla", "pqr", "acc"}
    for name, layout in TABLES.structs.items():
        for field, _ in layout.places:
            if field.name.rpartition(".")[2] in named and field.shape and not field.fields:
                assert field.frame, f"{name}.{field.name}"
                assert len(field.axes) == field.shape[-1]


# -- commands ----------------------------------------------------------------------------------------------------------


def test_commands_are_the_vendors() -> None:
    made = {
        "stop_broadcasts_all_ports": stop(all_ports=True),
        "stop_broadcasts_current_port": stop(),
        "save_persistent": set_data(7, b"\1\0\0\0\xfe\xff\xff\xff"),
    }
    for vector in COMMAND_VECTORS:
        arguments = vector["args"]
        if vector["what"] == "get_data":
            entries = {name: arguments[name] for name in ("size", "offset", "period")}
            made["get_data"] = get_data(arguments["did"], **entries)
        if vector["what"] in made:
            assert made[vector["what"]] == packet(vector)
        if vector["what"] == "set_data_offset":
            field, value = arguments["field"], arguments["value"]
            assert frame_to_json(packet(vector))["fields"] == {field: value}
            record = {"message": "SET_DID_FLASH_CONFIG", "fields": {field: value}}
            assert frame_from_json(record) == packet(vector)


def statement_of(vector: dict[str, Any]) -> dict[str, Any]:
    """Fields of a command's vector, by the vendor's names."""
    arguments = vector["args"]
    about = ("did", "did_name", "flags")
    match vector["what"].split("_")[0]:
        case "get":
            return {"id": arguments["did"], **{name: arguments[name] for name in ("size", "offset", "period")}}
        case "ack" | "nack":
            names = {"acked_flags": "pktInfo.flags", "acked_did": "pktInfo.id"}
            names |= {"body_size": "body.dataHdr.size", "body_offset": "body.dataHdr.offset"}
            return {names[name]: value for name, value in arguments.items() if name not in about}
        case "rmc":
            return {"bits": int(arguments["bits"], 16), "options": arguments["options"]}
    names = {"checksum_u32": "checksum", "field": ""}
    if "field" in arguments:
        return {arguments["field"]: arguments["value"]} if "value" in arguments else {}
    entries = {name: value for name, value in arguments.items() if name not in (*about, "size", "offset")}
    return {names.get(name, name): value for name, value in entries.items()}


@each_row("vector", COMMAND_VECTORS, ids=lambda vector: f"{vector['what']}-{vector['args'].get('did')}")
def test_commands_contain_the_vendor_values(vector: dict[str, Any]) -> None:
    """No argument of any vector is passed over."""
    message, arguments = frame_to_json(packet(vector)), vector["args"]
    assert len(packet(vector)) == vector["len"]
    expected = statement_of(vector)
    assert {name: message["fields"][name] for name in expected} == expected
    if vector["what"].startswith(("set", "rmc", "save", "software", "mag")):
        assert message["message"] == f"SET_{arguments['did_name']}"
        assert message["fields"].keys() >= expected.keys()
        assert len(packet(vector)) == 8 + arguments["size"] + 2 * bool(arguments["offset"])
    if vector["what"] == "data_partial_offset":
        assert list(message["fields"]) == [arguments["field"]]
        assert packet(vector)[6:8] == arguments["offset"].to_bytes(2, "little")


def test_the_document_preset() -> None:
    preset = bytes.fromhex("ef4905090c00e23c3501900000c000010000f7b0")
    message = frame_to_json(preset)
    assert (message["message"], message["fields"]["options"]) == ("SET_DID_RMC", 256)
    assert message["flags"]["options"] == ["RMC_OPTIONS_PRESERVE_CTRL"]


def test_limits() -> None:
    """Errata 8: a candidate beyond these limits is not a packet, even with a valid checksum."""
    cases = {
        build(frames.DATA, 4, bytes(1024)): "",
        build(frames.DATA, 4, bytes(1025)): "bad_size",
        build(frames.DATA, 4, bytes(1024), offset=1022): "",
        build(frames.DATA, 4, bytes(1024), offset=1023): "bad_size",
        build(frames.DATA, 43, bytes(1024), offset=60_000): "",
        build(frames.ACK, 0, bytes(2040)): "",
        get_data(4, size=1024): "",
        get_data(4, size=1025): "bad_size",
        oracle.build(9, 4, b""): "bad_type",
        oracle.build(0, 4, b""): "bad_type",
        oracle.build(0x24, 4, b"\0"): "bad_size",
        oracle.build(0x14, 4, b"1234"): "",
    }
    for data, reason in cases.items():
        decoder = IsbDecoder()
        decoder.feed(data + stop(), 0)
        events = decoder.drain(stalled=True)
        rejects = [event for event in events if not isinstance(event, (Batch, Reply))]
        assert [getattr(event, "reason", "") for event in rejects[:1]] == ([reason] if reason else []), data[:8].hex()
        assert any(isinstance(e, Reply) and e.message.name == "STOP_BROADCASTS_CURRENT_PORT" for e in events)


# -- lists -------------------------------------------------------------------------------------------------------------


def satellites(count: int, message: int | None = None) -> bytes:
    entry = bytes.fromhex("01 05 2d 5a00 2c 1c00".replace(" ", ""))
    head = (1000).to_bytes(4, "little") + (count if message is None else message).to_bytes(4, "little")
    return build(frames.DATA, 15, head + entry * count)


def test_lists_have_as_many_rows_as_are_in_use() -> None:
    for data, expected in ((satellites(7), 7), (satellites(50, 12), 12), (satellites(0), 0), (satellites(3, 9), 3)):
        sat = values(data)["sat"]
        assert sat.shape == (1, expected)
        assert expected == 0 or (sat["svId"] == 5).all()
    assert len(frame_to_json(satellites(50, 12))["fields"]["sat"]) == 50
    assert frame_from_json(frame_to_json(satellites(7))) == satellites(7)


def test_raw_gnss_data_of_an_unknown_kind_are_kept() -> None:
    odd = build(frames.DATA, 69, bytes([1, 77, 0, 0]) + b"abcd")
    assert frame_to_json(odd)["fields"]["buf"] == b"abcd".hex()
    assert frame_from_json(frame_to_json(odd)) == odd


def test_shorter_longer_and_older() -> None:
    whole = by_did(10)[6:-2]
    assert "upTime" not in values(build(frames.DATA, 10, whole[:56]))
    longer = build(frames.DATA, 10, whole + b"\1\2\3")
    assert set(values(longer)) == set(values(build(frames.DATA, 10, whole)))
    assert frame_to_json(longer)["wire"]["unknown"] == {"64": "010203"}
    assert frame_from_json(frame_to_json(longer)) == longer
    old = build(frames.DATA, 8, bytes(range(45)))
    assert list(frame_to_json(old)["fields"]) == ["options"]  # the pairs are elsewhere before 2.1.9
    assert frame_from_json(frame_to_json(old)) == old
    cut = build(frames.DATA, 4, by_did(4)[6:-2][24:36], offset=24)
    assert [len(value) for value in frame_to_json(cut)["fields"].values()] == [2, 1]
    assert frame_from_json(frame_to_json(cut)) == cut


def test_firmware_picks_the_layout() -> None:
    info = bytearray(by_did(1)[6:-2])
    info[12:16] = bytes([2, 0, 3, 0])
    port = build(frames.DATA, 75, bytes(223))
    decoder = IsbDecoder()
    decoder.feed(port + build(frames.DATA, 1, bytes(info)) + port, 0)
    batches = [event for event in decoder.drain() if isinstance(event, Batch)]
    assert [set(batch.columns) for batch in batches] == [{"port", "activePorts"}, {"port", "activePorts"}]
    bit = build(frames.DATA, 79, bytes(120))
    info[12:16] = bytes([2, 3, 0, 0])
    decoder.feed(build(frames.DATA, 1, bytes(info)) + bit, 0)
    (batch,) = (event for event in decoder.drain() if isinstance(event, Batch))
    assert "pos_variance" not in batch.columns
    assert "time.time" in batch.columns


def test_unknown_data_sets_are_kept() -> None:
    message = frame_to_json(build(frames.DATA, 200, b"abc"))
    assert message == {"id": 200, "message": "DID_200", "fields": {"data": "616263"}}
    assert ROWS[200].kind == "reply"


def test_text_fields_are_decoded_as_text() -> None:
    """GNSS versions were 220 numbers, and of an event's data only the first byte was there."""
    versions = b"EXT CORE 1.00 (71b20c)".ljust(30, b"\0") + b"00190000".ljust(10, b"\0")
    versions += b"".join(
        word.ljust(30, b"\0") for word in (b"ROM BASE 0x118B2060", b"FWVER=HPG 1.12", b"", b"", b"", b"")
    )
    message = frame_to_json(data := build(frames.DATA, 17, versions))["fields"]
    assert message["swVersion"] == "EXT CORE 1.00 (71b20c)"
    assert message["extension"] == ["ROM BASE 0x118B2060", "FWVER=HPG 1.12", "", "", "", ""]
    assert frame_from_json(frame_to_json(data)) == data
    head = struct.pack("<dIHbBHH", 1.5, 7, 3, 2, 0, 2, 12)
    event = build(frames.DATA, 119, head + b"temperature!")
    assert frame_to_json(event)["fields"]["data"] == "temperature!"
    assert frame_from_json(frame_to_json(event)) == event
    raw = build(frames.DATA, 119, head[:16] + struct.pack("<HH", 1, 3) + b"\1\2\3")
    assert frame_to_json(raw)["fields"]["data"] == "010203"
    assert frame_from_json(frame_to_json(raw)) == raw
    assert values(event)["data"] == "temperature!"
