"""The bytes of a command, and the bytes that write a setting.

    SET_DID_FLASH_CONFIG {"startupNavDtMs": 16}      EF 49 25 0C 06 00  10 00  10 00 00 00  8F 05
                                                     SET, with offset      16      the value
    DID_SYS_CMD.SOFTWARE_RESET                       EF 49 05 07 08 00  63 00 00 00  9C FF FF FF  48 22
    ASCE {"options": 0, "messages": [{"id": 7, "period": 1}]}          $ASCE,0,7,1*0E CR LF

Neighbouring fields of a setting are sent in one packet; fields maintained by the device (a checksum, the last place)
are left out, and split the packet. Values are wire values by name; a value that cannot be sent is an EncodeError with
the path of the field.

Source: ISB document, "ISB packet with data offset"; NMEA document of the same maker, "ASCE".
"""

import struct
from collections.abc import Mapping, Sequence
from typing import Any

from imuscope.protocols.embedded.nmea import sentence
from imuscope.protocols.isb import frames
from imuscope.protocols.isb.commands import (
    ASCE_FIELDS,
    COMMAND_ROWS,
    INVERSE,
    NMEA_PERIODS,
    RMC,
    SYS_CMD,
    SYSTEM_COMMANDS,
)
from imuscope.protocols.isb.config_effects import same_pace
from imuscope.protocols.isb.dataset_loader import CURRENT, SETS
from imuscope.protocols.isb.frames import STOP_ALL_PORTS, STOP_CURRENT_PORT, STOP_DID
from imuscope.protocols.isb.json_codec import frame_from_json
from imuscope.protocols.isb.messages import BY_NAME, SET_PREFIX, places
from imuscope.protocols.isb.stored_settings import GET_PREFIX, STREAM_FIELDS, STREAMS_SETTING, fields_of
from imuscope.protocols.isb.streams import GPX_PRESETS, PRESETS
from imuscope.protocols.schema import validation
from imuscope.protocols.schema.fields import Field
from imuscope.protocols.schema.layouts import EncodeError, pack

Values = Mapping[str, Any]
GPX_RMC = 126
NMEA_NAMES = ("ASCE", "INFO", "PERS", "SRST", "STPB", "STPC")
MAG_CAL_STATES = {"MULTI_AXIS": 1, "SINGLE_AXIS": 2, "ABORT": 101}
MAX_NMEA_MESSAGES = 20  # pairs of DID_NMEA_BCAST_PERIOD
_SYSTEM = {name: value for value, name in SYSTEM_COMMANDS.items()}
_STOPS = {"STOP_BROADCASTS_ALL_PORTS": STOP_ALL_PORTS, "STOP_BROADCASTS_CURRENT_PORT": STOP_CURRENT_PORT}


def system_command(command: int) -> bytes:
    """A system command and its inverse, in one set."""
    return frames.set_data(SYS_CMD, struct.pack("<II", command, command ^ 0xFFFFFFFF))


def frame(command: str, values: Values, version: str = CURRENT) -> bytes:
    """The bytes of a command of commands.COMMAND_ROWS.

    Raises:
        EncodeError: a value is missing, unknown or out of range; no such command.
    """
    name = command.removeprefix("$") if command.removeprefix("$") in NMEA_NAMES else command
    row = COMMAND_ROWS.get(name)
    if row is None:
        raise EncodeError(f"unknown command {command!r}")
    head, _, tail = name.partition(".")
    if name == "STOP_DID_BROADCAST":
        return frames.build(STOP_DID, _whole("id", values.get("id"), 255))
    if name in _STOPS:
        _none(name, values)
        return frames.build(_STOPS[name])
    if name == "GET_DATA" or name.startswith(f"{GET_PREFIX}DID_"):
        return _get(name, values)
    if head == "DID_RMC" and tail:
        _only(values, ("options",))
        return frames.set_data(RMC, struct.pack("<QI", PRESETS[tail], _whole("options", values.get("options", 0))))
    if head == "DID_GPX_RMC" and tail:
        _only(values, ("options",))
        options = _whole("options", values.get("options", 0))
        return frames.set_data(GPX_RMC, struct.pack("<QI", GPX_PRESETS[tail], options))
    if head == "DID_MAG_CAL" and tail:
        _none(name, values)
        return frames.set_data(BY_NAME[head].id, struct.pack("<I", MAG_CAL_STATES[tail]))
    if head == "DID_SYS_CMD" and tail:
        _none(name, values)
        return system_command(_SYSTEM[tail])
    if name in NMEA_NAMES:
        return _text(name, values)
    return set_frame(BY_NAME[name.removeprefix(SET_PREFIX)].id, values, version)


