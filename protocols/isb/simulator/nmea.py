"""NMEA 0183 sentences of the simulated IMX-5, sent and received, beside its binary packets.

    $INFO*0E             ──>  $INFO,62123,5.0.4.0,2.7.1.0,7,2.0.0.0,…        identity
    $ASCE*14             ──>  $ASCE,0,4,1,7,1*xx                              sentences and their periods
    $ASCE,0,7,1*0E            GGA with every solution; 0 ends it; option 512 keeps it
    $PERS $SRST $STPB $STPC   save the streams; restart; stop everything

A sentence is made from the data set that it reports, at its pace.

The manual calls the answer to ASCE ASCB; firmware 2.7.1 calls it ASCE, and so does this. The identity ends with type of
hardware, state and type of build, which are missing from the manual.

Source: Inertial Sense user manual, "NMEA 0183 (ASCII) protocol"; inertial-sense-sdk 2.7.1, protocol_nmea.cpp.
"""

import datetime
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from imuscope.protocols.embedded.nmea import sentence
from imuscope.protocols.isb.commands import NMEA_MESSAGES
from imuscope.protocols.isb.simulator.signals import DTYPES
from imuscope.protocols.isb.time_base import GPS_EPOCH

LEAP_S = 18
NUMBERS = {name: number for number, name in NMEA_MESSAGES.items()}


def _vector(values: Any, digits: int) -> str:
    return ",".join(f"{value:.{digits}f}" for value in values)


def _imu(row: Any) -> str:
    return f"{row['time']:.3f},{_vector(row['I.pqr'], 4)},{_vector(row['I.acc'], 3)}"


def _pimu(row: Any) -> str:
    return f"{row['time']:.3f},{_vector(row['theta'], 4)},{_vector(row['vel'], 4)},{row['dt']:.3f}"


def _ins(row: Any) -> str:
    return f"{row['timeOfWeek']:.3f},{row['week']},{row['insStatus']},{row['hdwStatus']}"


def _ins_1(row: Any) -> str:
    return f"{_ins(row)},{_vector(row['theta'], 4)},{_vector(row['uvw'], 3)},{_place(row)},{_vector(row['ned'], 3)}"


def _ins_2(row: Any) -> str:
    return f"{_ins(row)},{_vector(row['qn2b'], 4)},{_vector(row['uvw'], 3)},{_place(row)}"


def _place(row: Any) -> str:
    latitude, longitude, height = row["lla"]
    return f"{latitude:.8f},{longitude:.8f},{height:.3f}"


def _utc(row: Any) -> datetime.datetime:
    seconds = int(row["week"]) * 604_800 + int(row["timeOfWeekMs"]) / 1000 - LEAP_S
    return datetime.datetime.fromtimestamp(GPS_EPOCH + seconds, datetime.UTC)


def _clock(row: Any) -> str:
    return f"{_utc(row):%H%M%S}.{_utc(row).microsecond // 1000:03d}" if row["week"] else ""


def _angles(row: Any) -> str:
    words = []
    for value, width, names in ((row["lla"][0], 2, "NS"), (row["lla"][1], 3, "EW")):
        minutes = round(abs(float(value)) * 60, 5)
        words.append(f"{int(minutes // 60):0{width}d}{minutes % 60:08.5f},{names[int(value < 0)]}")
    return ",".join(words)


def _gga(row: Any) -> str:
    if not row["week"]:
        return ",,,,,0,00,,,M,,M,,"
    height = float(row["hMSL"])
    undulation = float(row["lla"][2]) - height
    where = f"{_clock(row)},{_angles(row)},1,{int(row['satsUsed']):02d},{float(row['pDop']):.2f}"
    return f"{where},{height:.3f},M,{undulation:.2f},M,,"


def _gll(row: Any) -> str:
    return f"{_angles(row)},{_clock(row)},A" if row["week"] else ",,,,,V"


def _zda(row: Any) -> str:
    return f"{_clock(row)},{_utc(row):%d,%m,%Y},00,00" if row["week"] else ",,,,00,00"


LINES: Mapping[str, tuple[int, Callable[[Any], str]]] = {
    "PIMU": (58, _imu),
    "PPIMU": (3, _pimu),
    "PRIMU": (58, _imu),
    "PINS1": (4, _ins_1),
    "PINS2": (5, _ins_2),
    "GNGGA": (13, _gga),
    "GNGLL": (13, _gll),
    "GNZDA": (13, _zda),
}
"""Sentence → the data set that it reports, and its formatter."""


def source_of(number: int) -> int | None:
    """The data set that a sentence reports; None if this device does not send it."""
    source = LINES.get(NMEA_MESSAGES.get(number, ""))
    return source[0] if source else None


def line(number: int, payload: bytes) -> bytes:
    """A sentence about a data set's value."""
    name = NMEA_MESSAGES[number]
    did, words = LINES[name]
    return sentence(f"{name},{words(np.frombuffer(payload, DTYPES[did], 1)[0])}")


def info(payload: bytes) -> bytes:
    """Identity of the device, from DID_DEV_INFO."""
    row = np.frombuffer(payload, DTYPES[1])[0]

    def version(name: str) -> str:
        return ".".join(str(part) for part in row[name])

    maker, more = (row[name].tobytes().rstrip(b"\0").decode() for name in ("manufacturer", "addInfo"))
    date = f"20{row['buildYear']:02d}-{row['buildMonth']:02d}-{row['buildDay']:02d}"
    words: tuple[Any, ...] = (row["serialNumber"], version("hardwareVer"), version("firmwareVer"), row["buildNumber"])
    time = f"{row['buildHour']:02d}:{row['buildMinute']:02d}:{row['buildSecond']:02d}.{row['buildMillisecond']:02d}"
    words += (version("protocolVer"), row["repoRevision"], maker, date, time, more)
    words += (row["hardwareType"], row["hdwRunState"], chr(row["buildType"] or ord(" ")))
    return sentence(f"INFO,{','.join(str(word) for word in words)}")


def periods(sentences: Mapping[int, int]) -> bytes:
    """Current outputs, as the answer to a query."""
    pairs = "".join(f",{number},{period}" for number, period in sorted(sentences.items()))
    return sentence(f"ASCE,0{pairs}")


def chosen(words: list[str]) -> tuple[int, dict[int, int]] | None:
    """Options and periods of an ASCE; None if it is invalid."""
    try:
        options = int(words[0])
        named = [NUMBERS.get(word, -1) if not word.isdigit() else int(word) for word in words[1::2]]
        periods = dict(zip(named, (int(word) for word in words[2::2]), strict=True))
    except (ValueError, IndexError):
        return None
    return (options, periods) if periods and all(number in NMEA_MESSAGES for number in periods) else None
