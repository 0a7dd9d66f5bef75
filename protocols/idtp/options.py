"""Decode options of IDTP: a key, the weakest mode, and properties of a device that its frames do not state."""

from collections.abc import Mapping
from typing import Any

from imuscope.protocols.family.decode_options import DecodeOption
from imuscope.protocols.family.info import RejectRemedy
from imuscope.protocols.idtp.custom_payloads import parse, written

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
