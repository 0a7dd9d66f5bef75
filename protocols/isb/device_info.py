"""Who is this Inertial Sense device? What DID_DEV_INFO tells, in words for a person.

    hardwareType 3, hardwareVer 5.0.4.0, firmwareVer 2.7.1.0, serialNumber 62123  ─>  IMX-5.0.4, 62123, 2.7.1

Source: inertial-sense-sdk 2.7.1, data_sets.h, dev_info_t.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from protocols.events import Reply
from protocols.isb.messages import ROWS

FAMILIES = {1: "uINS", 2: "EVB", 3: "IMX", 4: "GPX"}
FIRST_IMX = 5  # hardware version from which the same board was called IMX


def identity(reply: Reply) -> Mapping[str, str]:
    """What an answer tells: "product", "serial_number", "firmware"; nothing but device information tells any."""
    if reply.message is not ROWS[1]:
        return {}
    values = reply.values
    told: dict[str, str] = {}
    hardware, firmware = values.get("hardwareVer"), values.get("firmwareVer")
    if isinstance(hardware, Sequence) and len(hardware) == 4 and any(hardware):
        usual = 3 if hardware[0] >= FIRST_IMX else 1  # firmware before 2.1.9 does not tell its type
        family = FAMILIES.get(values.get("hardwareType", usual) or usual, "Inertial Sense")
        told["product"] = f"{family}-{_version(hardware[:3])}"
    if values.get("serialNumber"):
        told["serial_number"] = str(values["serialNumber"])
    if isinstance(firmware, Sequence) and len(firmware) == 4 and any(firmware):
        told["firmware"] = _version(firmware if firmware[3] else firmware[:3])
    return told


def _version(numbers: Sequence[Any]) -> str:
    return ".".join(str(number) for number in numbers)
