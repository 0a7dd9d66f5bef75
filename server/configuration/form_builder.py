"""How does a row of a protocol's table become a form?

    Setting ──> SettingForm        Field ──> FieldForm: which editor, which range, in which unit
    Command ──> CommandForm        Output, Stream ──> OutputChoice, StreamChoice: the lists with editors of their own

Nothing is decided here that a table does not say; a new command is a new row there and needs no line here. The editor
follows from the type:

    record, several records          record, list         named numbers         choice
    opaque bytes, text               hex, text            named bits            flags
    several numbers                  vector               0 or 1                bool
    as many as the payload holds     list                 else                  integer, number

64-bit limits are told as the nearest double, which is all that JSON has for a page.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from protocols.labels import spoken
from protocols.layouts import is_open
from protocols.schema import Command, Field, Setting
from protocols.transactions import DeviceContext, DeviceDriver, Values
from protocols.validation import bounds, is_whole
from server.configuration.api_models import (
    CommandForm,
    Editor,
    FieldForm,
    Forms,
    OutputChoice,
    SettingForm,
    StreamChoice,
)
from server.wire import BitsInfo

NOTHING: Mapping[str, Values] = {}
FORWARDS = "ForwardGnssData"  # an MTi that has this command takes RTCM; any Inertial Sense device does
_PRECISIONS, _COORDINATES = [0, 1, 2, 3], [0, 4, 8]


def forms_of(
    driver: DeviceDriver, protocol: str, known: DeviceContext, note: str = "", values: Mapping[str, Values] = NOTHING
) -> Forms:
    """Every setting and command of a device, as forms.

    Args:
        values: its settings, as far as they have been read: streams that are off are told at its own rates.
    """
    settings = list(driver.settings(known))
    commands = list(driver.commands(known))
    groups = dict.fromkeys([*(row.group for row in settings), *(row.group for row in commands)])
    editors = {setting.editor for setting in settings}
    return Forms(
        protocol=protocol,
        product=known.product,
        serial_number=known.serial_number,
        firmware=known.firmware,
        groups=list(groups),
        settings=[setting_form(setting) for setting in settings],
        commands=[command_form(command, _written_by(command, settings)) for command in commands],
        outputs=output_choices(known, values) if "outputs" in editors else [],
        streams=stream_choices(known, values) if "streams" in editors else [],
        corrections=protocol == "isb" or (bool(known.product) and any(row.name == FORWARDS for row in commands)),
        factory=bool(driver.factory(known)),
        note=note,
    )


def setting_form(setting: Setting) -> SettingForm:
    """One setting; `writable` where a command writes it."""
    return SettingForm(
        name=setting.name,
        title=setting.title or setting.name,
        group=setting.group,
        fields=field_forms(setting.fields),
        writable=bool(setting.write),
        partial=setting.partial,
        editor=setting.editor,
        after=setting.after,
        caution=setting.caution,
        consequence=setting.consequence,
        simple=setting.simple,
        doc=setting.doc,
        source=setting.source,
    )


def command_form(command: Command, writes: str = "") -> CommandForm:
    """One command."""
    return CommandForm(
        name=command.name,
        title=command.title or command.name,
        group=command.group,
        kind=command.kind,
        arguments=field_forms(command.arguments),
        reply=command.reply,
        caution=command.caution,
        consequence=command.consequence,
        simple=command.simple,
        doc=command.doc,
        source=command.source,
        harmless={name: list(those) for name, those in command.harmless.items()},
        writes=writes,
    )


def _written_by(command: Command, settings: Sequence[Setting]) -> str:
    """The setting whose fields are the arguments of a command, and that it writes; "" for none."""
    names = {argument.name for argument in command.arguments}
    found = (row.name for row in settings if row.write == command.name and names <= {one.name for one in row.fields})
    return next(found, "") if names and command.kind == "set" else ""


def field_forms(fields: Iterable[Field]) -> list[FieldForm]:
    """The fields of a record, in their order."""
    return [field_form(field) for field in fields]


def field_form(field: Field) -> FieldForm:
    """One field."""
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
        step=1.0 if not field.fields and _is_number(field) and is_whole(field) else None,
        default=field.default,
        decimals=field.decimals,
        length=_length(field),
        most=field.most,
        axes=list(field.axes),
        choices={str(number): spoken(meaning) for number, meaning in field.choices.items()},
        bits=_bits(field),
        fields=field_forms(field.fields),
        simple=field.simple,
        read_only=field.read_only,
        base=field.base,
        options=list(field.options),
        doc=field.doc,
        source=field.source,
    )


def editor_of(field: Field) -> Editor:
    """Which sort of input a field has."""
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
    """Allowed wire values; of a float only what the table says."""
    if not _is_number(field):
        return None, None
    if not is_whole(field):
        return field.low, field.high
    return bounds(field)


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
            {str(number): spoken(meaning) for number, meaning in bits.choices.items()},
            bits.severity,
            bits.normal_set,
            bits.doc,
        )
        for bits in field.bits
    ]


# ── the two lists with editors of their own ──────────────────────────────────────────────────────────────────────────


def output_choices(known: DeviceContext, values: Mapping[str, Values] = NOTHING) -> list[OutputChoice]:
    """What an Xsens output configuration of this product can ask for.

    Args:
        values: settings as last read.
    """
    from protocols.xbus.output_configuration import OUTPUTS, Output, allowed, max_rate
    from protocols.xbus.products import as_built, has, model_of

    model = as_built(model_of(known.product), values.get("HardwareVersion", {}))
    offered = [output for output in OUTPUTS.values() if has(model, output.on)]
    titles = Counter(output.field.title or output.name for output in offered)

    def title_of(output: Output) -> str:
        """Of two with one title the rarer one is told by its name: "Status", "Status byte"."""
        title = output.field.title or output.name
        spread = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", output.name).capitalize()
        return title if titles[title] == 1 or output.simple else spread

    return [
        OutputChoice(
            data_identifier=output.identifier,
            title=title_of(output),
            group=output.group,
            rates=list(allowed(max_rate(output, model))),
            formats=list(_PRECISIONS) if output.real else [],
            frames=list(_COORDINATES) if output.local else [],
            size=output.size(output.identifier),
            unit=output.field.unit,
            simple=output.simple,
            doc=output.field.doc,
        )
        for output in offered
    ]


def stream_choices(known: DeviceContext, values: Mapping[str, Values] = NOTHING) -> list[StreamChoice]:
    """What an Inertial Sense device can stream."""
    from protocols.isb.bandwidth import periods_ms
    from protocols.isb.streams import BY_GPX_BIT, OF_GPX, STREAMS

    periods = periods_ms(values)
    gpx = known.product.startswith("GPX")
    gpx_bits = {did: bit for bit, did in BY_GPX_BIT.items()}
    return [
        StreamChoice(
            did=stream.did,
            name=stream.name,
            title=stream.title,
            group=stream.group,
            size=-1 if stream.counted else stream.size,
            rmc_bit=gpx_bits.get(stream.did, -1) if gpx else stream.rmc_bit,
            source_ms=periods[stream.did],
            simple=stream.simple,
        )
        for stream in STREAMS.values()
        if not gpx or stream.did in OF_GPX
    ]


def flat(fields: Sequence[Field], values: Any, at: str = "") -> Iterable[tuple[str, Field, Any]]:
    """Every single value with its path and its field: records and lists of records are gone into, vectors are not."""
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
