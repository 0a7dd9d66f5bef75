"""Units of columns: stored in those in which the device sent them, converted only where they are read.

    stored  rad/s f4 ──× 57.3──> °/s f4       "shown": as on the page
                     ├─────────> rad/s f4     "device": as sent
                     └──× 1────> rad/s f4     "SI": rad, m, s, T and Pa; float64 where that is a conversion

°C and units that a device has for itself stay in "SI".
"""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, get_args

import numpy as np

from imuscope.protocols.arrays import Array
from imuscope.protocols.schema.units import Unit

Units = Literal["shown", "SI", "device"]
UNITS: tuple[Units, ...] = get_args(Units)


def scaled(column: Array, factor: float) -> Array:
    """A column in another unit. Divides where exact: 99 990 mm are 99.99 m, times 0.001 it is 99.99000000000001.

    A Python number preserves float32; the largest one in °/s is infinite.
    """
    with np.errstate(over="ignore"):
        return column / round(1 / factor) if factor < 1 and (1 / factor).is_integer() else column * factor


def described_in(
    info: Mapping[str, Any], shown: Sequence[float], units: Units
) -> tuple[Mapping[str, Any], tuple[float, ...]]:
    """A channel of the manifest in other units, and the factors from its stored columns to these.

    Args:
        info: in the units of the page.
        shown: factors from the stored columns to those; none if all are 1.
    """
    columns, factors = [], []
    for column, factor in zip(info["columns"], shown or (1.0,) * len(info["columns"]), strict=True):
        stored = column["unit"] if factor == 1 else column["sent_unit"]
        own = Unit.parse(stored)
        is_converted = units == "SI" and own.factor != 1
        by, unit = (own.factor, str(Unit(tuple(own.dimensions.items())))) if is_converted else (1.0, stored)
        if unit != column["unit"]:
            dtype = "f8" if is_converted else column["dtype"]
            period = column["period"] / factor * by
            column = {**column, "unit": unit, "dtype": dtype, "decimals": -1, "period": period}
        columns.append(column)
        factors.append(by)
    unit = columns[0]["unit"] if info["unit"] else ""
    return {**info, "unit": unit, "columns": columns}, tuple(factors)
