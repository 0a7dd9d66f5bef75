"""Changes that could cut the link in use.

A device has several serial ports, each with a rate of its own, and does not report which one this link uses. A port
whose present rate differs from the link's is excluded; any other may be ours, so its change counts as one of our line.
Through USB no rate matters, but that is not reported either.

Source: inertial-sense-sdk 2.7.1, data_sets.h, nvm_flash_cfg_t and gpx_flash_cfg_t.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from imuscope.protocols.commands.transactions import BaudChange, DeviceContext
from imuscope.protocols.isb.stored_settings import STREAMS_SETTING

Values = Mapping[str, Any]
PORTS = {"ser0BaudRate": "serial port 0", "ser1BaudRate": "serial port 1", "ser2BaudRate": "serial port 2"}
_BRIDGES = ("cbPreset", "cbOptions", "bits", "h3sp330BaudRate", "h4xRadioBaudRate", "h8gpioBaudRate", "CANbaud_kbps")
_EVB = "The bridges between the ports of the EVB change; this link may be one of them."
_IO = "The pin functions of the device change; the port of this link may be reassigned."


def line_change(setting: str, old: Values | None, new: Values, known: DeviceContext) -> BaudChange | None:
    """See imuscope.protocols.commands.transactions.DeviceDriver.line_change."""
    if setting == STREAMS_SETTING:
        if "streams" in new and not new["streams"]:
            return BaudChange("silent", "The device stops streaming; it still answers requests.")
        return None
    before = old or {}
    if setting == "DID_EVB_FLASH_CFG" and any(name in new and new[name] != before.get(name) for name in _BRIDGES):
        return BaudChange("port", _EVB)
    if setting not in ("DID_FLASH_CONFIG", "DID_GPX_FLASH_CFG"):
        return None
    changed = {name: new[name] for name in PORTS if name in new and new[name] != before.get(name)}
    ours = {
        name: rate
        for name, rate in changed.items()
        if known.baud is None or name not in before or before[name] == known.baud
    }
    if known.baud is not None:
        ours = {name: rate for name, rate in ours.items() if rate != known.baud}
    if ours:
        rates = list(dict.fromkeys(ours.values()))
        if known.baud is not None and any(
            name in before and before[name] == known.baud for name in PORTS.keys() - ours
        ):
            rates.append(known.baud)  # the link may use an unchanged port
        return BaudChange("baud", _words(ours, known), rates[0], tuple(rates[1:]))
    if any(name in new and new[name] != before.get(name, new[name]) for name in ("ioConfig", "platformConfig")):
        return BaudChange("port", _IO)
    return None


def _words(ours: Mapping[str, int], known: DeviceContext) -> str:
    changes = " and ".join(f"{PORTS[name]} to {rate:_} Bd".replace("_", " ") for name, rate in ours.items())
    if known.baud is None:
        return f"Sets {changes}; if the link uses one of these ports, its rate must be changed too."
    return f"Sets {changes}; if the link uses that port, its rate must be changed too, from {known.baud:_} Bd.".replace(
        "_", " "
    )
