"""What an MTi says of the date: UtcTime, GNSS solutions, and the head of a log.

A UtcTime counts where its flags call UTC valid, a solution where it has a fix and a valid date and time of day. The
Configuration that begins an .mtb file carries the date at which its writer began it, to the hundredth of a second.

Source: MT0101P 2020.A, tables 13, 14, 25 and section 5.3.6.
"""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np

from protocols.dates import UNKNOWN, Ints, utc_ns
from protocols.events import Batch, Reply
from protocols.xbus.frames import FIX_2D

UTC_VALID = 4
DATE_AND_TIME_VALID = 3


def utc_of(batch: Batch) -> Ints | None:
    """UTC of each sample, ns since the Unix epoch, UNKNOWN where it is not said; None where none says so."""
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
    """When a log began, by the Configuration at its head, ns since the Unix epoch; None where that was not set."""
    if reply.message.name != "Configuration":
        return None
    date, time = (str(reply.values.get(name, "")).strip("\0 ") for name in ("date", "time"))
    try:
        began = datetime.strptime(date + time[:6].ljust(6, "0"), "%Y%m%d%H%M%S").replace(tzinfo=UTC)
    except ValueError:
        return None
    hundredths = int(time[6:8]) if time[6:8].isdecimal() else 0
    return round(began.timestamp()) * 1_000_000_000 + hundredths * 10_000_000 if began.year >= 1999 else None
