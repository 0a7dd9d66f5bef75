"""Streams of an Inertial Sense device: periods, and bits of DID_RMC.

    GET_DATA period n   ──>  one packet every n × the source's own period
    DID_RMC bit         ──>  the same at n = 1; a GPX has DID_GPX_RMC, with bits of its own
    the sources         NAV    INS, PIMU           DID_FLASH_CONFIG.startupNavDtMs, DID_SYS_PARAMS.navOutputPeriodMs now
                        IMU    DID_IMU             DID_FLASH_CONFIG.startupImuDtMs, DID_SYS_PARAMS.imuSamplePeriodMs now
                               (document; for DID_IMU and DID_IMU_MAG the header says startupNavDtMs: see OTHER_PACES)
                        SLOW   barometer, magnetometer   about 20 ms
                        GNSS   all sets DID_GPS…   DID_FLASH_CONFIG.startupGPSDtMs
                        FAST   all others          1 ms
                        EVENT  on an event         no period

The document's table of default periods and the devices disagree (errata 6), so periods are read from the device; the
table's values are assumed until then.

Rules for editing: streamable data sets follow from datasets.txt; a data set with another pace than FAST is named in
`PACES`. Presets are the vendor's RMC_PRESET words.

Source: ISB document, "Data Source Update Rates"; inertial-sense-sdk 2.7.1, data_sets.h (RMC_BITS, RMC_PRESET,
GRMC_BITS, GRMC_PRESET).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from imuscope.protocols.isb.dataset_loader import SETS, TABLES, title_of

NAV, IMU, SLOW, GNSS, FAST, EVENT = "nav", "imu", "slow", "gnss", "fast", "event"
DEFAULT_MS: Mapping[str, float] = {NAV: 7, IMU: 14, SLOW: 20, GNSS: 200, FAST: 1, EVENT: 0}
"""The document's default periods."""

_PACES = {3: NAV, 4: NAV, 5: NAV, 65: NAV, 66: NAV, 58: IMU, 52: SLOW, 53: SLOW, 86: NAV, 85: IMU}
OTHER_PACES: Mapping[int, str] = {58: NAV, 85: NAV}
"""The SDK header's paces where the document differs; they come first, as the header is newer."""
_EVENTS = (37, 68, 72, 119)
_GROUPS = (
    ("Navigation", (4, 5, 65, 66, 48, 50, 67, 55, 87, 71)),
    ("Inertial", (58, 3, 97, 96, 57, 95, 62, 85, 86)),
    ("Magnetic field and pressure", (52, 53, 47, 59)),
    ("GNSS", (13, 30, 15, 45, 6, 14, 31, 16, 84, 69, 70, 60, 27, 41)),
    ("RTK", (54, 21, 22, 91, 92, 76, 77, 78, 79)),
    ("System", (10, 11, 75, 68, 72, 119, 37, 38, 123, 127)),
)
_USUAL_IDS = (4, 5, 65, 66, 58, 3, 52, 53, 13, 30, 15, 10)
REPLIES_THAT_STREAM = (17, 18, 120, 121, 125, 126)  # with bits in DID_RMC or DID_GPX_RMC
ONE_PERIOD = (3,)  # DID_PIMU comes at startupNavDtMs and "cannot be output at any other rate"

PRESETS: Mapping[str, int] = {
    "INS": 0x8000000000000402,
    "GPS": 0x8808601001300C00,
    "IMX_PPD": 0xC000609001353CE2,
    "IMX_PPD_NO_IMU": 0xC000601001353CC2,
    "IMX_PPD_IMU3_RAW": 0xC000611001353CE2,
    "IMX_PPD_IMU3_UNCAL": 0xC0006010013D3CE2,
    "IMX_PPD_GROUND_VEHICLE": 0xC000609181353CE2,
    "IMX_PPD_RTK_DBG": 0xC81060907135FCE2,
    "GPX_PPD": 0x8808601001313C00,
    "ALLAN_VARIANCE": 0x8000000000000010,
}


GPX_PRESETS: Mapping[str, int] = {
    "GPX_BASE": 0x8000000000000004,
    "GPX_GPS1": 0x7E0,
    "GPX_GPS2": 0x1F800,
    "GPX_IMX": 0x800000000031FFE4,
    "GPX_IMX_RTK_DBG": 0x800000000071FFE4,
}

