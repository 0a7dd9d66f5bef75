"""The other end of the wire: an IMX-5 that is not there, but answers.

    power, SOFTWARE_RESET ──boot──> DID_DEV_INFO, then what is persistent streams
                                         ^   GET: a stream or one packet     SET, stops: ACK     refused: NACK

`IsbDevice` is pure: it has no clock, no link and no thread. Whoever holds it says how late it is and takes what the
device has sent by then. What it measures is measurement.py, from the shared drive.

    GET_DATA     period 0 sends the data set once and ends its stream; else one packet every `period` times the source's
                 own. A part (offset, size) of what is not streamed is answered as asked; NACK for what is not there.
    SET_DATA     DID_RMC chooses streams by bits; DID_FLASH_CONFIG keeps what is written (new periods act after a reset,
                 as in the device); DID_SYS_CMD saves the streams or resets; DID_DEV_INFO and other sets are refused.
    stops        of one data set without an answer; of all with ACK.

What it does not do: calibration, RTK, NMEA and other ports; a stop of all ports stops this one.

Source: ISB document; inertial-sense-sdk 2.7.1, data_sets.h and ISComm.h.
"""

from __future__ import annotations

import struct

import numpy as np

from protocols.isb import frames
from protocols.isb.frames import ACK, DATA, GET_DATA, HEADER, NACK, TRAILER, WITH_OFFSET
from protocols.isb.measurement import (
    BLOCK_NS,
    DTYPES,
    GNSS,
    IMU,
    NAV,
    SLOW,
    SOURCES,
    UTC_2026_S,
    Array,
    Moments,
    Run,
    S,
    moments,
    packets,
    rows_of,
)
from protocols.motion import PLACE

PRODUCTS = ("IMX-5",)
FIRMWARE = (2, 7, 1, 0)
DEV_INFO, SYS_CMD, RMC, SYS_PARAMS, FLASH_CONFIG = 1, 7, 9, 10, 12
SAVE_PERSISTENT, RESET = 1, 99
RMC_PERSISTENT = 1 << 9
BOOT_NS = 300_000_000
STALL_NS = 200_000_000  # an incomplete request older than this is forgotten
SLOW_NS, GNSS_NS = 20_000_000, 200_000_000
SLOW_INS_2_HZ = 50
BAUD = 921_600


