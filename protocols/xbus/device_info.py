"""Identity of an MTi from its answers.

Source: MT0101P 2020.A, 5.3.1 and 5.3.2; the reserved bytes of Configuration are known from captures, the word order of
a long identifier from the vendor's public code.
"""

from collections.abc import Mapping

import numpy as np

from imuscope.protocols.events import Reply
from imuscope.protocols.schema.labels import device_label

_IS_LONG = 0x8000_0000


def identity(reply: Reply) -> Mapping[str, str]:
    """Identity in an answer: any of "product", "serial_number", "firmware"."""
    values = reply.values
    details: dict[str, str] = {}
    product = values.get("product_code") or _code_in(values.get("reserved_host"))
    if isinstance(product, str) and product.strip():
        details["product"] = product.strip().strip("\x00")
    elif "600-series" in reply.message.title:
        details["series"] = "MTi-600 series"  # only they have this form of Configuration
    if number := _number(reply):
        details["serial_number"] = number
    if reply.message.name.startswith("Firmware") and "major" in values:
        parts = [values[name] for name in ("major", "minor", "revision") if values.get(name) is not None]
        details["firmware"] = ".".join(str(part) for part in parts)
    return details


def _number(reply: Reply) -> str:
    """The identifier as printed on the label; "" if the answer has none.

    An identifier of 64 bits has its low word first in Configuration, its high word first in DeviceID; bit 31 of the low
    word marks it. Eight bytes without that mark hold an identifier of 32 bits, as sent by early firmware.
    """
    name = "master_device_id" if "master_device_id" in reply.values else "device_id"
    value = reply.values.get(name)
    if not isinstance(value, int | np.integer) or int(value) <= 0:
        return ""
    if not any(field.name == name and field.dtype == ">u8" for field in reply.message.fields):
        return f"{int(value):08X}"
    high, low = int(value) >> 32, int(value) & 0xFFFF_FFFF
    if not (high | low) & _IS_LONG:
        return f"{high or low:08X}"
    return device_label(low << 32 | high if name == "master_device_id" and high & _IS_LONG else int(value))


def formerly(serial_number: str) -> tuple[str, ...]:
    """Numbers that were used for a device before identifiers of 64 bits were read word by word."""
    if len(serial_number) < 10:
        return ()
    value = int(serial_number, 16)
    return f"{value:08X}", f"{(value & 0xFFFF_FFFF) << 32 | value >> 32:08X}"


def _code_in(reserved: object) -> str:
    """The product code that devices with a 64-bit identifier write into 20 bytes of Configuration (xbus facts)."""
    text = bytes(reserved[:20]).strip(b"\0 ") if isinstance(reserved, bytes | bytearray | np.bytes_) else b""
    return text.decode("ascii") if text.startswith(b"MTi") and text.isascii() else ""