_GPX_NAMES: Mapping[str, str] = {  # bits of DID_GPX_RMC → data sets with a different name
    "DEV_INFO": "DID_GPX_DEV_INFO",
    "FLASH_CFG": "DID_GPX_FLASH_CFG",
    "STATUS": "DID_GPX_STATUS",
    "RTOS_INFO": "DID_GPX_RTOS_INFO",
    "DEBUG_ARRAY": "DID_GPX_DEBUG_ARRAY",
    "DID_RTK_DEBUG": "DID_RTK_DEBUG",
    "PORT_MON": "DID_PORT_MONITOR",
    "GPX_PORT_MON": "DID_GPX_PORT_MONITOR",
}


@dataclass(frozen=True, slots=True)
class StreamRow:
    """One data set that can be streamed.

    Args:
        did, name, title: of the data set.
        group: heading of its list.
        size: bytes of its data; the greatest for a list; -1 if its layout is not public.
        counted: whether it is a list of variable length.
        pace: the source that times it: NAV, IMU, SLOW, GNSS, FAST or EVENT.
        rmc_bit: its bit of DID_RMC; -1: by GET_DATA only.
        basic: whether most users want it.
    """

    did: int
    name: str
    title: str
    group: str
    size: int
    counted: bool
    pace: str
    rmc_bit: int
    basic: bool

    @property
    def paces(self) -> tuple[str, ...]:
        """Every source that may time it, the likeliest first."""
        other = OTHER_PACES.get(self.did)
        return (self.pace,) if other is None else (other, self.pace)


def _pace(did: int, name: str) -> str:
    if did in _EVENTS:
        return EVENT
    return _PACES.get(did) or (GNSS if name.startswith("DID_GPS") else FAST)


def _streams() -> Mapping[int, StreamRow]:
    bits = {f"RMC_BITS_{bits.name}": bits.low for bits in TABLES.words["RMC_BITS"]}
    groups = {did: group for group, dids in _GROUPS for did in dids}
    rows = {}
    for did, row in SETS.items():
        if row.kind == "reply" and did not in REPLIES_THAT_STREAM:
            continue
        size = row.struct.size if row.struct else -1
        counted = bool(row.struct and row.struct.counts)
        title = title_of(row.name)
        bit = bits.get(row.rmc, -1)
        pace = _pace(did, row.name)
        rows[did] = StreamRow(
            did, row.name, title, groups.get(did, "Internal"), size, counted, pace, bit, basic=did in _USUAL_IDS
        )
    order = {did: place for place, did in enumerate(did for _, dids in _GROUPS for did in dids)}
    return {did: rows[did] for did in sorted(rows, key=lambda one: (order.get(one, len(order)), one))}


STREAMS = _streams()
"""By data set, in list order."""
SETS_BY_NAME = {row.name: did for did, row in SETS.items()}
BY_BIT = {row.rmc_bit: row.did for row in STREAMS.values() if row.rmc_bit >= 0}


BY_GPX_BIT = {
    bits.low: SETS_BY_NAME[_GPX_NAMES.get(bits.name, f"DID_{bits.name}")]
    for bits in TABLES.words["GRMC_BITS"]
    if bits.name != "PRESET"
}
"""Bit of DID_GPX_RMC → data set."""
OF_GPX = frozenset(BY_GPX_BIT.values()) | {did for did in STREAMS if did in range(120, 128)}
"""Streams of a GPX."""


def every(period: int) -> str:
    """A multiple of an unknown period as text: "1 in 5"."""
    return "at the rate of its source" if period == 1 else f"1 in {period}"


def stream_words(entry: Mapping[str, Any]) -> tuple[str, str]:
    """Title and value of a stream: "INS 2", "50 Hz"; its divisor if the period of its source is not known."""
    row = STREAMS.get(int(entry["did"]))
    period, source_ms = int(entry.get("period") or 1), float(entry.get("source_ms") or 0)
    title = row.title if row is not None else str(entry["did"])
    if row is not None and row.pace == EVENT:
        return title, "on events"
    hertz = float(f"{1000 / (source_ms * period):.3g}") if source_ms > 0 else 0.0
    return title, f"{hertz:g} Hz" if hertz else every(period)


def dids_of(bits: int, *, gpx: bool = False) -> list[int]:
    """The data sets enabled by a word of DID_RMC (of DID_GPX_RMC: `gpx`); unassigned bits are ignored."""
    return [did for bit, did in sorted((BY_GPX_BIT if gpx else BY_BIT).items()) if bits >> bit & 1]
