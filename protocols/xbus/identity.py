"""Who is this MTi? What its answers tell, in words for a person.

Source: MT0101P 2020.A, 5.3.1 and 5.3.2; what Configuration holds in its reserved bytes is from captures.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from protocols.events import Reply


def identity(reply: Reply) -> Mapping[str, str]:
    """What an answer tells: "product", "serial_number", "firmware"; only those that it tells."""
    values = reply.values
    told: dict[str, str] = {}
    product = values.get("product_code") or _code_in(values.get("reserved_host"))
    if isinstance(product, str) and product.strip():
        told["product"] = product.strip().strip("\x00")
    elif "600-series" in reply.message.title:
        told["series"] = "MTi-600 series"  # only they have this form of Configuration
    number = values.get("device_id64") or values.get("device_id") or values.get("master_device_id")
    if isinstance(number, int | np.integer) and int(number) > 0:
        told["serial_number"] = f"{int(number):08X}"
    if reply.message.name.startswith("Firmware") and "major" in values:
        parts = [values[name] for name in ("major", "minor", "revision") if values.get(name) is not None]
        told["firmware"] = ".".join(str(part) for part in parts)
    return told


def _code_in(reserved: object) -> str:
    """The product code that devices with a 64-bit identifier write into 20 bytes of Configuration (xbus facts)."""
    text = bytes(reserved[:20]).strip(b"\0 ") if isinstance(reserved, bytes | bytearray | np.bytes_) else b""
    return text.decode("ascii") if text.startswith(b"MTi") and text.isascii() else ""
