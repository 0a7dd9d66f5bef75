"""A simulated GPX-1: a GNSS receiver with ISB output, without inertial sensors.

    streams        position, velocity and satellites of the first receiver, its version, status, device information
    DID_GPX_RMC    selects streams by bits of its own; it lacks DID_RMC and all motion data
    configuration  DID_GPX_FLASH_CFG, kept over a reset; acts after it
    NMEA           sentences of the receiver

Streams other than the receiver's data have no pace of their own: enabled by a bit of DID_GPX_RMC they come as often as
in the vendor's presets.

Source: inertial-sense-sdk 2.7.1, data_sets.h (gpx_flash_cfg_t, gpx_status_t, GRMC_BITS, GRMC_PRESET).
"""

import struct
from typing import Any

import numpy as np

from imuscope.protocols.isb.field_docs import BAUD_RATES
from imuscope.protocols.isb.simulator import nmea
from imuscope.protocols.isb.simulator.device import RMC_PERSISTENT, RMC_PRESERVE, IsbSimulator
from imuscope.protocols.isb.simulator.settings import SettingsMemory, size, summed
from imuscope.protocols.isb.simulator.signals import DTYPES, FIRST_FIX_NS, GNSS_NS, S
from imuscope.protocols.isb.streams import BY_GPX_BIT, dids_of

DEV_INFO, GPS1_VERSION, SYS_CMD = 1, 17, 7
GPX_DEV_INFO, GPX_FLASH, GPX_STATUS, GPX_RMC, NMEA = 120, 121, 123, 126, 8
MEASURED = (13, 30, 15)  # position, velocity, satellites
EVERY_MS = {GPX_DEV_INFO: 1000, GPS1_VERSION: 1000, GPX_STATUS: 500, GPX_FLASH: 1000}
HARDWARE, HARDWARE_TYPE = (1, 0, 3, 0), 4
RUNNING = 2
_PORTS, _GNSS_AT = (12, 16, 20), 24


class GpxMemory(SettingsMemory):
    """Stored settings of a GPX."""

    @property
    def periods_ms(self) -> tuple[int, int, int]:
        """The only period, that of GNSS."""
        return 0, 0, self.word(_GNSS_AT)

    @property
    def baud(self) -> int:
        return self.word(_PORTS[0])

    def value(self, did: int, now: int) -> bytes:
        if did == GPX_FLASH:
            return self.flash
        return super().value(did, now) if did in (NMEA, GPS1_VERSION) else b""

    def write(self, did: int, offset: int, data: bytes, now: int) -> bool:
        if did != GPX_FLASH:
            return did == NMEA and super().write(did, offset, data, now)
        if not data or offset + len(data) > len(self.flash):
            return False
        words = bytearray(self.flash[:offset] + data + self.flash[offset + len(data) :])
        for at in _PORTS:
            rate = int.from_bytes(words[at : at + 4], "little")
            words[at : at + 4] = min(BAUD_RATES, key=lambda one: abs(one - rate)).to_bytes(4, "little")
        self.flash = summed(bytes(words))
        return True

    def choose(self, periods: dict[int, int], *, keep: bool = False) -> None:
        made = {number: every for number, every in periods.items() if nmea.source_of(number) in MEASURED}
        super().choose(made, keep=keep)


def factory(baud: int) -> bytes:
    """The flash configuration of a new device."""
    out = np.zeros(1, DTYPES[GPX_FLASH])
    out["size"], out["key"] = DTYPES[GPX_FLASH].itemsize, 1
    out["ser0BaudRate"] = out["ser1BaudRate"] = out["ser2BaudRate"] = baud
    out["startupGPSDtMs"] = GNSS_NS // 10**6
    out["gnssSatSigConst"], out["dynamicModel"] = 0x13FF, 8  # all but NavIC and IMES; airborne, up to 4 g
    out["gnssCn0Minimum"], out["gnssCn0DynMinOffset"] = 30, 20
    return summed(out.tobytes())


class GpxSimulator(IsbSimulator):
    """A simulated GPX-1; see IsbSimulator for the arguments."""

    def __init__(self, product: str = "GPX-1", *args: Any, **more: Any) -> None:
        super().__init__(product, *args, **more)
        self.memory = GpxMemory(factory(self.baud))
        self.persistent = {13: 1, 30: 1, 15: 5, GPX_STATUS: EVERY_MS[GPX_STATUS]}

    def value(self, did: int, now: int) -> bytes:
        if did in MEASURED:
            return super().value(did, now)
        if did in (DEV_INFO, GPX_DEV_INFO):
            return self._info()
        if did == GPX_RMC:
            return struct.pack("<QI", self._bits(), 0)
        return self._status(now) if did == GPX_STATUS else self.memory.value(did, now)

    def _bits(self) -> int:
        return sum(1 << bit for bit, did in BY_GPX_BIT.items() if did in self.streams)

    def _set(self, did: int, offset: int, data: bytes, now: int) -> bool:
        if did == GPX_RMC and offset == 0 and len(data) >= 8:
            bits, options = int.from_bytes(data[:8], "little"), int.from_bytes(data[8:12], "little")
            dids = {one for one in dids_of(bits, gpx=True) if self.value(one, now)}
            dids |= self.streams.keys() if options & RMC_PRESERVE else set()
            self._choose({one: self.streams.get(one, EVERY_MS.get(one, 1)) for one in dids})
            if options & RMC_PERSISTENT:
                self._save()
            return True
        return did in (SYS_CMD, NMEA, GPX_FLASH) and super()._set(did, offset, data, now)

    def _info(self) -> bytes:
        out = np.frombuffer(super()._info(), DTYPES[DEV_INFO]).copy()
        out["hardwareType"], out["hardwareVer"] = HARDWARE_TYPE, HARDWARE
        return out.tobytes()

    def _status(self, now: int) -> bytes:
        out = np.zeros(1, DTYPES[GPX_STATUS])
        fixed = now >= FIRST_FIX_NS
        out["timeOfWeekMs"] = int(np.frombuffer(super().value(13, now), DTYPES[13])["timeOfWeekMs"][0])
        out["grmcBitsSer0"] = self._bits()
        out["hdwStatus"] = 1 << 25 | (0b101 if fixed else 0)  # built-in test passed; satellites, time of week
        out["mcuTemp"] = 24.0 + 14.0 * (1 - np.exp(-now / (600 * S)))
        out["navOutputPeriodMs"], out["upTime"] = self._gnss_ns // 10**6, now / 1e9
        out["flashCfgChecksum"] = self.memory.word(4)
        out["gnssStatus"]["runState"] = RUNNING
        return out.tobytes()


assert size(GPX_FLASH) % 4 == 0  # its checksum is over words
