"""UTC of Inertial Sense data; time_base.py computes it after the receiver's first fix."""

from __future__ import annotations

import numpy as np

from imuscope.protocols.clocks.dates import UNKNOWN, Ints
from imuscope.protocols.events import Batch
from imuscope.protocols.isb.time_base import FIRST_WEEK, GPS_EPOCH, WEEK_S, S

DATED_NS = (GPS_EPOCH + FIRST_WEEK * WEEK_S) * S  # up-times are far smaller


def utc_of(batch: Batch) -> Ints | None:
    """UTC of each sample, ns since the Unix epoch, UNKNOWN before the first fix; None if none is known."""
    if batch.time_ns is None or not len(batch) or int(batch.time_ns.max()) < DATED_NS:
        return None
    return np.where(batch.time_ns >= DATED_NS, batch.time_ns, UNKNOWN)
