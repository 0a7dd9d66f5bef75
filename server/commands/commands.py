"""`imuscope commands`: print the tables of commands and settings.

    imuscope commands                              every command and setting of every protocol, a line each
    imuscope commands --protocol xbus SetPeriod    one of them: its fields with ranges, meaning and source
    imuscope commands --json SetPeriod             the same for programs, as GET /api/commands

The same rows are the forms of the page, the fields of `compose` and `send`, and GET /api/commands; this file adds no
text of its own.
"""

import difflib
import textwrap
from collections.abc import Iterable, Iterator, Sequence

from imuscope.protocols.commands.composer import ProtocolComposer
from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.schema.fields import Bits, Command, Field, Setting
from imuscope.protocols.schema.shown_values import is_scaled, meant, shown_number
from imuscope.protocols.schema.validation import bounds, is_whole
from imuscope.server.commands.compose import ComposeError, composers
from imuscope.server.configuration.api_models import Forms
from imuscope.server.configuration.form_builder import forms_of
from imuscope.server.devices.decode.decode_options import DecodeOptions

CommandListRow = Command | Setting
LINE_CHARS = 120
KINDS = {"ask": "asks, changes nothing", "set": "writes a setting", "do": "starts something"}


def manual(reading: DecodeOptions = DecodeOptions(), name: str = "") -> Iterator[str]:  # noqa: B008 - frozen
    """Lines of text on one command or setting, or on all.

    Args:
        reading: decode options, for the protocol and descriptions of a vendor's own messages.

    Raises:
        ComposeError: no command or setting has that name.
    """
    tables: dict[str, list[CommandListRow]] = {
        one.name: [*one.driver.commands(DeviceContext()), *one.driver.settings(DeviceContext())]
        for one in _composers(reading)
    }
    if not name:
        for family, rows in tables.items():
            yield from _overview(family, rows)
        return
    rows_of_name = [(family, row) for family, rows in tables.items() for row in rows if row.name == name]
    if not rows_of_name:
        raise _unknown(name, [row.name for rows in tables.values() for row in rows])
    for family, row in rows_of_name:
        yield from _entry(family, row)


def forms(reading: DecodeOptions, name: str = "") -> list[Forms]:
    """One command or setting, or all, in each protocol that has it: as of GET /api/commands.

    Raises:
        ComposeError: no command or setting has that name.
    """
    known = DeviceContext()
    every = [forms_of(one.driver, one.name, known) for one in _composers(reading)]
    if not name:
        return every
    names = [
        name for one in every for name in (*(row.name for row in one.settings), *(row.name for row in one.commands))
    ]
    if name not in names:
        raise _unknown(name, names)
    for one in every:
        one.settings = [row for row in one.settings if row.name == name]
        one.commands = [row for row in one.commands if row.name == name]
    return [one for one in every if one.settings or one.commands]


def _composers(reading: DecodeOptions) -> list[ProtocolComposer]:
    return [one for one in composers(reading).values() if reading.protocol in ("", "auto", one.name)]


def _unknown(name: str, names: Sequence[str]) -> ComposeError:
    near = difflib.get_close_matches(name, names, 3, 0.5)
    return ComposeError(f"unknown command {name!r}" + (f"; similar: {', '.join(near)}" if near else ""))


def _overview(protocol: str, rows: Sequence[CommandListRow]) -> Iterator[str]:
    width = max((len(row.name) for row in rows), default=0)
    group = ""
    for row in sorted(rows, key=lambda row: list(dict.fromkeys(one.group for one in rows)).index(row.group)):
        if row.group != group:
            group = row.group
            yield from ("", f"{protocol}: {group}")
        caution = f"  [{row.caution}]" if row.caution else ""
        yield f"  {row.name:<{width}}  {row.title or row.name}{caution}"


