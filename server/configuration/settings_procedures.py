"""Steps of jobs: transactions over several settings, as generators without I/O like the transactions they consist of.

    read_settings  identify; read every setting (or the given ones), with the reason if one could not be read
    write_all      write several settings, one after the other, each read back
    changed_words  changes as text
    outcomes       values that were refused or differ from the request (devices round rates)

If a device stops answering, reading ends after `SILENT_LIMIT` settings without an answer; the rest is reported as not
read. Writing ends with the first setting after which the device is not in the state any more in which it is written:
after a power cut it measures.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from imuscope.protocols.commands.transactions import (
    DeviceContext,
    DeviceDriver,
    DeviceRejectedError,
    DeviceRestartedError,
    NoReplyError,
    Transaction,
    Values,
    WriteResult,
)
from imuscope.protocols.schema.fields import Setting
from imuscope.protocols.schema.layouts import EncodeError
from imuscope.server.configuration.value_format import field_at, record_at, title_at, value_at, words
from imuscope.server.wire import FieldOutcome

SILENT_LIMIT = 3
NOT_READ = "not read: the device had stopped answering"
Report = Callable[[str], None]


@dataclass(slots=True)
class SettingsSnapshot:
    """Values read from a device.

    Args:
        missing: setting → why it could not be read.
    """

    known: DeviceContext
    values: dict[str, Values] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)


def read_settings(
    driver: DeviceDriver, known: DeviceContext, names: Sequence[str] | None, report: Report
) -> Transaction[SettingsSnapshot]:
    """Identify the device, then read its settings; to be run in the state in which settings are read.

    Args:
        names: settings to read; None for all.
        report: called with a text for each step.

    Raises:
        NoReplyError: the device does not answer at all, or has restarted.
    """
    report("Identifying the device")
    with suppress(DeviceRejectedError):  # keep the known part
        known = yield from driver.identify(known)
    snapshot = SettingsSnapshot(known)
    silent = 0
    for row in driver.settings(known):
        if not row.read and not row.write:
            continue
        if names is not None and row.name not in names:
            continue
        if silent >= SILENT_LIMIT:
            snapshot.missing[row.name] = NOT_READ
            continue
        report(f"Reading {row.title or row.name}")
        try:
            snapshot.values[row.name] = yield from driver.read(row.name, known)
            silent = 0
        except DeviceRejectedError as error:
            snapshot.missing[row.name] = error.why
            silent = 0
        except DeviceRestartedError:
            raise
        except NoReplyError as error:
            if not snapshot.values and silent + 1 >= SILENT_LIMIT:
                raise
            snapshot.missing[row.name] = "no answer"
            silent += 1
            report(str(error))
    return snapshot


def write_all(
    driver: DeviceDriver,
    known: DeviceContext,
    changes: Mapping[str, Values],
    report: Report,
    held: Collection[str] = (),
) -> Transaction[list[WriteResult]]:
    """Write settings. The result also contains refused ones, those without an answer, and those that cannot be sent.

    Args:
        held: settings whose values the device reported itself; they are sent unchecked (Driver.write).
    """
    done: list[WriteResult] = []
    takes_writes = True
    titles = {row.name: row.title or row.name for row in driver.settings(known)}
    for name, values in changes.items():
        if not takes_writes:
            done.append(WriteResult(name, values, None, ""))
            continue
        report(f"Writing {titles.get(name, name)}")
        try:
            done.append((yield from driver.write(name, values, known, held=name in held)))
        except EncodeError as error:
            done.append(WriteResult(name, values, None, f"not sent: {error}"))
        except NoReplyError as error:
            done.append(WriteResult(name, values, None, ""))
            report(str(error))
            is_over = isinstance(error, DeviceRestartedError)
            takes_writes = not is_over and (yield from driver.takes_writes(known))
    return done


def minimal_changes(
    driver: DeviceDriver,
    rows: Mapping[str, Setting],
    present: Mapping[str, Values],
    changes: Mapping[str, Mapping[str, Any]],
) -> dict[str, dict[str, Any]]:
    """Changes to write: complete settings, single fields of `partial` ones, nothing that already has the value."""
    result: dict[str, dict[str, Any]] = {}
    for name, values in changes.items():
        row, old = rows[name], present.get(name)
        read_only = {one.name for one in row.fields if one.read_only}
        new = {key: value for key, value in values.items() if key not in read_only}
        if old is None:
            result[name] = new
            continue
        if row.partial:
            new = {key: value for key, value in new.items() if key not in old or _differ(driver, name, key, old, new)}
        else:
            new = {key: value for key, value in old.items() if key not in read_only} | new
        if new and driver.same(name, {key: old.get(key) for key in new}, new):
            result[name] = new
    return result


def changed_elsewhere(
    driver: DeviceDriver,
    rows: Mapping[str, Setting],
    present: Mapping[str, Values],
    base: Mapping[str, Mapping[str, Any]] | None,
    todo: Mapping[str, Mapping[str, Any]],
) -> str:
    """The title of the first setting to write that has changed since the edit was made; "" for none.

    Args:
        base: settings at that time; settings not in it are not compared.
    """
    for name in todo:
        before, now = (base or {}).get(name), present.get(name)
        if before is None or now is None:
            continue
        read_only = {one.name for one in rows[name].fields if one.read_only}
        keys = [key for key in (todo[name] if rows[name].partial else before) if key in before and key not in read_only]
        if driver.same(name, {key: before[key] for key in keys}, {key: now.get(key) for key in keys}):
            return rows[name].title or name
    return ""


def _differ(driver: DeviceDriver, setting: str, key: str, old: Values, new: Values) -> bool:
    return bool(driver.same(setting, {key: old[key]}, {key: new[key]}))


def altered(driver: DeviceDriver, known: DeviceContext, written: Collection[str]) -> list[str]:
    """Other settings that change when these are written."""
    rows = {row.name: row for row in driver.settings(known)}
    more = {name for one in written if one in rows for name in driver.alters(rows[one].write, {}, known)}
    return [name for name in rows if name in more and name not in written]


def outcomes(driver: DeviceDriver, rows: Mapping[str, Setting], written: Sequence[WriteResult]) -> list[FieldOutcome]:
    """Each field whose value differs from the request."""
    results: list[FieldOutcome] = []
    for one in written:
        row = rows[one.setting]
        title = row.title or row.name
        if one.refused:
            results.append(FieldOutcome(one.setting, "", title, "", "", one.refused))
            continue
        if one.actual is None:
            results.append(FieldOutcome(one.setting, "", title, "", "", "no answer"))
            continue
        actual = {key: one.actual.get(key) for key in one.requested}
        for path in driver.same(one.setting, one.requested, actual):
            results.append(_outcome(row, path, one.requested, actual))
    return results


def _outcome(row: Setting, path: str, requested: Values, actual: Values) -> FieldOutcome:
    at = field_at(row.fields, path)
    sides = []
    for values in (requested, actual):
        value = value_at(values, path)
        record = record_at(values, path)
        sides.append("" if value is None else words(at, value, record) if at is not None else str(value))
    return FieldOutcome(row.name, path, title_at(row.fields, path), sides[0], sides[1])


def changed_words(row: Setting, paths: Sequence[str], old: Values, new: Values) -> list[str]:
    """List the changes as text, one for each path: "Baud rate 115 200 → 921 600 Bd"."""
    texts = []
    for path in paths:
        at = field_at(row.fields, path)
        sides = [(value_at(values, path), record_at(values, path)) for values in (old, new)]
        left, right = ("—" if v is None else words(at, v, of) if at is not None else str(v) for v, of in sides)
        texts.append(f"{title_at(row.fields, path)} {left} → {right}")
    return texts
