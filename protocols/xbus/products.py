"""Products of the MTi family and their properties.

The document marks every message, data identifier, option flag and sync function with its products. This module has the
list of products and the recurring sets of these marks:

    series          1            10           100                 600
    IMU             MTi-1        MTi-10       MTi-100             MTi-610
    VRU             MTi-2        MTi-20       MTi-200             MTi-620
    AHRS            MTi-3        MTi-30       MTi-300             MTi-630
    GNSS/INS        MTi-7                     MTi-G-700, -710     MTi-670
    RTK GNSS/INS                                                  MTi-680G

`model_of` reads a product code as sent by devices ("MTi-630-8A1G6", "MTi-G-710-2A8G4"); a rugged one ("MTi-630R") has
the rules of its plain form, and an MTi-670G those of an MTi-670 but for its sync lines. For a product without rules
here (MTi-8, MTi-320, Avior, Sirius) everything is offered, the form says so, and the device refuses what it lacks.

Source: MT0101P 2020.A, Introduction and the product rows of 5.3; names of newer products from the vendor's public code.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import radians
from typing import Any, Literal

from imuscope.protocols.family.sensor_properties import SensorProperties

Kind = Literal["IMU", "VRU", "AHRS", "GNSS", "RTK"]


@dataclass(frozen=True, slots=True)
class Model:
    """One product.

    Args:
        number: as in the document's product rows (710 for the MTi-G-710, 680 for the MTi-680G).
        series: 1, 10, 100 or 600; the MTi-G-710 belongs to the 100-series.
        early: its hardware is older than version 2.0.
        late: its hardware has version 2.0 or newer.
    """

    name: str
    number: int
    series: int
    kind: Kind
    early: bool = False
    late: bool = False


MODELS: Mapping[int, Model] = {
    model.number: model
    for model in (
        Model("MTi-1", 1, 1, "IMU"),
        Model("MTi-2", 2, 1, "VRU"),
        Model("MTi-3", 3, 1, "AHRS"),
        Model("MTi-7", 7, 1, "GNSS"),
        Model("MTi-10", 10, 10, "IMU"),
        Model("MTi-20", 20, 10, "VRU"),
        Model("MTi-30", 30, 10, "AHRS"),
        Model("MTi-100", 100, 100, "IMU"),
        Model("MTi-200", 200, 100, "VRU"),
        Model("MTi-300", 300, 100, "AHRS"),
        Model("MTi-G-710", 710, 100, "GNSS"),
        Model("MTi-610", 610, 600, "IMU"),
        Model("MTi-620", 620, 600, "VRU"),
        Model("MTi-630", 630, 600, "AHRS"),
        Model("MTi-670", 670, 600, "GNSS"),
        Model("MTi-680G", 680, 600, "RTK"),
    )
}

ALL = frozenset(MODELS)
ONE = frozenset(n for n, model in MODELS.items() if model.series == 1)
CLASSIC = frozenset(n for n, model in MODELS.items() if model.series in (10, 100))
SIX = frozenset(n for n, model in MODELS.items() if model.series == 600)
IMU = frozenset(n for n, model in MODELS.items() if model.kind == "IMU")
GNSS = frozenset(n for n, model in MODELS.items() if model.kind in ("GNSS", "RTK"))
FILTER = ALL - IMU
RTK = frozenset({680})
BARO = frozenset({7}) | SIX | {100, 200, 300, 710}
NO_PRODUCTS: frozenset[int] = frozenset()
"""Features of no product of this document: deprecated, or known from the devices' own software only."""

_CODE = re.compile(r"MTi-(?:G-)?(\d+)([GR]?)(?![0-9A-Za-z])")
INTERNAL_GNSS = "MTi-670G"


def model_of(product: str) -> Model | None:
    """The product of a code or name; None if it is not in this document.

    The MTi-G-700 preceded the MTi-G-710; the document treats the two together, so it has the other's number here.
    """
    match = _CODE.match(product.strip())
    if match and match[1] == "700":
        return replace(MODELS[710], name="MTi-G-700")
    model = MODELS.get(int(match[1])) if match else None
    own_name = match is not None and (match[2] == "R" or match[0] == INTERNAL_GNSS)
    return replace(model, name=match[0]) if model is not None and match is not None and own_name else model


def as_built(model: Model | None, hardware: Mapping[str, Any]) -> Model | None:
    """The product adjusted by its hardware version; `hardware`: major and minor, empty if unknown."""
    major = int(hardware.get("major", 0))
    return replace(model, early=major < 2, late=major >= 2) if model is not None and major else model


def absent(product: str) -> tuple[str, ...]:
    """Flags of the status word that a product lacks: they would look like a permanent fault (table 27)."""
    model = model_of(product)
    if model is None or model.kind == "RTK":
        return ()
    without_rtk = ("RtkStatus",)
    if model.kind == "GNSS":
        return without_rtk
    without_gnss = ("GnssFix", "FilterMode", *without_rtk)
    if model.kind != "IMU":
        return without_gnss
    return ("FilterValid", "NoRotationUpdateStatus", "RepresentativeMotion", "FilterInputStart", *without_gnss)


def has(model: Model | None, on: frozenset[int]) -> bool:
    """Whether this product has the features marked with `on`. An unknown one may have anything."""
    return model is None or model.number in on


# Noise of the sensors, and the accuracy of their attitude.
#
#     series      gyroscopes                accelerometers           roll and pitch; heading
#     1           -                         -                        -
#     10          0.03 °/s/√Hz, 18 °/h      60 µg/√Hz, 15 µg         0.5°; 1° (MTi-30)
#     100         0.01 °/s/√Hz, 10 °/h      60 µg/√Hz, 15 µg         0.2°; 1° (MTi-300)
#     600         0.007 °/s/√Hz, 8 °/h      60 µg/√Hz, 15 µg         -
#
# The second figure of a sensor is its in-run bias stability. An IMU has no attitude, and the heading of a VRU is not
# referenced. A dash stands for a figure that no document at hand gives; a covariance that needs it is unknown.
# The body's axes are x forward, y left, z up, as printed on the housing.
#
# Source: MTi 10-series and MTi 100-series User Manual, MT0605P, sensor specifications; product sheet of the MTi-300
# (Movella, May 2023); MTi 600-series Datasheet, MT1603P 2020.A.
MICRO_G = 9.80665e-6


def _series(turn: float, turn_bias: float) -> SensorProperties:
    """Properties of a series: °/s/√Hz and °/h of its gyroscopes; the accelerometers are the same in all."""
    return SensorProperties(
        turn=radians(turn),
        acceleration=60 * MICRO_G,
        turn_bias=radians(turn_bias / 3600),
        acceleration_bias=15 * MICRO_G,
    )


_BY_SERIES = {1: SensorProperties(), 10: _series(0.03, 18), 100: _series(0.01, 10), 600: _series(0.007, 8)}
_TILT = {10: 0.5, 100: 0.2}  # °, by series
_HEADING = {30: 1.0, 300: 1.0}  # °, by model


def sensors_of(product: str) -> SensorProperties:
    """Properties of a product, by its code."""
    model = model_of(product)
    if model is None:
        return SensorProperties()
    tilt = radians(_TILT.get(model.series, 0.0)) if model.kind != "IMU" else 0.0
    return replace(_BY_SERIES[model.series], tilt=tilt, heading=radians(_HEADING.get(model.number, 0.0)))
