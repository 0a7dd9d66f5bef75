"""Settings of an Inertial Sense device: its stored and reported values, as rows.

    STORED     data sets read as settings: their titles, whether they are writable, when changes take effect
    streams    data sets sent to this port, and how often

Rules for editing: a stored data set is a row of `STORED`; field_docs.py explains its fields.

Source: ISB document; inertial-sense-sdk 2.7.1, data_sets.h.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

from imuscope.protocols.isb.dataset_loader import CURRENT, SETS, SOURCE, as_written
from imuscope.protocols.isb.field_docs import noted
from imuscope.protocols.isb.messages import SET_PREFIX, places
from imuscope.protocols.isb.streams import OF_GPX, STREAMS
from imuscope.protocols.schema.fields import Bits, Field, Setting

GET_PREFIX = "GET_"
ISB_SOURCE = "Inertial Sense binary protocol document"
STREAMS_SETTING = "streams"
WHOLE = (8, 126)  # sentences and streams of a GPX take effect at once, but only as a whole
PERSISTENT = 1 << 9  # an option of streams and sentences: a request to save them, not a readable state

G_STREAMS, G_NMEA, G_CONFIG, G_CAL, G_SYSTEM, G_ABOUT, G_READ, G_WRITE = (
    *("Streams", "NMEA", "Configuration", "Calibration", "System", "About", "Read a data set", "Write a data set"),
)


@dataclass(frozen=True, slots=True)
class StoredDataSet:
    """A data set stored or reported by the device.

    Args:
        title: display name; the document has constants only.
        write: whether it can be written.
        after: when a written value takes effect.
    """

    title: str
    group: str
    doc: str
    write: bool = False
    after: str = ""
    basic: bool = False


STORED: Mapping[int, StoredDataSet] = {
    12: StoredDataSet(
        "Flash configuration",
        G_CONFIG,
        "Configuration stored across restarts; fields are written individually, by offset.",
        True,
        "reset",
        True,
    ),
    8: StoredDataSet("NMEA sentences", G_NMEA, "Sentences sent and their periods.", write=True, basic=True),
    19: StoredDataSet("Magnetometer calibration", G_CAL, "Magnetometer calibration.", write=True, basic=True),
    94: StoredDataSet("In-field calibration", G_CAL, "In-field calibration.", write=True),
    87: StoredDataSet("Wheel encoders", G_CAL, "Calibration of the wheel encoders.", write=True),
    64: StoredDataSet("Built-in test", G_CAL, "Built-in test.", write=True),
    73: StoredDataSet("Base survey", G_CONFIG, "Survey of the position of a base.", write=True),
    90: StoredDataSet("CAN bus", G_CONFIG, "CAN bus messages.", True, "reset"),
    61: StoredDataSet("RTK engine", G_CONFIG, "Options of the RTK engine.", write=True),
    121: StoredDataSet("GPX configuration", G_CONFIG, "Configuration of a GPX, stored across restarts.", True, "reset"),
    126: StoredDataSet("GPX streams", G_STREAMS, "Streams of a GPX.", write=True),
    125: StoredDataSet("GPX built-in test", G_CAL, "Built-in test of a GPX.", write=True),
    81: StoredDataSet("EVB configuration", G_CONFIG, "Configuration of an EVB, stored across restarts.", True, "reset"),
    1: StoredDataSet("Device", G_ABOUT, "Product, serial number, versions.", basic=True),
    10: StoredDataSet("System state", G_ABOUT, "Current temperatures, periods and status."),
    17: StoredDataSet("First GNSS receiver", G_ABOUT, "Version of the first receiver."),
    18: StoredDataSet("Second GNSS receiver", G_ABOUT, "Version of the second receiver."),
    2: StoredDataSet("Last fault", G_ABOUT, "The last fault."),
    75: StoredDataSet("Port traffic", G_ABOUT, "Traffic and losses of every port."),
    120: StoredDataSet("GPX device", G_ABOUT, "Product, serial number, versions of a GPX."),
    93: StoredDataSet("EVB device", G_ABOUT, "Product, serial number, versions of an EVB."),
}


# -- fields ------------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=1024)
def fields_of(did: int, version: str = CURRENT) -> tuple[Field, ...]:
    """The fields of a data set in firmware `version`, with their notes, in the units of the wire."""
    row = SETS.get(did)
    if row is None or row.struct is None:
        return ()
    size = row.sizes.get(version, row.struct.size)
    return tuple(as_written(noted(did, field)) for field, _ in places(did, 0, size, version=version))


def select(name: str, doc: str, choices: Mapping[int, str], dtype: str = "<u2") -> Field:
    return Field(name, dtype, choices=choices, doc=doc)


def _data_set(choices: Mapping[int, str]) -> Field:
    """The data set of a stream, which names it in comparisons."""
    return replace(select("did", "Data set.", choices), key_mask=0xFFFF)


DATA_SETS: Mapping[int, str] = {did: row.name for did, row in SETS.items() if did and row.struct}
_PERIOD = Field("period", "<u2", default=1, doc="Multiple of the source's period.", low=1)

STREAM_FIELDS = (
    Field(
        "streams",
        shape=(-1,),
        max_length=len(STREAMS),
        fields=(
            _data_set({did: row.name for did, row in STREAMS.items()}),
            _PERIOD,
            Field("size", "<u2", unit="B", read_only=True, doc="Observed data size; 0 if none was received."),
            Field("source_ms", "<f8", unit="ms", read_only=True, doc="Period of the source; 0: sent on events."),
        ),
        title="Streams",
        doc="Streams of this port.",
        source=ISB_SOURCE,
    ),
    Field(
        "options",
        "<u4",
        bits=(Bits("PERSISTENT", 9, doc="Save these streams across restarts"),),
        title="Options",
        default=0,
        doc="Saves these streams when they are written. The saved state cannot be read back.",
        source=ISB_SOURCE,
    ),
)

GPX_STREAM_FIELDS = (
    replace(
        STREAM_FIELDS[0],
        max_length=len(OF_GPX),
        fields=(
            _data_set({did: row.name for did, row in STREAMS.items() if did in OF_GPX}),
            *STREAM_FIELDS[0].fields[1:],
        ),
    ),
    STREAM_FIELDS[1],
)

# -- settings ----------------------------------------------------------------------------------------------------------


@lru_cache(maxsize=16)
def settings_of(version: str = CURRENT) -> Mapping[str, Setting]:
    """All stored settings by name, for firmware `version`."""
    rows = [
        Setting(
            STREAMS_SETTING,
            STREAM_FIELDS,
            read=f"{GET_PREFIX}DID_RMC",
            write="GET_DATA",
            partial=True,
            editor="streams",
            group=G_STREAMS,
            title="Streams",
            doc="Data sets that the device sends to this port, and their periods.",
            source=ISB_SOURCE,
        )
    ]
    for did, row in STORED.items():
        name = SETS[did].name
        rows.append(
            Setting(
                name,
                fields_of(did, version),
                read=f"{GET_PREFIX}{name}",
                write=f"{SET_PREFIX}{name}" if row.write else "",
                partial=row.write and did not in WHOLE,
                after=row.after,  # type: ignore[arg-type]
                group=row.group,
                basic=row.basic,
                title=row.title,
                doc=row.doc,
                source=SOURCE,
            )
        )
    return {row.name: row for row in rows if row.fields}
