"""What would be sent, byte by byte, what is wrong with it, and can the line carry what it asks for?

    values ──> problems, each at its field            one of them: no frame
           ──> frames, each cut into named spans
           ──> load: bytes/s of all outputs as they would be, against the capacity at the rate that would be in effect
           ──> line: how the change could cut the line

Nothing is sent. What the device has now (as far as it has been read) fills in what the change does not say.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from protocols.layouts import EncodeError
from protocols.schema import Setting
from protocols.transactions import DeviceContext, DeviceDriver, LinkLoad, Values
from server.configuration.api_models import (
    FieldProblem,
    FitAnswer,
    FrameInfo,
    LoadInfo,
    PartInfo,
    PreviewAnswer,
    SpanInfo,
)
from server.configuration.checks import problems_of, sentence, unlike
from server.configuration.settings_diff import SideValues, compare
from server.configuration.value_format import numbers
from server.wire_codec import to_json_safe

MOST_FRAMES = 32


@dataclass(frozen=True, slots=True)
class Line:
    """What the link of a device carries.

    Args:
        baud: now; None where it has no rate.
        capacity: bytes/s at that rate; None where it is not known.
        measured: bytes/s now.
        others: what other devices that share it send, title and bytes/s, as far as their settings have been read.
    """

    baud: int | None = None
    capacity: float | None = None
    measured: float | None = None
    others: Sequence[tuple[str, float]] = ()

    def at(self, baud: int | None) -> float | None:
        """Bytes/s at another rate: bits a byte stay as they are."""
        if baud is None or self.baud is None or self.capacity is None:
            return self.capacity
        return self.capacity * baud / self.baud


@dataclass(frozen=True, slots=True)
class DevicePresentState:
    """What is known of a device and its line when something is looked at before it is sent.

    Args:
        values: its settings, as far as they have been read.
    """

    driver: DeviceDriver
    known: DeviceContext
    line: Line = Line()
    values: Mapping[str, Values] = field(default_factory=dict)

    def setting(self, name: str) -> Setting:
        """The row of a setting. KeyError when this device has none of that name."""
        return {row.name: row for row in self.driver.settings(self.known)}[name]

    def kept_by(self, command: str) -> Setting | None:
        """The setting that a command writes, where its arguments are the setting's own fields."""
        row = next((row for row in self.driver.commands(self.known) if row.name == command), None)
        names = {one.name for one in row.arguments} if row is not None else set()
        for kept in self.driver.settings(self.known):
            if names and kept.write == command and names <= {one.name for one in kept.fields}:
                return kept
        return None


def preview_setting(present: DevicePresentState, name: str, values: Mapping[str, Any]) -> PreviewAnswer:
    """What writing these values would send. KeyError when there is no such setting."""
    row, driver, known = present.setting(name), present.driver, present.known
    values = numbers(row.fields, values)
    found = problems_of(row.fields, values, partial=row.partial)
    left = unlike(found, values, present.values.get(name, {}))
    held, found = len(left) < len(found), left  # what the device has may stay, whatever the tables allow
    frames: list[bytes] = []
    if not found:
        try:
            frames = driver.setting_frames(name, values, known, held=held, old=present.values.get(name))
        except EncodeError as error:
            found = [FieldProblem(error.path, sentence(error))]
    if found:
        return PreviewAnswer(frames=[], problems=found)
    change = driver.line_change(name, present.values.get(name), values, known)
    merged = {**present.values, name: {**present.values.get(name, {}), **values}}
    baud = change.baud if change is not None and change.baud is not None else present.line.baud
    return PreviewAnswer(
        frames=[frame_info(driver, frame) for frame in frames[:MOST_FRAMES]],
        problems=[],
        load=load_of(present, merged, baud),
        line=change.words if change is not None else "",
    )


def preview_command(present: DevicePresentState, name: str, values: Mapping[str, Any]) -> PreviewAnswer:
    """What a command would send. KeyError when there is no such command."""
    row = {one.name: one for one in present.driver.commands(present.known)}[name]
    values = numbers(row.arguments, values)
    kept = present.kept_by(name)
    held = present.values.get(kept.name, {}) if kept is not None else {}
    found = unlike(problems_of(row.arguments, values), values, held)
    if not found and (other := present.driver.instead(name, values, present.values, present.known)) and other[1]:
        now = present.values.get(other[0], {})
        partial = present.setting(other[0]).partial
        new = {key: value for key, value in other[1].items() if not partial or key not in now or now[key] != value}
        return preview_setting(present, other[0], new)
    try:
        frame = b"" if found else present.driver.frame(name, values, present.known)
    except EncodeError as error:
        found, frame = [FieldProblem(error.path, sentence(error))], b""
    return PreviewAnswer(frames=[frame_info(present.driver, frame)] if frame else [], problems=found)


def frame_info(driver: DeviceDriver, frame: bytes) -> FrameInfo:
    """A frame with what each of its bytes means."""
    spans = [SpanInfo(span.offset, span.size, span.label, span.path) for span in driver.spans(frame)]
    return FrameInfo(driver.name_of(frame), frame.hex(), spans)


def load_of(present: DevicePresentState, values: Mapping[str, Values], baud: int | None) -> LoadInfo | None:
    """What these settings ask of the line; None where they are not known well enough to tell.

    Outputs that were not read are not none.
    """
    if any(row.editor and row.name not in values for row in present.driver.settings(present.known)):
        return None
    try:
        load = present.driver.load(values, present.known)
    except (KeyError, EncodeError):
        return None
    if not load.parts:
        return None
    return _info(load, present.line, baud)


def fit(present: DevicePresentState, name: str, values: Mapping[str, Any], baud: int | None) -> FitAnswer:
    """The same outputs with rates that the line can carry.

    Raises:
        KeyError: there is no such setting.
        EncodeError: the values cannot be sent at all.
        ValueError: the link's capacity is not known.
    """
    row = present.setting(name)
    values = numbers(row.fields, values)
    found = problems_of(row.fields, values, partial=True)
    if found:
        raise EncodeError(found[0].message.rstrip("."), found[0].path)
    rate = baud if baud is not None else present.line.baud
    capacity = present.line.at(rate)
    if capacity is None:
        raise ValueError("This link has no rate that could be too small.")
    before = {**present.values, name: {**present.values.get(name, {}), **values}}
    left = max(capacity - sum(sent for _, sent in present.line.others), 0.0)
    after = {**before, **present.driver.fit(before, left, present.known)}
    load = present.driver.load(after, present.known)
    words = _lowered(present, row, before[name], after[name])
    return FitAnswer(to_json_safe(after[name]), _info(load, present.line, rate), words)


def _lowered(present: DevicePresentState, row: Setting, before: Values, after: Values) -> list[str]:
    """What a fit changed, in words: "Acceleration 400 Hz → 100 Hz"."""
    sides = SideValues("", {row.name: before}), SideValues("", {row.name: after})
    rows = compare(present.driver, present.known, *sides).rows
    return [f"{one.title} {one.left or 'off'} → {one.right or 'off'}" for one in rows]


def _info(load: LinkLoad, line: Line, baud: int | None) -> LoadInfo:
    parts = [PartInfo(part.path, part.title, part.bytes_per_s) for part in load.parts]
    parts += [PartInfo("", title, sent) for title, sent in line.others]
    total = load.total + sum(sent for _, sent in line.others)
    return LoadInfo(parts, total, line.at(baud), baud, list(load.limits), line.measured)