def _entry(protocol: str, row: CommandListRow) -> Iterator[str]:
    yield f"{row.name}  ({protocol}, {row.group})"
    kind = KINDS[row.kind] if isinstance(row, Command) else "a setting, stored by the device"
    yield f"  {row.title or row.name}: {kind}."
    yield from _wrapped(row.doc)
    if isinstance(row, Command) and row.reply:
        yield f"  Answer: {row.reply}, within {row.timeout_s:g} s."
    if row.caution:
        yield from _wrapped(f"Caution ({row.caution}): {row.consequence} `send` requires --yes.")
    if row.source:
        yield f"  Source: {row.source}"
    yield from _fields(row.arguments if isinstance(row, Command) else row.fields, "  ")


def _fields(fields: Iterable[Field], margin: str) -> Iterator[str]:
    for field in fields:
        unit = "rad, or degrees as 90deg" if field.unit == "rad" else field.unit
        parts = [_type(field), unit, _range(field), _step(field)]
        usual = None if field.default is None else shown_number(field, field.default)
        parts += [f"usually {usual}"] * (usual is not None) + ["read-only"] * field.read_only
        yield f"{margin}{field.name}  " + ", ".join(part for part in parts if part)
        yield from _wrapped(field.doc, margin + "    ")
        meanings = [f"{number} {meaning}" for number, meaning in field.choices.items()]
        meanings += [_bits(bits) for bits in field.bits]
        yield from _wrapped("; ".join(meanings), margin + "    ")
        yield from _meanings(field, margin + "    ")
        yield from _fields(field.fields, margin + "    ")


def _meanings(field: Field, margin: str) -> Iterator[str]:
    """The unit and range that a field has while another one has certain values."""
    for meaning in field.meanings:
        value = meaning.values[0] if meaning.values else None
        row = meant(field, {field.meaning_of: value})
        when = f"{field.meaning_of} {' or '.join(map(str, meaning.values))}" if meaning.values else "any other"
        parts = [meaning.title, row.unit, _range(row, signed=meaning.signed), _step(row)]
        yield from _wrapped(f"with {when}: " + ", ".join(part for part in parts if part), margin)


def _bits(bits: Bits) -> str:
    """A flag with its mask and name; a group with its values, each shifted to its position in the word."""
    if bits.width == 1:
        return f"{1 << bits.low:#x} {bits.name}"
    values = ", ".join(f"{value << bits.low:#x} {meaning}" for value, meaning in bits.choices.items())
    return f"{((1 << bits.width) - 1) << bits.low:#x} {bits.name}=" + (values or f"0 to {(1 << bits.width) - 1}")


def _type(field: Field) -> str:
    kind = {"bytes": "hex", "ascii": "text", "": "record"}.get(field.dtype, field.dtype.strip("<>"))
    if not field.shape:
        return kind
    return f"{kind} × " + (
        f"up to {field.max_length}" if field.max_length else "×".join(map(str, field.shape)).replace("-1", "any")
    )


def _step(field: Field) -> str:
    """The step of a scaled whole number."""
    return f"in steps of {field.scale:g}" if is_scaled(field) and field.dtype and is_whole(field) else ""


def _range(field: Field, *, signed: bool = False) -> str:
    if field.fields or field.dtype in ("bytes", "ascii") or field.choices or field.bits:
        return ""
    if field.meanings and not signed and not field.unit and not is_scaled(field):
        return ""
    low, high = bounds(field) if is_whole(field) else (field.low, field.high)
    if is_scaled(field):
        low, high = (None if limit is None else shown_number(field, limit) for limit in (low, high))
    shown = ["" if limit is None else str(limit) if isinstance(limit, int) else f"{limit:.7g}" for limit in (low, high)]
    return f"{shown[0]} to {shown[1]}" if all(shown) else ""


def _wrapped(text: str, margin: str = "  ") -> list[str]:
    return textwrap.wrap(text, LINE_CHARS, initial_indent=margin, subsequent_indent=margin)