class IsbDevice:
    """A simulated IMX-5.

    Args:
        product: of PRODUCTS.
        serial: None for one made of the seed.
        seed: repeats noise and faults exactly.
        start_ns: the time, on the clock that `advance` speaks, at which power comes; its 0 is the begin of 2026 in UTC,
            so that the date goes on when a device is switched off and on.
        rate: samples/s of inertial data and navigation; above 1000 the device is faster than any real one.
        drop, corrupt: share of streamed packets that never leave, or leave with one bit turned.
        clock_drift_ppm: how much faster the device's oscillator runs than the clock of `advance`.
        clock_jump: (device time s, by s): the device's clock jumps once.
        road: how much of the vehicle's shaking reaches the sensor: 0 none, 1 a rigid mount.
    Raises:
        ValueError: the product is not known.
    """

    def __init__(
        self,
        product: str = "IMX-5",
        serial: int | None = None,
        seed: int = 0,
        start_ns: int = 0,
        *,
        rate: float = 100,
        drop: float = 0.0,
        corrupt: float = 0.0,
        clock_drift_ppm: float = 0.0,
        clock_jump: tuple[float, float] | None = None,
        road: float = 0.0,
    ) -> None:
        if product not in PRODUCTS:
            raise ValueError(f"there is no twin of {product!r}; there are {', '.join(PRODUCTS)}")
        self.product = product
        self.serial = 62_000 + seed % 0xFFFF if serial is None else serial
        self.baud = BAUD
        self._seed, self._start_ns = seed, start_ns
        self._speed = 1 + clock_drift_ppm * 1e-6
        self._drop, self._corrupt = drop, corrupt
        jump = clock_jump and (round(clock_jump[0] * 1e9), round(clock_jump[1] * 1e9))
        self.run = Run(seed, road, jump, UTC_2026_S * S + start_ns)
        self._period_ns = max(round(S / rate), 1)
        self.flash = self._factory(rate)
        every = max(1, round(rate / SLOW_INS_2_HZ))
        self.persistent: dict[int, int] = {58: 1, 4: 1, 5: every, 52: 1, 53: 1, 13: 1, 30: 1, 15: 5}
        self.streams: dict[int, int] = {}
        self._awake = False
        self._block = 0
        self._sent_ns = -1  # all that was due up to this device time has been sent
        self._waiting: list[tuple[int, bytes]] = []  # packets of this block not sent yet, last first
        self._heard = bytearray()
        self._heard_ns = 0
        self._count = 0

    # -- the two directions of the wire

    def advance(self, now_ns: int) -> bytes:
        """Everything that the device sends up to `now_ns`, since it was last asked."""
        now = self._local(now_ns)
        out: list[bytes] = []
        if not self._awake and now >= BOOT_NS:
            self._awake = True
            self.streams = dict(self.persistent)
            self._sent_ns = BOOT_NS
            self._block = BOOT_NS // BLOCK_NS
            self._make()
            out.append(frames.build(DATA, DEV_INFO, self.value(DEV_INFO, now)))
        if self._awake:
            self._due(now, out)
        return b"".join(out)

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """Bytes from the host. What the device had to send by then, followed by its answers."""
        out = [self.advance(now_ns)]
        if not self._awake:
            return b""  # nobody listens yet
        now = self._local(now_ns)
        if now - self._heard_ns > STALL_NS:
            self._heard.clear()
        self._heard += data
        self._heard_ns = now
        while (request := self._next_request()) is not None and self._awake:
            out.append(self._answer(*request, now))
        return b"".join(out)

    def _local(self, now_ns: int) -> int:
        """Device time: ns of the device's own oscillator since it was switched on."""
        return int((now_ns - self._start_ns) * self._speed)

    def _next_request(self) -> tuple[int, int, int, bytes] | None:
        """The next valid packet from the host: flags byte, data set, offset, payload."""
        heard = self._heard
        while (at := heard.find(bytes((frames.FIRST, frames.SECOND)))) >= 0:
            del heard[:at]
            if len(heard) < HEADER:
                return None
            size = HEADER + (heard[4] | heard[5] << 8) + TRAILER
            if size <= frames.MAX_PACKET:
                if len(heard) < size:
                    return None
                packet = bytes(heard[:size])
                if struct.pack("<H", frames.fletcher16_of(packet[:-TRAILER])) == packet[-TRAILER:]:
                    del heard[:size]
                    skip = 2 if packet[2] & WITH_OFFSET and size >= HEADER + 2 + TRAILER else 0
                    offset = int.from_bytes(packet[HEADER : HEADER + skip], "little")
                    return packet[2], packet[3], offset, packet[HEADER + skip : -TRAILER]
            del heard[0]
        del heard[: -1 if heard.endswith(bytes((frames.FIRST,))) else None]
        return None

    # -- streams

    def period_ns(self, did: int) -> int:
        """Between two samples of what paces a data set."""
        return {NAV: self._period_ns, IMU: self._period_ns, SLOW: SLOW_NS, GNSS: GNSS_NS}[SOURCES[did].pace]

    def _make(self) -> None:
        """All packets of the current block that have not been sent."""
        made: list[tuple[int, int, bytes]] = []
        shared: dict[tuple[int, bool], Moments] = {}
        for place, did in enumerate(SOURCES):
            if did not in self.streams:
                continue
            period = self.period_ns(did)
            first, end = (-(-block * BLOCK_NS // period) for block in (self._block, self._block + 1))
            if first == end:
                continue
            steps = np.arange(first, end)
            grid = (period, SOURCES[did].pace == GNSS)
            at = shared.setdefault(grid, moments(self.run, did, period, steps))
            chosen = np.flatnonzero((steps % self.streams[did] == 0) & (steps * period > self._sent_ns))
            if len(chosen):
                sent = packets(did, rows_of(did, at, chosen))
                made += zip((steps[chosen] * period).tolist(), [place] * len(sent), sent, strict=True)
        self._waiting = [(time, packet) for time, _, packet in sorted(made, reverse=True)]

    def _due(self, now: int, out: list[bytes]) -> None:
        while True:
            while self._waiting and self._waiting[-1][0] <= now:
                self._send(self._waiting.pop()[1], out)
            end = (self._block + 1) * BLOCK_NS
            self._sent_ns = max(self._sent_ns, min(now, end - 1))
            if self._waiting or now < end:
                return
            self._block += 1
            self._make()

    def _send(self, packet: bytes, out: list[bytes]) -> None:
        number = self._count
        self._count += 1
        if self._drop or self._corrupt:
            random = np.random.default_rng([self._seed, number])
            chance = random.random()
            if chance < self._drop:
                return
            if chance < self._drop + self._corrupt:
                at, bit = random.integers(len(packet)), random.integers(8)
                packet = packet[:at] + bytes([packet[at] ^ 1 << bit]) + packet[at + 1 :]
        out.append(packet)

    def _choose(self, streams: dict[int, int]) -> None:
        if streams != self.streams:
            self.streams = streams
            self._make()

    # -- answers

    def _answer(self, flags: int, did: int, offset: int, payload: bytes, now: int) -> bytes:
        match flags & frames.TYPE_MASK:
            case frames.GET_DATA if len(payload) >= 8:
                wanted, size, at, period = struct.unpack_from("<HHHH", payload)
                return self._get(wanted, size, at, period, now)
            case frames.SET_DATA:
                done = self._set(did, offset, payload, now)
                return _acked(ACK if done else NACK, flags, did, did, len(payload), offset)
            case frames.STOP_DID:
                self._choose({one: every for one, every in self.streams.items() if one != did})
            case frames.STOP_ALL_PORTS | frames.STOP_CURRENT_PORT:
                self._choose({})
                return _acked(ACK, flags, did, 0, 0, 0)
        return b""

    def _get(self, did: int, size: int, offset: int, period: int, now: int) -> bytes:
        """A stream begins, or one packet (with a part, where one is asked for); or a refusal."""
        if did in SOURCES and not (offset or size):
            others = {one: every for one, every in self.streams.items() if one != did}
            self._choose({**others, did: period} if period else others)
            if period:
                return b""
        value = self.value(did, now)
        end = offset + size if size else len(value)
        if not value or offset >= len(value) or end > len(value):
            return _acked(NACK, GET_DATA, 0, did, size, offset)
        return frames.build(DATA, did, value[offset:end], offset=offset)

    def _set(self, did: int, offset: int, data: bytes, now: int) -> bool:
        """Write; False where that cannot be."""
        if did == RMC and offset == 0 and len(data) >= 8:
            bits = int.from_bytes(data[:8], "little")
            self._choose({one: self.streams.get(one, 1) for one, row in SOURCES.items() if bits >> row.bit & 1})
            if int.from_bytes(data[8:12], "little") & RMC_PERSISTENT:
                self.persistent = dict(self.streams)
            return True
        if did == FLASH_CONFIG and data and offset + len(data) <= len(self.flash):
            self.flash = _summed(self.flash[:offset] + data + self.flash[offset + len(data) :])
            return True
        if did == SYS_CMD and offset == 0 and len(data) == 8:
            command, inverse = struct.unpack("<II", data)
            if command ^ inverse != 0xFFFFFFFF or command not in (SAVE_PERSISTENT, RESET):
                return False
            if command == SAVE_PERSISTENT:
                self.persistent = dict(self.streams)
            else:
                self._reset(now)
            return True
        return False

    def _reset(self, now: int) -> None:
        """As if power had failed for a moment: its time begins anew, stored periods act."""
        nav_ms = int.from_bytes(self.flash[16:20], "little")
        if nav_ms != max(1, round(self._period_ns / 1e6)):
            self._period_ns = max(nav_ms, 1) * 1_000_000
        self._start_ns += round(now / self._speed)
        self.run = Run(self._seed, self.run.road, None, self.run.utc_ns + now)
        self._awake, self._waiting, self.streams = False, [], {}
        self._heard.clear()
        self._heard_ns = 0
        self._sent_ns = -1

    # -- values

    def value(self, did: int, now: int) -> bytes:
        """A whole data set as it is now; b"" where this device has none of that number."""
        if did in SOURCES:
            period = self.period_ns(did)
            steps = np.array([now // period])
            return rows_of(did, moments(self.run, did, period, steps), np.array([0])).tobytes()
        if did == FLASH_CONFIG:
            return self.flash
        if did == RMC:
            bits = sum(1 << SOURCES[one].bit for one in self.streams)
            return struct.pack("<QI", bits, 0)
        if did == DEV_INFO:
            return self._info()
        return self._parameters(now) if did == SYS_PARAMS else b""

    def _info(self) -> bytes:
        out = np.zeros(1, DTYPES[DEV_INFO])
        out["hardwareType"], out["hdwRunState"], out["serialNumber"] = 3, 2, self.serial
        out["hardwareVer"], out["firmwareVer"], out["protocolVer"] = (5, 0, 4, 0), FIRMWARE, (2, 0, 0, 0)
        out["buildNumber"], out["repoRevision"] = 7, 0x2701_0000
        out["manufacturer"] = _text(b"Inertial Sense Inc", 24)
        out["buildType"] = ord("r")
        out["buildYear"], out["buildMonth"], out["buildDay"] = 26, 1, 1
        out["addInfo"] = _text(b"twin", 24)
        return out.tobytes()

    def _parameters(self, now: int) -> bytes:
        at = Moments(self.run, now // self._period_ns, np.array([now]), self._period_ns)
        out = np.zeros(1, DTYPES[SYS_PARAMS])
        out["timeOfWeekMs"] = at.gps[1] // 10**6
        out["insStatus"], out["hdwStatus"] = at.ins_status, at.hdw_status
        out["imuTemp"] = out["baroTemp"] = out["mcuTemp"] = 24.0 + 14.0 * (1 - np.exp(-now / (600 * S)))
        for name in ("imuSamplePeriodMs", "navOutputPeriodMs", "navUpdatePeriodMs"):
            out[name] = max(1, round(self._period_ns / 1e6))
        out["sensorTruePeriod"], out["upTime"] = self._period_ns / 1e9, now / 1e9
        out["flashCfgChecksum"] = int.from_bytes(self.flash[4:8], "little")
        return out.tobytes()

    def _factory(self, rate: float) -> bytes:
        out = np.zeros(1, DTYPES[FLASH_CONFIG])
        out["size"], out["key"] = DTYPES[FLASH_CONFIG].itemsize, 21
        out["startupImuDtMs"] = out["startupNavDtMs"] = max(1, round(1e3 / rate))
        out["startupGPSDtMs"] = GNSS_NS // 10**6
        out["ser0BaudRate"] = out["ser1BaudRate"] = out["ser2BaudRate"] = BAUD
        out["dynamicModel"], out["gnssSatSigConst"] = 4, 0x10FF  # a ground vehicle; GPS, QZSS, Galileo, BeiDou, SBAS
        out["refLla"] = out["lastLla"] = PLACE
        out["gnssCn0Minimum"] = 15
        return _summed(out.tobytes())


def _acked(kind: int, flags: int, header_id: int, did: int, size: int, offset: int) -> bytes:
    """ACK or NACK: the packet that is answered, and what of it. (A GET may name a set beyond 255; a NACK cannot.)"""
    return frames.build(kind, 0, struct.pack("<BBHBHH", flags, header_id, 0, did & 0xFF, size, offset))


def _summed(flash: bytes) -> bytes:
    """The flash configuration with its checksum: the exclusive or of all words behind it (SDK: flashChecksum32)."""
    total = int(np.bitwise_xor.reduce(np.frombuffer(flash, "<u4")[2:]))
    return flash[:4] + struct.pack("<I", total) + flash[8:]


def _text(words: bytes, size: int) -> Array:
    return np.frombuffer(words.ljust(size, b"\0"), "S1")
