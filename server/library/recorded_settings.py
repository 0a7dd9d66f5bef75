"""Settings of a device at the time of recording, as texts of the Configure page.

    snapshot/<device> of the file   wire values by setting and field       {"OutputConfiguration": {"outputs": [...]}}
    the protocol's tables           titles, units, choices, named bits ──> "Acceleration: 400 Hz", "Altitude: 30 m"

Settings have the order and the groups of Configure. Values that are not in the tables, or do not match them (a file of
another origin or a later version), are shown unchanged, so that no recorded value is missing.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.schema.fields import Field, Setting
from imuscope.server.configuration.controllers import driver_of
from imuscope.server.configuration.form_builder import flat
from imuscope.server.configuration.value_format import (
    entry_comment,
    entry_title,
    entry_value,
    key_of,
    spaced,
    title_at,
    titled,
    words,
)
from imuscope.server.library.api_models import RecordedSetting, RecordedSettings, SettingRow

OTHERS = "Others"
_MAX_LISTED = 40  # elements of a list that are shown one by one


def settings_of(snapshot: Mapping[str, Any]) -> RecordedSettings:
    """A recorded snapshot as texts.

    Args:
        snapshot: as written by server/library/recording_session.py; any other content results in no settings.
    """
    values, missing = _mapping(snapshot.get("values")), _mapping(snapshot.get("missing"))
    protocol, product, firmware = (_text(snapshot.get(name)) for name in ("protocol", "product", "firmware"))
    driver = driver_of(protocol)
    known = DeviceContext(product, _text(snapshot.get("serial_number")), firmware)
    rows = {row.name: row for row in driver.settings(known)} if driver is not None else {}
    order = [name for name in rows if name in values] + [name for name in values if name not in rows]
    settings = [_setting(name, rows.get(name), values[name]) for name in order if isinstance(values[name], Mapping)]
    titles = {name: rows[name].title if name in rows and rows[name].title else spaced(name) for name in missing}
    return RecordedSettings(settings, {titles[name]: _text(why) for name, why in missing.items()})


def _setting(name: str, row: Setting | None, values: Mapping[str, Any]) -> RecordedSetting:
    if row is None:
        return RecordedSetting(name, spaced(name), OTHERS, list(_unchanged(values)))
    try:
        rows = list(_as_text(row, values))
    except (TypeError, ValueError, KeyError, AttributeError, OverflowError):  # values that do not match the table
        rows = list(_unchanged(values))
    return RecordedSetting(name, row.title or spaced(name), row.group, rows)


def _keyed(key: Field, entries: list[Any]) -> Iterator[SettingRow]:
    """A list of records with a key, such as an output configuration: each quantity and its rate."""
    for entry in entries:
        if entry[key.name]:
            yield SettingRow(entry_title(key, int(entry[key.name])), entry_value(entry))


def _as_text(row: Setting, values: Mapping[str, Any]) -> Iterator[SettingRow]:
    alone = len(row.fields) == 1 and not row.fields[0].fields
    for field in row.fields:
        if field.name not in values:
            continue
        value = values[field.name]
        key = key_of(field.fields)
        if field.fields and (key or isinstance(value, list)):
            yield from _keyed(key, value) if key and value else _list(field, value)
            continue
        for path, one, inside in flat((field,), {field.name: value}):
            yield SettingRow("" if alone else titled(title_at(row.fields, path)), words(one, inside))
    known = {field.name for field in row.fields}
    yield from _unchanged({name: value for name, value in values.items() if name not in known})


def _list(field: Field, entries: list[Any]) -> Iterator[SettingRow]:
    title = field.title or spaced(field.name)
    if not entries:
        yield SettingRow(title, "none")
    for place, entry in enumerate(entries[:_MAX_LISTED]):
        texts = [
            f"{titled(title_at(field.fields, path))} {words(one, value)}"
            for path, one, value in flat(field.fields, entry)
        ]
        yield SettingRow(f"{title} {place + 1}", entry_comment(field.fields, entry) or ", ".join(texts))
    if len(entries) > _MAX_LISTED:
        yield SettingRow(title, f"and {len(entries) - _MAX_LISTED} more")


def _unchanged(values: Mapping[str, Any]) -> Iterator[SettingRow]:
    for name, value in values.items():
        yield SettingRow(spaced(str(name)) if len(values) > 1 else "", _plain(value))


def _plain(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{spaced(str(name)).lower()} {_plain(one)}" for name, one in value.items())
    if isinstance(value, list):
        return ", ".join(_plain(one) for one in value[:_MAX_LISTED]) or "none"
    return "none" if value is None else str(value)


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _text(value: Any) -> str:
    return value if isinstance(value, str) else ""
