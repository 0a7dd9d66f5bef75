"""Bandwidth that streams need, bytes per second.

    one packet   6 header + data + 2 checksum             INS 1: 6 + 80 + 2 = 88 B
    a second has 1000 / (source's period in ms × multiple)         1000 / (7 × 2) × 88 B = 6 286 B/s

That is exact for every data set of fixed size, and for lists (satellites) whose size was seen when the streams were
read; otherwise a list counts at its greatest. The source's periods are those of the configuration if given (valid after
the restart), else those the device reported when its streams were read. An NMEA sentence counts at its usual length.
Rare events count nothing.

`fit` slows down the most expensive stream, step by step, until all fit: a period of 1, 2, 4, 5, 10, 20 … of its source,
at least once in `SLOWEST_MS`.

Source: ISB document, "ISB packet", "Data source update rates".
"""

from collections.abc import Mapping
from typing import Any

from imuscope.protocols.commands.transactions import LinkLoad, OutputLoad
from imuscope.protocols.isb.commands import NMEA_MESSAGES
from imuscope.protocols.isb.frames import HEADER, TRAILER
from imuscope.protocols.isb.stored_settings import STREAMS_SETTING
from imuscope.protocols.isb.streams import DEFAULT_MS, EVENT, FAST, GNSS, IMU, NAV, ONE_PERIOD, STREAMS

Values = Mapping[str, Any]
STEPS = (1, 2, 4, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000)
SLOWEST_MS = 10_000
PERIOD_TOLERANCE = 0.04  # share within which two periods are equal
NOTHING: Mapping[str, float] = {}
NMEA_SETTING = "DID_NMEA_BCAST_PERIOD"
USUAL_LENGTH: Mapping[str, int] = {  # characters with line end, as the device writes them
    **{"PIMU": 78, "PPIMU": 86, "PRIMU": 78, "PINS1": 176, "PINS2": 146, "PGPSP": 150, "GNGGA": 86, "GNGLL": 54},
    **{"GNGSA": 66, "GNRMC": 78, "GNZDA": 38, "PASHR": 76, "PSTRB": 36, "INFO": 128, "GNGSV": 280, "GNVTG": 42},
}
NMEA_PACES: Mapping[str, str] = {"PIMU": IMU, "PPIMU": NAV, "PRIMU": IMU, "PINS1": NAV, "PINS2": NAV, "PASHR": NAV}
NMEA_EVENTS = ("PSTRB",)


def sources_of(settings: Mapping[str, Values]) -> Mapping[str, float]:
    """The periods given by the configuration, and only those."""
    flash = settings.get("DID_FLASH_CONFIG") or settings.get("DID_GPX_FLASH_CFG") or {}
    named = {NAV: "startupNavDtMs", IMU: "startupImuDtMs", GNSS: "startupGPSDtMs"}
    return {pace: float(flash[name]) for pace, name in named.items() if flash.get(name)}


def in_effect(settings: Mapping[str, Values]) -> Mapping[str, float]:
    """The periods in effect on the device, as far as reported."""
    params = settings.get("DID_SYS_PARAMS") or {}
    named = {NAV: "navOutputPeriodMs", IMU: "imuSamplePeriodMs"}
    return {pace: float(params[name]) for pace, name in named.items() if params.get(name)}


def periods_ms(settings: Mapping[str, Values]) -> Mapping[int, float]:
    """The period of each data set's source on this device: as measured if it streams, else as reported, else as
    documented.
    """
    rows = {one["did"]: one for one in settings.get(STREAMS_SETTING, {}).get("streams", []) if one.get("source_ms")}
    periods = {**sources_of(settings), **in_effect(settings)}
    period_by_pace = {STREAMS[did].paces: float(one["source_ms"]) for did, one in rows.items() if one.get("size")}
    by_stream = {}
    for did, row in STREAMS.items():
        if row.pace == EVENT:
            by_stream[did] = 0.0
        elif did in rows:
            by_stream[did] = float(rows[did]["source_ms"])
        else:
            guess = next((periods[pace] for pace in row.paces if pace in periods), DEFAULT_MS[row.paces[0]])
            by_stream[did] = period_by_pace.get(row.paces, guess)
    return by_stream


