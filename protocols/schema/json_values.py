"""Wire values as what JSON can hold, for all protocols: bytes as hex, flag words by the names of their set bits."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from imuscope.protocols.schema.fields import Bits, Field


def jsonable(value: Any) -> Any:
    """Bytes as hex, at any depth."""
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, Mapping):
        return {name: jsonable(part) for name, part in value.items()}
    if isinstance(value, list):
        return [jsonable(part) for part in value]
    return value


def flag_names(
    field: Field, value: Any, path: str, title: Callable[[Bits], str] = lambda bits: bits.name
) -> Iterator[tuple[str, list[str]]]:
    """The set bits of the flag words in `value`, with the path of each word.

    Args:
        title: label of a bit or a group of bits.
    """
    if not field.fields and not field.bits:
        return
    for k, one in enumerate(value if isinstance(value, list) else [value]):
        here = f"{path}[{k}]" if isinstance(value, list) else path
        for part in field.fields:
            yield from flag_names(part, one[part.name], f"{here}.{part.name}", title)
        if field.bits:
            yield here, [_named(bits, title(bits), bits.of(one)) for bits in field.bits if bits.of(one)]


def _named(bits: Bits, name: str, value: int) -> str:
    return name if bits.width == 1 else f"{name}: {bits.choices.get(value, value)}"
