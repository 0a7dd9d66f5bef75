"""Every data set as a row of the schema, and the layout of a payload of a given size.

A payload is rarely the whole structure: a GET may have requested a part of it, a satellite list has variable length,
older firmware has a shorter or another structure, newer firmware a longer one. `places` gives the fields of a payload
and their offsets, for any offset and size; fields cut in two are left out, bytes beyond the table have no field:

    table    week  timeOfWeek  insStatus  hdwStatus  theta ×3      uvw ×3 …
             0     4           12         16         20            32
    payload                                          [20 … 32)                   offset 20, size 12: theta
                                                         [24 … 36)               offset 24: theta[1], theta[2], uvw[0]

For a list with a count of used elements (numSats), columns hold just these.

Raw GNSS data (DID 60, 69, 70) carry one of several structures, by their dataType; a receiver's velocity (DID 30, 31) is
ECEF, or NED if its status says so.

Commands and answers have rows of their own: GET_DATA, ACK, NACK and the stops; SET_DATA has the fields of its data set
and is called SET_DID_….

Source: inertial-sense-sdk 2.7.1, data_sets.h and ISComm.h; ISB document.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.protocols.isb import classify
from imuscope.protocols.isb.dataset_loader import (
    CURRENT,
    SETS,
    SOURCE,
    TABLES,
    VERSIONS,
    DataSet,
    element_size,
    title_of,
)
from imuscope.protocols.isb.frames import ACK, GET_DATA, NACK, STOP_ALL_PORTS, STOP_CURRENT_PORT, STOP_DID, TYPES
from imuscope.protocols.isb.time_base import FIX, GTIME, LEAP_SECONDS_AS_OF, NONE, TOW, UP, WEEK_TOW
from imuscope.protocols.schema.fields import Bits, Field, Message
from imuscope.protocols.schema.layouts import Layout, size_of

Place = tuple[Field, int]
"""A field with its shape closed, and its offset in a payload."""

RAW_SETS = (60, 69, 70)
VELOCITY_SETS = (30, 31)
EVENT_SET = 119  # its data are text, or bytes, by its type
POSITION_SET = 13  # the receiver whose towOffset is that of the device's clock
DEVICE_INFOS = (1, 93, 120)
EVB_SETS, GPX_SETS = range(80, 94), range(120, 128)

RAW_KINDS = {
    1: ("obs", "obsd_t"),
    2: ("eph", "eph_t"),
    3: ("gloEph", "geph_t"),
    4: ("sbas", "sbsmsg_t"),
    5: ("sta", "sta_t"),
    6: ("ion", "ion_model_utc_alm_t"),
}
OPAQUE = Field("data", "bytes", (-1,), doc="Payload with an undocumented layout.")

_TICKS = {UP: 1_000_000_000, WEEK_TOW: 1_000_000_000, FIX: 1_000_000, TOW: 1_000_000, GTIME: 1_000_000_000}
_UTC = f"Shown as UTC with the leap seconds known on {LEAP_SECONDS_AS_OF}; with week 0 it is the time since start."


@dataclass(frozen=True, slots=True)
class PayloadLayout:
    """Fields of the payloads of one offset and size.

    Args:
        message: the row, with the fields present.
        layout: their columns.
    """

    message: Message
    layout: Layout


# -- rows --------------------------------------------------------------------------------------------------------------


def clock_of(dataset: DataSet) -> int:
    """Kind of clock in a data set (time_base.py)."""
    name = dataset.clock
    if not name:
        return NONE
    if name in ("obs", "time.time"):
        return GTIME
    if name.startswith("week+"):
        return FIX if name.endswith("Ms") else WEEK_TOW
    return TOW if name.startswith("timeOfWeek") else UP


def clock_field(dataset: DataSet) -> str:
    return dataset.clock.rpartition("+")[2]


def _row(did: int) -> Message:
    dataset = SETS.get(did)
    if dataset is None:
        return Message(did, f"DID_{did}", (OPAQUE,), kind="reply", title=f"Data set {did}", doc="Unknown data set.")
    fields = tuple(field for field, _ in dataset.struct.places) if dataset.struct else (OPAQUE,)
    clock = clock_of(dataset)
    help_text = TABLES.help.get(("sets", dataset.name), ("", ""))[1]
    return Message(
        did,
        dataset.name,
        fields,
        time=clock_field(dataset),
        tick_ns=_TICKS.get(clock, 0),
        kind=dataset.kind,  # type: ignore[arg-type]
        title=title_of(dataset.name),
        doc=" ".join(filter(None, (help_text, _UTC if clock in (WEEK_TOW, FIX, TOW) else ""))),
        source=SOURCE,
    )


ROWS = {did: _row(did) for did in range(256)}
BY_NAME = {row.name: row for row in ROWS.values()}


def _command(kind: int, fields: tuple[Field, ...], doc: str, *, device: bool = False) -> Message:
    row = Message(0, TYPES[kind], fields, kind="reply" if device else "command", doc=doc, source=SOURCE)
    return replace(row, direction="to_host" if device else "to_device", title=TYPES[kind].replace("_", " "))


def _u2(name: str, doc: str = "") -> Field:
    return Field(name, "<u2", doc=doc)


_NAMES = {did: row.name for did, row in ROWS.items() if did in SETS}
_ACKED = (
    Field(
        "pktInfo.flags",
        "u1",
        bits=(Bits("TYPE", 0, 4, TYPES), Bits("EXTENDED", 4), Bits("WITH_OFFSET", 5)),
        doc="Type and flags of the acknowledged packet.",
    ),
    Field("pktInfo.id", "u1", choices=_NAMES, doc="Data set of the acknowledged packet."),
    _u2("pktCounter", "Always 0."),
    Field("body.dataHdr.id", "u1", choices=_NAMES, doc="The data set written; 0 if the packet was not a SET."),
    _u2("body.dataHdr.size", "Bytes written, without the offset."),
    _u2("body.dataHdr.offset"),
)

COMMANDS = {
    ACK: _command(ACK, _ACKED, "Acknowledges SET_DATA and the two commands that stop all broadcasts.", device=True),
    NACK: _command(NACK, _ACKED, "A request was rejected, or an invalid packet was received.", device=True),
    GET_DATA: _command(
        GET_DATA,
        (
            _u2("id", "Data set."),
            _u2("size", "Bytes to send; 0: the whole data set."),
            _u2("offset"),
            _u2("period", "Multiple of the source's period; 0 requests one packet and stops the broadcast."),
        ),
        "Requests a data set.",
    ),
    STOP_ALL_PORTS: _command(STOP_ALL_PORTS, (), "Stops all broadcasts on all ports."),
    STOP_DID: _command(STOP_DID, (), "Stops the broadcast of one data set."),
    STOP_CURRENT_PORT: _command(STOP_CURRENT_PORT, (), "Stops all broadcasts on this port."),
}
SET_PREFIX = "SET_"


@lru_cache(maxsize=256)
def set_row(did: int) -> Message:
    """The command that writes a data set."""
    row = ROWS[did]
    return replace(row, name=SET_PREFIX + row.name, kind="command", direction="to_device", title=f"Set {row.title}")


# -- forms -------------------------------------------------------------------------------------------------------------


def version_for(did: int, offset: int, size: int, firmware: str | None) -> str:
    """The firmware whose structure a payload has.

    Args:
        offset, size: the part of the set that it holds.
        firmware: its version, of VERSIONS, from the device's information; None if not received.

    Returns:
        `firmware` (else the current one) if the size of a whole payload agrees or no version's does, and for a part;
        otherwise the newest that agrees.
    """
    version = firmware or CURRENT
    sizes = SETS[did].sizes if did in SETS else {}
    if offset or not sizes or sizes.get(version) == size:
        return version
    return next((other for other in reversed(VERSIONS) if sizes.get(other) == size), version)


def _known(dataset: DataSet, version: str) -> tuple[Place, ...]:
    """The places of a structure that are the same in firmware `version`."""
    assert dataset.struct is not None
    places = dataset.struct.places
    names = [field.name for field, _ in places]
    lost: set[str] = set()
    index = VERSIONS.index(version)
    for at, changed in dataset.changes:
        later = VERSIONS.index(at) > index
        if later if at != VERSIONS[-1] else index == len(VERSIONS) - 1:
            lost.update(names[names.index(changed[1]) :] if changed[0] == "from" else changed)
    return tuple((field, at) for field, at in places if field.name not in lost)


def _cut(field: Field, at: int, offset: int, end: int, count: int | None) -> Place | None:
    """The whole elements of a field at `at` that lie in [offset, end), with their offset in the payload."""
    step = element_size(field)
    total = math.prod(field.shape)
    first = max(0, -((at - offset) // step))
    stop = (end - at) // step
    if field.dtype == "ascii":
        count = None  # a text has the length of its structure; newer firmware adds fields behind it
    stop = min(stop, total) if count is None else min(stop, count) if count >= 0 else stop
    if stop <= first and not (count is not None and stop == first == 0):  # a list may be empty
        return None
    if first or stop != total:
        axes = field.axes[first:stop] if field.axes else ()
        field = replace(field, shape=(stop - first,), axes=axes)
    return field, at + first * step - offset


IMU_SETS = (57, 96)


@lru_cache(maxsize=4096)
def places(
    did: int, offset: int, size: int, *, version: str | None = None, variant: int = 0, count: int = -1
) -> tuple[Place, ...]:
    """The fields of a payload and their offsets.

    Args:
        offset, size: the part of the data set that the payload holds.
        version: firmware, of VERSIONS; None if unknown.
        variant: see classify.variant_of.
        count: elements of the list in use; -1: all present.
    """
    dataset = SETS.get(did)
    if dataset is None or dataset.struct is None:
        return ((replace(OPAQUE, shape=(size,)), 0),)
    out: list[Place] = []
    version = version_for(did, offset, size, version)
    for field, at in [*_known(dataset, version), *_more_imus(did, dataset, version)]:
        counted: int | None = count if field.name in dataset.struct.counts else None
        if did in RAW_SETS and field.name == "data":
            field, counted = _raw(field, at, offset, size, variant, count)
        if did in VELOCITY_SETS and field.name == "vel" and variant:
            field = replace(field, frame="NED", axes=("north", "east", "down"))
        if did == EVENT_SET and field.name == "data" and not offset:
            field = replace(field, dtype="ascii" if variant else "bytes", shape=(max(size - at, 0),))
        place = _cut(field, at, offset, offset + size, counted)
        if place:
            out.append(place)
    return tuple(out)


def _more_imus(did: int, dataset: DataSet, version: str | None) -> list[Place]:
    """The inertial sensors of an IMX-6, five where an IMX-5 has three."""
    place = dataset.struct.field("I") if did in IMU_SETS and version == VERSIONS[-1] and dataset.struct else None
    return [(replace(place[0], shape=(5,)), place[1])] if place is not None else []


def _raw(field: Field, at: int, offset: int, size: int, variant: int, count: int) -> tuple[Field, int | None]:
    """The member of the union in raw GNSS data; bytes if it is unknown or incomplete."""
    name, struct = RAW_KINDS.get(variant if not offset else 0, ("", ""))
    there = offset + size - at
    if struct and (name == "obs" or there >= TABLES.structs[struct].size):
        fields = tuple(part for part, _ in TABLES.structs[struct].places)
        row = Field(name, shape=(14,) if name == "obs" else (), fields=fields, source=field.source)
        return row, count if name == "obs" else None
    return replace(field, name="buf"), -1


def form_of(did: int, members: tuple[Place, ...], size: int) -> PayloadLayout:
    """A row and a layout of places."""
    row = ROWS[did]
    fields = tuple(field for field, _ in members)
    names = {field.name for field in fields}
    clock = row.time if row.time in names else ""
    apart = tuple(field.name for field in fields if field.axes or field.bits or (field.fields and field.shape))
    message = replace(row, fields=fields, time=clock, tick_ns=row.tick_ns if clock else 0, separate_channels=apart)
    layout = Layout([(field, ((at, size_of(field)),)) for field, at in members], size)
    return PayloadLayout(message, layout)


@lru_cache(maxsize=4096)
def form_for_key(key: int) -> PayloadLayout:
    """The form for a key of classify.py; cached for all decoders, because making it takes 0.1 ms."""
    count, variant, size, offset = key & 0xFF, key >> 8 & 0xFF, key >> 16 & 0x7FF, key >> 27 & 0x7FF
    did, version_index = key >> 38 & 0xFF, key >> 46
    if offset:
        count = -1  # a part does not have the number of used elements
    version = None if version_index == classify.NO_FIRMWARE else VERSIONS[version_index]
    layout = places(did, offset, size, version=version, variant=variant, count=count)
    return form_of(did, layout, size)


# -- tables for classify.py --------------------------------------------------------------------------------------------


def rules() -> Ints:
    """(256, RULES): rules of each DID for classify.py."""
    table = np.zeros((256, classify.RULES), np.int64)
    for did, dataset in SETS.items():
        table[did, classify.FAMILY] = 1 if did in EVB_SETS else 2 if did in GPX_SETS else 0
        table[did, classify.HAS_FIRMWARE] = did in DEVICE_INFOS
        if dataset.struct is None:
            continue
        table[did, classify.STREAMS] = dataset.kind == "data"
        _clock_rules(table, did, dataset)
        for name, counted_by in dataset.struct.counts.items():
            row, at = _the(dataset, name)
            counter, counter_at = _the(dataset, counted_by)
            table[did, classify.LIST_AT], table[did, classify.LIST_STEP] = at, element_size(row)
            table[did, classify.COUNT_AT], table[did, classify.COUNT_SIZE] = counter_at, size_of(counter)
    for did in RAW_SETS:
        table[did, classify.VARIANT] = classify.RAW_DATA
    for did in VELOCITY_SETS:
        table[did, classify.VARIANT] = classify.VELOCITY
    table[POSITION_SET, classify.VARIANT] = classify.POSITION
    table[EVENT_SET, classify.VARIANT] = classify.EVENT
    return table


def _clock_rules(table: Ints, did: int, dataset: DataSet) -> None:
    table[did, classify.CLOCK] = clock_of(dataset)
    if dataset.clock == "obs":
        table[did, classify.CLOCK_AT] = classify.RAW_AT  # the time of the first observation
    elif dataset.clock:
        row, at = _the(dataset, clock_field(dataset))
        table[did, classify.CLOCK_AT] = at
        table[did, classify.CLOCK_MS] = row.dtype == "<u4"
    if dataset.clock.startswith("week+"):
        table[did, classify.WEEK_AT] = _the(dataset, "week")[1]


def _the(dataset: DataSet, name: str) -> Place:
    field = dataset.struct.field(name) if dataset.struct else None
    assert field is not None, f"{dataset.name} has no field {name}"
    return field


def version_numbers() -> Ints:
    """VERSIONS without the newest, in the form that classify.version_of compares."""
    return np.array([_number(version) for version in VERSIONS[:-1]], np.int64)


def _number(version: str) -> int:
    major, minor, patch = (int(part) for part in version.split("."))
    return major << 16 | minor << 8 | patch