def load(settings: Mapping[str, Values]) -> LinkLoad:
    sources, now = sources_of(settings), in_effect(settings)
    parts: list[OutputLoad] = []
    limits: list[str] = []
    for place, one in enumerate(settings.get(STREAMS_SETTING, {}).get("streams", [])):
        row = STREAMS.get(one["did"])
        if row is None:
            continue
        parts.append(OutputLoad(f"streams.{place}", row.title, rate_of(one, sources, now) * packet_size(one)))
        if row.did in ONE_PERIOD and (one.get("period") or 1) != 1:
            limits.append(f"{row.name} is sent at every navigation update; its rate cannot be changed.")
    for place, one in enumerate(settings.get(NMEA_SETTING, {}).get("nmeaBroadcastMsgs", [])):
        name = NMEA_MESSAGES.get(one["msgID"], "")
        if one["msgID"] and one["msgPeriod"] and name not in NMEA_EVENTS:
            parts.append(
                OutputLoad(f"nmeaBroadcastMsgs.{place}", f"NMEA {name}, about", _sentence_load(name, one, sources))
            )
    return LinkLoad(tuple(parts), sum(part.bytes_per_s for part in parts), tuple(limits))


def message_rate(settings: Mapping[str, Values]) -> float | None:
    """Packets per second of the fastest stream of these settings; None if they were not read."""
    if STREAMS_SETTING not in settings:
        return None
    sources, now = sources_of(settings), in_effect(settings)
    rows = settings[STREAMS_SETTING].get("streams", [])
    return max((rate_of(one, sources, now) for one in rows if one["did"] in STREAMS), default=0.0)


def source_ms(one: Values, sources: Mapping[str, float], now: Mapping[str, float] = NOTHING) -> float:
    """Period of the source of a stream, ms; 0 without one.

    The measured value is in the row. A period of the device that the configuration changes differs after the next
    restart.

    Args:
        sources: periods by the configuration.
        now: periods in effect, if known.
    """
    row = STREAMS[one["did"]]
    if row.pace == EVENT:
        return 0.0
    measured = float(one.get("source_ms") or 0)
    if not measured:
        return next((sources[pace] for pace in row.paces if pace in sources), DEFAULT_MS[row.paces[0]])
    for pace in row.paces:
        in_effect = now.get(pace, measured if len(row.paces) == 1 else 0.0)
        if abs(in_effect - measured) <= PERIOD_TOLERANCE * measured:
            return sources.get(pace, measured)
    return measured


def rate_of(one: Values, sources: Mapping[str, float], now: Mapping[str, float] = NOTHING) -> float:
    """Packets per second of a stream."""
    period_ms = source_ms(one, sources, now) * (one.get("period") or 1)
    return float(1000 / period_ms) if period_ms else 0.0


def packet_size(one: Values) -> int:
    """Bytes of one packet of a stream: as observed, else from the table."""
    row = STREAMS[one["did"]]
    return HEADER + (int(one.get("size") or 0) or max(row.size, 0)) + TRAILER


def _sentence_load(name: str, one: Values, sources: Mapping[str, float]) -> float:
    pace = NMEA_PACES.get(name, GNSS if name.startswith(("G", "PGPSP")) else FAST)
    return USUAL_LENGTH.get(name, 80) * 1000 / ((sources.get(pace) or DEFAULT_MS[pace]) * int(one["msgPeriod"]))


def fit(settings: Mapping[str, Values], capacity: float) -> Mapping[str, Values]:
    """See imuscope.protocols.commands.transactions.DeviceDriver.fit_rates. If even the slowest rates do not fit, they
    are returned.
    """
    if STREAMS_SETTING not in settings:
        return settings
    sources, now = sources_of(settings), in_effect(settings)
    streams = [dict(one) for one in settings[STREAMS_SETTING].get("streams", [])]
    fitted = {**settings, STREAMS_SETTING: {**settings[STREAMS_SETTING], "streams": streams}}
    while load(fitted).total > capacity:
        costly = sorted(streams, key=lambda one: rate_of(one, sources, now) * packet_size(one), reverse=True)
        if not any(_slower(one, sources, now) for one in costly):
            break
    return fitted


def _slower(one: dict[str, Any], sources: Mapping[str, float], now: Mapping[str, float]) -> bool:
    """Set the next longer period, if there is one."""
    period = one.get("period") or 1
    base = source_ms(one, sources, now)
    longer = next((step for step in STEPS if step > period), None)
    if longer is None or not base or one["did"] in ONE_PERIOD or base * longer > SLOWEST_MS:
        return False
    one["period"] = longer
    return True
