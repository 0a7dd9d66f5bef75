"""Coverage of table rows by vectors. Counted, for every table of every protocol.

A group is one kind of row: `rows` says which there are, by the code's own tables; `met` says which of them vectors
meet, and where each vector came from. What is met is read off the bytes (by the oracle, or by hand), not off a label.

    vendor           the vendor's own code encoded it or read it
    spec-example     printed in the document
    device-capture   a real device sent it
    computed         by an oracle of tests/oracles, or by hand

    python -m tests.protocols.vector_coverage        prints the table
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from imuscope.protocols.embedded import nmea, rtcm, ubx
from imuscope.protocols.idtp import frames as idtp_frames
from imuscope.protocols.idtp import messages as idtp_messages
from imuscope.protocols.isb import dataset_loader as isb_tables
from imuscope.protocols.isb import frames as isb_frames
from imuscope.protocols.isb import messages as isb_messages
from imuscope.protocols.xbus import data_identifiers as xbus_items
from imuscope.protocols.xbus import enums as xbus_codes
from imuscope.protocols.xbus import messages as xbus_messages
from tests.oracles import idtp as idtp_oracle
from tests.oracles import isb as isb_oracle
from tests.oracles import xbus as xbus_oracle
from tests.protocols.embedded.nmea_sentences import EM1000, TSS2
from tests.protocols.embedded.nmea_sentences import EXAMPLES as SENTENCES
from tests.protocols.idtp import idtp_vectors
from tests.protocols.isb import isb_vectors
from tests.protocols.xbus import xbus_vectors
from tests.support.source_files import ROOT

PROVENANCES = ("vendor", "spec-example", "device-capture", "computed")
FOREIGN = json.loads((ROOT / "tests" / "golden" / "foreign" / "computed.json").read_text())["messages"]
Met = Iterator[tuple[Any, str]]


@dataclass(frozen=True)
class Group:
    """One kind of row.

    Args:
        rows: what there is.
        met: (row, provenance of the vector), once for every vector.
    """

    rows: Callable[[], set[Any]]
    met: Callable[[], Met]

    def count(self) -> dict[Any, dict[str, int]]:
        """Row → provenance → how many vectors."""
        counted: dict[Any, dict[str, int]] = {row: {} for row in self.rows()}
        for row, source in self.met():
            by_source = counted.setdefault(row, {})
            by_source[source] = by_source.get(source, 0) + 1
        return counted

    def missing(self) -> set[Any]:
        """Rows without a vector."""
        counted = self.count()
        return {row for row in self.rows() if not counted[row]}


# -- Xbus --------------------------------------------------------------------------------------------------------------


@functools.cache
def _xbus_vectors() -> Sequence[tuple[xbus_oracle.OracleXbusFrame, str]]:
    messages = [(vector, _xbus_source(vector["source"])) for vector in (*xbus_vectors.DATA, *xbus_vectors.COMMANDS)]
    messages += [(vector, "device-capture") for vector in xbus_vectors.DEVICE]
    messages += [(vector, "computed") for name in ("messages", "items") for vector in xbus_vectors.COMPUTED[name]]
    frames = []
    for vector, source in messages:
        (frame,) = xbus_oracle.scan(xbus_vectors.frame(vector), final=True).frames
        frames.append((frame, source))
    return frames


def _xbus_source(words: str) -> str:
    """LLCP is the document; the rest is the vendor's library, but for what was done by hand."""
    return "spec-example" if words.startswith("LLCP") else "computed" if words.startswith("hand") else "vendor"


def _shape(row: Any) -> tuple[tuple[str, str], ...]:
    return tuple((field.name, field.dtype) for field in row.fields)


def _xbus_messages_met() -> Met:
    for frame, source in _xbus_vectors():
        shape = () if frame.mid == 0x36 else _shape(xbus_messages.form_of(frame.mid, frame.payload)[0])
        yield (frame.mid, shape), source


def _xbus_item_rows() -> set[tuple[int, int, int]]:
    """(identifier without its format, precision, size of a fixed form or 0)."""
    rows = set()
    for row in xbus_items.ITEMS:
        for precision in range(4) if row.dtype == "real" else (0,):
            rows.add((row.id, precision, 8 if row.dtype == ">u8" and row.id == DEVICE_ID else 0))
    return rows


DEVICE_ID = 0xE080  # of 4 or of 8 bytes: two rows


def _xbus_items_met() -> Met:
    real = {row.id for row in xbus_items.ITEMS if row.dtype == "real"}
    for frame, source in _xbus_vectors():
        at = 0
        while frame.mid == 0x36 and at + 3 <= len(frame.payload):
            identifier, size = int.from_bytes(frame.payload[at : at + 2], "big"), frame.payload[at + 2]
            value = frame.payload[at + 3 : at + 3 + size]
            if len(value) == size and xbus_oracle.numbers(identifier, value):
                base = identifier & 0xFFF0
                yield (base, identifier & 3 if base in real else 0, 8 if base == DEVICE_ID and size == 8 else 0), source
            at += 3 + size


def _strings_met() -> Met:
    yield from ((name, "computed") for name in SENTENCES)
    yield from (("TSS2", "computed") for _ in [TSS2])
    yield from (("EM1000", "computed") for _ in [EM1000])


