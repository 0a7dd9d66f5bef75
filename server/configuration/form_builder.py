"""Forms built from the rows of a protocol's tables.

    Setting ──> SettingForm        Field ──> FieldForm: editor, range, unit
    Command ──> CommandForm        a family's lists of outputs: tables of their own

All information comes from the tables; a new command is a new row there and needs no code here. The editor follows from
the type:

    record, several records          record, list         named numbers         choice
    opaque bytes, text               hex, text            named bits            flags
    several numbers                  vector               0 or 1                bool
    as many as the payload holds     list                 else                  integer, number

64-bit limits are given as the nearest double, the only number type of JSON in a page.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

from imuscope.protocols.commands.rate_tables import RateTable
from imuscope.protocols.commands.transactions import DeviceContext, DeviceDriver, Values
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.schema.fields import Command, Field, Setting
from imuscope.protocols.schema.labels import constant_label
from imuscope.protocols.schema.layouts import is_open
from imuscope.protocols.schema.validation import bounds, is_whole
from imuscope.server.configuration.api_models import (
    CommandForm,
    Editor,
    FieldForm,
    Forms,
    SettingForm,
)
from imuscope.server.configuration.value_format import shown
from imuscope.server.wire import BitsInfo

NOTHING: Mapping[str, Values] = {}


def forms_of(
    driver: DeviceDriver, protocol: str, known: DeviceContext, note: str = "", values: Mapping[str, Values] = NOTHING
) -> Forms:
    """Every setting and command of a device, as forms.

    Args:
        values: its settings, as far as read; they give the rates at which streams that are off are listed.
    """
    settings = list(driver.settings(known))
    commands = list(driver.commands(known))
    groups = dict.fromkeys([*(row.group for row in settings), *(row.group for row in commands)])
    family = PROTOCOLS.get(protocol)
    tables = family.configuration.tables(known, values) if family is not None else {}
    return Forms(
        protocol=protocol,
        product=known.product,
        serial_number=known.serial_number,
        firmware=known.firmware,
        groups=list(groups),
        settings=[setting_form(setting, tables.get(setting.editor)) for setting in settings],
        commands=[command_form(command, _written_by(command, settings)) for command in commands],
        corrections=family is not None
        and family.configuration.corrections is not None
        and family.configuration.corrections.takes(known),
        factory=bool(driver.factory(known)),
        axes=family.device.sensors(known.product).axes if family is not None else "FLU",
        note=note,
    )


def all_forms() -> list[Forms]:
    """The tables of every protocol that has them, as forms: all products together."""
    return [
        forms_of(one.configuration.driver, one.name, DeviceContext())
        for one in PROTOCOLS.values()
        if one.configuration.driver is not None
    ]


def setting_form(setting: Setting, table: RateTable | None = None) -> SettingForm:
    """Form of a setting; `writable` if a command writes it."""
    return SettingForm(
        name=setting.name,
        title=setting.title or setting.name,
        group=setting.group,
        fields=field_forms(setting.fields),
        writable=bool(setting.write),
        partial=setting.partial,
        table=table,
        after=setting.after,
        caution=setting.caution,
        consequence=setting.consequence,
        basic=setting.basic,
        doc=setting.doc,
        source=setting.source,
    )


def command_form(command: Command, writes: str = "") -> CommandForm:
    return CommandForm(
        name=command.name,
        title=command.title or command.name,
        group=command.group,
        kind=command.kind,
        arguments=field_forms(command.arguments),
        reply=command.reply,
        caution=command.caution,
        consequence=command.consequence,
        basic=command.basic,
        doc=command.doc,
        source=command.source,
        harmless={name: list(those) for name, those in command.harmless_values.items()},
        writes=writes,
    )


def _written_by(command: Command, settings: Sequence[Setting]) -> str:
    """The setting that a command writes and whose fields are its arguments; "" for none."""
    names = {argument.name for argument in command.arguments}
    writers = (row.name for row in settings if row.write == command.name and names <= {one.name for one in row.fields})
    return next(writers, "") if names and command.kind == "set" else ""


def field_forms(fields: Iterable[Field]) -> list[FieldForm]:
    """Forms of the fields of a record, in their order."""
    return [field_form(field) for field in fields]


def field_form(field: Field) -> FieldForm:
    """Form of a field, in the unit of its plots."""
    field = shown(field)
    editor = editor_of(field)
    low, high = _range(field)
    return FieldForm(
        name=field.name,
        title=field.title or field.name,
        editor=editor,
        unit=field.unit,
        scale=field.scale,
        bias=field.bias,
        low=low,
        high=high,
        limited=_limited(field),
        step=1.0 if not field.fields and _is_number(field) and is_whole(field) else None,
        default=field.default,
        decimals=field.decimals,
        length=_length(field),
        max_length=field.max_length,
        axes=list(field.axes),
        frame=field.frame,
        choices={str(number): constant_label(meaning) for number, meaning in field.choices.items()},
        bits=_bits(field),
        fields=field_forms(field.fields),
        basic=field.basic,
        read_only=field.read_only,
        base=field.base,
        options=list(field.options),
        listed=field.listed,
        meaning_of=field.meaning_of,
        meanings=field.meanings,
        doc=field.doc,
        source=field.source,
    )


def editor_of(field: Field) -> Editor:
    if field.fields:
        return "list" if field.shape else "record"
    if field.dtype in ("bytes", "ascii"):
        return "hex" if field.dtype == "bytes" else "text"
    if field.shape:
        return "list" if is_open(field) or field.bits or field.choices else "vector"
    if field.choices:
        return "choice"
    if field.bits:
        return "flags"
    if not is_whole(field):
        return "number"
    return "bool" if (field.low, field.high) == (0, 1) else "integer"


def _is_number(field: Field) -> bool:
    return not field.fields and field.dtype not in ("bytes", "ascii")


def _range(field: Field) -> tuple[float | None, float | None]:
    """Allowed wire values; for a float only the limits of the table."""
    if not _is_number(field):
        return None, None
    if not is_whole(field):
        return field.low, field.high
    return bounds(field)


def _limited(field: Field) -> list[Literal["low", "high"]]:
    of_type = _range(replace(field, low=None, high=None))
    sides: tuple[Literal["low", "high"], ...] = ("low", "high")
    return [side for side, limit, free in zip(sides, _range(field), of_type, strict=True) if limit != free]


def _length(field: Field) -> int:
    if is_open(field):
        return 0
    if field.dtype in ("bytes", "ascii") or (field.shape and not field.fields):
        return math.prod(field.shape)
    return field.shape[0] if field.shape else 0


def _bits(field: Field) -> list[BitsInfo]:
    return [
        BitsInfo(
            bits.name,
            bits.low,
            bits.width,
            {str(number): constant_label(meaning) for number, meaning in bits.choices.items()},
            bits.severity,
            bits.normal_set,
            bits.doc,
        )
        for bits in field.bits
    ]


def flat(fields: Sequence[Field], values: Any, at: str = "") -> Iterable[tuple[str, Field, Any]]:
    """Every single value with its path and its field. Records and lists of records are traversed, vectors are not."""
    if not isinstance(values, dict):
        return
    for field in fields:
        if field.name not in values:
            continue
        path, value = f"{at}{field.name}", values[field.name]
        if not field.fields:
            yield path, field, value
        elif isinstance(value, list):
            for place, one in enumerate(value):
                yield from flat(field.fields, one, f"{path}.{place}.")
        else:
            yield from flat(field.fields, value, f"{path}.")
