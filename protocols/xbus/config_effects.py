"""Effects of a change of settings: loss of the link, equality, and factory values.

Source: MT0101P 2020.A, 4.2 and 7.1 (defaults), 5.3.3 and 5.3.5 (what acts on the line); tables 7 and 22.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any

from imuscope.protocols.commands.transactions import BaudChange, DeviceContext, Values
from imuscope.protocols.xbus.enums import SEND_LATEST
from imuscope.protocols.xbus.output_configuration import ALWAYS
from imuscope.protocols.xbus.products import Model, model_of

BAUD_RATES: Mapping[int, int] = {  # table 7, with its errata
    **{0x0D: 4_000_000, 0x0E: 3_500_000, 0x0C: 2_000_000, 0x80: 921_600, 0x0A: 921_600, 0x00: 460_800, 0x01: 230_400},
    **{0x02: 115_200, 0x03: 76_800, 0x04: 57_600, 0x05: 38_400, 0x06: 28_800, 0x07: 19_200, 0x08: 14_400},
    **{0x09: 9_600, 0x0B: 4_800},
}
_PORTS = ("RS-232 host port", "UART host port")
_XBUS = 1
_FACTORY_BAUD = 115_200
_ALTERNATIVE_UART = 1 << 4
_DISABLE_AUTO_MEASUREMENT = 1 << 1


def line_change(setting: str, old: Values | None, new: Values, known: DeviceContext) -> BaudChange | None:
    if old is not None and not differing(setting, old, new):
        return None
    if setting == "Baudrate":
        return _baud_change(int(new["baudrate_code"]), known, "The device")
    if setting == "PortConfig":
        return _port_change([int(word) for word in (old or {}).get("words", ())], new["words"], known)
    if setting == "OutputConfiguration" and not any(entry["data_identifier"] for entry in new["outputs"]):
        return BaudChange("silent", "The device sends no data until an output is selected again.")
    if setting == "SyncSettings" and _sends_latest(new) and not _sends_latest(old or {"settings": []}):
        return BaudChange("silent", "The device sends data only when triggered (SendLatest).")
    if setting == "StringOutputType" and new["string_types"]:
        return BaudChange("protocol", "The device sends text lines in place of MTData2.")
    if setting == "OutputSkipFactor" and new["skip_factor"] == 0xFFFF:
        return BaudChange("silent", "The device sends strings only on request (ReqData).")
    if setting == "ExtOutputMode" and (int(new["mode"]) ^ int((old or {"mode": 0})["mode"])) & _ALTERNATIVE_UART:
        return BaudChange("port", "The device uses another UART after the reset.")
    if (
        setting == "OptionFlags"
        and int(new["flags"]) & ~int((old or {"flags": 0})["flags"]) & _DISABLE_AUTO_MEASUREMENT
    ):
        return BaudChange("silent", "The device no longer starts measuring by itself.")
    return None


def _baud_change(code: int, known: DeviceContext, who: str) -> BaudChange | None:
    rate = BAUD_RATES.get(code)
    if rate is None or rate == known.baud:
        return None
    return BaudChange("baud", f"{who} uses {rate:_} Bd after the reset.".replace("_", " "), rate)


def _port_change(old: list[int], new: list[int], known: DeviceContext) -> BaudChange | None:
    """Effect of changing the ports if it is unknown which of the two is in use: any Xbus port with our rate may be.

    If one of two such ports changes, the device may answer at the old rate or at the new one.
    """
    ours = own_places(old, known)
    changed = {place: _one_port(place, old, new, known) for place in ours}
    changes = [change for change in changed.values() if change is not None]
    if not changes:
        return None
    worst = next((change for change in changes if change.baud is None), changes[0])
    rates = [known.baud if change is None else change.baud for change in changed.values()]
    others = tuple(dict.fromkeys(rate for rate in rates if rate is not None and rate != worst.baud))
    words = " ".join(dict.fromkeys(change.words for change in changes))
    if None in changed.values():
        words += " The port of this link is unknown."
    return BaudChange(worst.kind, words, worst.baud, others)


def own_places(words: list[int], known: DeviceContext) -> list[int]:
    """The host ports that this line may be connected to: those with Xbus at its rate; if there are none, both."""
    hosts = [place for place, word in enumerate(words[:2]) if word >> 16 & 0xF == _XBUS]
    at_rate = [place for place in hosts if BAUD_RATES.get(words[place] & 0xFF) == known.baud]
    return at_rate or hosts or [0, 1]


def own_ports(values: Mapping[str, Values], known: DeviceContext) -> list[str]:
    words = [int(word) for word in values.get("PortConfig", {}).get("words", ())]
    return [f"PortConfig.words.{place}" for place in own_places(words, known)] if words and known.baud else []


def _one_port(place: int, old: list[int], new: list[int], known: DeviceContext) -> BaudChange | None:
    """Effect of the change of one port's word on a link connected to it."""
    word, before = int(new[place]), old[place] if place < len(old) else None
    if word >> 16 & 0xF != _XBUS:
        off = not word >> 16 & 0xF
        kind, does = ("port", "is switched off") if off else ("protocol", "uses NMEA")
        return BaudChange(kind, f"The {_PORTS[place]} {does} after the reset.")  # type: ignore[arg-type]
    if before is not None and (word ^ before) & 0xFF == 0 and word != before:
        return BaudChange("port", f"The {_PORTS[place]} changes its flow control or character format after the reset.")
    return _baud_change(word & 0xFF, known, f"The {_PORTS[place]}")


def rates(values: Mapping[str, Values], known: DeviceContext) -> tuple[int, ...]:
    codes = [int(values["Baudrate"]["baudrate_code"])] if "Baudrate" in values else []
    codes += [int(word) & 0xFF for word in values.get("PortConfig", {}).get("words", ())[:2]]
    candidates = (known.baud, *(BAUD_RATES.get(code) for code in codes), _FACTORY_BAUD)
    return tuple(dict.fromkeys(rate for rate in candidates if rate is not None))


