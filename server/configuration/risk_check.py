"""What does a person's wish mean, and what could it harm? Asked before it becomes a job.

A caution of the tables, or a change that could cut the line, is a Risk with its consequence in words; flash that
wears a little with each write is told in the form and not asked about.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from protocols.layouts import EncodeError
from protocols.schema import Command, Setting
from protocols.transactions import RequiresState, Values
from server.api.errors import ApiError
from server.configuration.api_models import FieldProblem
from server.configuration.budget import OVER_HINT, overload
from server.configuration.checks import problems_of, unlike
from server.configuration.dangers import UNASKED, Risk, dangers_of_write
from server.configuration.device_controller import DeviceController
from server.configuration.value_format import head_of, numbers
from server.devices.member import shares

SHARED = "Other devices share this line: at another rate than theirs they are not heard."
WRONG_HINT = "Correct this value, then apply again; nothing was written."


@dataclass(frozen=True, slots=True)
class ChangeRequest:
    """What is to be done.

    Args:
        dangers: what has to be confirmed.
        values: what is to be written, by setting; of a command, under its name.
        setting: a command that writes this setting; "" for another.
        changes: it writes something.
        restarts: the device restarts, and speaks at the rate that it has stored.
        held: settings with values that the tables do not allow but the device has, or had once: they go back unchecked.
    """

    title: str
    dangers: list[Risk] = field(default_factory=list)
    values: dict[str, dict[str, Any]] = field(default_factory=dict)
    setting: str = ""
    changes: bool = False
    restarts: bool = False
    held: frozenset[str] = frozenset()


def discarded(desk: DeviceController) -> list[Risk]:
    """What a command left unfinished, and what is done now would throw away."""
    return [Risk("loses-settings", words) for words in desk.unfinished.values()]


Past = Callable[[], Iterable[Mapping[str, Values]]]
"""What the device told of itself before: the values of its snapshots, newest first. Asked only where it matters."""


def nothing_past() -> Iterable[Mapping[str, Values]]:
    """No snapshots."""
    return ()


def plan_changes(
    desk: DeviceController, changes: Mapping[str, Mapping[str, Any]], past: Past = nothing_past
) -> ChangeRequest:
    """Settings to write.

    Args:
        past: reads files, where a value is not allowed: then this is not for the event loop.
    Raises:
        ApiError: a setting that there is not or that cannot be written, a value that cannot be sent, or outputs that
            the line cannot carry.
    """
    rows = desk.rows
    dangers: list[Risk] = []
    wanted: dict[str, dict[str, Any]] = {}
    held: set[str] = set()
    for name, given in changes.items():
        row = rows.get(name)
        if row is None or not row.write:
            what = "has no setting" if row is None else "tells, and does not take,"
            raise ApiError(
                404,
                "not-found",
                f"{desk.session.info.name} {what} {name!r:.80}.",
                "Leave it out, or choose one of the list of settings.",
            )
        values = wanted[name] = numbers(row.fields, given)
        if _check(desk, row, values, past):
            held.add(name)
        dangers += dangers_of(desk, row, values)
    why = overload(desk.present, wanted)
    if why:
        raise ApiError(422, "too-much", why, OVER_HINT)
    titles = [rows[name].title or name for name in changes]
    title = f"Write {titles[0]}" if len(titles) == 1 else f"Write {len(titles)} settings"
    return ChangeRequest(title, dangers + discarded(desk), wanted, changes=True, held=frozenset(held))


def _check(desk: DeviceController, row: Setting, values: Mapping[str, Any], past: Past) -> bool:
    """Whether values are among them that the tables do not allow, and the device has, or had once."""
    fields = [one for one in row.fields if not one.read_only]
    names = {one.name for one in fields}
    given = {name: value for name, value in values.items() if name in names or name not in _told(row)}
    whole = not row.partial and row.name not in desk.values
    found = problems_of(fields, given, partial=not whole) or _beyond(desk, row, given)
    if not found:
        return False
    left = {head_of(problem.path, given)[0]: problem for problem in reversed(found)}
    for there in _pasts(desk, past):
        left = {name: one for name, one in left.items() if there.get(row.name, {}).get(name, desk) != given.get(name)}
        if not left:
            return True
    first = next(problem for problem in found if problem in left.values())
    raise ApiError(422, "bad-value", f"{row.title or row.name}: {first.message}", WRONG_HINT)


def _beyond(desk: DeviceController, row: Setting, values: Mapping[str, Any]) -> list[FieldProblem]:
    """What is wrong with values together, where each alone is allowed."""
    whole = dict(values) if row.partial else {**desk.values.get(row.name, {}), **values}
    try:
        desk.driver.setting_frames(row.name, whole, desk.known)
    except EncodeError as error:
        return [FieldProblem(error.path or next(iter(values), ""), f"{error}.")]
    return []


def _pasts(desk: DeviceController, past: Past) -> Iterator[Mapping[str, Values]]:
    yield desk.values
    yield from past()


def _told(row: Setting) -> set[str]:
    return {one.name for one in row.fields if one.read_only}


def dangers_of(desk: DeviceController, row: Setting, values: Mapping[str, Any]) -> list[Risk]:
    """What writing these values of a setting could cost; nothing where the device has them already."""
    found = dangers_of_write(desk.driver, row, desk.values.get(row.name), values, desk.known)
    if shares(desk.session) and any(one.caution == "cuts-line" for one in found):
        found.append(Risk("cuts-line", SHARED))
    return found


def plan_command(desk: DeviceController, name: str, values: Mapping[str, Any]) -> ChangeRequest:
    """A command to run.

    Raises:
        ApiError: there is none of that name, or a value cannot be sent.
    """
    rows = {row.name: row for row in desk.driver.commands(desk.known)}
    row = rows.get(name)
    if row is None:
        raise ApiError(
            404,
            "not-found",
            f"{desk.session.info.name} has no command {name!r:.80}.",
            "Choose one of the list of commands.",
        )
    kept = desk.present.kept_by(name)
    partial = kept is not None and kept.partial  # a field that is not given stays as the device has it
    usual = {} if partial else {one.name: one.default for one in row.arguments if one.default is not None}
    values = {**usual, **numbers(row.arguments, values)}
    held = desk.values.get(kept.name, {}) if kept is not None else {}
    found = unlike(problems_of(row.arguments, values, partial=partial), values, held)
    if found:
        raise ApiError(422, "bad-value", f"{row.title or name}: {found[0].message}", WRONG_HINT)
    if (other := desk.driver.instead(name, values, desk.values, desk.known)) is not None:
        return _instead(desk, row, *other)
    setting = _written_by(desk, name, values)
    if setting is not None:
        why = overload(desk.present, {setting.name: values})
        if why:
            raise ApiError(422, "too-much", why, OVER_HINT)
        title = f"Write {setting.title or setting.name}"
        dangers = dangers_of(desk, setting, values) + discarded(desk)
        return ChangeRequest(title, dangers, {setting.name: dict(values)}, setting.name, True)
    dangers = [Risk(row.caution, row.consequence)] if row.harms(values) and row.caution not in UNASKED else []
    try:
        body = desk.driver.run(name, values, desk.known)
    except EncodeError as error:
        raise ApiError(422, "bad-value", f"{row.title or name}: {error}.", "Nothing was sent.") from None
    if not (isinstance(body, RequiresState) and body.continues):
        dangers += discarded(desk)
    changes = row.kind == "set" or row.caution in ("loses-settings", "wears-flash", "moves-frame")
    restarts = row.caution == "restarts"
    return ChangeRequest(row.title or name, dangers, {name: dict(values)}, changes=changes, restarts=restarts)


def _instead(desk: DeviceController, row: Command, setting: str, values: Values) -> ChangeRequest:
    """A command whose place a setting has: written like any change of it, on trial where the line could be cut.

    Raises:
        ApiError: the setting was not read yet.
    """
    if not values:
        hint = "Read its settings first."
        raise ApiError(409, "not-read", f"{row.title or row.name} changes {setting}, which is not read yet.", hint)
    return replace(plan_changes(desk, {setting: values}), title=row.title or row.name, setting=setting)


def _written_by(desk: DeviceController, command: str, values: Mapping[str, Any]) -> Setting | None:
    """The setting that a command writes, where its arguments are the setting's own fields."""
    for row in desk.driver.settings(desk.known):
        names = {one.name for one in row.fields if not one.read_only}
        if row.write == command and values and (set(values) <= names if row.partial else set(values) == names):
            return row
    return None
