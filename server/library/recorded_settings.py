"""What was a device set to when it was recorded, in the words in which Configure says it?

    snapshot/<device> of the file   wire values by setting and field       {"OutputConfiguration": {"outputs": [...]}}
    the protocol's tables           titles, units, choices, named bits ──> "Acceleration: 400 Hz", "Altitude: 30 m"

Settings come in the order and the groups of Configure. What the tables do not know, or what does not fit them (the file
is another's, or of a later version), is told as it stands: nothing that was recorded is left out.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from protocols.schema import Field, Setting
from protocols.transactions import DeviceContext
from server.configuration.controllers import driver_of
from server.configuration.form_builder import flat
from server.configuration.value_format import entry_comment, output_title, output_words, title_at, words
from server.library.api_models import RecordedSetting, RecordedSettings, SettingRow

OTHERS = "Others"
_LISTED = 40  # elements of a list that are told one by one


def settings_of(snapshot: Mapping[str, Any]) -> RecordedSettings:
    """A recorded snapshot in words.

    Args:
        snapshot: as server/library/recording_session.py writes it; of a file that says otherwise nothing is told.
    """
    values, missing = _mapping(snapshot.get("values")), _mapping(snapshot.get("missing"))
    protocol, product, firmware = (_text(snapshot.get(name)) for name in ("protocol", "product", "firmware"))
    driver = driver_of(protocol)
    known = DeviceContext(product, _text(snapshot.get("serial_number")), firmware)
    rows = {row.name: row for row in driver.settings(known)} if driver is not None else {}
    order = [name for name in rows if name in values] + [name for name in values if name not in rows]
    found = [_setting(name, rows.get(name), values[name]) for name in order if isinstance(values[name], Mapping)]
    titles = {name: rows[name].title if name in rows and rows[name].title else spaced(name) for name in missing}
    return RecordedSettings(found, {titles[name]: _text(why) for name, why in missing.items()})


def spaced(name: str) -> str:
    """A name of a table for a person: "OutputConfiguration" is "Output configuration"."""
    text = re.sub(r"([a-z])([A-Z])", lambda found: f"{found[1]} {found[2].lower()}", name.replace("_", " "))
    return text[:1].upper() + text[1:]


def _setting(name: str, row: Setting | None, values: Mapping[str, Any]) -> RecordedSetting:
    if row is None:
        return RecordedSetting(name, spaced(name), OTHERS, list(_as_they_stand(values)))
    try:
        rows = list(_outputs(row, values) if row.editor == "outputs" else _in_words(row, values))
    except (TypeError, ValueError, KeyError, AttributeError, OverflowError):  # they are not what the table says
        rows = list(_as_they_stand(values))
    return RecordedSetting(name, row.title or spaced(name), row.group, rows)


def _outputs(row: Setting, values: Mapping[str, Any]) -> Iterator[SettingRow]:
    """The list of an Xsens output configuration: each quantity and its rate."""
    for entry in values[row.fields[0].name]:
        if entry["data_identifier"]:
            yield SettingRow(output_title(int(entry["data_identifier"])), output_words(entry))


def _in_words(row: Setting, values: Mapping[str, Any]) -> Iterator[SettingRow]:
    alone = len(row.fields) == 1 and not row.fields[0].fields
    for field in row.fields:
        if field.name not in values:
            continue
        value = values[field.name]
        if field.fields and isinstance(value, list):
            yield from _list(field, value)
            continue
        for path, one, inside in flat((field,), {field.name: value}):
            yield SettingRow("" if alone else _titled(title_at(row.fields, path)), words(one, inside))
    known = {field.name for field in row.fields}
    yield from _as_they_stand({name: value for name, value in values.items() if name not in known})


def _titled(title: str) -> str:
    """A title; where the table gives none it is a name, of which short ones ("q0") are symbols."""
    return spaced(title) if len(title) > 2 and (title[0].islower() or "_" in title) else title


def _list(field: Field, entries: list[Any]) -> Iterator[SettingRow]:
    title = field.title or spaced(field.name)
    if not entries:
        yield SettingRow(title, "none")
    for place, entry in enumerate(entries[:_LISTED]):
        told = [
            f"{_titled(title_at(field.fields, path))} {words(one, value)}"
            for path, one, value in flat(field.fields, entry)
        ]
        yield SettingRow(f"{title} {place + 1}", entry_comment(field.fields, entry) or ", ".join(told))
    if len(entries) > _LISTED:
        yield SettingRow(title, f"and {len(entries) - _LISTED} more")


def _as_they_stand(values: Mapping[str, Any]) -> Iterator[SettingRow]:
    for name, value in values.items():
        yield SettingRow(spaced(str(name)) if len(values) > 1 else "", _plain(value))


def _plain(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{spaced(str(name)).lower()} {_plain(one)}" for name, one in value.items())
    if isinstance(value, list):
        return ", ".join(_plain(one) for one in value[:_LISTED]) or "none"
    return "none" if value is None else str(value)


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _text(value: Any) -> str:
    return value if isinstance(value, str) else ""
