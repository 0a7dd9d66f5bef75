"""IDTP as a family: the only object of this folder that other folders use."""

import secrets
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from imuscope.protocols.commands.composer import FrameRecord, ProtocolComposer
from imuscope.protocols.events import Batch
from imuscope.protocols.family.decode_options import DecodeOption
from imuscope.protocols.family.info import (
    ConfigurationTraits,
    Decoding,
    DeviceTraits,
    FamilyHints,
    FrameFormat,
    PageWords,
    PayloadDefinition,
    ProtocolInfo,
    RejectRemedy,
    StreamTraits,
    SupportTable,
)
from imuscope.protocols.idtp.commands import DATA, HEADER, reading_fields
from imuscope.protocols.idtp.custom_payloads import TEMPLATE, parse, written
from imuscope.protocols.idtp.decoder import IdtpDecoder
from imuscope.protocols.idtp.driver import IdtpDriver
from imuscope.protocols.idtp.frames import LITE, SECURE, build, scanner
from imuscope.protocols.idtp.inspect import IdtpFrameLister, detection_score
from imuscope.protocols.idtp.json_codec import frame_from_json
from imuscope.protocols.idtp.messages import MESSAGES, MODE_NAMES, status_name
from imuscope.protocols.schema.fields import Field
from imuscope.protocols.simulator.family import SimulatedDevice, SimulatorInfo, SimulatorOption, SimulatorRequest

MODES = ("lite", "safety", "secure")
FORMAT = """schema file (TOML), describing vendor payload types:
  [[message]]                     type = 0x80, name = "WheelSpeed", doc = "…"; then its fields, in order:
  [[message.field]]               name, type = i8…i64, u8…u64, f32, f64; count, axes, unit, scale, bias, decimals, doc
"""
KEY_AND_UNVERIFIED = (
    "--unverified is for Secure frames without a key, but a key is given (--key or IMUSCOPE_KEY); leave one out"
)


def _key(text: str) -> bytes:
    try:
        key = bytes.fromhex(text)
    except ValueError:
        key = b""
    if not key:
        raise ValueError("a key must be an even number of hex digits, at least two")
    return key


def _schema(text: str) -> Mapping[int, Any]:
    try:
        return parse(text)
    except ValueError as error:
        raise ValueError(f"the schema cannot be used: {error!s:.300}") from None


def _merge(old: str, new: str) -> str:
    """Both schemas in one; a type that is described again has the newer description."""
    return written({**parse(old), **parse(new)})


OPTIONS = (
    DecodeOption(
        "key",
        "secret",
        "key for Secure frames, hexadecimal",
        read=_key,
        write=bytes.hex,
        scopes=frozenset(("source", "inspect", "compose")),
        title="Key for Secure frames of IDTP (hex, optional)",
        early=True,
        pattern=r"(\s*[0-9A-Fa-f]\s*[0-9A-Fa-f])+\s*",
        malformed="The key must consist of hex digits, two per byte.",
        example="00112233445566778899aabbccddeeff",
    ),
    DecodeOption(
        "min_mode",
        "choice",
        "weakest protection mode accepted (default: secure with a key, else lite)",
        tuple((mode, mode.capitalize()) for mode in MODES),
        MODES.index,
        scopes=frozenset(("source", "inspect")),
    ),
    DecodeOption(
        "time_unit",
        "choice",
        "unit of timestamps, if the device does not report it (default: us, unless arrival times disagree)",
        (("us", "Microseconds"), ("ms", "Milliseconds"), ("ns", "Nanoseconds"), ("s", "Seconds")),
        recorded=True,
        table_role="unit",
        title="Timestamp unit",
        unset="Detected from arrival times, usually µs",
    ),
    DecodeOption(
        "rotation",
        "choice",
        "direction of quaternions, if the device does not report it (default: body to ENU)",
        (("enu_from_body", "Body to ENU"), ("body_from_enu", "ENU to body")),
        recorded=True,
        title="Quaternion direction",
        default="enu_from_body",
    ),
    DecodeOption(
        "schema",
        "file",
        "description of vendor payload types, TOML",
        read=_schema,
        write=written,
        scopes=frozenset(("source", "inspect", "compose", "commands")),
        recorded=True,
        merge=_merge,
        details=FORMAT,
    ),
    DecodeOption(
        "unverified",
        "flag",
        "without a key, show Secure frames, marked as unverified",
        keyword="show_unverified",
        scopes=frozenset(("source", "inspect")),
        conflicts={"key": KEY_AND_UNVERIFIED},
    ),
    DecodeOption(
        "no_replay_check",
        "flag",
        "accept frames with any sequence number",
        read=lambda text: False,
        keyword="replay_check",
        scopes=frozenset(("inspect",)),
    ),
)

