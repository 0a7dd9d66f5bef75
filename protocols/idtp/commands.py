"""Commands of IDTP. A frame of any payload type, as rows that a form can be drawn from.

    Imu3Acc … ImuQuat    the standard types, by the document's names of their readings
    Frame                any type, 0x00 to 0xFF, its payload as hex
    0x80, Wheels …  a vendor's own types: by number with `data` as hex, or as described (custom_payloads.py)

Every frame has the header's arguments first: time stamp, sequence number, device, version and mode. The mode selects
the protection; a Secure frame needs the source's key. The protocol has neither settings nor answers.

Source: IDTP v2.1.0, sections 4.3 to 4.5.
"""

from collections.abc import Mapping
from dataclasses import replace

from imuscope.protocols.idtp.custom_payloads import Schema
from imuscope.protocols.idtp.frames import LITE, MAJOR, MAX_PAYLOAD, SAFETY, VERSION
from imuscope.protocols.idtp.messages import MESSAGES, MODE_NAMES, SECTION, WIRE
from imuscope.protocols.schema.fields import Command, Field, Message

G_STANDARD, G_VENDOR = "Standard payloads", "Vendor payloads"
ANY = "Frame"
HEADER_SOURCE = "IDTP v2.1.0, section 4.3"
VERSIONS: Mapping[int, str] = {MAJOR << 4 | minor: f"{MAJOR}.{minor}" for minor in range(16)}

_HEADER = (
    Field("timestamp", "<u4", default=0, doc="Sensor time; microseconds are recommended."),
    Field("sequence", "<u4", default=0, doc="Frame number; receivers discard frames whose number is not newer."),
    Field("device_id", "<u2", default=0, title="Device", doc="Vendor-assigned number of the sensor."),
    Field("mode", "u1", choices=MODE_NAMES, default=SAFETY, low=LITE, high=2, doc="Protection of the frame."),
    Field(
        "version",
        "u1",
        choices=VERSIONS,
        default=VERSION,
        low=0x20,
        high=0x2F,
        basic=False,
        doc="Protocol version; 0x21 is 2.1.",
    ),
)
HEADER: tuple[Field, ...] = tuple(replace(field, source=HEADER_SOURCE) for field in _HEADER)
DATA = Field("data", "bytes", (-1,), max_length=MAX_PAYLOAD, title="Payload", doc="Payload in hex, at most 972 bytes.")
TYPE = Field(
    "type",
    "u1",
    default=0x80,
    title="Payload type",
    doc="0x00 to 0x06 are standard types; types from 0x80 are vendor-specific.",
)


def reading_fields(row: Message) -> tuple[Field, ...]:
    """The readings of a payload one by one, by the names that inspect prints."""
    fields: list[Field] = []
    for field in row.fields:
        names = WIRE.get(field.name, ()) if field.source == SECTION else ()
        if not names:
            fields.append(field)
        for name, axis in zip(names, field.axes or ("",), strict=False):
            title = f"{field.title or field.name} {axis}".strip()
            fields.append(
                replace(field, name=name, shape=(), axes=(), title=title, default=1.0 if name == "w" else 0.0)
            )
    return tuple(fields)


def commands(schema: Schema) -> Mapping[str, Command]:
    """All rows by name, including those of `schema`."""
    rows = [_command(row, G_STANDARD, basic=True) for row in MESSAGES]
    rows += [_command(row, G_VENDOR, basic=True) for row in schema.values()]
    rows.append(
        Command(
            ANY,
            (TYPE, *HEADER, DATA),
            "do",
            G_VENDOR,
            title="Any payload",
            doc="Frame of any type, with the payload as bytes.",
        )
    )
    return {row.name: row for row in rows}


def _command(row: Message, group: str, *, basic: bool) -> Command:
    arguments = (*HEADER, *reading_fields(row))
    return Command(row.name, arguments, "do", group, basic=basic, title=row.name, doc=row.doc, source=row.source)
