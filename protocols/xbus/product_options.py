"""Options of each product: flags, functions, lines and profiles, and their combinations.

Tables 8, 11, 12 and 30 mark each option flag, sync function, sync line and filter profile with its products. `fitted`
narrows a field to one product; `problems_beyond` finds problems across fields: a sync line that its function does not
allow, a duplicate output, a quaternion that is not a rotation.

Source: MT0101P 2020.A, 5.3.3 to 5.3.7.
"""

import math
from calendar import monthrange
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from imuscope.protocols.schema.fields import Field
from imuscope.protocols.schema.validation import ValueProblem
from imuscope.protocols.xbus.enums import (
    BAUD_CODES,
    CLOCK_BIAS,
    FILTER_PROFILES,
    ICC_COMMANDS,
    INTERVAL,
    OPTION_FLAGS,
    PULSE,
    RESET_CODES,
    SEND_LATEST,
    START_SAMPLING,
    SYNC_FUNCTIONS,
    SYNC_LINES,
    SYNC_OUT,
    TRIGGER,
)
from imuscope.protocols.xbus.output_configuration import OUTPUTS, output_of
from imuscope.protocols.xbus.products import ALL, CLASSIC, GNSS, INTERNAL_GNSS, NO_PRODUCTS, ONE, RTK, SIX, Model

_OPTIONS: Mapping[str, frozenset[int]] = {  # table 8
    "DisableAutoStore": ONE,
    "DisableAutoMeasurement": ONE,
    "EnableBeidou": frozenset({7, 670, 710}),
    "EnableAhs": ONE | CLASSIC,
    "EnableOrientationSmoother": frozenset({670, 680, 710}),
    "EnableConfigurableBusId": CLASSIC | SIX,
    "EnableInRunCompassCalibration": ALL,
    "EnableConfigMessageAtStartup": ONE,
    "EnableColdFilterResets": frozenset({670, 680}),
    "EnablePositionVelocitySmoother": RTK,
    "EnableContinuousZRU": RTK,
}

_OLD = CLASSIC | SIX
SYNC_ON: Mapping[int, frozenset[int]] = {  # table 11
    TRIGGER: _OLD,
    INTERVAL: _OLD,
    SEND_LATEST: ALL,
    CLOCK_BIAS: _OLD | {7},
    START_SAMPLING: _OLD,
    PULSE: GNSS,
}
_LINES_OUT = (4, 7, 8, 10)  # table 12; In3 of the MTi-680G has its receiver's own pulse
_SYNC_OUT_LINES = (4, 7)
PULSE_LINES: Mapping[int, tuple[int, ...]] = {  # table 12 with its notes 1, 5 and 6
    7: (8,),
    710: (4,),
    670: (2, 9, 7),
    680: (10, 7),
}
LINE_NOTES: tuple[tuple[frozenset[int], str], ...] = (  # table 12, notes 2 to 6
    (CLASSIC, "ClockIn is inverted: choose the opposite polarity there."),
    (frozenset({7}), "An external reference clock for ClockBiasEstimation is connected to In1."),
    (SIX, "Reference clocks and external time pulses are connected to In1 or In2."),
    (frozenset({670}), "Gnss1Pps on In1 or In2 enables the time pulse."),
    (RTK, "Gnss1Pps is always enabled on In3."),
)
MAX_ICC = 3  # table 36; further commands are from the vendor's own software
LONGEST_PERIOD = 1152  # 10 ms; a longer one is made from it and a skip factor (5.3.5)
SOFTWARE = 6

_PROFILES: Mapping[str, range | tuple[int, ...]] = {  # table 30
    "MTi-7": (11, 12, 13),
    "GNSS": (1, 2, 3, 4, 5),  # MTi-G-700 and MTi-G-710; the 600-series has labels
    "VRU1": (54,),
    "VRU": (43,),
    "AHRS1": range(50, 55),
    "AHRS": range(39, 44),
}


def lines_of(model: Model) -> tuple[int, ...]:
    """Sync lines of a product (table 12); all where the document does not have it."""
    if model.name == INTERNAL_GNSS:
        return tuple(SYNC_LINES)
    if model.series == 600:
        return (2, 9, 10, 7, SOFTWARE) if model.number in RTK else (2, 9, 7, SOFTWARE)
    own = {7: (2, 1, 8, SOFTWARE), 710: (2, 0, 1, 5, 4, SOFTWARE)}
    return own.get(model.number, (2, 0, 4, SOFTWARE))


