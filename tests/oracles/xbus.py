"""Slow and simple Xbus decoder, the reference for the fast one.

Pure Python, one byte at a time, nothing imported from the project. Types are written here a second time, from the
document, so that a slip in the project's tables does not repeat itself.

    python -m tests.oracles.xbus FACTS.json

writes tests/golden/xbus/computed.json: a vector for every message and every identifier in the facts, marked "computed",
with simple ramps as values.
"""

import json
import struct
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

PREAMBLE = 0xFA
MAX_DATA_BYTES = 8185


# -- frames ------------------------------------------------------------------------------------------------------------


@dataclass
class OracleXbusFrame:
    offset: int
    size: int
    bid: int
    mid: int
    payload: bytes


@dataclass
class XbusScan:
    frames: list[OracleXbusFrame] = field(default_factory=list)
    rejects: list[tuple[int, str]] = field(default_factory=list)
    rest: int = 0  # index from which bytes are undecided


def scan(data: bytes, *, final: bool) -> XbusScan:
    """Every frame and every failed candidate, by the rule: after a failure go on one byte later."""
    result = XbusScan()
    at = 0
    while at < len(data):
        if data[at] != PREAMBLE:
            at += 1
            continue
        verdict = _candidate(data[at:])
        if verdict == "incomplete" and not final:
            break
        if isinstance(verdict, OracleXbusFrame):
            verdict.offset = at
            result.frames.append(verdict)
            at += verdict.size
        else:
            result.rejects.append((at, "truncated" if verdict == "incomplete" else verdict))
            at += 1
    result.rest = at
    return result


def _candidate(data: bytes) -> OracleXbusFrame | str:
    if len(data) >= 3 and data[1] == 0 and data[2] == 0:
        return "bad_id"
    if len(data) < 4:
        return "incomplete"
    length, body = data[3], 4
    if length == 255:
        if len(data) < 6:
            return "incomplete"
        length, body = data[4] * 256 + data[5], 6
        if length > MAX_DATA_BYTES:
            return "bad_size"
    size = body + length + 1
    if len(data) < size:
        return "incomplete"
    if sum(data[1:size]) % 256 != 0:
        return "bad_checksum"
    return OracleXbusFrame(0, size, data[1], data[2], data[body : size - 1])


# -- items -------------------------------------------------------------------------------------------------------------

REAL = {  # identifier without its format bits → name, how many numbers
    0x0810: ("Temperature", 1),
    0x2010: ("Quaternion", 4),
    0x2020: ("RotationMatrix", 9),
    0x2030: ("EulerAngles", 3),
    0x4010: ("DeltaV", 3),
    0x4020: ("Acceleration", 3),
    0x4030: ("FreeAcceleration", 3),
    0x4040: ("AccelerationHR", 3),
    0x5010: ("AltitudeMsl", 1),
    0x5020: ("AltitudeEllipsoid", 1),
    0x5030: ("PositionEcef", 3),
    0x5040: ("LatLon", 2),
    0x8020: ("RateOfTurn", 3),
    0x8030: ("DeltaQ", 4),
    0x8040: ("RateOfTurnHR", 3),
    0xA060: ("RawDeltaQ", 4),
    0xA070: ("RawDeltaV", 3),
    0xC020: ("MagneticField", 3),
    0xC030: ("MagneticFieldCorrected", 3),
    0xD010: ("VelocityXYZ", 3),
}

FIXED = {  # → name, struct format
    0x1010: ("UtcTime", ">IHBBBBBB"),
    0x1020: ("PacketCounter", ">H"),
    0x1030: ("Itow", ">I"),
    0x1040: ("GnssAge", ">B"),
    0x1050: ("PressureAge", ">B"),
    0x1060: ("SampleTimeFine", ">I"),
    0x1070: ("SampleTimeCoarse", ">I"),
    0x1080: ("FrameRange", ">HH"),
    0x1090: ("PacketCounter8", ">B"),
    0x10A0: ("SampleTime64", ">Q"),
    0x10B0: ("PacketCounter32", ">I"),
    0x3010: ("BaroPressure", ">I"),
    0x4810: ("TriggerIn1", ">BBIH"),
    0x4820: ("TriggerIn2", ">BBIH"),
    0x4830: ("TriggerIn3", ">BBIH"),
    0x7010: ("GnssPvtData", ">IHBBBBBBIiBBBBiiiiIIiiiiiIIiHHHHHHH"),
    0x7030: ("GnssPvtPulse", ">I"),
    0xA010: ("RawAccGyrMagTemp", ">9Hh"),
    0xA020: ("RawGyroTemp", ">3h"),
    0xA030: ("RawAcc", ">3H"),
    0xA040: ("RawGyr", ">3H"),
    0xA050: ("RawMag", ">3H"),
    0xA090: ("RawFloatAccGyrMagTemp", ">10f"),
    0xB010: ("AnalogIn1", ">H"),
    0xB020: ("AnalogIn2", ">H"),
    0xE010: ("StatusByte", ">B"),
    0xE020: ("StatusWord", ">I"),
    0xE040: ("Rssi", ">b"),
    0xE080: ("DeviceId", ">I"),
    0xE090: ("LocationId", ">H"),
}