def _get(name: str, values: Values) -> bytes:
    request = {"size": 0, "offset": 0, "period": 0, **values}
    if name != "GET_DATA":
        request["id"] = BY_NAME[name.removeprefix(GET_PREFIX)].id
    return frame_from_json({"message": "GET_DATA", "fields": request})


def _text(name: str, values: Values) -> bytes:
    """A sentence; `ASCE` sets the given pairs, or without any queries them."""
    if name != "ASCE":
        _none(name, values)
        return sentence(name)
    _only(values, [field.name for field in ASCE_FIELDS])
    messages = values.get("messages") or []
    if not isinstance(messages, Sequence) or len(messages) > 20:
        raise EncodeError("messages is a list of at most 20", "messages")
    words = [name]
    if messages:
        words.append(str(_whole("options", values.get("options", 0))))
    for place, one in enumerate(messages):
        for part in ("id", "period"):
            words.append(str(_whole(f"messages.{place}.{part}", one.get(part), 65_535)))
    return sentence(",".join(words))


def set_frame(did: int, values: Values, version: str = CURRENT) -> bytes:
    """One SET of neighbouring fields of a data set (or of all), including those maintained by the device."""
    if not values:
        raise EncodeError("give at least one field")
    validation.require_valid(fields_of(did, version), values, partial=True)
    values = _padded(values) if did == NMEA_PERIODS else values
    if did == SYS_CMD and INVERSE not in values and "command" in values:
        values = {**values, INVERSE: int(values["command"]) ^ 0xFFFFFFFF}
    runs = _runs(did, values, version)
    if len(runs) > 1:
        names = [field.name for field in fields_of(did, version) if field.name in values]
        raise EncodeError(f"one packet carries adjacent fields only; {' and '.join(names)} are not adjacent")
    return runs[0]


# -- settings ----------------------------------------------------------------------------------------------------------


def set_frames(did: int, values: Values, version: str = CURRENT, *, held: bool = False) -> list[bytes]:
    """The SETs that write only the given fields of a data set: one for each run of neighbours.

    Fields maintained by the device are skipped.

    Args:
        held: values read from the device itself, which are written back unchecked.
    """
    fields = fields_of(did, version)
    read_only = {field.name for field in fields if field.read_only}
    if not held:
        validation.require_valid(
            fields, {name: value for name, value in values.items() if name not in read_only}, partial=True
        )
    if did == NMEA_PERIODS:
        values = _padded(values)
    return _runs(did, {name: value for name, value in values.items() if name not in read_only}, version)


def _runs(did: int, values: Values, version: str) -> list[bytes]:
    """One SET for each run of fields without a gap."""
    size = SETS[did].sizes.get(version) or SETS[did].struct.size  # type: ignore[union-attr]
    runs: list[tuple[int, bytearray]] = []
    for field, at in places(did, 0, size, version=version):
        if field.name not in values:
            continue
        raw = _packed(field, values[field.name])
        if runs and runs[-1][0] + len(runs[-1][1]) == at:
            runs[-1][1].extend(raw)
        else:
            runs.append((at, bytearray(raw)))
    return [frames.set_data(did, bytes(raw), at) for at, raw in runs]


