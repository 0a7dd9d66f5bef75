"""Effects of a change or a command: on the link in use, on other settings, and their risks.

Source: inertial-sense-sdk 2.7.1, data_sets.h, nvm_flash_cfg_t, gpx_flash_cfg_t and mag_cal_t; ISB document, "Data
source update rates", "Stop broadcasts".
"""

import struct
from collections.abc import Collection, Iterable, Mapping
from typing import Any

from imuscope.protocols.commands.transactions import BaudChange, DeviceContext, Risk
from imuscope.protocols.isb.commands import COMMAND_ROWS, SYSTEM_COMMANDS
from imuscope.protocols.isb.messages import SET_PREFIX
from imuscope.protocols.isb.stored_settings import GET_PREFIX, PERSISTENT, STREAMS_SETTING, settings_of

Values = Mapping[str, Any]
PORTS = {"ser0BaudRate": "serial port 0", "ser1BaudRate": "serial port 1", "ser2BaudRate": "serial port 2"}
_BRIDGES = ("cbPreset", "cbOptions", "bits", "h3sp330BaudRate", "h4xRadioBaudRate", "h8gpioBaudRate", "CANbaud_kbps")
_EVB = "The bridges between the ports of the EVB change; this link may be one of them."
_IO = "The pin functions of the device change; the port of this link may be reassigned."


def line_change(setting: str, old: Values | None, new: Values, known: DeviceContext) -> BaudChange | None:
    """See imuscope.protocols.commands.transactions.DeviceDriver.line_change.

    A device has several serial ports, each with a rate of its own, and does not report which one this link uses. A port
    whose present rate differs from the link's is excluded; any other may be ours, so its change counts as one of our
    line. Through USB no rate matters, but that is not reported either.
    """
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


def own_ports(values: Mapping[str, Values], known: DeviceContext) -> list[str]:
    rates = values.get("DID_FLASH_CONFIG", {})
    return [f"DID_FLASH_CONFIG.{name}" for name in PORTS if known.baud is not None and rates.get(name) == known.baud]


def _words(ours: Mapping[str, int], known: DeviceContext) -> str:
    changes = " and ".join(f"{PORTS[name]} to {rate:_} Bd".replace("_", " ") for name, rate in ours.items())
    if known.baud is None:
        return f"Sets {changes}; if the link uses one of these ports, its rate must be changed too."
    return f"Sets {changes}; if the link uses that port, its rate must be changed too, from {known.baud:_} Bd.".replace(
        "_", " "
    )


_SENTENCES, _GPX_STREAMS, _CALIBRATION = "DID_NMEA_BCAST_PERIOD", "DID_GPX_RMC", "DID_MAG_CAL"
_STREAMS = (STREAMS_SETTING, _GPX_STREAMS)
_OUTPUT = (*_STREAMS, _SENTENCES)
_RESTARTED = (*_OUTPUT, _CALIBRATION, "DID_SYS_PARAMS")
_OF_PORT = ("STOP_BROADCASTS_CURRENT_PORT", "STOP_BROADCASTS_ALL_PORTS", "STPB", "STPC")


