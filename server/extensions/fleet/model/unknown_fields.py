"""Words and fields of reports of later versions, which this one does not know: kept as text, and counted.

A robot is often newer than its fleet server. Its words (kind of an event, level, state) are shown as they are; so are
fields of the status and of devices, up to MAX_MORE of each. Further fields of events and alarms are ignored.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any, Literal, get_args

from imuscope.server import wire
from imuscope.server.text.printable import json_text, printable

if TYPE_CHECKING:
    from imuscope.server.extensions.fleet.model.reports import RobotReport

AlarmRaisedState = Literal["raised", "acknowledged", "missing"]
MAX_MORE = 16
MAX_TEXT = 100
PARTS = ("kind", "level", "state", "status", "field")
"""Of a report, in which something can be unknown."""
_KNOWN: Mapping[str, frozenset[str]] = {
    "kind": frozenset(get_args(wire.EventKind)),
    "level": frozenset(get_args(wire.Level)),
    "state": frozenset(get_args(AlarmRaisedState)),
    "status": frozenset(get_args(wire.DeviceStatus)),
}


def with_further_fields(more: Mapping[str, str], raw: Mapping[Any, Any], known: Collection[str]) -> dict[str, str]:
    """`more` and the fields of a map that are not known, as text, as many as are kept."""
    if all(name in known for name in raw):
        return dict(more)
    fields = dict(more)
    for name, value in raw.items():
        if isinstance(name, str) and name not in known and len(fields) < MAX_MORE:
            fields[_short(printable(name))] = _text(value)
    return fields


def unknown_parts(report: RobotReport) -> Counter[str]:
    """Number of words and fields of a report that this version does not know, by part."""
    counts: Counter[str] = Counter()
    for event in report.events:
        counts["kind"] += event.kind not in _KNOWN["kind"]
        counts["level"] += event.level not in _KNOWN["level"]
    if report.status is not None:
        counts["field"] += len(report.status.more)
        for alarm in report.status.alarms:
            counts["level"] += alarm.level not in _KNOWN["level"]
            counts["state"] += alarm.state not in _KNOWN["state"]
        for device in report.status.devices:
            counts["status"] += device.status not in _KNOWN["status"]
            counts["field"] += len(device.more)
    return +counts


def _text(value: Any) -> str:
    if isinstance(value, str):
        return _short(printable(value))
    if isinstance(value, float):
        return f"{value:.6g}" if math.isfinite(value) else "—"
    return _short(json_text(value, default=lambda _: "…"))


def _short(text: str) -> str:
    return text if len(text) <= MAX_TEXT else text[: MAX_TEXT - 1] + "…"
