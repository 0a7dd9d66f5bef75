"""Tables of a store: names, columns, units, and a line of documentation each.

A table is a Delta Lake table in `tables/NAME`. The types are Arrow's; all times are UTC in microseconds. A column that
is added here appears in a store with the next upload; rows that are older than it have no value there (NULL).

    recordings ─── devices ─── settings, losses, events, minutes, samples

`recording` joins them, and `device` within a recording. `recordings` is written last: rows of other tables whose
recording is not in it belong to an upload that was cut off, and the views leave them out.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import pyarrow as pa

TIME = pa.timestamp("us", "UTC")
TEXT, REAL, WHOLE, DAY = pa.string(), pa.float64(), pa.int64(), pa.date32()


@dataclass(frozen=True, slots=True)
class StoreColumn:
    """Name, type and meaning of a column in the store."""

    name: str
    type: pa.DataType
    doc: str


@dataclass(frozen=True, slots=True)
class StoreTable:
    """A table.

    Args:
        partitions: columns that its files are grouped by.
        joined: whether its rows belong to a row of `recordings`.
    """

    name: str
    doc: str
    columns: tuple[StoreColumn, ...]
    partitions: tuple[str, ...]
    joined: bool

    @property
    def schema(self) -> pa.Schema:
        return pa.schema([pa.field(one.name, one.type, metadata={"doc": one.doc}) for one in self.columns])


def _columns(*rows: tuple[str, pa.DataType, str]) -> tuple[StoreColumn, ...]:
    return tuple(StoreColumn(*row) for row in rows)


def _table(
    name: str,
    doc: str,
    keys: tuple[StoreColumn, ...],
    *rows: tuple[str, pa.DataType, str],
    partitions: tuple[str, ...] = ("date",),
    joined: bool = True,
) -> StoreTable:
    return StoreTable(name, doc, keys + _columns(*rows), partitions, joined)


_KEYS = _columns(
    ("date", DAY, "UTC date on which the recording starts; partition"),
    ("robot", TEXT, "name given to `upload`"),
    ("recording", TEXT, "identifier of the recording: depends on its content and on the robot only"),
)
_OF_DEVICE = _KEYS + _columns(("device", TEXT, "identifier of the device within the recording: 1, 2, 1.102"))

RECORDINGS = _table(
    "recordings",
    "one row for each recording",
    _KEYS,
    ("title", TEXT, "title, or the name of the file"),
    ("started", TIME, "arrival of the first byte"),
    ("ended", TIME, "arrival of the last byte"),
    ("duration_s", REAL, "from the first to the last byte, s"),
    ("devices", WHOLE, "number of devices"),
    ("messages", WHOLE, "frames that were received whole, of all devices"),
    ("lost", WHOLE, "samples that the devices counted and that did not arrive"),
    ("rejects", WHOLE, "frames that failed their check"),
    ("markers", WHOLE, "number of markers and notes"),
    ("tags", TEXT, "tags, separated by commas"),
    ("notes", TEXT, "notes"),
    ("damaged", TEXT, "the problem of the file; empty if there is none"),
    ("name", TEXT, "name of the uploaded file"),
    ("format", TEXT, "its format: mcap, csv, bin, or that of a vendor's log"),
    ("object", TEXT, "the recording in the store: robots/ROBOT/DATE/RECORDING.mcap"),
    ("bytes", WHOLE, "size of the object"),
    ("checksum", TEXT, "SHA-256 of the object, hexadecimal"),
    ("host", TEXT, "computer that recorded it"),
    ("version", TEXT, "version of imuscope that uploaded it"),
    ("uploaded", TIME, "when it was uploaded"),
    joined=False,
)
DEVICES = _table(
    "devices",
    "one row for each device of each recording",
    _OF_DEVICE,
    ("name", TEXT, "displayed name"),
    ("product", TEXT, "product, as the device reports it"),
    ("serial_number", TEXT, "serial number, as the device reports it"),
    ("firmware", TEXT, "version of its firmware"),
    ("protocol", TEXT, "protocol family"),
    ("link", TEXT, "kind of link: serial, tcp, udp, file, simulator, …"),
    ("adapter", TEXT, "serial adapter, by its identity where the port was named by it, else port or kind of link"),
    ("source", TEXT, "source as given to imuscope"),
    ("baud", WHOLE, "baud rate of a serial port"),
    ("duration_s", REAL, "duration of the recording, s"),
    ("messages", WHOLE, "frames that were received whole"),
    ("bytes", WHOLE, "bytes received on its link"),
    ("lost", WHOLE, "samples that it counted and that did not arrive"),
    ("gaps", WHOLE, "number of losses"),
    ("rejects", WHOLE, "frames that failed their check"),
    ("gyro_noise", REAL, "noise density of the gyroscopes by its data sheet, rad/s/√Hz"),
    ("accelerometer_noise", REAL, "noise density of the accelerometers by its data sheet, m/s²/√Hz"),
)
EVENTS = _table(
    "events",
    "what happened: losses, rejects, clock steps, answers, user actions, markers and notes",
    _OF_DEVICE,
    ("time", TIME, "when it happened"),
    ("kind", TEXT, "gap, reject, clock, link, reply, text, marker, note, device or command"),
    ("level", TEXT, "info, warning or error"),
    ("text", TEXT, "one sentence"),
    ("began", TIME, "start of the time it concerns, if it lasts"),
    ("ended", TIME, "end of that time"),
    ("samples", WHOLE, "number of samples it concerns"),
    ("data", TEXT, "further values, JSON"),
)
LOSSES = _table(
    "losses",
    "stretches in which samples are missing",
    _OF_DEVICE,
    ("began", TIME, "last sample before"),
    ("ended", TIME, "first sample after"),
    ("duration_s", REAL, "from began to ended, s"),
    ("samples", WHOLE, "samples that are missing; 0 if it is not known how many"),
    ("cause", TEXT, "link: the line was away; else what counted them"),
)
SETTINGS = _table(
    "settings",
    "settings of the devices at the time of recording",
    _OF_DEVICE,
    ("setting", TEXT, "name in the protocol's document"),
    ("title", TEXT, "name on the page"),
    ("field", TEXT, "field of the setting, with its path: outputs[0].rate"),
    ("value", TEXT, "value as on the wire; lists and the like as JSON"),
    ("number", REAL, "the value, if it is a number"),
)
MINUTES = _table(
    "minutes",
    "figures of every signal in every minute: questions over many recordings read these, not the samples",
    _OF_DEVICE,
    ("message", TEXT, "message of the protocol"),
    ("signal", TEXT, "CHANNEL.COLUMN, as in `imuscope analyse`; CHANNEL.norm is the length of a vector"),
    ("unit", TEXT, "unit of the values"),
    (
        "quantity",
        TEXT,
        "rate of turn, acceleration, free acceleration, magnetic field, temperature, pressure, or empty",
    ),
    ("axis", TEXT, "x, y, z, w, norm, or empty"),
    ("minute", TIME, "start of the minute"),
    ("count", WHOLE, "finite samples"),
    ("min", REAL, "least value"),
    ("max", REAL, "greatest value"),
    ("mean", REAL, "mean; of an angle that wraps, the short way round"),
    ("sigma", REAL, "standard deviation"),
    ("rms", REAL, "root mean square"),
    ("rate", REAL, "samples per second"),
    ("noise", REAL, "white noise, unit/√Hz, from second differences: what moves slowly does not count"),
)
SAMPLES = _table(
    "samples",
    "samples of all signals: a row for each packet, a column for each signal and unit, NULL in packets without it",
    _OF_DEVICE,
    ("message", TEXT, "message of the protocol"),
    ("time", TIME, "time of the sample"),
    ("entry", WHOLE, "number of an entry of a list in the packet, such as a satellite, from 1; NULL: the packet"),
    partitions=("date", "robot"),
)
TABLES: Mapping[str, StoreTable] = {
    one.name: one for one in (RECORDINGS, DEVICES, EVENTS, LOSSES, SETTINGS, MINUTES, SAMPLES)
}
SIGNAL, UNIT = b"signal", b"unit"
"""Metadata of the columns of `samples` that hold a signal: its name and unit."""