# -- ISB ---------------------------------------------------------------------------------------------------------------


@functools.cache
def _isb_vectors() -> Sequence[tuple[isb_oracle.OracleIsbPacket, str]]:
    messages = [(vector, "vendor") for vector in (*isb_vectors.DATA, *isb_vectors.COMMANDS)]
    messages += [(vector, vector["source"]) for vector in (*isb_vectors.COMPUTED, *isb_vectors.FORMS)]
    return [
        (packet, source)
        for vector, source in messages
        for packet in isb_oracle.scan(isb_vectors.packet(vector), final=True).packets
    ]


def _isb_data() -> Iterator[tuple[isb_oracle.OracleIsbPacket, str]]:
    return (row for row in _isb_vectors() if row[0].kind == 4 and not row[0].part)


def _older_rows() -> set[tuple[int, int]]:
    """Data sets with another structure in some firmware, and its size."""
    sets = isb_tables.SETS.items()
    return {(did, size) for did, row in sets if row.struct for size in row.sizes.values()}


# -- IDTP --------------------------------------------------------------------------------------------------------------


@functools.cache
def _idtp_vectors() -> Sequence[tuple[idtp_oracle.OracleIdtpFrame, str]]:
    messages = [(vector, "vendor") for vector in idtp_vectors.VECTORS]
    messages += [(vector, vector["source"]) for vector in idtp_vectors.COMPUTED]
    return [
        (frame, source)
        for vector, source in messages
        for frame in idtp_oracle.scan(idtp_vectors.frame(vector), final=True, unverified=True).frames
    ]


def _kind_of(kind: int) -> str:
    return "standard" if kind < idtp_messages.STANDARD_END else "reserved" if kind < 0x80 else "vendor's own"


# -- the groups --------------------------------------------------------------------------------------------------------

GROUPS: Mapping[str, Group] = {
    "Xbus messages, each form": Group(
        lambda: {(row.id, () if row.id == 0x36 else _shape(row)) for row in xbus_messages.MESSAGES}, _xbus_messages_met
    ),
    "Xbus items, each precision": Group(_xbus_item_rows, _xbus_items_met),
    "Xbus strings": Group(
        lambda: {bits.name for bits in xbus_codes.STRING_TYPES if not bits.name.startswith("Reserved")}, _strings_met
    ),
    "sentences of our own": Group(lambda: set(nmea.SENTENCES), _strings_met),
    "ISB packet types": Group(
        lambda: set(isb_frames.TYPES), lambda: ((packet.kind, source) for packet, source in _isb_vectors())
    ),
    "ISB data sets": Group(
        lambda: set(isb_tables.SETS), lambda: ((packet.did, source) for packet, source in _isb_data())
    ),
    "ISB raw GNSS kinds": Group(
        lambda: {(did, kind) for did in isb_messages.RAW_SETS for kind in isb_messages.RAW_KINDS},
        lambda: (
            ((packet.did, packet.payload[1]), source) for packet, source in _isb_data() if packet.did in (60, 69, 70)
        ),
    ),
    "ISB structures of other firmware": Group(
        _older_rows, lambda: (((packet.did, len(packet.payload)), source) for packet, source in _isb_data())
    ),
    "ISB velocity frames": Group(
        lambda: {(did, ned) for did in isb_messages.VELOCITY_SETS for ned in (False, True)},
        lambda: (
            ((packet.did, bool(packet.payload[21] & 0x80)), source)
            for packet, source in _isb_data()
            if packet.did in (30, 31)
        ),
    ),
    "IDTP payload types, each mode": Group(
        lambda: {(row.id, mode) for row in idtp_messages.MESSAGES for mode in range(len(idtp_frames.MODES))},
        lambda: (((frame.kind, frame.mode), source) for frame, source in _idtp_vectors() if frame.version % 16),
    ),
    "IDTP kinds of type, each mode": Group(
        lambda: {(name, mode) for name in ("standard", "reserved", "vendor's own") for mode in range(3)},
        lambda: (((_kind_of(frame.kind), frame.mode), source) for frame, source in _idtp_vectors()),
    ),
    "IDTP versions": Group(
        lambda: {0x20, 0x21}, lambda: ((frame.version, source) for frame, source in _idtp_vectors())
    ),
    "u-blox messages": Group(
        lambda: set(ubx.NAMES), lambda: ((tuple(v["id"]), v["source"]) for v in FOREIGN if v["protocol"] == "ubx")
    ),
    "RTCM 3 messages": Group(
        lambda: set(rtcm.NAMES), lambda: ((v["id"], v["source"]) for v in FOREIGN if v["protocol"] == "rtcm3")
    ),
}


def main() -> None:
    """Print how many rows there are, and how many are met by vectors from each source."""
    print(f"{'':36}{'rows':>6}{'missing':>9}" + "".join(f"{source:>16}" for source in PROVENANCES))
    for name, group in GROUPS.items():
        rows, counted = group.rows(), group.count()
        by_source = [sum(source in counted[row] for row in rows) for source in PROVENANCES]
        print(f"{name:36}{len(rows):6}{len(group.missing()):9}" + "".join(f"{count:16}" for count in by_source))


if __name__ == "__main__":
    main()
