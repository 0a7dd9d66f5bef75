"""Settings of the simulated IMX-5, and the effects of writing them.

    DID_FLASH_CONFIG        kept over a reset; takes effect after it. Its checksum is computed with every write; an
                            unsupported rate becomes the nearest; inertial data are never slower than navigation
    DID_NMEA_BCAST_PERIOD   pairs are merged: a sentence that is not named keeps its period
    DID_MAG_CAL, DID_BIT    writing a state starts a process, which runs by itself and ends
    others of `STORED_SETS` written values are read back; lost with a reset

The device lacks and refuses all other data sets.

Source: inertial-sense-sdk 2.7.1, data_sets.h; user manual, "Data Sets (DIDs)".
"""

import struct
from dataclasses import dataclass, field

import numpy as np

from imuscope.protocols.isb.dataset_loader import SETS
from imuscope.protocols.isb.field_docs import BAUD_RATES
from imuscope.protocols.isb.simulator.signals import DTYPES, GNSS_NS
from imuscope.protocols.simulator.trajectory import PLACE

SYS_FAULT, NMEA, FLASH, GPS1_VERSION, MAG_CAL, BIT = 2, 8, 12, 17, 19, 64
STORED_SETS = (61, 73, 87, 90, 94)  # RTK options, survey, wheels, CAN, calibration in the field
INPUTS = (71, 88)  # wheel encoder, position measurement: write only
PERSISTENT = 1 << 9
SENTENCES = 20
S = 10**9
MAG_CAL_NS, BIT_NS = 20 * S, 3 * S
RECAL_RUNNING, RECAL_COMPLETE = 200, 201
BIT_DONE, BIT_RUNNING = 1, 6
_NAV_MS, _IMU_MS, _GNSS_MS = 16, 12, 188  # offsets in the flash configuration
_PORTS = (20, 24, 204)


def size(did: int) -> int:
    """Bytes of a data set."""
    row = SETS[did].struct
    assert row is not None
    return row.size


