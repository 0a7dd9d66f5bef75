"""Outputs of an MTi: identifiers, rates and groups.

`OUTPUTS` is table 16: every data identifier with its products and its greatest rate. A device turns a requested rate
into the greatest one that divides the item's own and is not above the request; 0 and 0xFFFF request the greatest. Items
of time and status accompany every message and have no rate (0xFFFF).

An output configuration becomes streams of messages:

    main      one message a tick of the fastest item, holding the items due at that tick and all accompanying ones
    gnss      a message of its own for each of the receiver's items, followed by the items of time, last one first
    hr        a message of its own for each high-rate item, with the items of time
    scr       the sensors' raw readings, with the items of time

At different rates a tick's message contains only the items due: with a quaternion at 100 Hz and an acceleration at
400 Hz, three messages of four carry no quaternion.

Source: MT0101P 2020.A, tables 16, 17, 23 and 24; the separate messages of GNSS items, and their content, are known from
captures. The high rate of a 1-series device depends on its hardware: 800 Hz from 2.0 on, before that 1000 Hz; that of a
600-series' RateOfTurnHR is 2000 Hz from 2.0 on.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

from imuscope.protocols.schema.fields import Field
from imuscope.protocols.schema.layouts import is_open, size_of
from imuscope.protocols.xbus.data_identifiers import BY_NAME
from imuscope.protocols.xbus.products import ALL, BARO, CLASSIC, FILTER, GNSS, ONE, Model, has

ALWAYS = 0xFFFF  # output frequency of items in every message
TIME = 0x10  # high byte of the items that also accompany the messages of the other streams
ORDER = ("main", "gnss", "hr", "scr")
SIX_HERTZ: Mapping[str, int] = {"BaroPressure": 100, "Temperature": 400}
"""Rates of the 600-series above those of table 16, by the vendor's public code."""
IDLE_HZ = 100  # rate of messages with nothing but accompanying items
SATELLITES = 28  # assumed length of their list, from a capture; it varies


@dataclass(frozen=True, slots=True)
class Output:
    """An available output quantity.

    Args:
        identifier: in its plain form, float32 and ENU.
        hertz: the greatest rate; ALWAYS for items in every message.
        real: True if the identifier selects the precision.
        local: True if it selects the coordinate system.
        products: products that have it.
        stream: "main", "gnss", "scr" or "hr".
        basic: False for rarely used ones.
    """

    identifier: int
    name: str
    hertz: int
    real: bool = True
    local: bool = False
    products: frozenset[int] = ALL
    stream: str = "main"
    group: str = ""
    basic: bool = True

    @property
    def field(self) -> Field:
        """The row of data_identifiers.py: title, unit, doc."""
        return BY_NAME[self.name]

    def size(self, identifier: int) -> int:
        """Bytes of its data in the form of a full identifier; of the satellites' list, with SATELLITES."""
        field = self.field
        if field.dtype == "real":
            return size_of(replace(field, dtype=(">f4", "fp1220", "fp1632", ">f8")[identifier & 3]))
        parts = field.fields or (field,)
        return sum(size_of(part) * (SATELLITES if is_open(part) else 1) for part in parts)


_TIME, _ATTITUDE, _INERTIAL, _PLACE, _RECEIVER, _OTHER = (
    *("Time and status", "Orientation", "Inertial and magnetic", "Position and velocity", "GNSS receiver", "Other"),
)