def is_wired(function: int, line: int, model: Model | None = None) -> bool:
    """Whether the line has the direction required by the function."""
    if function == PULSE:
        any_line = {one for some in PULSE_LINES.values() for one in some}
        return line in (any_line if model is None or model.name == INTERNAL_GNSS else PULSE_LINES.get(model.number, ()))
    return line in _SYNC_OUT_LINES if function in SYNC_OUT else line not in _LINES_OUT


def functions_of(model: Model) -> tuple[int, ...]:
    """Sync functions of a product (table 11)."""
    return tuple(number for number, on in SYNC_ON.items() if model.number in on)


def profiles_of(model: Model) -> tuple[int, ...]:
    """Numbers of a product's filter profiles; none in the 600-series, whose profiles have labels."""
    if model.series == 600 or model.kind == "IMU":
        return ()
    return tuple(_PROFILES.get(model.name) or _PROFILES[model.kind + "1" * (model.series == 1)])


LABELS: Mapping[int, tuple[tuple[str, ...], tuple[str, ...]]] = {
    620: (("Responsive", "Robust", "General"), ("VRU", "VRUAHS")),
    630: (("Responsive", "Robust", "General"), ("FixedMagRef", "NorthReference", "VRU", "VRUAHS")),
    670: (("General", "GeneralNoBaro", "GeneralMag"), ()),
    680: (("General_RTK", "GeneralNoBaro_RTK", "GeneralMag_RTK"), ()),
}
"""Filter profiles of the 600-series: labels, and the heading behaviours that go with them after a slash."""


PORT_NAMES = ("RS-232", "UART", "RTCM input")
"""Ports of the 600-series, in the order of the words of SetPortConfig."""


def fitted(message: str, field: Field, model: Model | None) -> Field:
    """A field of a message for one product; as in the document if the product is unknown."""
    if message == "SetOptionFlags":
        return _options(field, model)
    if message == "SetSyncSettings":
        return replace(field, fields=tuple(_sync(part, model) for part in field.fields))
    if message == "SetFilterProfile":
        return _profile(field, model)
    if message == "SetPortConfig":
        return replace(field, shape=(len(PORT_NAMES),), axes=PORT_NAMES)
    if message == "SetBaudrate":
        return replace(field, choices={code: name for code, name in BAUD_CODES.items() if code != 0xFF}, default=2)
    if message == "ResetOrientation":
        gone = {2} if model is None or model.number not in GNSS else {1, 2}
        return replace(field, choices={code: name for code, name in RESET_CODES.items() if code not in gone}, default=3)
    if message == "IccCommand" and model is not None:
        return replace(field, choices={code: name for code, name in ICC_COMMANDS.items() if code <= MAX_ICC})
    if message == "ResetOrientation.Stored":
        known = fitted("ResetOrientation", field, model)
        return replace(known, choices={code: name for code, name in known.choices.items() if code})
    return field


def _options(field: Field, model: Model | None) -> Field:
    bits = (bit for bit in OPTION_FLAGS if model is None or model.number in _OPTIONS.get(bit.name, NO_PRODUCTS))
    return replace(field, bits=tuple(bits), default=0)


def _sync(part: Field, model: Model | None) -> Field:
    if part.name == "function":
        functions = functions_of(model) if model else tuple(SYNC_ON)
        return replace(part, choices={n: SYNC_FUNCTIONS[n] for n in functions}, default=SEND_LATEST)
    if part.name == "line" and model is not None:
        doc = " ".join([part.doc, *(note for products, note in LINE_NOTES if model.number in products)])
        return replace(part, choices={n: SYNC_LINES[n] for n in lines_of(model)}, default=2, doc=doc)
    return part


def _profile(field: Field, model: Model | None) -> Field:
    if field.dtype == "ascii":
        labels, headings = LABELS.get(model.number if model else 0, ((), ()))
        known = f" Labels: {', '.join(labels)}." if labels else ""
        known += f" Headings: {', '.join(headings)}." if headings else ""
        options = tuple(f"{label}/{heading}" for label in labels for heading in headings) or labels
        return replace(field, doc=field.doc + known, options=options)
    numbers = profiles_of(model) if model else tuple(FILTER_PROFILES)
    return replace(field, choices={n: FILTER_PROFILES[n] for n in numbers}, default=numbers[0] if numbers else None)


# -- combinations ------------------------------------------------------------------------------------------------------