REMEDIES: Mapping[str, RejectRemedy] = {
    "no_key": RejectRemedy(
        "Secure frames are arriving, but there is no key to check them: they are rejected.",
        "Give the key: --key @FILE, or here.",
        "Give the key: --key @FILE.",
        "a Secure frame, but no key to check it with (--key)",
        needed="key",
    ),
    "bad_hmac": RejectRemedy(
        "Secure frames do not match the key: they are rejected.",
        "Check that it is the key of this device.",
        listed="damaged, forged, or made with another key",
        is_damage=True,
    ),
    "below_min_mode": RejectRemedy(
        "Frames arrive in a weaker mode than this source accepts: they are rejected.",
        "Set the device to a stronger mode, or lower --min-mode if you trust the line.",
        listed="intact, but of a weaker mode than the minimum (--min-mode)",
    ),
}
LISTED = {"stale": "intact, but old: its sequence number has passed (--no-replay-check)"}
UNPROTECTED = (
    "Lite",
    "Set the device to Safety, or to Secure with a key, and --min-mode so that weaker ones are rejected.",
)


_CHECKS = {LITE: "CRC-8 of the header alone"}


def protection(batch: Batch) -> str:
    """Protection of the frames of a batch, by the last of them; "" if unknown (an opaque payload)."""
    if not batch.verified:
        return f"{MODE_NAMES[SECURE]}, unverified: no key"
    status = batch.columns.get(status_name(batch.message.name))
    if status is None or not len(status):
        return ""
    mode = int(status[-1]) & 3
    return f"{MODE_NAMES.get(mode, '')}, {_CHECKS.get(mode, 'verified' if mode == SECURE else 'CRC-32')}"


CHECKS = {0: "CRC-8", 1: "CRC-32", 2: "HMAC-SHA256; requires the device's key"}


def supported() -> Iterator[SupportTable]:
    """Modes, then payload types."""
    yield SupportTable(
        "Modes",
        "Devices of version 2.1, over any link. A key is given with `--key`, `?key=` or on the page.",
        ("mode", "frame protection"),
        tuple((name, CHECKS[number]) for number, name in MODE_NAMES.items()),
    )
    types = tuple((f"`0x{row.id:02X}`", row.name, row.doc.rstrip("."), _quantities(row.fields)) for row in MESSAGES)
    own = ("`0x80` … `0xFF`", "vendor-specific", "User-defined (`--schema` or Define payload)", "any")
    yield SupportTable(
        "Payload types",
        "A type without a definition is shown as bytes.",
        ("type", "name", "contents", "quantities"),
        (*types, own),
    )


def _quantities(fields: tuple[Field, ...]) -> str:
    return ", ".join(
        f"{field.title or field.name} ({field.unit})" if field.unit else field.title or field.name for field in fields
    )


CLOCKS: Mapping[str, int] = {"us": 1_000, "ns": 1, "ms": 1_000_000, "s": 1_000_000_000}
SECURE_BYTES = 56  # a sample's two frames are this much longer in Secure than in Safety mode


