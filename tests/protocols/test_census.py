"""Coverage: every message, item, data set, packet type, payload type and foreign name has a vector."""

import lzma
from dataclasses import replace
from typing import Any

import pytest

from imuscope.protocols.embedded import nmea, rtcm, ubx
from imuscope.protocols.events import Text
from imuscope.protocols.idtp import messages as idtp_messages
from imuscope.protocols.idtp.json_codec import frame_from_json, frame_to_json
from imuscope.protocols.isb import dataset_loader as isb_tables
from imuscope.protocols.isb import frames as isb_frames
from imuscope.protocols.isb import messages as isb_messages
from imuscope.protocols.isb.decoder import IsbDecoder
from imuscope.protocols.schema.fields import Bits
from imuscope.protocols.xbus import data_identifiers as xbus_items
from imuscope.protocols.xbus import enums as xbus_codes
from imuscope.protocols.xbus import messages as xbus_messages
from tests.protocols.idtp.idtp_vectors import COMPUTED, KEY, frame
from tests.protocols.vector_coverage import FOREIGN, GROUPS, PROVENANCES
from tests.support.each_row import each_row
from tests.support.source_files import ROOT

GOLDEN = ROOT / "tests" / "golden"
SHARED = ROOT.parent / "shared" / "vectors"


@each_row("name", GROUPS)
def test_every_row_has_a_vector(name: str) -> None:
    group = GROUPS[name]
    assert group.rows()
    assert group.missing() == set()
    for by_source in group.count().values():
        assert set(by_source) <= set(PROVENANCES)


def test_the_number_of_vectors() -> None:
    assert len(GROUPS["ISB data sets"].rows()) == 109
    assert {identifier for identifier, _, _ in GROUPS["Xbus items, each precision"].rows()} == {
        row.id for row in xbus_items.ITEMS
    }
    assert {mid for mid, _ in GROUPS["Xbus messages, each form"].rows()} == {row.id for row in xbus_messages.MESSAGES}
    assert len(GROUPS["IDTP payload types, each mode"].rows()) == 7 * 3


ADDED: dict[str, tuple[Any, str, Any]] = {  # group → owner of the attribute, and its value with one row more
    "Xbus messages, each form": (
        *(xbus_messages, "MESSAGES"),
        (*xbus_messages.MESSAGES, replace(xbus_messages.MESSAGES[0], id=0xEE, name="New")),
    ),
    "Xbus items, each precision": (
        *(xbus_items, "ITEMS"),
        (*xbus_items.ITEMS, replace(xbus_items.ITEMS[0], id=0x6660, name="New")),
    ),
    "Xbus strings": (xbus_codes, "STRING_TYPES", (*xbus_codes.STRING_TYPES, Bits("PNEW", 16))),
    "sentences of our own": (nmea, "SENTENCES", {**nmea.SENTENCES, "PNEW": nmea.SENTENCES["PHTRO"]}),
    "ISB packet types": (isb_frames, "TYPES", {**isb_frames.TYPES, 9: "NEW"}),
    "ISB data sets": (isb_tables, "SETS", {**isb_tables.SETS, 200: replace(isb_tables.SETS[4], name="DID_NEW")}),
    "ISB raw GNSS kinds": (isb_messages, "RAW_KINDS", {**isb_messages.RAW_KINDS, 7: ("new", "eph_t")}),
    "ISB structures of other firmware": (
        *(isb_tables, "SETS"),
        {**isb_tables.SETS, 4: replace(isb_tables.SETS[4], sizes={"2.0.3": 78})},
    ),
    "ISB velocity frames": (isb_messages, "VELOCITY_SETS", (30, 31, 32)),
    "IDTP payload types, each mode": (
        *(idtp_messages, "MESSAGES"),
        (*idtp_messages.MESSAGES, replace(idtp_messages.MESSAGES[0], id=0x08, name="New")),
    ),
    "u-blox messages": (ubx, "NAMES", {**ubx.NAMES, (1, 0x77): "NAV-NEW"}),
    "RTCM 3 messages": (rtcm, "NAMES", {**rtcm.NAMES, 1999: "New"}),
}


@each_row("name", ADDED)
def test_a_row_without_a_vector_is_found(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    module, attribute, table = ADDED[name]
    monkeypatch.setattr(module, attribute, table)
    assert GROUPS[name].missing()


@each_row("vector", FOREIGN, ids=lambda vector: f"{vector['protocol']}-{vector['name']}")
def test_foreign_messages_are_recognised_by_name(vector: dict[str, Any]) -> None:
    """Names from two public libraries; a number without a title is still found and reported by number."""
    decoder = IsbDecoder()
    decoder.feed(bytes.fromhex(vector["hex"]), 0)
    (text,) = decoder.drain(stalled=True)  # its last byte may begin one of our own
    assert isinstance(text, Text)
    assert (text.protocol, text.name, text.size) == (vector["protocol"], vector["name"], len(vector["hex"]) // 2)
    if vector["protocol"] == "rtcm3":
        assert text.fields["number"] == vector["id"]
        assert text.fields["title"] == rtcm.NAMES.get(vector["id"], "")
    assert decoder.skipped == 0


@each_row("vector", COMPUTED, ids=lambda v: f"{v['version']:x}-{v['mode']}-{v['type']:02x}")
def test_computed_idtp_frames(vector: dict[str, Any]) -> None:
    record = frame_to_json(frame(vector))
    assert (record["id"], record["fields"]["mode"], record["fields"]["version"]) == (
        *(vector["type"], vector["mode"]),
        vector["version"],
    )
    if "values" in vector:
        assert {name: record["fields"][name] for name in vector["values"]} == vector["values"]
    else:
        assert record["fields"]["data"] == frame(vector)[20 : 20 + len(record["fields"]["data"]) // 2].hex()
    assert frame_from_json(record, KEY) == frame(vector)


COPIED = {  # shared vector → where a test reads it; the commands are those of the forms, and copied too
    **{f"{protocol}/data.json": f"{protocol}/data.json" for protocol in ("xbus", "isb")},
    **{f"{protocol}/commands.json": f"{protocol}/commands.json" for protocol in ("xbus", "isb")},
    "xbus/sample.mtb": "xbus/sample.mtb",
    "idtp/vectors.json": "idtp/vectors.json",
    **{
        f"isb/logs/LOG_SN60339_20261120_120000_0001.{kind}": f"isb/logs/log.{kind}.xz" for kind in ("raw", "dat", "idx")
    },
    **{f"isb/logs/{kind}.values.jsonl": f"isb/logs/{kind}.values.jsonl.xz" for kind in ("raw", "dat")},
}


def test_no_shared_vector_is_left_out() -> None:
    """Each shared vector has an identical copy in the project, and a test names each copy."""
    for copy in COPIED.values():
        assert (GOLDEN / copy).is_file()
    if not SHARED.is_dir():
        pytest.skip(f"no shared vectors: {SHARED} is not there")
    files = {path.relative_to(SHARED).as_posix() for path in SHARED.rglob("*") if path.is_file()}
    assert files - {"README.md"} == set(COPIED)
    for name, copy in COPIED.items():
        data = (GOLDEN / copy).read_bytes()
        assert (lzma.decompress(data) if copy.endswith(".xz") else data) == (SHARED / name).read_bytes(), name
