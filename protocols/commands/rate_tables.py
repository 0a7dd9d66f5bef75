"""Tables by which a list of outputs is edited (schema.Setting.editor): a row for each quantity, switched on at a rate.

An entry of the list names its quantity by a number, the key, and has a rate:

    key       0x4020, or 0x4024 with a variant in other bits of it (precision, coordinate frame)
    rate      in Hz; or a divisor of the quantity's own rate, if the table has `interval`
"""

from dataclasses import dataclass, field


@dataclass(slots=True)
class VariantChoice:
    bits: int  # of the key
    words: str  # "Float32"


@dataclass(slots=True)
class KeyVariant:
    """A property of an output that is in bits of its key."""

    name: str  # class of its column: "precision", "frame"
    title: str
    mask: int
    choices: list[VariantChoice]
    fixed: str = ""  # words for an output without a choice


@dataclass(slots=True)
class RateRow:
    """One quantity that a device can send."""

    id: int  # its key, without variants
    title: str
    group: str
    name: str = ""  # in the vendor's documents
    rates: list[int] = field(default_factory=list)  # allowed, Hz, fastest first; empty: with every message
    variants: dict[str, list[int]] = field(default_factory=dict)  # variant → available bits
    interval_ms: float = 0.0  # at divisor 1; 0: unknown until the device reports it
    basic: bool = True
    doc: str = ""


@dataclass(slots=True)
class RateTable:
    """The table of a list: names of the fields of its entries, and its rows."""

    key: str  # field with the number of the quantity
    rate: str  # field with the rate, or the divisor
    heading: str  # of the column of titles
    rows: list[RateRow]
    key_mask: int = 0xFFFF  # bits of the key that name the quantity
    key_digits: int = 0  # hexadecimal digits of a displayed key; 0: decimal
    every: int = 0  # rate of every message, or the highest; 0: none
    interval: str = ""  # field with the measured interval at divisor 1, ms; "": rates are in Hz
    divisors: list[int] = field(default_factory=list)  # offered ones
    variants: list[KeyVariant] = field(default_factory=list)
    grouped: bool = False  # the group of a row is shown beside its title
