"""Comparison of two values of a setting.

Dependent fields (a checksum) are not compared; streams and sentences are compared by content, not by order; float32 by
their bits. The options of streams and sentences only affect how they are written. One of them counts, and only on the
right side: a request to save (PERSISTENT) that is missing on the left is a difference, so that it is carried out; a
device that does not report it afterwards has not refused it.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

from imuscope.protocols.isb.stored_settings import PERSISTENT, STREAMS_SETTING

Values = Mapping[str, Any]
MEANINGLESS = ("checksum", "options")
SAVED = ("DID_NMEA_BCAST_PERIOD", "DID_GPX_RMC")  # whose options can request saving
CLOSE = 0.1  # share within which two periods are equal


def differences(setting: str, a: Values, b: Values) -> list[str]:
    """Paths of the fields present in both that differ."""
    if setting == STREAMS_SETTING:
        return _streams(a, b) + _to_save(a, b)
    rows = _to_save(a, b) if setting in SAVED else []
    for name in a:
        if name not in b or name in MEANINGLESS:
            continue
        if name == "nmeaBroadcastMsgs":
            rows += [name] * (_sentences(a[name]) != _sentences(b[name]))
        else:
            rows += _differ(name, a[name], b[name])
    return rows


def _streams(a: Values, b: Values) -> list[str]:
    """Streams by data set: missing, new, or with another period. One that was read but not observed matches any."""
    if "streams" not in a or "streams" not in b:
        return []
    other = {one["did"]: one for one in b.get("streams", [])}
    rows = []
    for place, one in enumerate(a.get("streams", [])):
        match = other.get(one["did"])
        if match is None:
            rows.append(f"streams.{place}")
        elif 0 not in (one.get("size"), match.get("size")) and not same_pace(one, match):
            rows.append(f"streams.{place}.period")
    ours = {one["did"] for one in a.get("streams", [])}
    return rows + [f"streams.{place}" for place, one in enumerate(b.get("streams", [])) if one["did"] not in ours]


def same_pace(one: Values, other: Values) -> bool:
    """Whether two rows of a stream mean the same rate: the same multiple, or the same interval, because the source that
    a device uses is not always known.
    """
    if one.get("period", 1) == other.get("period", 1):
        return True
    apart, other_apart = (float(row.get("source_ms") or 0) * (row.get("period") or 1) for row in (one, other))
    return bool(apart and other_apart) and abs(apart - other_apart) <= CLOSE * min(apart, other_apart)


def _to_save(a: Values, b: Values) -> list[str]:
    """Whether the right side requests a save that the left one does not."""
    before, requested = int(a.get("options") or 0), int(b.get("options") or 0)
    return ["options"] if requested & ~before & PERSISTENT else []


def _sentences(pairs: Any) -> dict[int, int]:
    return {one["msgID"]: one["msgPeriod"] for one in pairs if one["msgID"] and one["msgPeriod"]}


def _differ(path: str, a: Any, b: Any) -> list[str]:
    if isinstance(a, list) and isinstance(b, list):
        if len(a) != len(b):
            return [path]
        return [row for place, (x, y) in enumerate(zip(a, b, strict=True)) for row in _differ(f"{path}.{place}", x, y)]
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        shared = [name for name in a if name in b]
        if not shared and a != b:
            return [path]
        return [row for name in shared for row in _differ(f"{path}.{name}", a[name], b[name])]
    if isinstance(a, float) or isinstance(b, float):
        return [] if _f4(a) == _f4(b) else [path]
    return [] if a == b else [path]


def _f4(value: Any) -> Any:
    """A number rounded to float32 if that is the only difference; others unchanged."""
    try:
        return struct.pack("<f", value)
    except (struct.error, OverflowError, TypeError):
        return value