def instead(
    command: str, values: Values, present: Mapping[str, Values], known: DeviceContext
) -> tuple[str, Values] | None:
    """See transactions.DeviceDriver.instead: the 600-series gets SetPortConfig, its SetBaudrate is deprecated."""
    model = model_of(known.product)
    if command != "SetBaudrate" or model is None or model.series != 600:
        return None
    words = [int(word) for word in present.get("PortConfig", {}).get("words", ())]
    if not words:
        return "PortConfig", {}
    code, ours = int(values["baudrate_code"]), own_places(words, known)
    return "PortConfig", {"words": [word & ~0xFF | code if n in ours else word for n, word in enumerate(words)]}


def _sends_latest(values: Values) -> set[int]:
    """The lines on which SendLatest waits for a trigger."""
    return {int(one["line"]) for one in values["settings"] if one["function"] == SEND_LATEST and one["polarity"]}


# -- comparison --------------------------------------------------------------------------------------------------------

_FLOAT32_TOLERANCE = 1e-6  # relative: precision of float32 for a decimal number


def differing(setting: str, a: Values, b: Values) -> list[str]:
    """Paths of the fields whose meaning differs between two values of a setting."""
    if setting == "OutputConfiguration":
        a, b = ({"outputs": [dict(entry) for entry in side["outputs"] if any(entry.values())]} for side in (a, b))
        if _bag(a) == _bag(b):
            return []  # the order of the list is irrelevant
    if setting == "FilterProfile":
        a, b = ({"profile": side["profile"]} for side in (a, b) if "profile" in side)
    return list(dict.fromkeys(_paths(setting, a, b, "")))


def _bag(values: Values) -> list[tuple[int, int]]:
    return sorted((entry["data_identifier"], entry["output_frequency"] or ALWAYS) for entry in values["outputs"])


def _paths(setting: str, a: Any, b: Any, path: str) -> Iterator[str]:
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        for name in dict.fromkeys([*a, *b]):
            here = f"{path}.{name}" if path else str(name)
            if name not in a or name not in b:
                yield here
            else:
                yield from _paths(setting, a[name], b[name], here)
    elif isinstance(a, (list, tuple)) and isinstance(b, (list, tuple)):
        for place in range(max(len(a), len(b))):
            if place >= len(a) or place >= len(b):
                yield f"{path}.{place}"
            else:
                yield from _paths(setting, a[place], b[place], f"{path}.{place}")
    elif not _equal(setting, a, b):
        yield path


def _equal(setting: str, a: Any, b: Any) -> bool:
    if isinstance(a, str) or isinstance(b, str):
        return bool(a == b)
    if isinstance(a, (int, float)) and isinstance(b, (int, float)):
        if setting == "Baudrate":
            return BAUD_RATES.get(int(a), a) == BAUD_RATES.get(int(b), b)
        if setting == "PortConfig":
            a, b = int(a), int(b)
            return a >> 8 == b >> 8 and BAUD_RATES.get(a & 0xFF) == BAUD_RATES.get(b & 0xFF)
        return (
            math.isclose(a, b, rel_tol=_FLOAT32_TOLERANCE, abs_tol=_FLOAT32_TOLERANCE / 10)
            if isinstance(a, float) or isinstance(b, float)
            else a == b
        )
    return bool(a == b)


# -- factory -----------------------------------------------------------------------------------------------------------

_HZ = 100
_FRONT, _END = ((0x1020, ALWAYS), (0x1060, ALWAYS)), ((0xE020, ALWAYS),)
_PROFILES: Mapping[int, int | str] = {  # table 40 and 4.2
    **{2: 54, 3: 50, 7: 11, 20: 43, 30: 39, 200: 43, 300: 39, 710: 1},
    **{620: "Responsive/VRU", 630: "Responsive/NorthReference", 670: "General", 680: "General_RTK"},
}


def factory_outputs(model: Model) -> tuple[tuple[int, int], ...]:
    """The factory output configuration of a product."""
    if model.kind == "IMU":
        return (*_FRONT, (0x8030, _HZ), (0x4010, _HZ), (0xC020, _HZ), *_END)
    place = ((0x5022, _HZ), (0x5042, _HZ), (0xD012, _HZ)) if model.kind in ("GNSS", "RTK") else ()
    return (*_FRONT, (0x2010, _HZ), *place, *_END)


def factory(model: Model | None) -> dict[str, Values]:
    """The documented factory defaults; none if the product is unknown."""
    if model is None:
        return {}
    unity = {"q0": 1.0, "q1": 0.0, "q2": 0.0, "q3": 0.0}
    pairs = factory_outputs(model)
    values: dict[str, Values] = {
        "OutputConfiguration": {"outputs": [{"data_identifier": i, "output_frequency": rate} for i, rate in pairs]},
        "LocationID": {"location_id": 0},
        "AlignmentRotation.RotSensor": unity,
        "AlignmentRotation.RotLocal": unity,
    }
    if model.number in _PROFILES:
        values["FilterProfile"] = {"profile": _PROFILES[model.number]}
    if model.kind not in ("GNSS", "RTK"):
        values["SyncSettings"] = {"settings": []}
    if model.series == 600:
        values["StringOutputType"] = {"string_types": 0, "frequency": 0}
    else:
        values["Baudrate"] = {"baudrate_code": 2}
    if model.series in (10, 100):
        values |= {"StringOutputType": {"string_types": 0}, "OutputSkipFactor": {"skip_factor": 0}}
        values["Period"] = {"period": 1152}
    return values
