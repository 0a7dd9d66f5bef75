"""Identity of an Inertial Sense device: DID_DEV_INFO as text.

    hardwareType 3, hardwareVer 5.0.4.0, firmwareVer 2.7.1.0, serialNumber 62123  ─>  IMX-5.0.4, 62123, 2.7.1

Source: inertial-sense-sdk 2.7.1, data_sets.h, dev_info_t.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from imuscope.protocols.events import Reply
from imuscope.protocols.isb.messages import ROWS

FAMILIES = {1: "uINS", 2: "EVB", 3: "IMX", 4: "GPX"}
FIRST_IMX = 5  # from this hardware version on the same board is called IMX


def identity(reply: Reply) -> Mapping[str, str]:
    """Identity in an answer: "product", "serial_number", "firmware"; only device information has any."""
    if reply.message is not ROWS[1]:
        return {}
    values = reply.values
    reported: dict[str, str] = {}
    hardware, firmware = values.get("hardwareVer"), values.get("firmwareVer")
    if isinstance(hardware, Sequence) and len(hardware) == 4 and any(hardware):
        usual = 3 if hardware[0] >= FIRST_IMX else 1  # firmware before 2.1.9 does not report its type
        family = FAMILIES.get(values.get("hardwareType", usual) or usual, "Inertial Sense")
        reported["product"] = f"{family}-{_version(hardware[:3])}"
    if values.get("serialNumber"):
        reported["serial_number"] = str(values["serialNumber"])
    if isinstance(firmware, Sequence) and len(firmware) == 4 and any(firmware):
        reported["firmware"] = _version(firmware if firmware[3] else firmware[:3])
    return reported


def _version(numbers: Sequence[Any]) -> str:
    return ".".join(str(number) for number in numbers)
