"""Date and time of day as nanoseconds since the Unix epoch."""

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Ints

UNKNOWN = -1
S = 1_000_000_000


def utc_ns(
    year: Ints, month: Ints, day: Ints, hour: Ints, minute: Ints, second: Ints, ns: Ints, valid: NDArray[np.bool_]
) -> Ints:
    """UTC of n calendar times.

    Args:
        ns: (n,) of the second, may be negative.
        valid: (n,) whether the sender marks each as valid.

    Returns:
        (n,) int64, ns since the Unix epoch; UNKNOWN if a time is marked invalid, or is not a time.
    """
    out = np.full(len(year), UNKNOWN, np.int64)
    good = valid & (year >= 1970) & (year < 2262) & (month >= 1) & (month <= 12) & (day >= 1) & (day <= 31)
    good &= (hour < 24) & (minute < 60) & (second <= 60) & (np.abs(ns) <= S)
    months = (year[good] - 1970) * 12 + month[good] - 1
    days = months.astype("datetime64[M]").astype("datetime64[D]").astype(np.int64) + day[good] - 1
    seconds = ((days * 24 + hour[good]) * 60 + minute[good]) * 60 + second[good]
    out[good] = seconds * S + ns[good]
    return out
