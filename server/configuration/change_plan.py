"""Check of a change request and its risks, before it becomes a job.

A caution of the tables, or a change that could cut the line, is a Risk with its consequence as text.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from imuscope.protocols.commands.transactions import RequiresState, Risk, Values
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.schema.fields import Command, Setting
from imuscope.protocols.schema.layouts import EncodeError
from imuscope.server.configuration.api_models import FieldProblem
from imuscope.server.configuration.budget import overload_error
from imuscope.server.configuration.device_controller import DeviceController
from imuscope.server.configuration.risks import dangers_of_write
from imuscope.server.configuration.value_checks import problems_of, without_current_values
from imuscope.server.configuration.value_format import numbers
from imuscope.server.errors import DomainError

SHARED = "Other devices share this line; they cannot be received at another baud rate than theirs."
TEMPORARY = "The change is temporary: it is rolled back unless confirmed within {seconds:g} s of the device's answer."
WRONG_HINT = "Correct this value, then apply again; nothing was written."


@dataclass(frozen=True, slots=True)
class ChangeRequest:
    """Request for a change.

    Args:
        risks: risks that need confirmation.
        values: values to write, by setting; for a command, under its name.
        setting: the setting that the command writes; "" for other commands.
        changes: the request writes something.
        restarts: the device restarts, with its stored baud rate.
        current: settings with values that the tables do not allow but the device has, or had once; they are sent
            unchecked.
    """

    title: str
    risks: list[Risk] = field(default_factory=list)
    values: dict[str, dict[str, Any]] = field(default_factory=dict)
    setting: str = ""
    changes: bool = False
    restarts: bool = False
    current: frozenset[str] = frozenset()


def discarded(controller: DeviceController) -> list[Risk]:
    """Unfinished work of an earlier command that this request would discard."""
    return [Risk("loses-settings", words) for words in controller.unfinished.values()]


Past = Callable[[], Iterable[Mapping[str, Values]]]
"""Returns values that the device reported before: those of its snapshots, newest first. Called only if needed."""


def nothing_past() -> Iterable[Mapping[str, Values]]:
    """No snapshots."""
    return ()


def plan_changes(
    controller: DeviceController, changes: Mapping[str, Mapping[str, Any]], past: Past = nothing_past
) -> ChangeRequest:
    """Check settings to write.

    Args:
        past: called if a value is not allowed; it reads files, so do not call this function on the event loop.

    Raises:
        DomainError: unknown or read-only setting, invalid value, or outputs that the line cannot carry.
    """
    rows = controller.rows
    risks: list[Risk] = []
    writes: dict[str, dict[str, Any]] = {}
    reported: set[str] = set()
    for name, fields in changes.items():
        row = rows.get(name)
        if row is None or not row.write:
            problem_text = "has no setting" if row is None else "cannot write the read-only setting"
            raise DomainError(
                "not-found",
                f"{controller.member.info.name} {problem_text} {name!r:.80}.",
                "Leave it out, or choose one of the list of settings.",
            )
        values = writes[name] = numbers(row.fields, fields)
        if _check(controller, row, values, past):
            reported.add(name)
        risks += dangers_of(controller, row, values)
    if (error := overload_error(controller.present, writes)) is not None:
        raise error
    titles = [rows[name].title or name for name in changes]
    title = f"Write {titles[0]}" if len(titles) == 1 else f"Write {len(titles)} settings"
    return ChangeRequest(title, risks + discarded(controller), writes, changes=True, current=frozenset(reported))


def _check(controller: DeviceController, row: Setting, values: Mapping[str, Any], past: Past) -> bool:
    """Check values against the tables, except values that the device has or had; True if there are such values."""
    fields = [one for one in row.fields if not one.read_only]
    names = {one.name for one in fields}
    writable = {name: value for name, value in values.items() if name in names or name not in _read_only_fields(row)}
    whole = not row.partial and row.name not in controller.values
    problems = problems_of(fields, writable, partial=not whole)
    left = problems or _combined_problems(controller, row, writable, None)
    if not left:
        return False
    for values_then in _known_values(controller, past):
        reported = values_then.get(row.name, {})
        if problems:
            left = without_current_values(left, writable, reported)
        else:
            left = _combined_problems(controller, row, writable, reported)
        if not left:
            return True
    raise DomainError("bad-value", f"{row.title or row.name}: {left[0].message}", WRONG_HINT)


def _combined_problems(
    controller: DeviceController, row: Setting, values: Mapping[str, Any], reported: Values | None
) -> list[FieldProblem]:
    """Problems of a combination of values that are allowed individually, beside what the device reported."""
    whole = dict(values) if row.partial else {**controller.values.get(row.name, {}), **values}
    try:
        controller.driver.setting_frames(row.name, whole, controller.context, old=reported)
    except EncodeError as error:
        return [FieldProblem(error.path or next(iter(values), ""), f"{error}.")]
    return []


def _known_values(controller: DeviceController, past: Past) -> Iterator[Mapping[str, Values]]:
    yield controller.values
    yield from past()


def _read_only_fields(row: Setting) -> set[str]:
    return {one.name for one in row.fields if one.read_only}


def dangers_of(controller: DeviceController, row: Setting, values: Mapping[str, Any]) -> list[Risk]:
    """Risks of writing these values of a setting; empty if the device already has them."""
    risks = dangers_of_write(controller.driver, row, controller.values.get(row.name), values, controller.context)
    if controller.member.shares_link and any(one.caution == "cuts-line" for one in risks):
        risks.append(Risk("cuts-line", SHARED))
    return risks


def plan_command(controller: DeviceController, name: str, values: Mapping[str, Any]) -> ChangeRequest:
    """Check a command to run.

    Raises:
        DomainError: unknown command, or invalid value.
    """
    rows = {row.name: row for row in controller.driver.commands(controller.context)}
    row = rows.get(name)
    if row is None:
        raise DomainError(
            "not-found",
            f"{controller.member.info.name} has no command {name!r:.80}.",
            "Choose one of the list of commands.",
        )
    setting_row = controller.present.setting_of(name)
    partial = setting_row is not None and setting_row.partial  # fields that are not given keep their value
    defaults = {} if partial else {one.name: one.default for one in row.arguments if one.default is not None}
    values = {**defaults, **numbers(row.arguments, values)}
    reported = controller.values.get(setting_row.name, {}) if setting_row is not None else {}
    problems = without_current_values(problems_of(row.arguments, values, partial=partial), values, reported)
    if problems:
        raise DomainError("bad-value", f"{row.title or name}: {problems[0].message}", WRONG_HINT)
    if (other := controller.driver.instead(name, values, controller.values, controller.context)) is not None:
        return _instead(controller, row, *other)
    setting = controller.present.written_by(name, values)
    if setting is not None:
        if (error := overload_error(controller.present, {setting.name: values})) is not None:
            raise error
        title = f"Write {setting.title or setting.name}"
        risks = dangers_of(controller, setting, values) + discarded(controller)
        return ChangeRequest(title, risks, {setting.name: dict(values)}, setting.name, True)
    risks = [Risk(row.caution, row.consequence)] if row.is_risky(values) else []
    risks += controller.driver.risks(name, None, values, controller.context)
    try:
        controller.driver.command_frames(name, values, controller.context)
        body = controller.driver.run(name, values, controller.context)
    except EncodeError as error:
        raise DomainError("bad-value", f"{row.title or name}: {error}.", "Nothing was sent.") from None
    if not (isinstance(body, RequiresState) and body.continues):
        risks += discarded(controller)
    changes = row.kind == "set" or row.caution in ("loses-settings", "wears-flash", "moves-frame")
    restarts = row.caution == "restarts"
    return ChangeRequest(row.title or name, risks, {name: dict(values)}, changes=changes, restarts=restarts)


def _instead(controller: DeviceController, row: Command, setting: str, values: Values) -> ChangeRequest:
    """Plan a command that is carried out as a change of a setting, temporary until confirmed if the link could be lost.

    Raises:
        DomainError: the setting was not read yet.
    """
    if not values:
        hint = "Read its settings first."
        raise DomainError("not-read", f"{row.title or row.name} changes {setting}, which has not been read yet.", hint)
    return replace(plan_changes(controller, {setting: values}), title=row.title or row.name, setting=setting)


UNKNOWN_BYTES = "These bytes are not a known message; they may change anything in the device."


def risks_of_bytes(controller: DeviceController, data: bytes) -> list[Risk]:
    """Risks of bytes typed by a user, which name their messages; none of one message that only asks."""
    rows = {row.name: row for row in controller.driver.commands(controller.context)}
    names = _messages_of(controller, data)
    if not names or any(name not in rows for name in names):
        return [Risk("", UNKNOWN_BYTES)]
    commands = [rows[name] for name in names]
    if len(commands) == 1 and commands[0].kind == "ask":
        return []
    return [Risk(row.caution, f"{row.name}: {row.doc or row.title} {row.consequence}".strip()) for row in commands]


def _messages_of(controller: DeviceController, data: bytes) -> list[str]:
    """Commands that bytes consist of; none if a part of them is not a whole message."""
    family = PROTOCOLS[controller.member.info.protocol]
    listing = family.frames.listing(**controller.member.link_session.decode_options.settings(family.name))
    listing.feed(data)
    lines = listing.drain(stalled=True)
    if any("reject" in line for line in lines) or sum(line["size"] for line in lines) != len(data):
        return []
    return [controller.driver.name_of(data[line["offset"] : line["offset"] + line["size"]]) for line in lines]