def _packed(field: Field, value: Any) -> bytes:
    if field.dtype == "bytes" and isinstance(value, str):
        value = bytes.fromhex(value)
    return pack((field,), {field.name: value})


def _padded(values: Values) -> Values:
    """A list of sentences filled up to the length of the data set: sentences that are not named are off."""
    messages = values.get("nmeaBroadcastMsgs")
    if messages is None:
        return values
    if len(messages) > MAX_NMEA_MESSAGES:
        raise EncodeError(f"at most {MAX_NMEA_MESSAGES} sentences, given {len(messages)}", "nmeaBroadcastMsgs")
    empty = [{"msgID": 0, "msgPeriod": 0}] * (MAX_NMEA_MESSAGES - len(messages))
    return {**values, "nmeaBroadcastMsgs": [*messages, *empty]}


def streams_frames(values: Values, old: Values | None = None) -> list[bytes]:
    """The requests that start and stop streams, and the one that saves them.

    Args:
        old: streams now, if known: unchanged ones are not requested.
    """
    periods = chosen(values)
    now = {one["did"]: one for one in (old or {}).get("streams", [])}
    ended = [did for did in now if did not in periods] if "streams" in values else []
    out = [frames.build(STOP_DID, did) for did in ended]
    rows = touched(values.get("streams", []), now)
    out += [frames.get_data(row["did"], period=row.get("period", 1)) for row in rows]
    if persists(values):
        out.append(system_command(1))
    return out


def touched(streams: Sequence[Values], now: Mapping[int, Values]) -> list[Values]:
    """The rows that differ from the device's state; only these are sent. A row that was read but never observed counts
    as read.
    """
    changed = []
    for row in streams:
        there = now.get(row["did"])
        unobserved = there is not None and row.get("size") == 0 and row.get("period", 1) == 1
        if there is None or not (unobserved or same_pace(row, there)):
            changed.append(row)
    return changed


def chosen(values: Values) -> dict[int, int]:
    """Data set → period of the streams in a value of the setting."""
    _only(values, [field.name for field in STREAM_FIELDS])
    periods: dict[int, int] = {}
    rows = values.get("streams", [])
    if not isinstance(rows, (list, tuple)):
        raise EncodeError(f"streams is a list, given {rows!r}", "streams")
    allowed = STREAM_FIELDS[0].fields[0].choices
    for place, one in enumerate(rows):
        if not isinstance(one, Mapping):
            raise EncodeError(f"a stream is a record of did and period, given {one!r}", f"streams.{place}")
        did = _whole(f"streams.{place}.did", one.get("did"), 255)
        if did not in allowed:
            raise EncodeError(f"data set {did} cannot be streamed", f"streams.{place}.did")
        if did in periods:
            raise EncodeError(f"{allowed[did]} is listed twice", f"streams.{place}.did")
        period = _whole(f"streams.{place}.period", one.get("period", 1), 65_535)
        if period == 0:
            raise EncodeError(
                "period must be in [1, 65535]; to stop the stream, leave it out", f"streams.{place}.period"
            )
        periods[did] = period
    return periods


def persists(values: Values) -> bool:
    """Whether these streams are saved over a restart."""
    return bool(_whole("options", values.get("options", 0)) & 1 << 9)


# -- checks ------------------------------------------------------------------------------------------------------------


def _whole(path: str, value: Any, most: int = 0xFFFFFFFF) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
        raise EncodeError(f"{path.rpartition('.')[2]} is a whole number from 0 to {most}, given {value!r}", path)
    return value


def _only(values: Values, names: Sequence[str]) -> None:
    for name in values:
        if name not in names:
            raise EncodeError(f"no field is called {name!r}; there are: {', '.join(names) or 'none'}", name)


def _none(command: str, values: Values) -> None:
    if values:
        raise EncodeError(f"{command} takes no values, given {', '.join(values)}", next(iter(values)))


def did_of(setting: str) -> int:
    """The data set of a setting; for the streams DID_RMC."""
    return RMC if setting == STREAMS_SETTING else BY_NAME[setting].id