def numbers(identifier: int, value: bytes) -> tuple[str, list[Any]] | None:
    """Name and wire values of one item, records flattened; None where the identifier is not known or the size wrong."""
    base, precision = identifier & 0xFFF0, identifier & 3
    if identifier & 0xC == 0xC:
        return None
    if base == 0x7020:
        if len(value) < 8 or (len(value) - 8) % 4:
            return None
        return "GnssSatInfo", [*struct.unpack(">IBBBB", value[:8]), *value[8:]]
    if base == 0xA080:
        return "RawBlob", list(value)
    if base == 0xE080 and len(value) == 8:
        return "DeviceId", list(struct.unpack(">Q", value))
    if base in REAL:
        name, count = REAL[base]
        width = (4, 4, 6, 8)[precision]
        if len(value) != count * width:
            return None
        return name, [_real(precision, value[i : i + width]) for i in range(0, len(value), width)]
    if base in FIXED:
        name, form = FIXED[base]
        return (name, list(struct.unpack(form, value))) if struct.calcsize(form) == len(value) else None
    return None


def _real(precision: int, raw: bytes) -> float:
    if precision == 0:
        return float(struct.unpack(">f", raw)[0])
    if precision == 1:
        return float(struct.unpack(">i", raw)[0]) / 2**20
    if precision == 2:
        integer = int.from_bytes(bytes([raw[4], raw[5], raw[0], raw[1], raw[2], raw[3]]), "big", signed=True)
        return integer / 2**32
    return float(struct.unpack(">d", raw)[0])


def mtdata2(payload: bytes) -> tuple[dict[str, list[Any]], int]:
    """Items by name, the last of a name counting, chained blobs joined; and how many bytes were good."""
    every, good = mtdata2_items(payload)
    values: dict[str, list[Any]] = {}
    for name, content in every:
        values.pop(name, None)
        values[name] = content
    return values, good


def mtdata2_items(payload: bytes) -> tuple[list[tuple[str, list[Any]]], int]:
    """All items, chained blobs joined; and how many bytes were good."""
    values: list[tuple[str, list[Any]]] = []
    at = 0
    blob_goes_on = False
    while at + 3 <= len(payload) and at + 3 + payload[at + 2] <= len(payload):
        identifier = payload[at] * 256 + payload[at + 1]
        value = payload[at + 3 : at + 3 + payload[at + 2]]
        known = numbers(identifier, value)
        name, content = known if known else (f"0x{identifier:04X}", list(value))
        if identifier == 0xA080 and blob_goes_on:
            content = values.pop()[1] + content
        blob_goes_on = identifier == 0xA080 and len(value) == 255
        values.append((name, content))
        at += 3 + len(value)
    return values, at


def build(mid: int, payload: bytes, bid: int = 0xFF) -> bytes:
    """One frame."""
    length = bytes([len(payload)]) if len(payload) < 255 else b"\xff" + len(payload).to_bytes(2, "big")
    body = bytes([bid, mid]) + length + payload
    return bytes([PREAMBLE]) + body + bytes([(256 - sum(body) % 256) % 256])


# -- computed vectors --------------------------------------------------------------------------------------------------

_LISTS = {
    "ReqSyncSettingsAck": "settings",
    "SetSyncSettings": "settings",
    "ReqOutputConfigurationAck": "outputs",
    "SetOutputConfiguration": "outputs",
    "SetOutputConfigurationAck": "outputs",
    "CanOutputConfig": "outputs",
    "SetCanOutputConfig": "outputs",
    "SetCanOutputConfigAck": "outputs",
    "AvailableFilterProfiles": "profiles",
}
_CODES = {"U1": ">B", "U2": ">H", "U4": ">I", "U8": ">Q", "I2": ">h", "I4": ">i", "F4": ">f", "F8": ">d"}


def _sample(kind: str, seed: int) -> tuple[bytes, Any]:
    """Bytes and wire value of a field of a type of the facts."""
    kind = {"U2/I2": "U2", "U2 (10/100-series) or U4 (600-series)": "U2", "char[128]": "ASCII[128]"}.get(kind, kind)
    if kind in _CODES:
        value = seed + 0.5 if kind[0] == "F" else seed * (1 + len(kind)) % 100
        return struct.pack(_CODES[kind], value), value
    if kind.startswith("ASCII"):
        text = f"Label{seed}"
        size = int(kind[6:-1]) if "[" in kind else len(text)
        return text.encode()[:size].ljust(size, b" " if size == 20 else b"\0"), text[:size]
    size = int(kind[6:-1]) if "[" in kind else 5
    raw = bytes((seed + i) % 256 for i in range(size))
    return raw, raw.hex()


