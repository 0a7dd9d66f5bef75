"""Unix time: whole ns from the wire to an export, float s where a page draws."""

import numpy as np

from imuscope.protocols.arrays import Floats, Ints
from imuscope.protocols.clocks.kernels import NO_TIME, float_seconds

__all__ = ("NO_TIME", "nanoseconds", "seconds")

LAST_S = 9_223_372_036  # in 2262: 2⁶³ ns


def seconds(times_ns: Ints) -> Floats:
    """Unix s of unix ns, as near as a float is (0.2 µs); NaN for NO_TIME."""
    out = np.empty(len(times_ns))
    flags = times_ns.flags
    float_seconds(times_ns if flags.c_contiguous and flags.writeable else times_ns.copy(), np.nan, out)
    return out


def nanoseconds(times: Floats) -> Ints:
    """Unix ns of unix s, to the digits of the float; NO_TIME for NaN, the last that there is for any later one."""
    known = np.isfinite(times)
    unix = np.clip(np.where(known, times, 0.0), -LAST_S, LAST_S)
    whole = np.floor(unix)
    return np.where(known, whole.astype(np.int64) * 10**9 + np.rint((unix - whole) * 1e9).astype(np.int64), NO_TIME)
