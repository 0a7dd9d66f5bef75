"""Dates in Xbus messages: UtcTime, GNSS solutions, and the head of a log.

A UtcTime counts if its flags call UTC valid, a solution if it has a fix and a valid date and time of day. The
Configuration at the start of an .mtb file carries the start date of its writer, to the hundredth of a second.

Source: MT0101P 2020.A, tables 13, 14, 25 and section 5.3.6.
"""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np

from imuscope.protocols.clocks.dates import UNKNOWN, Ints, utc_ns
from imuscope.protocols.events import Batch, Reply
from imuscope.protocols.xbus.frames import FIX_2D

UTC_VALID = 4
DATE_AND_TIME_VALID = 3


def utc_of(batch: Batch) -> Ints | None:
    """UTC of each sample, ns since the Unix epoch, UNKNOWN where absent; None if no sample has it."""
    names = {field.name for field in batch.message.fields}
    if "UtcTime" in names:
        row = batch.columns["UtcTime"]
        valid = row["flags"] & UTC_VALID != 0
        fields = ("year", "month", "day", "hour", "minute", "second", "ns")
    elif "GnssPvtData" in names:
        row = batch.columns["GnssPvtData"]
        valid = (row["fixtype"] >= FIX_2D) & (row["valid"] & DATE_AND_TIME_VALID == DATE_AND_TIME_VALID)
        fields = ("year", "month", "day", "hour", "min", "sec", "nano")
    else:
        return None
    year, month, day, hour, minute, second, ns = (np.asarray(row[name]).astype(np.int64) for name in fields)
    times = utc_ns(year, month, day, hour, minute, second, ns, valid)
    return times if (times != UNKNOWN).any() else None


def date_of(reply: Reply) -> int | None:
    """Start of a log from the Configuration message in its header, ns since the Unix epoch; None if it is not set."""
    if reply.message.name != "Configuration":
        return None
    date, time = (str(reply.values.get(name, "")).strip("\0 ") for name in ("date", "time"))
    try:
        began = datetime.strptime(date + time[:6].ljust(6, "0"), "%Y%m%d%H%M%S").replace(tzinfo=UTC)
    except ValueError:
        return None
    hundredths = int(time[6:8]) if time[6:8].isdecimal() else 0
    return round(began.timestamp()) * 1_000_000_000 + hundredths * 10_000_000 if began.year >= 1999 else None
