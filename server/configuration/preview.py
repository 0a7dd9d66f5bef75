"""Preview of a change: the frames to send, byte by byte, the problems and the load on the link.

    values ──> problems, each at its field            one of them: no frame
           ──> frames, each divided into named spans
           ──> load: bytes/s of all outputs after the change, against the capacity at the baud rate after the change
           ──> line: how the change could cut the line

Nothing is sent. Present values of the device (as far as they have been read) complete the change.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from imuscope.protocols.commands.transactions import DeviceContext, DeviceDriver, LinkLoad, OutputLoad, Values
from imuscope.protocols.schema.fields import Setting
from imuscope.protocols.schema.layouts import EncodeError
from imuscope.server.configuration.api_models import (
    FieldProblem,
    FitRatesResult,
    FrameInfo,
    LoadInfo,
    PreviewResult,
)
from imuscope.server.configuration.risks import dangers_of_write
from imuscope.server.configuration.settings_diff import ComparedValues, compare
from imuscope.server.configuration.value_checks import problems_of, sentence, without_current_values
from imuscope.server.configuration.value_format import numbers
from imuscope.server.wire.codec import to_json_safe

MAX_FRAMES = 32


@dataclass(frozen=True, slots=True)
class SerialLine:
    """Load and capacity of the link of a device.

    Args:
        baud: present rate; None if the link has no rate.
        capacity: bytes/s at that rate; None if it is not known.
        measured: present bytes/s.
        other_devices: title and bytes/s of other devices that share the link, as far as their settings have been read.
    """

    baud: int | None = None
    capacity: float | None = None
    measured: float | None = None
    other_devices: Sequence[tuple[str, float]] = ()

    def rate_at(self, baud: int | None) -> float | None:
        """Bytes/s at another baud rate, with the same number of bits per byte."""
        if baud is None or self.baud is None or self.capacity is None:
            return self.capacity
        return self.capacity * baud / self.baud


@dataclass(frozen=True, slots=True)
class DevicePresentState:
    """Known state of a device and its link, for a preview.

    Args:
        values: its settings, as far as they have been read.
    """

    driver: DeviceDriver
    known: DeviceContext
    line: SerialLine = SerialLine()
    values: Mapping[str, Values] = field(default_factory=dict)

    def setting(self, name: str) -> Setting:
        """The row of a setting; KeyError if the device does not have it."""
        return {row.name: row for row in self.driver.settings(self.known)}[name]

    def setting_of(self, command: str) -> Setting | None:
        """The setting that a command writes, if its arguments are fields of the setting."""
        row = next((row for row in self.driver.commands(self.known) if row.name == command), None)
        names = {one.name for one in row.arguments} if row is not None else set()
        for setting in self.driver.settings(self.known):
            if names and setting.write == command and names <= {one.name for one in setting.fields}:
                return setting
        return None

    def written_by(self, command: str, values: Mapping[str, Any]) -> Setting | None:
        """The setting as a change of which a command with these values is carried out."""
        for row in self.driver.settings(self.known):
            names = {one.name for one in row.fields if not one.read_only}
            if row.write == command and values and (set(values) <= names if row.partial else set(values) == names):
                return row
        return None


def preview_setting(present: DevicePresentState, name: str, values: Mapping[str, Any]) -> PreviewResult:
    """Frames that would write these values; KeyError for an unknown setting."""
    row, driver, known = present.setting(name), present.driver, present.known
    values = numbers(row.fields, values)
    problems = problems_of(row.fields, values, partial=row.partial)
    left = without_current_values(problems, values, present.values.get(name, {}))
    held, problems = len(left) < len(problems), left  # present values may stay, whatever the tables allow
    frames: list[bytes] = []
    if not problems:
        try:
            frames = driver.setting_frames(name, values, known, held=held, old=present.values.get(name))
        except EncodeError as error:
            problems = [FieldProblem(error.path, sentence(error))]
    if problems:
        return PreviewResult(frames=[], problems=problems)
    change = driver.line_change(name, present.values.get(name), values, known)
    old = present.values.get(name)
    risks = dangers_of_write(driver, replace(row, caution=""), old, values, known) if old is not None else []
    merged = {**present.values, name: {**present.values.get(name, {}), **values}}
    is_same = old is not None and not driver.same(name, {key: old.get(key) for key in values}, values)
    if frames and row.after == "reset" and not is_same:
        frames += driver.restart_frames(merged, known)
    baud = change.baud if change is not None and change.baud is not None else present.line.baud
    return PreviewResult(
        frames=[frame_info(driver, frame) for frame in frames[:MAX_FRAMES]],
        problems=[],
        load=load_of(present, merged, baud),
        line=change.words if change is not None else "",
        risks=[] if change is not None else list(dict.fromkeys(one.consequence for one in risks)),
    )


def preview_command(present: DevicePresentState, name: str, values: Mapping[str, Any]) -> PreviewResult:
    """Frames that a command would send; KeyError for an unknown command."""
    row = {one.name: one for one in present.driver.commands(present.known)}[name]
    values = numbers(row.arguments, values)
    setting = present.setting_of(name)
    held = present.values.get(setting.name, {}) if setting is not None else {}
    problems = without_current_values(problems_of(row.arguments, values), values, held)
    if not problems and (other := present.driver.instead(name, values, present.values, present.known)) and other[1]:
        now = present.values.get(other[0], {})
        partial = present.setting(other[0]).partial
        new = {key: value for key, value in other[1].items() if not partial or key not in now or now[key] != value}
        return preview_setting(present, other[0], new)
    if not problems and (written := present.written_by(name, values)) is not None:
        return preview_setting(present, written.name, values)
    frames: list[bytes] = []
    try:
        frames = [] if problems else present.driver.command_frames(name, values, present.known)
    except EncodeError as error:
        problems = [FieldProblem(error.path, sentence(error))]
    return PreviewResult(frames=[frame_info(present.driver, frame) for frame in frames], problems=problems)


def frame_info(driver: DeviceDriver, frame: bytes) -> FrameInfo:
    """A frame with the meaning of each byte."""
    spans = driver.annotate(frame)
    return FrameInfo(driver.name_of(frame), frame.hex(), spans)


def load_of(present: DevicePresentState, values: Mapping[str, Values], baud: int | None) -> LoadInfo | None:
    """Load that these settings put on the link; None if they are not known well enough.

    Outputs that were not read are unknown, not empty.
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


