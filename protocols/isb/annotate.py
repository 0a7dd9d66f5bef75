"""Annotation of a packet or a sentence byte by byte, shown while it is composed.

    EF 49 | 25  | 0C               | 06 00   | 10 00  | 10 00 00 00         | 8F 05
    sync    SET   DID_FLASH_CONFIG   payload   offset   startupNavDtMs = 16   checksum

Source: ISB document, "ISB packet"; NMEA 0183.
"""

from collections.abc import Iterator

from imuscope.protocols.commands.transactions import ByteRange
from imuscope.protocols.isb.commands import SYSTEM_COMMANDS
from imuscope.protocols.isb.dataset_loader import SETS
from imuscope.protocols.isb.frames import DATA, FIRST, HEADER, SECOND, SET_DATA, TRAILER, TYPE_MASK, TYPES, WITH_OFFSET
from imuscope.protocols.isb.json_codec import described
from imuscope.protocols.isb.messages import BY_NAME, COMMANDS, ROWS, set_row
from imuscope.protocols.schema.fields import Field
from imuscope.protocols.schema.layouts import size_of, unpack

MAX_ELEMENTS = 64  # list elements annotated one by one; a longer list is one span


def name_of(frame: bytes) -> str:
    """Name of a packet: "SET_DID_FLASH_CONFIG", "DID_SYS_CMD.SOFTWARE_RESET", "STPC"; "" for other bytes."""
    if frame[:1] == b"$":
        return frame[1:].split(b"*")[0].split(b",")[0].decode("latin-1").strip()
    if len(frame) < HEADER + TRAILER or frame[:2] != bytes((FIRST, SECOND)) or frame[2] & TYPE_MASK not in TYPES:
        return ""
    kind, did = frame[2] & TYPE_MASK, frame[3]
    if kind == SET_DATA and did == BY_NAME["DID_SYS_CMD"].id and len(frame) == HEADER + 8 + TRAILER:
        command = SYSTEM_COMMANDS.get(int.from_bytes(frame[HEADER : HEADER + 4], "little"))
        return f"DID_SYS_CMD.{command}" if command else set_row(did).name
    if kind == DATA:
        return ROWS[did].name
    if kind == SET_DATA:
        return set_row(did).name
    name = COMMANDS[kind].name
    if name == "GET_DATA" and len(frame) >= HEADER + 8 + TRAILER:
        dataset = SETS.get(int.from_bytes(frame[HEADER : HEADER + 2], "little"))
        return f"GET_{dataset.name}" if dataset else name
    return name


def annotate(frame: bytes) -> list[ByteRange]:
    """See imuscope.protocols.commands.transactions.DeviceDriver.annotate; bytes that are neither a packet nor a
    sentence are one span.
    """
    if frame[:1] == b"$":
        return list(_sentence(frame))
    if not name_of(frame):
        return [ByteRange(0, len(frame), "unknown")] if frame else []
    return list(_packet(frame))


def _packet(frame: bytes) -> Iterator[ByteRange]:
    kind, did = frame[2] & TYPE_MASK, frame[3]
    yield ByteRange(0, 2, "preamble")
    yield ByteRange(2, 1, TYPES[kind] + (", with offset" if frame[2] & WITH_OFFSET else ""))
    yield ByteRange(3, 1, ROWS[did].name if kind in (DATA, SET_DATA) or did else "no data set")
    yield ByteRange(4, 2, f"payload: {int.from_bytes(frame[4:6], 'little')} B")
    begin, offset = HEADER, 0
    if frame[2] & WITH_OFFSET and kind in (DATA, SET_DATA):
        offset = int.from_bytes(frame[6:8], "little")
        yield ByteRange(6, 2, f"offset: {offset} B into the set")
        begin += 2
    payload = frame[begin:-TRAILER]
    at = 0
    for field, place in described(kind, did, payload, offset, None):
        if place > at:
            yield ByteRange(begin + at, place - at, "no field")
        yield from _field(field, payload, place, begin, field.name)
        at = place + size_of(field)
    if at < len(payload):
        yield ByteRange(begin + at, len(payload) - at, "no field")
    yield ByteRange(len(frame) - TRAILER, TRAILER, "checksum")


def _field(field: Field, payload: bytes, at: int, begin: int, path: str) -> Iterator[ByteRange]:
    """A field; each element of a vector, each field of a record."""
    size = size_of(field)
    if not size:
        return
    count = 1
    for n in field.shape:
        count *= n
    if field.dtype in ("bytes", "ascii") or count > MAX_ELEMENTS:
        yield ByteRange(begin + at, size, field.name, path)
        return
    step = size // count
    for place in range(count):
        here = f"{path}.{place}" if field.shape else path
        if field.fields:
            inner = at + place * step
            for part in field.fields:
                yield from _field(part, payload, inner, begin, f"{here}.{part.name}")
                inner += size_of(part)
            continue
        one = Field(field.name, field.dtype)
        value = unpack((one,), payload, at + place * step)[field.name]
        yield ByteRange(begin + at + place * step, step, _label(field, value, place), here)


def _label(field: Field, value: float, place: int) -> str:
    """Label of a value: "startupNavDtMs = 16 ms", "theta roll = 5.73 °", "id = DID_INS_1"."""
    name = f"{field.name} {field.axes[place]}" if len(field.axes) > place else field.name
    if field.choices:
        return f"{name} = {field.choices.get(int(value), value)}"
    if field.bits:
        words = [bits.name for bits in field.bits if bits.of(int(value))]
        return f"{name} = {', '.join(words) or 'none'}"
    shown = value * field.scale + field.bias if field.scale != 1 or field.bias else value
    unit = field.unit.split(",")[place] if field.unit.count(",") >= max(place, 1) else field.unit
    text = f"{shown:.6g}" if isinstance(shown, float) else str(shown)
    return f"{name} = {text}{' ' + unit if unit else ''}"


def _sentence(frame: bytes) -> Iterator[ByteRange]:
    """$, words between commas, the checksum, the line end."""
    body, star, tail = frame.partition(b"*")
    yield ByteRange(0, 1, "start")
    at = 1
    for place, word in enumerate(body[1:].split(b",")):
        if place:
            yield ByteRange(at, 1, "comma")
            at += 1
        if word:
            text = word.decode("latin-1")
            yield ByteRange(at, len(word), "sentence" if not place else text, "" if not place else str(place))
            at += len(word)
    if star:
        digits = tail.rstrip(b"\r\n")
        yield ByteRange(at, 1 + len(digits), "checksum")
        at += 1 + len(digits)
    if at < len(frame):
        yield ByteRange(at, len(frame) - at, "end of line")
