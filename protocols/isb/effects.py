"""Side effects of commands on settings.

    GET_DATA with a period, a stop, a preset, DID_RMC        the streams; a stop of a port ends its sentences too
    a restart                                                unsaved values: streams, sentences, states
    the maker's own commands                                 anything
    DID_MAG_CAL.x                                            the state of that calibration

A command that writes a whole data set (SET_DID_x) names the setting itself (Setting.write).

Source: ISB document, "Data source update rates", "Stop broadcasts"; inertial-sense-sdk 2.7.1, data_sets.h.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any

from imuscope.protocols.isb.commands import COMMAND_ROWS, SYSTEM_COMMANDS
from imuscope.protocols.isb.messages import SET_PREFIX
from imuscope.protocols.isb.stored_settings import GET_PREFIX, STREAMS_SETTING

_SENTENCES, _GPX_STREAMS, _CALIBRATION = "DID_NMEA_BCAST_PERIOD", "DID_GPX_RMC", "DID_MAG_CAL"
_STREAMS = (STREAMS_SETTING, _GPX_STREAMS)
_OUTPUT = (*_STREAMS, _SENTENCES)
_RESTARTED = (*_OUTPUT, _CALIBRATION, "DID_SYS_PARAMS")
_OF_PORT = ("STOP_BROADCASTS_CURRENT_PORT", "STOP_BROADCASTS_ALL_PORTS", "STPB", "STPC")


def alters(command: str, values: Mapping[str, Any], settings: Iterable[str]) -> Collection[str]:
    """See imuscope.protocols.commands.transactions.DeviceDriver.alters.

    Args:
        settings: names of the device's settings.
    """
    name = command.removeprefix("$")
    if name == "SET_DID_SYS_CMD":
        name = f"DID_SYS_CMD.{SYSTEM_COMMANDS.get(values.get('command', 0), '')}"
    row = COMMAND_ROWS.get(name)
    if row is None or row.caution == "loses-settings":
        return frozenset(settings)
    head = name.removeprefix(SET_PREFIX).partition(".")[0]
    changed: tuple[str, ...] = ()
    if row.caution == "restarts":
        changed = _RESTARTED
    elif name in _OF_PORT:
        changed = _OUTPUT
    elif name.startswith(GET_PREFIX):
        changed = _STREAMS if values.get("period", 1) else ()  # a single packet does not affect streams
    elif name == "STOP_DID_BROADCAST" or head in ("DID_RMC", _GPX_STREAMS):
        changed = _STREAMS
    elif name == "ASCE":
        changed = (_SENTENCES,)
    elif head in ("DID_FLASH_CONFIG", "DID_GPX_FLASH_CFG"):
        changed = (STREAMS_SETTING, "DID_SYS_PARAMS")  # streams are multiples of its periods
    elif head == _CALIBRATION:
        changed = (_CALIBRATION,)
    return frozenset(changed) & frozenset(settings)
