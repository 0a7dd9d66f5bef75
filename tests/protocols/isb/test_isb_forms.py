"""Packet types, raw GNSS data, velocity frames and the structures of other firmware, against the facts alone."""

from __future__ import annotations

from typing import Any

import numpy as np

from imuscope.protocols.events import Batch, Reply
from imuscope.protocols.isb.dataset_loader import CURRENT, SETS, TABLES
from imuscope.protocols.isb.decoder import IsbDecoder
from imuscope.protocols.isb.frames import DATA, build
from imuscope.protocols.isb.json_codec import frame_from_json, frame_to_json
from imuscope.protocols.isb.messages import RAW_KINDS
from tests.protocols.isb.isb_vectors import FORMS, by_did, leaves, packet
from tests.support.each_row import each_row


def of(form: str) -> Any:
    """The vectors of one form, as a parameter."""
    rows = [row for row in FORMS if row["form"] == form]
    assert rows
    return each_row("row", rows, ids=lambda row: "-".join(str(row.get(k, "")) for k in list(row)[1:4]))


def events_of(data: bytes, *, firmware: str = "") -> list[Batch | Reply]:
    """Decoded packet after the device has reported its firmware."""
    decoder = IsbDecoder()
    if firmware:
        numbers = (9, 0, 0) if firmware == "next" else tuple(int(word) for word in firmware.split("."))
        for did in (1, 93, 120):  # of an IMX, an EVB, a GPX
            report = bytearray(by_did(1)[6:-2])
            report[12:16] = bytes((*numbers, 0))
            decoder.feed(build(DATA, did, bytes(report)), 0)
        decoder.drain()
    decoder.feed(data, 0)
    return [event for event in decoder.drain() if isinstance(event, Batch | Reply)]


@of("packet")
def test_every_packet_type(row: dict[str, Any]) -> None:
    (event,) = events_of(packet(row))
    name = {"DATA": "DID_INS_1", "SET_DATA": "SET_DID_FLASH_CONFIG"}.get(row["type"], row["type"])
    assert event.message.name == name == frame_to_json(packet(row))["message"]
    assert frame_to_json(packet(row))["id"] == row["did"]
    assert frame_from_json(frame_to_json(packet(row))) == packet(row)


@of("raw")
def test_raw_gnss_data(row: dict[str, Any]) -> None:
    data = packet(row)
    name, struct = RAW_KINDS[row["kind"]]
    assert struct == row["struct"]
    message = frame_to_json(data)["fields"]
    records = message[name] if row["kind"] == 1 else [message[name]]
    assert len(records) == row["count"]
    for record in records:
        assert leaves(record).keys() == row["values"].keys()
        for field, numbers in leaves(record).items():
            np.testing.assert_array_equal(numbers, row["values"][field])
    (batch,) = events_of(data)
    assert isinstance(batch, Batch)
    assert len(np.atleast_1d(batch.columns[name][0])) == row["count"]
    assert frame_from_json(frame_to_json(data)) == data


@of("velocity")
def test_velocity_frames(row: dict[str, Any]) -> None:
    (batch,) = events_of(packet(row))
    assert isinstance(batch, Batch)
    (field,) = (field for field in batch.message.fields if field.name == "vel")
    assert field.frame == row["frame"]


@of("firmware")
def test_other_firmware(row: dict[str, Any]) -> None:
    """Known fields of an older or newer structure are decoded, and no field has the value of another."""
    data = packet(row)
    message = leaves(frame_to_json(data, row["version"])["fields"])
    data_set = SETS[row["did"]]
    assert data_set.struct is not None
    named = {field.name for field, _ in data_set.struct.places if field.dtype != "bytes"}
    for name, numbers in row["values"].items():
        if name in message:
            np.testing.assert_array_equal(message[name], numbers)
    tops = {name.partition("[")[0] for name in message}
    expected = {name.partition("[")[0] for name in row["values"]}
    names = {name for name in tops if name in named or name.partition(".")[0] in named}
    if row["version"] == "next" and row["did"] in (57, 96):
        expected.add("I")  # five in place of three, from the same place: xbus/test_products.py
    assert names <= expected, f"not in {row['version']}: {names - expected}"
    reserved = {name for name in expected if "reserved" in name.lower() or "unused" in name.lower()}
    assert expected - names <= reserved, f"also in {row['version']}: {expected - names}"
    (event,) = events_of(data, firmware=row["version"])
    columns = event.columns if isinstance(event, Batch) else event.values
    assert {name.partition(".")[0] for name in columns} == {name.partition(".")[0] for name in tops}
    assert frame_from_json(frame_to_json(data, row["version"])) == data


@each_row("row", [r for r in FORMS if r["form"] == "firmware"], ids=lambda r: f"{r['did']}-{r['size']}")
def test_the_size_selects_the_layout(row: dict[str, Any]) -> None:
    """Without a device information a size that only other firmware has picks that firmware's structure."""
    sizes = SETS[row["did"]].sizes
    newest = [version for version, size in sizes.items() if size == row["size"]][-1:]
    if newest != [row["version"]] or sizes.get(CURRENT) == row["size"]:
        return
    assert frame_to_json(packet(row))["fields"] == frame_to_json(packet(row), row["version"])["fields"]


def test_directions_wrap_and_accuracies_do_not() -> None:
    """Mean and σ of a heading that passes north were those of the line: only Euler angles had a period."""
    fields = {row.name: row for struct in TABLES.structs.values() for row, _ in struct.places}
    for name in ("baseToRoverHeading", "azim", "magHdg"):
        assert fields[name].period == 360.0, name
    for name in ("baseToRoverHeadingAcc", "elev"):
        assert fields[name].period == 0.0, name