def _message_vector(message: dict[str, Any]) -> dict[str, Any]:
    """A vector for one message of the facts."""
    name = message["name"].split(" (")[0]
    rows = [row for row in message["payload"] if not row["name"].endswith("64")]
    if name == "IccCommandAck":
        rows = [row for row in rows if row["name"] != "representative_motion_active"]
    if name.endswith("OutputTypeAck"):
        rows = rows[:1]
    payload, fields = b"", {}
    for seed, row in enumerate(rows, 1):
        if name == "Configuration" and row["name"] == "device_id":
            seed = 1  # repeated from the start, as devices do; it distinguishes the two forms
        raw, value = _sample(row["type"], seed) if row["type"][:6] != "repeat" else (b"", None)
        payload += raw
        if value is not None:
            fields["words" if row["name"] == "word[i]" else row["name"]] = value
    if "words" in fields:
        payload, fields = payload * 3, {"words": [fields["words"]] * 3}
    if name in _LISTS:
        payload, fields = payload * 2, {_LISTS[name]: [fields, fields]}
    if message["kind"] == "reserved" or name in ("MTData", "EmtsData", "SetStealthMode", "UpdateFilterProfile"):
        payload, fields = b"\x01\x02", {"data": "0102"}
    return {"message": name, "fields": fields, "message_hex": build(message["mid"], payload).hex().upper()}


_MORE = [  # forms that the facts describe in words only
    ("InitBus", 0x02, "", {}),
    ("InitBusResults", 0x03, "0102", {"data": "0102"}),
    ("ReqOutputModeAck", 0xD1, "0006", {"mode": 6}),
    ("SetOutputMode", 0xD0, "0006", {"mode": 6}),
    ("ReqOutputSettingsAck", 0xD3, "00000001", {"settings": 1}),
    ("SetOutputSettings", 0xD2, "00000001", {"settings": 1}),
    ("ReqStringOutputTypeAck", 0x8F, "000004000064", {"string_types": 1024, "frequency": 100}),
    ("IccCommandAck", 0x75, "00", {"command": 0}),
    ("Error", 0x42, "280102", {"code": 40, "extra": "0102"}),
    ("GnssReceiverSettingsAck", 0xAD, "0102", {"data": "0102"}),
    (
        "SetGnssReceiverSettings",
        0xAC,
        "00010002000400000008",
        {"type": 1, "baudrate": 2, "input_rate": 4, "options": 8},
    ),
]


def _item_vectors() -> list[dict[str, Any]]:
    """Every identifier in every precision, as the oracle's own types have it."""
    vectors = []
    for base, (name, count) in REAL.items():
        for precision, (scale, code, size) in enumerate(((1, ">f", 4), (2**20, ">i", 4), (2**32, "", 6), (1, ">d", 8))):
            values = [0.25 * (i + 1) * (-1) ** i for i in range(count)]
            raw = b""
            for value in values:
                if size == 6:
                    whole = int(value * scale).to_bytes(6, "big", signed=True)
                    raw += whole[2:] + whole[:2]
                else:
                    raw += struct.pack(code, int(value * scale) if scale > 1 else value)
            payload = (base | precision).to_bytes(2, "big") + bytes([len(raw)]) + raw
            vectors.append({"xdi": base | precision, "values": {name: values}, "payload": payload})
    for base, (name, form) in FIXED.items():
        count = len(struct.unpack(form, bytes(struct.calcsize(form))))
        numbers_ = [(i + 1) * 3 for i in range(count)]
        raw = struct.pack(form, *numbers_)
        payload = base.to_bytes(2, "big") + bytes([len(raw)]) + raw
        vectors.append({"xdi": base, "values": {name: numbers_}, "payload": payload})
    for base, name, raw in ((0xA080, "RawBlob", b"\x01\x02"), (0x7020, "GnssSatInfo", bytes(range(16)))):
        payload = base.to_bytes(2, "big") + bytes([len(raw)]) + raw
        values = list(raw) if base == 0xA080 else [*struct.unpack(">IBBBB", raw[:8]), *raw[8:]]
        vectors.append({"xdi": base, "values": {name: values}, "payload": payload})
    return vectors


def computed(facts: dict[str, Any]) -> dict[str, Any]:
    """All computed vectors."""
    by_hand = {"MTData2", *(name for name, *_ in _MORE)}
    messages = [
        _message_vector(message)
        for message in facts["messages"]
        if message["payload"] or message["name"].split(" (")[0] not in by_hand
    ]
    messages = [message for message in messages if message["message"] != "MTData2"]
    messages += [
        {"message": name, "fields": fields, "message_hex": build(mid, bytes.fromhex(payload)).hex().upper()}
        for name, mid, payload, fields in _MORE
    ]
    items = [
        {
            "xdi": f"0x{one['xdi']:04X}",
            "values": one["values"],
            "message_hex": build(0x36, one["payload"]).hex().upper(),
        }
        for one in _item_vectors()
    ]
    return {"source": "computed", "messages": messages, "items": items}


if __name__ == "__main__":
    target = Path(__file__).parents[1] / "golden" / "xbus" / "computed.json"
    content = computed(json.loads(Path(sys.argv[1]).read_text()))
    body = ",\n".join(json.dumps(row) for row in content["messages"])
    rest = ",\n".join(json.dumps(row) for row in content["items"])
    target.write_text(f'{{"source": "computed",\n"messages": [\n{body}\n],\n"items": [\n{rest}\n]}}\n')