def _composer(settings: Mapping[str, Any]) -> ProtocolComposer:
    key, schema = settings.get("key"), settings.get("schema")
    rows = {**{row.name: row for row in MESSAGES}, **{row.name: row for row in (schema or {}).values()}}
    messages = {name: (*HEADER, *reading_fields(row)) for name, row in rows.items()}

    def frame(record: FrameRecord) -> bytes:
        return frame_from_json(record, key, schema)

    return ProtocolComposer("idtp", IdtpDriver(schema), messages, frame, (*HEADER, DATA))


def _make(request: SimulatorRequest) -> Sequence[SimulatedDevice]:
    from imuscope.protocols.idtp.simulator import IdtpSimulator

    mode = request.options["mode"]
    return [
        IdtpSimulator(
            device_id=102 + request.seed % 1000,
            seed=request.seed,
            start_ns=request.start_ns,
            rate=request.rate,
            mode=MODES.index(mode),
            key=(request.settings.get("key") or secrets.token_bytes(32)) if mode == "secure" else None,
            clock_drift_ppm=request.clock_drift_ppm,
            clock_jump=request.clock_jump,
            tick_ns=CLOCKS[request.options["clock"]],
        )
    ]


def _bytes_per_s(rate: float, options: Mapping[str, Any]) -> float:
    sample = 104 + (SECURE_BYTES if options["mode"] == "secure" else 0)
    return rate * sample


def _frame_size(head: bytes) -> int:
    """A header of 20 bytes with SIZE at 14 and MODE at 17, payload, a trailer that depends on the mode."""
    if len(head) < 20:
        return 0
    return 20 + (head[14] | head[15] << 8) + {1: 4, 2: 32}.get(head[17], 0)


SIMULATOR = SimulatorInfo(
    _make,
    _bytes_per_s,
    b"IDTP",
    _frame_size,
    "an IDTP device in Safety mode at 100 Hz",
    options=(
        SimulatorOption("mode", "choice", "safety", MODES),
        SimulatorOption("clock", "choice", "us", tuple(CLOCKS)),
    ),
    usual=True,
    device="an IDTP device",
)


FAMILY = ProtocolInfo(
    "idtp",
    "IDTP 2.1",
    frames=FrameFormat(
        likeness=detection_score,
        listing=IdtpFrameLister,
        sample=build(4, bytes(36), sequence=1, mode=1) + build(6, bytes(16), sequence=3),
        scan=scanner(None, LITE, show_unverified=True),
        frame_size="imuscope.protocols.idtp.client_frames",
        permissive={"show_unverified": True, "replay_check": False},
        rows=lambda: MESSAGES,
        composer=_composer,
    ),
    decoding=Decoding(
        decoder=IdtpDecoder,
        options=OPTIONS,
        payload_definition=PayloadDefinition("schema", TEMPLATE, (("i16", 2), ("u8", 1))),
        protection=protection,
        refusals={
            "bad_version": ("The frames have an unsupported version.", "This program supports IDTP 2."),
            "successor": ("These bytes are INDT, the successor of IDTP.", "INDT is not supported."),
        },
        remedies=REMEDIES,
        listed_rejects=LISTED,
        unprotected=UNPROTECTED,
    ),
    stream=StreamTraits(
        counts=True,
        datagrams=True,
        silence=True,
    ),
    device=DeviceTraits(
        sender="IDTP device",
    ),
    configuration=ConfigurationTraits(
        driver=IdtpDriver(),
    ),
    page=PageWords(
        short="IDTP",
        hints=FamilyHints(attitude="Configure the device to send ImuQuat payloads to show the horizon."),
        supported=supported,
        exempt={
            "settings": "IDTP has no settings.",
            "clients": "IDTP has no settings that a program could change.",
            "utc": "IDTP has no time in UTC.",
            "position": "IDTP has no positions.",
            "sensors": "IDTP does not name products.",
            "logs": "No log format is documented.",
            "corrections": "IDTP has no satellite receivers.",
            "mounting": "IDTP has no settings.",
        },
    ),
    simulator=SIMULATOR,
)