def alters(command: str, values: Mapping[str, Any], settings: Iterable[str]) -> Collection[str]:
    """See imuscope.protocols.commands.transactions.DeviceDriver.alters.

        GET_DATA with a period, a stop, a preset, DID_RMC        the streams; a stop of a port ends its sentences too
        a restart                                                unsaved values: streams, sentences, states
        the maker's own commands                                 anything
        DID_MAG_CAL.x                                            the state of that calibration

    A command that writes a whole data set (SET_DID_x) names the setting itself (Setting.write).

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
_OF_STREAMS = (STREAMS_SETTING, "DID_NMEA_BCAST_PERIOD", "ASCE", "DID_RMC", "DID_GPX_RMC")
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
    """See imuscope.protocols.commands.transactions.DeviceDriver.risks.

        DID_FLASH_CONFIG    turns or moves the reference frame of all output; ends the measurement
                            periods: shorter than an IMX-5 with GNSS can keep, or than the one they follow
        DID_MAG_CAL         replaces the existing calibration
        fields maintained by the device (a checksum, its own size)      not for the user to write
        streams, sentences  the option that stores them

    The same words apply to every way of writing: form, API, command line, as a setting or as a data set.
    """
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
    is_of_streams = setting.removeprefix(SET_PREFIX).partition(".")[0] in _OF_STREAMS
    if is_of_streams and int(changed.get("options") or 0) & PERSISTENT:
        risks.append(Risk("wears-flash", _SAVED))
    if setting == "DID_MAG_CAL" and changed.get("state") in _CALIBRATES:
        risks.append(Risk("moves-frame", _RECALIBRATED))
    return risks


MEANINGLESS = ("checksum", "options")
SAVED = ("DID_NMEA_BCAST_PERIOD", "DID_GPX_RMC")  # whose options can request saving
PERIOD_TOLERANCE = 0.1  # share within which two periods are equal


def differences(setting: str, a: Values, b: Values) -> list[str]:
    """Paths of the fields present in both that differ.

    Dependent fields (a checksum) are not compared; streams and sentences are compared by content, not by order; float32
    by their bits. The options of streams and sentences only affect how they are written. One of them counts, and only
    on the right side: a request to save (PERSISTENT) that is missing on the left is a difference, so that it is carried
    out; a device that does not report it afterwards has not refused it.
    """
    if setting == STREAMS_SETTING:
        return _streams(a, b) + _to_save(a, b)
    rows = _to_save(a, b) if setting in SAVED else []
    for name in a:
        if name not in b or name in MEANINGLESS:
            continue
        if name == "nmeaBroadcastMsgs":
            rows += [name] * (_sentences(a[name]) != _sentences(b[name]))
        else:
            rows += _differ(name, a[name], b[name])
    return rows


def _streams(a: Values, b: Values) -> list[str]:
    """Streams by data set: missing, new, or with another period. One that was read but not observed matches any."""
    if "streams" not in a or "streams" not in b:
        return []
    other = {one["did"]: one for one in b.get("streams", [])}
    rows = []
    for place, one in enumerate(a.get("streams", [])):
        match = other.get(one["did"])
        if match is None:
            rows.append(f"streams.{place}")
        elif 0 not in (one.get("size"), match.get("size")) and not same_pace(one, match):
            rows.append(f"streams.{place}.period")
    ours = {one["did"] for one in a.get("streams", [])}
    return rows + [f"streams.{place}" for place, one in enumerate(b.get("streams", [])) if one["did"] not in ours]


def same_pace(one: Values, other: Values) -> bool:
    """Whether two rows of a stream mean the same rate: the same multiple, or the same interval, because the source that
    a device uses is not always known.
    """
    if one.get("period", 1) == other.get("period", 1):
        return True
    apart, other_apart = (float(row.get("source_ms") or 0) * (row.get("period") or 1) for row in (one, other))
    return bool(apart and other_apart) and abs(apart - other_apart) <= PERIOD_TOLERANCE * min(apart, other_apart)


def _to_save(a: Values, b: Values) -> list[str]:
    """Whether the right side requests a save that the left one does not."""
    before, requested = int(a.get("options") or 0), int(b.get("options") or 0)
    return ["options"] if requested & ~before & PERSISTENT else []


def _sentences(pairs: Any) -> dict[int, int]:
    return {one["msgID"]: one["msgPeriod"] for one in pairs if one["msgID"] and one["msgPeriod"]}


def _differ(path: str, a: Any, b: Any) -> list[str]:
    if isinstance(a, list) and isinstance(b, list):
        if len(a) != len(b):
            return [path]
        return [row for place, (x, y) in enumerate(zip(a, b, strict=True)) for row in _differ(f"{path}.{place}", x, y)]
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        shared = [name for name in a if name in b]
        if not shared and a != b:
            return [path]
        return [row for name in shared for row in _differ(f"{path}.{name}", a[name], b[name])]
    if isinstance(a, float) or isinstance(b, float):
        return [] if _f4(a) == _f4(b) else [path]
    return [] if a == b else [path]


def _f4(value: Any) -> Any:
    """A number rounded to float32 if that is the only difference; others unchanged."""
    try:
        return struct.pack("<f", value)
    except (struct.error, OverflowError, TypeError):
        return value
