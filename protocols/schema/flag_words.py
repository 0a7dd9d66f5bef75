"""Flag words from the names of flags and groups.

    A|B                        the flags A and B
    GPS1_SOURCE=SER1|G15       the group GPS1_SOURCE at its value SER1, and the flag G15
    GPS|GAL                    groups that are on or off: all of their bits
    ["IO_CONFIG_G9_MASK …"]    as `imuscope inspect` lists them: the vendor's constants, "GROUP: VALUE"

A value of a group is written after = or :, or joined to the group's name by _ (G6G7_COM1), or as a number. Names are
case-insensitive; the end of the vendor's constant is sufficient. Flags and groups that are not named are 0. Names not
in the table are refused with a list of valid ones: a wrong bit is another port, or another pin.
"""

import difflib
from collections.abc import Iterable, Sequence

from imuscope.protocols.schema.fields import Bits, Field
from imuscope.protocols.schema.layouts import EncodeError

ALL = ("ON", "ALL")
MAX_NAMED_FLAGS = 6


def word_of(text: str, field: Field, path: str = "") -> int:
    """The flag word for the given names.

    Raises:
        EncodeError: a name that the field's table does not have, a group without a value, a group twice.
    """
    path = path or field.name
    word = used = 0
    for term in text.replace(",", "|").split("|"):
        if not term.strip():
            continue
        bits, value = _term(term.strip(), field.bits, path)
        mask = ((1 << bits.width) - 1) << bits.low
        if used & mask and word & mask != value << bits.low:
            raise EncodeError(f"{path} has {bits.name} twice: give it one value", path)
        used |= mask
        word |= value << bits.low
    return word


def unknown_bits(rows: Sequence[Bits], word: int) -> list[str]:
    """Set bits that the table does not have, as text."""
    known = sum(((1 << row.width) - 1) << row.low for row in rows)
    left = word & ~known if word >= 0 else 0
    return [f"unknown bit {bit}" for bit in range(left.bit_length()) if left >> bit & 1]


def _term(term: str, rows: Sequence[Bits], path: str) -> tuple[Bits, int]:
    """A flag, or a group and its value."""
    name, sign, meaning = (part.strip() for part in term.replace(":", "=", 1).partition("="))
    rows_of_name = _named(name, rows)
    if rows_of_name and sign:
        return rows_of_name, _value(rows_of_name, meaning, path)
    if rows_of_name and rows_of_name.width == 1:
        return rows_of_name, 1
    if rows_of_name:
        return rows_of_name, _whole(rows_of_name, path)
    for row in rows if not sign else ():
        for value, one in row.choices.items():
            if _is(name, f"{row.name}_{one}", f"{row.doc}_{one}"):
                return row, value
    raise EncodeError(f"{path} has no flag {name!r}; {nearest(name, [_shown(row) for row in rows])}", path)


def _named(name: str, rows: Sequence[Bits]) -> Bits | None:
    """The row of a name: its own, the vendor's constant, or an unambiguous end of the constant."""
    return next((row for row in rows if _is(name, row.name, row.doc)), None)


def _is(name: str, own: str, constant: str) -> bool:
    name, own, constant = name.casefold(), own.casefold(), constant.casefold()
    return name in (own, constant) or (len(name) > len(own) and name.endswith(own) and constant.endswith(f"_{name}"))


def _value(row: Bits, meaning: str, path: str) -> int:
    """A value of a group (or 0 and 1 of a flag) by name or number."""
    most = (1 << row.width) - 1
    for value, one in row.choices.items():
        if meaning.casefold() == one.casefold():
            return value
    try:
        number = int(meaning, 0)
    except ValueError:
        number = -1
    if 0 <= number <= most and (not row.choices or number in row.choices):
        return number
    allowed = f"one of {_values(row)}" if row.choices else f"a number from 0 to {most}"
    raise EncodeError(f"{path}: {row.name} is {allowed}, given {meaning!r}", path)


def _whole(row: Bits, path: str) -> int:
    """The value of a group named without one: all bits, if the group has such a value."""
    others = [value for value, one in row.choices.items() if one in ALL]
    others = others or [value for value in row.choices if value] * (len(row.choices) == 2)
    if not others:
        allowed = _values(row) or f"a number from 0 to {(1 << row.width) - 1}"
        raise EncodeError(f"{path}: {row.name} needs a value, as in {row.name}=…: {allowed}", path)
    return others[0]


def _values(row: Bits) -> str:
    return ", ".join(row.choices.values())


def _shown(row: Bits) -> str:
    return row.name if row.width == 1 else f"{row.name}=…"


def nearest(name: str, names: Iterable[str]) -> str:
    """List the nearest names ("nearest are: …"), or all of them if they are few."""
    names = list(names)
    if len(names) <= MAX_NAMED_FLAGS:
        return f"there are: {', '.join(names)}"
    folded = {one.casefold(): one for one in names}
    close = difflib.get_close_matches(name.casefold(), folded, 5, 0.4)
    names_close = [folded[one] for one in close] or names[:5]
    return f"nearest are: {', '.join(names_close)}"