def fit(present: DevicePresentState, name: str, values: Mapping[str, Any], baud: int | None) -> FitRatesResult:
    """The same outputs with rates that the line can carry.

    Raises:
        KeyError: unknown setting.
        EncodeError: the values are invalid.
        ValueError: the link's capacity is not known.
    """
    row = present.setting(name)
    values = numbers(row.fields, values)
    problems = problems_of(row.fields, values, partial=True)
    if problems:
        raise EncodeError(problems[0].message.rstrip("."), problems[0].path)
    rate = baud if baud is not None else present.line.baud
    capacity = present.line.rate_at(rate)
    if capacity is None:
        raise ValueError("This link has no baud rate to fit.")
    before = {**present.values, name: {**present.values.get(name, {}), **values}}
    left = max(capacity - sum(sent for _, sent in present.line.other_devices), 0.0)
    after = {**before, **present.driver.fit_rates(before, left, present.known)}
    load = present.driver.load(after, present.known)
    words = _lowered(present, row, before[name], after[name])
    return FitRatesResult(to_json_safe(after[name]), _info(load, present.line, rate), words)


def _lowered(present: DevicePresentState, row: Setting, before: Values, after: Values) -> list[str]:
    """Rates that a fit lowered, as text: "Acceleration 400 Hz → 100 Hz"."""
    sides = ComparedValues("", {row.name: before}), ComparedValues("", {row.name: after})
    rows = compare(present.driver, present.known, *sides).rows
    return [f"{one.title} {one.left or 'off'} → {one.right or 'off'}" for one in rows]


def _info(load: LinkLoad, line: SerialLine, baud: int | None) -> LoadInfo:
    parts = [*load.parts, *(OutputLoad("", title, sent) for title, sent in line.other_devices)]
    total = load.total + sum(sent for _, sent in line.other_devices)
    return LoadInfo(parts, total, line.rate_at(baud), baud, list(load.limits), line.measured)