def problems_beyond(
    message: str, values: Mapping[str, Any], model: Model | None, old: Mapping[str, Any] | None = None
) -> Iterator[ValueProblem]:
    """Problems of values that are each within range.

    Args:
        old: what the device reports: it knows better than the tables which of these it has.
    """
    old = old or {}
    if message == "SetOutputConfiguration":
        reported = {entry["data_identifier"] for entry in old.get("outputs", ())}
        yield from _of_outputs(values["outputs"], model, reported)
    elif message == "SetSyncSettings":
        for place, entry in enumerate(values["settings"]):
            if entry not in old.get("settings", ()):
                yield from _of_sync(entry, f"settings.{place}", model)
    elif message == "SetAlignmentRotation":
        norm = math.hypot(*(values[name] for name in ("q0", "q1", "q2", "q3")))
        if not abs(norm - 1) <= 0.01:
            yield ValueProblem("q0", f"q0 to q3 make a unit quaternion, given one of length {norm:.4g} (0.99 to 1.01)")
    elif message == "AdjustUTCTime" and values["correction"] == 0:
        yield ValueProblem("correction", "correction lies between -10000 and 10000 and is not 0, given 0")
    elif message == "SetPeriod" and values["period"] > LONGEST_PERIOD and values["period"] % LONGEST_PERIOD:
        allowed = "225 to 1152, or a multiple of 1152 (10 ms), of which the device skips"
        yield ValueProblem("period", f"period is {allowed}, given {values['period']}")
    elif message == "SetPortConfig":
        yield from _of_ports(values["words"], old.get("words", ()))
    elif message == "SetOptionFlags":
        yield from _of_options(values["set_flags"] & ~old.get("flags", 0), model)
    elif message == "SetUTCTime":
        yield from _of_date(values)


def _of_options(word: int, model: Model | None) -> Iterator[ValueProblem]:
    for bit in OPTION_FLAGS:
        if model and word >> bit.low & 1 and bit.name in _OPTIONS and model.number not in _OPTIONS[bit.name]:
            yield ValueProblem("set_flags", f"{model.name} has no option flag {bit.name} (0x{1 << bit.low:X})")


def _of_date(values: Mapping[str, Any]) -> Iterator[ValueProblem]:
    year, month = values["year"], values["month"]
    last = monthrange(year, month)[1]
    if values["day"] > last:
        yield ValueProblem("day", f"day lies between 1 and {last} in {year}-{month:02}, given {values['day']}")


def _of_outputs(
    outputs: list[Mapping[str, Any]], model: Model | None, reported: Collection[int]
) -> Iterator[ValueProblem]:
    if [(entry["data_identifier"], entry["output_frequency"]) for entry in outputs] == [(0, 0)]:
        return  # encoding of an empty list
    known: set[int] = set()
    for place, entry in enumerate(outputs):
        identifier = entry["data_identifier"]
        path, plain = f"outputs.{place}.data_identifier", identifier & 0xFFF0
        if output_of(identifier, model) is None and identifier not in reported:
            why = "has no such form" if output_of(plain, model) else "has no such data"
            if not output_of(plain, model) and plain in OUTPUTS and model:
                why = f"has no {OUTPUTS[plain].name}"
            yield ValueProblem(path, f"data_identifier 0x{identifier:04X}: {model.name if model else 'an MTi'} {why}")
        elif identifier in known:
            yield ValueProblem(path, f"data_identifier 0x{identifier:04X} is listed twice; remove one")
        known.add(identifier)


def _of_sync(entry: Mapping[str, Any], path: str, model: Model | None) -> Iterator[ValueProblem]:
    function, line = entry["function"], entry["line"]
    if not entry["polarity"]:
        return  # disabled
    if line == SOFTWARE and function != SEND_LATEST:
        yield ValueProblem(
            f"{path}.line", f"line 6 (Software) goes with SendLatest (8) only, given function {function}"
        )
    if not is_wired(function, line, model):
        way = "an output" if function in SYNC_OUT else "an input"
        if function == PULSE and model is not None and model.number in PULSE_LINES:
            way = " or ".join(f"line {one} ({SYNC_LINES[one]})" for one in PULSE_LINES[model.number])
        yield ValueProblem(
            f"{path}.line", f"{SYNC_FUNCTIONS[function]} goes with {way}, given line {line} ({SYNC_LINES[line]})"
        )


def _of_ports(words: Sequence[int], reported: Sequence[int]) -> Iterator[ValueProblem]:
    for place, word in enumerate(words):
        if reported[place : place + 1] == [word]:
            continue
        if word & 0xFF not in BAUD_CODES or word & 0xFF == 0xFF:
            yield ValueProblem(
                f"words.{place}", f"{PORT_NAMES[place]}: choose one of the baud rates, given code {word & 0xFF}"
            )
        elif place < 2 and word >> 16 & 0xF not in (0, 1, 5):
            allowed = "0 (none), 1 (Xbus) or 5 (NMEA)"
            yield ValueProblem(
                f"words.{place}", f"{PORT_NAMES[place]}: the protocol is {allowed}, given {word >> 16 & 0xF}"
            )
