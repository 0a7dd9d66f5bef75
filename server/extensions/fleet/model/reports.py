"""Reports of robots on the bus: MessagePack, with a limit for every number, text and list.

    report      a map: version, boot, number, time, status, events, dropped
    journal     the answer of a robot to the query of its journal: a map with reports in order of their numbers

docs/fleet.md is the specification. Version 1 can grow: a kind, a level or a state is any short word, and fields of the
status and of devices that this version does not know are kept as text, up to MAX_MORE of each, and counted; further
fields of events and alarms are ignored. A field that is missing has its default. A value of another shape, or beyond a
limit, makes the whole report invalid: `decode_report` raises ReportError and nothing else, for any bytes.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from typing import Annotated, Any, Literal, TypeVar, get_args

import msgspec
from msgspec import Meta
from pydantic import Field

from imuscope.server import wire
from imuscope.server.text.printable import json_text, printable

AlarmRaisedState = Literal["raised", "acknowledged", "missing"]
MAX_MORE = 16
MAX_TEXT = 100
PARTS = ("kind", "level", "state", "status", "field")
"""Parts of a report whose value a later version may add."""
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


VERSION: Literal[1] = 1
MAX_REPORT = 65_536  # bytes
MAX_JOURNAL = 262_144  # bytes of an answer
MAX_DEVICES, MAX_ALARMS, MAX_EVENTS, MAX_REPORTS = 64, 100, 64, 500

Number = Annotated[float, Meta(ge=-1e15, le=1e15)]
Count = Annotated[int, Meta(ge=0, le=2**53 - 1)]
Name = Annotated[str, Meta(max_length=100)]
Word = Annotated[str, Meta(min_length=1, max_length=40)]
"""A word from a list that later versions may extend."""
Further = Annotated[dict[Name, Name], Meta(max_length=MAX_MORE)]
Sentence = Annotated[str, Meta(max_length=500)]
Digest = Annotated[str, Meta(pattern="^([0-9a-f]{32})?$")]
Boot = Annotated[str, Meta(pattern="^[0-9a-f]{16}$")]


class ReportError(ValueError):
    """An invalid report: the reason as one sentence."""


class ReportedAlarm(msgspec.Struct, frozen=True):
    """An active alarm of a robot, as its status reports it."""

    name: Name
    level: Word
    state: Word
    device: Name = ""


@dataclass(frozen=True, slots=True)
class RobotDevice:
    """Identity, rate and comparison with the profile of one device."""

    id: Annotated[Name, Field(description="as on the robot's own page")]
    name: Name
    status: Annotated[Word, Field(description="as DeviceStatus, or another one of a later version")]
    product: Name = ""
    serial_number: Name = ""
    firmware: Name = ""
    protocol: Annotated[Name, Field(description="empty while it is unknown")] = ""
    rate: Annotated[Number, Field(description="samples/s of the fastest message, within 1 %")] = 0.0
    expected_rate: Annotated[
        Number | None, Field(description="samples/s that it is configured for; null if unknown")
    ] = None
    loss: Annotated[
        Annotated[float, Meta(ge=0, le=1)] | None,
        Field(description="share of samples lost in the last minute, 0 … 1; null if unknown"),
    ] = None
    lost: Annotated[Count, Field(description="samples lost since the robot's server was started")] = 0
    fix: Annotated[Name, Field(description="fix of its receiver of satellites, in words; empty if it has none")] = ""
    temperature: Annotated[Number | None, Field(description="°C")] = None
    clock_ppm: Annotated[Number | None, Field(description="its clock against that of its host")] = None
    clock_ppm_uncertainty: Annotated[Number | None, Field(description="± of `clock_ppm`")] = None
    clock_uncertainty_ms: Annotated[
        Number | None, Field(description="± of the mapping from device time to host time")
    ] = None
    settings: Annotated[
        Digest, Field(description="digest of its settings, as last read; empty while they are unknown")
    ] = ""
    settings_read: Annotated[Number | None, Field(description="clock of the robot, unix s: when they were read")] = None
    more: Annotated[Further, Field(description="what a later version reports, by name")] = field(default_factory=dict)


class RobotStatus(msgspec.Struct, frozen=True):
    """Summary of a robot, from its own report.

    Args:
        more: fields of a later version, as text.
    """

    version: Name = ""
    group: Name = ""
    address: Sentence = ""
    latency_ms: Number | None = None
    recording: bool = False
    disk_free_bytes: Count | None = None
    pages: Word = "off"
    alarms: Annotated[tuple[ReportedAlarm, ...], Meta(max_length=MAX_ALARMS)] = ()
    devices: Annotated[tuple[RobotDevice, ...], Meta(max_length=MAX_DEVICES)] = ()
    more: Further = msgspec.field(default_factory=dict)


class RobotEvent(msgspec.Struct, frozen=True):
    """An event of a robot or of a device of it."""

    time: Number
    kind: Word
    level: Word
    text: Sentence
    device: Name = ""


class RobotReport(msgspec.Struct, frozen=True):
    """Changes since the report before.

    Args:
        boot: run of the robot's server; numbers begin at 1 with each.
        number: of this report; without status and events, of the one before.
        time: of the robot's clock, unix s.
        status: None if it is as before.
        dropped: reports of this run that left the journal unread, and events that were too many for a report.
    """

    boot: Boot
    number: Count
    time: Number
    version: Literal[1] = VERSION
    status: RobotStatus | None = None
    events: Annotated[tuple[RobotEvent, ...], Meta(max_length=MAX_EVENTS)] = ()
    dropped: Count = 0

    @property
    def is_empty(self) -> bool:
        """Whether nothing happened."""
        return self.status is None and not self.events


class JournalAnswer(msgspec.Struct, frozen=True):
    """Earlier reports in order of their numbers.

    Args:
        first: number of the oldest report that the robot still has; one more than the newest if it has none.
        last: number of the newest one.
        following: the run after this one, if this one has ended; empty otherwise.
    """

    boot: Boot
    first: Count
    last: Count
    reports: Annotated[tuple[RobotReport, ...], Meta(max_length=MAX_REPORTS)] = ()
    following: Annotated[str, Meta(pattern="^([0-9a-f]{16})?$")] = ""


T = TypeVar("T", RobotReport, JournalAnswer)
_encoder = msgspec.msgpack.Encoder()
_reports = msgspec.msgpack.Decoder(RobotReport)
_journals = msgspec.msgpack.Decoder(JournalAnswer)


def encode(message: RobotReport | JournalAnswer) -> bytes:
    return _encoder.encode(message)


def decode_report(data: bytes) -> RobotReport:
    """The report in these bytes.

    Raises:
        ReportError: it is invalid.
    """
    report = _decoded(data, _reports, MAX_REPORT)
    return report if report.status is None else _with_further(report, _all_fields(data))


def decode_journal(data: bytes) -> JournalAnswer:
    """The answer of a journal in these bytes; its reports are in ascending order and of one run.

    Raises:
        ReportError: it is invalid.
    """
    answer = _decoded(data, _journals, MAX_JOURNAL)
    numbers = [one.number for one in answer.reports]
    if any(b <= a for a, b in pairwise(numbers)):
        raise ReportError("The reports of the journal are not in order.")
    if any(one.boot != answer.boot for one in answer.reports):
        raise ReportError("The reports of the journal are of different runs.")
    raw = _all_fields(data).get("reports", ())
    reports = tuple(_with_further(*pair) for pair in zip(answer.reports, raw, strict=True)) if raw else answer.reports
    return msgspec.structs.replace(answer, reports=reports)


def _decoded(data: bytes, decoder: msgspec.msgpack.Decoder[T], limit: int) -> T:
    if len(data) > limit:
        raise ReportError(f"The message has {len(data)} bytes; at most {limit} are allowed.")
    try:
        message = decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ReportError(f"The message is not valid: {error!s:.200}.") from None
    for report in (message,) if isinstance(message, RobotReport) else message.reports:
        _check_finite(report)
    return message


def _all_fields(data: bytes) -> Any:
    """A valid message with the fields that this version skips; an empty map if those cannot be read."""
    try:
        return msgspec.msgpack.decode(data)
    except (msgspec.DecodeError, ValueError, TypeError, OverflowError, RecursionError):
        return {}


_FIELDS_OF_DEVICE = frozenset(one.name for one in fields(RobotDevice))


def _with_further(report: RobotReport, raw: Any) -> RobotReport:
    """The report, whose status and devices have the fields of later versions as text."""
    status, values = report.status, raw.get("status")
    if status is None or not values:
        return report
    devices = tuple(
        replace(one, more=with_further_fields(one.more, device, _FIELDS_OF_DEVICE))
        for one, device in zip(status.devices, values.get("devices") or (), strict=True)
    )
    more = with_further_fields(status.more, values, RobotStatus.__struct_fields__)
    return msgspec.structs.replace(report, status=msgspec.structs.replace(status, devices=devices, more=more))


def _check_finite(report: RobotReport) -> None:
    """Raise ReportError for a number that is not finite, which a comparison with limits lets through."""
    numbers: list[Any] = [report.time, *(event.time for event in report.events)]
    if report.status is not None:
        numbers.append(report.status.latency_ms)
        for one in report.status.devices:
            figures: Sequence[Any] = (one.rate, one.expected_rate, one.loss, one.temperature, one.settings_read)
            numbers += (*figures, one.clock_ppm, one.clock_ppm_uncertainty, one.clock_uncertainty_ms)
    if not all(math.isfinite(one) for one in numbers if one is not None):
        raise ReportError("The message has a number that is not finite.")