OUTPUTS: Mapping[int, Output] = {
    row.identifier: row
    for row in (
        Output(0x1020, "PacketCounter", ALWAYS, real=False, group=_TIME),
        Output(0x1060, "SampleTimeFine", ALWAYS, real=False, group=_TIME),
        Output(0x1070, "SampleTimeCoarse", ALWAYS, real=False, group=_TIME, basic=False),
        Output(0x1010, "UtcTime", ALWAYS, real=False, group=_TIME),
        Output(0xE020, "StatusWord", ALWAYS, real=False, group=_TIME),
        Output(0xE010, "StatusByte", ALWAYS, real=False, group=_TIME, basic=False),
        Output(0xE080, "DeviceId", ALWAYS, real=False, products=CLASSIC, group=_TIME, basic=False),
        Output(0xE090, "LocationId", ALWAYS, real=False, products=CLASSIC, group=_TIME, basic=False),
        Output(0x2010, "Quaternion", 400, local=True, products=FILTER, group=_ATTITUDE),
        Output(0x2030, "EulerAngles", 400, local=True, products=FILTER, group=_ATTITUDE),
        Output(0x2020, "RotationMatrix", 400, local=True, products=FILTER, group=_ATTITUDE, basic=False),
        Output(0x4020, "Acceleration", 400, group=_INERTIAL),
        Output(0x8020, "RateOfTurn", 400, group=_INERTIAL),
        Output(0xC020, "MagneticField", 100, group=_INERTIAL),
        Output(0x4030, "FreeAcceleration", 400, products=FILTER, group=_INERTIAL),
        Output(0x4010, "DeltaV", 400, group=_INERTIAL),
        Output(0x8030, "DeltaQ", 400, group=_INERTIAL),
        Output(0x4040, "AccelerationHR", 2000, stream="hr", group=_INERTIAL, basic=False),
        Output(0x8040, "RateOfTurnHR", 1600, stream="hr", group=_INERTIAL, basic=False),
        Output(0xA010, "RawAccGyrMagTemp", 2000, False, products=CLASSIC, stream="scr", group=_INERTIAL, basic=False),
        Output(0xA020, "RawGyroTemp", 2000, False, products=CLASSIC, stream="scr", group=_INERTIAL, basic=False),
        Output(0x5040, "LatLon", 400, products=GNSS, group=_PLACE),
        Output(0x5020, "AltitudeEllipsoid", 400, products=GNSS, group=_PLACE),
        Output(0xD010, "VelocityXYZ", 400, local=True, products=GNSS, group=_PLACE),
        Output(0x5030, "PositionEcef", 400, products=GNSS, group=_PLACE, basic=False),
        Output(0x7010, "GnssPvtData", 4, real=False, products=GNSS, stream="gnss", group=_RECEIVER),
        Output(0x7020, "GnssSatInfo", 4, real=False, products=GNSS - ONE, stream="gnss", group=_RECEIVER),
        Output(
            0x7030,
            "GnssPvtPulse",
            4,
            False,
            products=frozenset({670, 680}),
            stream="gnss",
            group=_RECEIVER,
            basic=False,
        ),
        Output(0x3010, "BaroPressure", 50, real=False, products=BARO, group=_OTHER),
        Output(0x0810, "Temperature", 1, group=_OTHER),
    )
}


def output_of(identifier: int, model: Model | None = None) -> Output | None:
    """The row for a full identifier, precision and coordinate system included; None if the product lacks it."""
    output = OUTPUTS.get(identifier & 0xFFF0)
    if output is None or not has(model, output.products):
        return None
    precision, local = identifier & 3, identifier & 0xC
    if (precision and not output.real) or (local and not output.local) or local == 0xC:
        return None
    return output


def max_rate(output: Output, model: Model | None = None) -> int:
    """The greatest rate of an item in a product, Hz; ALWAYS for accompanying ones."""
    if model is None or output.hertz == ALWAYS:
        return output.hertz
    if model.series == 600:
        return 2000 if output.name == "RateOfTurnHR" and model.late else SIX_HERTZ.get(output.name, output.hertz)
    if output.stream == "hr" and model.series != 600:
        return 800 if model.series == 1 and not model.early else 1000
    return min(output.hertz, 100) if model.series == 1 and output.hertz == 400 else output.hertz


def accepted_rates(requested: int, most: int) -> int:
    """The rate that a device grants for `requested` Hz: the greatest that divides `most` and is not above it."""
    if most == ALWAYS or requested in (0, ALWAYS) or requested >= most:
        return most
    return max(rate for rate in allowed(most) if rate <= requested)


@lru_cache(maxsize=64)
def allowed(most: int) -> tuple[int, ...]:
    """Rates that divide `most`, Hz, greatest first; none for accompanying items."""
    return () if most == ALWAYS else tuple(rate for rate in range(most, 0, -1) if most % rate == 0)


@dataclass(frozen=True, slots=True)
class OutputStream:
    """Items sent together.

    Args:
        items: (identifier, Hz) in the order of the message.
        rate: ticks/s: every item's rate divides it.
    """

    kind: str
    items: tuple[tuple[int, int], ...]
    rate: int


def streams(configuration: Sequence[tuple[int, int]]) -> list[OutputStream]:
    """The streams of an output configuration with granted rates: main, then GNSS, then the others."""
    always = tuple(pair for pair in configuration if pair[1] == ALWAYS)
    time = tuple(pair for pair in always if pair[0] >> 8 == TIME)
    together: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for identifier, rate in configuration:
        output = OUTPUTS.get(identifier & 0xFFF0)
        if rate != ALWAYS and output is not None:
            alone = output.name if output.stream in ("gnss", "hr") else ""
            together.setdefault((output.stream, alone), []).append((identifier, rate))
    if not together and always:
        together["main", ""] = []
    out = []
    for (kind, _), items in sorted(together.items(), key=lambda one: (ORDER.index(one[0][0]), one[0][1])):
        keep = always if kind == "main" else time
        ordered = tuple(pair for pair in configuration if pair in items or pair in keep)
        if kind == "gnss":
            ordered = (*items, *reversed(time))
        out.append(OutputStream(kind, ordered, math.lcm(*(rate for _, rate in items)) if items else IDLE_HZ))
    return out