@dataclass
class SettingsMemory:
    """All settings, stored and momentary.

    Args:
        flash: the flash configuration as it leaves the factory.

    Attributes:
        sentences: NMEA message → period.
        saved_sentences: those restored after a reset.
    """

    flash: bytes
    sentences: dict[int, int] = field(default_factory=dict)
    saved_sentences: dict[int, int] = field(default_factory=dict)
    _sets: dict[int, bytes] = field(default_factory=dict)
    _calibration: tuple[int, int] | None = None  # start and state, while it runs
    _test: tuple[int, int] | None = None  # start and kind

    def word(self, offset: int) -> int:
        """A 32-bit word of the flash configuration."""
        return int.from_bytes(self.flash[offset : offset + 4], "little")

    @property
    def periods_ms(self) -> tuple[int, int, int]:
        """Periods of navigation, inertial data and GNSS after a reset."""
        return self.word(_NAV_MS), self.word(_IMU_MS), self.word(_GNSS_MS)

    @property
    def baud(self) -> int:
        """The rate of the first port after a reset."""
        return self.word(_PORTS[0])

    def reset(self) -> None:
        """Discard unsaved values."""
        self._sets.clear()
        self._calibration = self._test = None
        self.sentences = dict(self.saved_sentences)

    # -- read

    def value(self, did: int, now: int) -> bytes:
        """A data set; b"" if this device lacks it."""
        if did == FLASH:
            return self.flash
        if did == NMEA:
            pairs = sorted(self.sentences.items())[:SENTENCES]
            return struct.pack("<I", 0) + b"".join(bytes(pair) for pair in pairs).ljust(2 * SENTENCES, b"\0")
        if did == MAG_CAL:
            return self._mag_cal(now)
        if did == BIT:
            return self._bit(now)
        if did in (SYS_FAULT, GPS1_VERSION):
            return (b"simulator" if did == GPS1_VERSION else b"").ljust(size(did), b"\0")
        return self._sets.get(did, bytes(size(did))) if did in STORED_SETS else b""

    def _mag_cal(self, now: int) -> bytes:
        if self._calibration is None:
            return struct.pack("<Iff", 0, 0, 0)
        progress = min((now - self._calibration[0]) / MAG_CAL_NS, 1.0)
        return struct.pack("<Iff", RECAL_RUNNING if progress < 1 else RECAL_COMPLETE, 100 * progress, 0)

    def _bit(self, now: int) -> bytes:
        out = bytearray(size(BIT))
        if self._test is not None:
            out[1] = self._test[1]
            out[2] = BIT_RUNNING if now - self._test[0] < BIT_NS else BIT_DONE
        return bytes(out)

    # -- written

    def write(self, did: int, offset: int, data: bytes, now: int) -> bool:
        """Write a part; False if that is not possible."""
        if did in INPUTS:
            return offset + len(data) <= size(did)
        whole = self.value(did, now)
        if not data or not whole or offset + len(data) > len(whole) or did in (SYS_FAULT, GPS1_VERSION):
            return False
        whole = whole[:offset] + data + whole[offset + len(data) :]
        if did == FLASH:
            self.flash = _settled(whole)
        elif did == NMEA:
            pairs = zip(data[4 - min(offset, 4) :: 2], data[5 - min(offset, 4) :: 2], strict=False)
            keep = offset == 0 and int.from_bytes(data[:4], "little") & PERSISTENT
            self.choose(dict(pairs), keep=bool(keep))
        elif did == MAG_CAL:
            state = int.from_bytes(whole[:4], "little")
            self._calibration = (now, state) if state in (1, 2) else None
        elif did == BIT:
            self._test = (now, whole[0]) if whole[0] > 1 else None
        else:
            self._sets[did] = whole
        return True

    def choose(self, periods: dict[int, int], *, keep: bool = False) -> None:
        """Merge sentences and their periods into the present ones; 0 ends one."""
        merged = {**self.sentences, **periods}
        self.sentences = {number: period for number, period in merged.items() if number and period}
        if keep:
            self.saved_sentences = dict(self.sentences)


def _settled(flash: bytes) -> bytes:
    """Configuration as adjusted by the device: supported rates, and the checksum."""
    words = bytearray(flash)
    for at in _PORTS:
        rate = int.from_bytes(words[at : at + 4], "little")
        words[at : at + 4] = min(BAUD_RATES, key=lambda one: abs(one - rate)).to_bytes(4, "little")
    nav, imu = (int.from_bytes(words[at : at + 4], "little") for at in (_NAV_MS, _IMU_MS))
    words[_IMU_MS : _IMU_MS + 4] = min(imu, nav).to_bytes(4, "little")
    return summed(bytes(words))


def summed(flash: bytes) -> bytes:
    """The flash configuration with its checksum: the exclusive or of all words after it (SDK: flashChecksum32)."""
    total = int(np.bitwise_xor.reduce(np.frombuffer(flash, "<u4")[2:]))
    return flash[:4] + struct.pack("<I", total) + flash[8:]


def factory(rate: float, baud: int) -> bytes:
    """The flash configuration of a new device."""
    out = np.zeros(1, DTYPES[FLASH])
    out["size"], out["key"] = DTYPES[FLASH].itemsize, 21
    out["startupImuDtMs"] = out["startupNavDtMs"] = max(1, round(1e3 / rate))
    out["startupGPSDtMs"] = GNSS_NS // 10**6
    out["ser0BaudRate"] = out["ser1BaudRate"] = out["ser2BaudRate"] = baud
    out["dynamicModel"], out["gnssSatSigConst"] = 4, 0x10FF  # a ground vehicle; GPS, QZSS, Galileo, BeiDou, SBAS
    out["refLla"] = out["lastLla"] = PLACE
    out["gnssCn0Minimum"] = 15
    return summed(out.tobytes())
