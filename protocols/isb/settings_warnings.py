"""Warnings about risky settings, apart from those that affect the link.

    DID_FLASH_CONFIG    turns or moves the reference frame of all output; ends the measurement
                        periods: shorter than an IMX-5 with GNSS can keep, or than the one they follow; faster streams
    DID_MAG_CAL         replaces the existing calibration
    fields maintained by the device (a checksum, its own size)      not for the user to write
    streams, sentences  the option that stores them

The same words apply to every way of writing: form, API, command line, as a setting or as a data set.

Source: inertial-sense-sdk 2.7.1, data_sets.h, nvm_flash_cfg_t, mag_cal_t.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from imuscope.protocols.commands.transactions import Risk
from imuscope.protocols.isb.messages import SET_PREFIX
from imuscope.protocols.isb.stored_settings import PERSISTENT, STREAMS_SETTING, settings_of

Values = Mapping[str, Any]
_FRAMES = ("insRotation", "insOffset", "gps1AntOffset", "gps2AntOffset", "refLla")
_PERIODS = ("startupImuDtMs", "startupNavDtMs")
_TURNED = "The reference frame of attitude, position or velocity changes; every consumer of the data must be adapted."
_ENDED = "With a period of 0 the device stops measuring."
LEAST_NAV_MS = 7  # of an IMX-5 with a GNSS receiver
_TOO_SHORT = "An IMX-5 with a GNSS receiver needs a navigation period of at least {least} ms, given {given} ms."
_SHORTENED = (
    "The sampling period of {given} ms is longer than the navigation period: the device shortens it to {least} ms."
)
_FASTER = "Every stream that follows the navigation period rises from {old:.4g} to {new:.4g} Hz."
_RECALIBRATED = "The existing magnetometer calibration is replaced."
_OWN = "The device maintains these fields itself. Writing them can make it discard its configuration."
_STREAMS = (STREAMS_SETTING, "DID_NMEA_BCAST_PERIOD", "ASCE", "DID_RMC", "DID_GPX_RMC")
_SAVED = "The streams and sentences of this moment are saved to the flash memory: they run again after every restart."
_CALIBRATES = (1, 2)  # states of DID_MAG_CAL that start one


def _of_navigation(before: Values, changed: Values, product: str) -> list[Risk]:
    """Consequences of another navigation period."""
    period, old = changed.get("startupNavDtMs", 0), before.get("startupNavDtMs", 0)
    risks = []
    if 0 < period < LEAST_NAV_MS and (not product or product.startswith("IMX-5")):
        risks.append(Risk("stops-output", _TOO_SHORT.format(least=LEAST_NAV_MS, given=period)))
    navigation, sampling = period or old, changed.get("startupImuDtMs", before.get("startupImuDtMs", 0))
    if 0 < navigation < sampling and ("startupImuDtMs" in changed or period):
        risks.append(Risk("", _SHORTENED.format(given=sampling, least=navigation)))
    if 0 < period < old:
        risks.append(Risk("", _FASTER.format(old=1000 / old, new=1000 / period)))
    return risks


def risks_of_change(setting: str, old: Values | None, new: Values, product: str = "") -> list[Risk]:
    """See imuscope.protocols.commands.transactions.DeviceDriver.risks."""
    before = old or {}
    changed = {name: value for name, value in new.items() if name not in before or before[name] != value}
    row = settings_of().get(setting)
    risks = []
    if row is not None and any(one.read_only and one.name in changed for one in row.fields):
        risks.append(Risk("loses-settings", _OWN))
    if setting in ("DID_FLASH_CONFIG", "DID_GPX_FLASH_CFG"):
        if any(name in changed for name in _FRAMES):
            risks.append(Risk("moves-frame", _TURNED))
        if any(changed.get(name) == 0 for name in _PERIODS):
            risks.append(Risk("stops-output", _ENDED))
    if setting == "DID_FLASH_CONFIG":
        risks += _of_navigation(before, changed, product)
    is_of_streams = setting.removeprefix(SET_PREFIX).partition(".")[0] in _STREAMS
    if is_of_streams and int(changed.get("options") or 0) & PERSISTENT:
        risks.append(Risk("wears-flash", _SAVED))
    if setting == "DID_MAG_CAL" and changed.get("state") in _CALIBRATES:
        risks.append(Risk("moves-frame", _RECALIBRATED))
    return risks
