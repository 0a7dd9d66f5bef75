"""What can a device be told and asked? The tables of commands and settings as text: `imuscope commands`.

    imuscope commands                              every command and setting of every protocol, a line each
    imuscope commands --protocol xbus SetPeriod    one of them: its fields with ranges, meaning and source

The same rows are the forms of the page, the fields of `compose` and `send`, and GET /api/commands; nothing is written
here that a row does not say.
"""

from __future__ import annotations

import difflib
import textwrap
from collections.abc import Iterable, Iterator, Sequence

from protocols.idtp.custom_payloads import Schema
from protocols.registry import PROTOCOLS
from protocols.schema import Bits, Command, Field, Setting
from protocols.transactions import DeviceContext
from protocols.validation import bounds, is_whole
from server.commands.compose import ComposeError, composers
from server.configuration.api_models import Forms
from server.configuration.form_builder import forms_of

CommandListRow = Command | Setting
WIDTH = 120
KINDS = {"ask": "asks, changes nothing", "set": "writes a setting", "do": "starts something"}


def all_forms() -> list[Forms]:
    """The tables of every protocol that has any, as forms: all products together."""
    return [forms_of(one.driver, one.name, DeviceContext()) for one in PROTOCOLS.values() if one.driver is not None]


def manual(protocol: str = "", name: str = "", schema: Schema | None = None) -> Iterator[str]:
    """Lines of text: of one command or setting, else of all.

    Args:
        schema: rows of the vendor's own payload types of IDTP.
    Raises:
        ComposeError: nothing is called like that.
    """
    tables: dict[str, list[CommandListRow]] = {
        one.name: [*one.driver.commands(DeviceContext()), *one.driver.settings(DeviceContext())]
        for one in composers(schema=schema).values()
        if protocol in ("", "auto", one.name)
    }
    if not name:
        for spoken, rows in tables.items():
            yield from _overview(spoken, rows)
        return
    found = [(spoken, row) for spoken, rows in tables.items() for row in rows if row.name == name]
    if not found:
        names = [row.name for rows in tables.values() for row in rows]
        near = difflib.get_close_matches(name, names, 3, 0.5)
        raise ComposeError(f"there is no command {name!r}" + (f"; near: {', '.join(near)}" if near else ""))
    for spoken, row in found:
        yield from _entry(spoken, row)


def _overview(protocol: str, rows: Sequence[CommandListRow]) -> Iterator[str]:
    width = max((len(row.name) for row in rows), default=0)
    group = ""
    for row in sorted(rows, key=lambda row: list(dict.fromkeys(one.group for one in rows)).index(row.group)):
        if row.group != group:
            group = row.group
            yield from ("", f"{protocol}: {group}")
        harm = f"  [{row.caution}]" if row.caution else ""
        yield f"  {row.name:<{width}}  {row.title or row.name}{harm}"


def _entry(protocol: str, row: CommandListRow) -> Iterator[str]:
    yield f"{row.name}  ({protocol}, {row.group})"
    kind = KINDS[row.kind] if isinstance(row, Command) else "a setting, kept by the device"
    yield f"  {row.title or row.name}: {kind}."
    yield from _wrapped(row.doc)
    if isinstance(row, Command) and row.reply:
        yield f"  Answer: {row.reply}, within {row.timeout_s:g} s."
    if row.caution:
        yield from _wrapped(f"Caution ({row.caution}): {row.consequence} `send` wants --yes.")
    if row.source:
        yield f"  Source: {row.source}"
    yield from _fields(row.arguments if isinstance(row, Command) else row.fields, "  ")


def _fields(fields: Iterable[Field], margin: str) -> Iterator[str]:
    for field in fields:
        parts = [_type(field), field.unit, _range(field)]
        parts += [f"usually {field.default}"] * (field.default is not None) + ["read-only"] * field.read_only
        yield f"{margin}{field.name}  " + ", ".join(part for part in parts if part)
        yield from _wrapped(field.doc, margin + "    ")
        meanings = [f"{number} {meaning}" for number, meaning in field.choices.items()]
        meanings += [_bits(bits) for bits in field.bits]
        yield from _wrapped("; ".join(meanings), margin + "    ")
        yield from _fields(field.fields, margin + "    ")


def _bits(bits: Bits) -> str:
    """A flag by its mask and name; a group with its values, each as it stands in the word."""
    if bits.width == 1:
        return f"{1 << bits.low:#x} {bits.name}"
    values = ", ".join(f"{value << bits.low:#x} {meaning}" for value, meaning in bits.choices.items())
    return f"{((1 << bits.width) - 1) << bits.low:#x} {bits.name}=" + (values or f"0 to {(1 << bits.width) - 1}")


def _type(field: Field) -> str:
    kind = {"bytes": "hex", "ascii": "text", "": "record"}.get(field.dtype, field.dtype.strip("<>"))
    if not field.shape:
        return kind
    return f"{kind} × " + (
        f"up to {field.most}" if field.most else "×".join(map(str, field.shape)).replace("-1", "any")
    )


def _range(field: Field) -> str:
    if field.fields or field.dtype in ("bytes", "ascii") or field.choices or field.bits:
        return ""
    low, high = bounds(field) if is_whole(field) else (field.low, field.high)
    shown = ["" if limit is None else str(limit) if isinstance(limit, int) else f"{limit:.7g}" for limit in (low, high)]
    return f"{shown[0]} to {shown[1]}" if all(shown) else ""


def _wrapped(text: str, margin: str = "  ") -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=margin, subsequent_indent=margin)
