"""A simulated IMX-5.

    power, SOFTWARE_RESET ──boot──> DID_DEV_INFO, then the persistent streams
                                         ^   GET: a stream or one packet     SET, stops: ACK     refused: NACK

`IsbSimulator` is pure: it has no clock, link or thread. The caller passes the current time and gets the bytes sent by
then. simulator/signals.py computes its measurements, from the shared drive.

    GET_DATA     period 0 sends the data set once and ends its stream, whatever size is requested (a part of one without
                 a bit in DID_RMC leaves the stream, which is another slot of the vendor's code); else one packet every
                 `period` times the source's own. NACK for unknown data sets.
    SET_DATA     DID_RMC selects streams by bits; simulator/settings.py has the stored values (new periods and rates
                 take effect after a reset, as in the device); DID_SYS_CMD saves, resets, and refuses the rest.
    stops        of one data set without an answer; of all with ACK.
    NMEA         simulator/nmea.py: sentences beside the packets, and text requests.
    RTCM 3       accepted and counted, as corrections for the receiver.

Not simulated: RTK and other ports; a stop of all ports stops this one.

Source: ISB document; inertial-sense-sdk 2.7.1, data_sets.h and ISComm.h.
"""

import math
import struct
from collections import Counter

import numpy as np

from imuscope.protocols.arrays import Array
from imuscope.protocols.embedded.finders import STARTS, find
from imuscope.protocols.events import Text
from imuscope.protocols.framing.stream_parser import StreamParser
from imuscope.protocols.isb import frames
from imuscope.protocols.isb.frames import ACK, DATA, GET_DATA, NACK, WITH_OFFSET
from imuscope.protocols.isb.simulator import nmea
from imuscope.protocols.isb.simulator.settings import SettingsMemory, factory
from imuscope.protocols.isb.simulator.signals import (
    BLOCK_NS,
    DTYPES,
    GNSS,
    GNSS_NS,
    IMU,
    NAV,
    SLOW,
    SOURCES,
    UTC_2026_S,
    S,
    SignalSamples,
    SignalSource,
    moments,
    packets,
    rows_of,
)
from imuscope.protocols.isb.streams import BY_BIT, dids_of
from imuscope.protocols.simulator.setups import AS_BUILT, SensorSetup

PRODUCTS = ("IMX-5", "GPX-1")  # the second is gpx.py
IMU_SOURCES = ("nav", "imu")
FIRMWARE = (2, 7, 1, 0)
DEV_INFO, SYS_CMD, RMC, SYS_PARAMS = 1, 7, 9, 10
SAVE_PERSISTENT, RESET = 1, 99
DONE = (1, 3, 4, 5, 6, 7, 8, 11, 60, 61, 62, 70, 97, 98, 99)  # accepted system commands
RMC_PRESERVE = 1 << 8
RMC_PERSISTENT = 1 << 9
BITS = frozenset(BY_BIT.values())
BOOT_NS = 300_000_000
Request = tuple[int, int, int, bytes] | Text
STALL_NS = 200_000_000  # an incomplete request older than this is forgotten
SLOW_NS, FAST_NS = 20_000_000, 1_000_000
SLOW_INS_2_HZ = 50
BAUD = 921_600


class IsbSimulator:
    """A simulated IMX-5.

    Args:
        product: of PRODUCTS.
        serial: None: derived from the seed.
        seed: repeats noise exactly.
        start_ns: power-on time, on the clock of `advance`; its 0 is the start of 2026 in UTC, so that the date
            continues when a device is switched off and on.
        rate: samples/s of inertial data and navigation; above 1000 the device is faster than any real one.
        clock_drift_ppm: how much faster the device's oscillator runs than the clock of `advance`.
        clock_jump: (device time s, by s): the device's clock jumps once.
        imu_source: period that DID_IMU follows: "nav", that of navigation (the header of the SDK), or "imu", that of
            inertial data (the document).
        vibration: share of the vehicle's shaking that reaches the sensor: 0 none, 1 a rigid mount.
        baud: rate of its ports; None for the factory's.
        setup: motion, and errors that a calibration finds.

    Raises:
        ValueError: unknown product.
    """

    def __init__(
        self,
        product: str = "IMX-5",
        serial: int | None = None,
        seed: int = 0,
        start_ns: int = 0,
        *,
        rate: float = 100,
        clock_drift_ppm: float = 0.0,
        clock_jump: tuple[float, float] | None = None,
        imu_source: str = "nav",
        vibration: float = 0.0,
        baud: int | None = None,
        setup: SensorSetup = AS_BUILT,
    ) -> None:
        if product not in PRODUCTS:
            raise ValueError(f"there is no simulator of {product!r}; there are {', '.join(PRODUCTS)}")
        self.product = product
        self.serial = 62_000 + seed % 0xFFFF if serial is None else serial
        self.baud = baud or BAUD
        self._seed, self._start_ns = seed, start_ns
        self._speed = 1 + clock_drift_ppm * 1e-6
        jump = clock_jump and (round(clock_jump[0] * 1e9), round(clock_jump[1] * 1e9))
        self.run = SignalSource(seed, vibration, jump, UTC_2026_S * S + start_ns, setup)
        self._period_ns = max(round(S / rate), 1)
        self.memory = SettingsMemory(factory(rate, self.baud))
        self.corrections: Counter[str] = Counter()  # received RTCM messages, by number
        if imu_source not in IMU_SOURCES:
            raise ValueError(f"imu_source is one of {', '.join(IMU_SOURCES)}, given {imu_source!r}")
        self._imu_source = imu_source
        self._imu_ns, self._gnss_ns = self._period_ns, GNSS_NS
        every = max(1, round(rate / SLOW_INS_2_HZ))
        self.persistent: dict[int, int] = {58: 1, 4: 1, 5: every, 52: 1, 53: 1, 13: 1, 30: 1, 15: 5}
        self.streams: dict[int, int] = {}
        self._is_awake = False
        self._block = 0
        self._sent_ns = -1  # everything due up to this device time has been sent
        self._waiting: list[tuple[int, bytes]] = []  # packets of this block not sent yet, last first
        self._parser = StreamParser(frames.scan, find, STARTS)
        self._received_ns = 0

    # -- the two directions of the link

    def advance(self, now_ns: int) -> bytes:
        now = self._local(now_ns)
        out: list[bytes] = []
        if not self._is_awake and now >= BOOT_NS:
            self._is_awake = True
            self.streams = dict(self.persistent)
            self.memory.reset()
            self._sent_ns = BOOT_NS
            self._block = BOOT_NS // BLOCK_NS
            self._make()
            out.append(frames.build(DATA, DEV_INFO, self.value(DEV_INFO, now)))
        if self._is_awake:
            self._due(now, out)
        return b"".join(out)

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """Handle bytes from the host; returns the bytes sent by then, followed by its answers."""
        out = [self.advance(now_ns)]
        if not self._is_awake:
            return b""  # the device has not booted yet
        now = self._local(now_ns)
        requests = self._requests(stalled=True) if now - self._received_ns > STALL_NS else []
        self._parser.feed(data, now)
        self._received_ns = now
        out += [self._receive(request, now) for _, request in requests + self._requests()]
        return b"".join(out)

    @property
    def next_ns(self) -> int:
        if not self._is_awake or not self._waiting:
            return 0
        return self._start_ns + math.ceil(self._waiting[-1][0] / self._speed)

    def _receive(self, request: Request, now: int) -> bytes:
        """One packet, sentence or correction."""
        if not self._is_awake:
            return b""  # an earlier one was a reset
        if isinstance(request, tuple):
            return self._answer(*request, now)
        if request.protocol == "rtcm3":
            self.corrections[request.name] += 1
        return self._text(request.line, now) if request.protocol == "nmea" else b""

    def _local(self, now_ns: int) -> int:
        """Device time: ns of the device's own oscillator since it was switched on."""
        return int((now_ns - self._start_ns) * self._speed)

    def _requests(self, *, stalled: bool = False) -> list[tuple[int, Request]]:
        """Requests received, in order: packets as (flags byte, data set, offset, payload), sentences, corrections."""
        cut = self._parser.drain(stalled=stalled)
        requests: list[tuple[int, Request]] = [(text.offset, text) for text in cut.texts if text.name]
        for at, _, body, length, did, flags in cut.table[:6].T.tolist():
            shifted = flags & WITH_OFFSET and flags & frames.TYPE_MASK in (frames.DATA, frames.SET_DATA)
            offset = int.from_bytes(cut.data[body - 2 : body], "little") if shifted else 0
            requests.append((cut.start + at, (flags, did, offset, cut.data[body : body + length])))
        return sorted(requests, key=lambda one: one[0])

    # -- streams

    def period_ns(self, did: int) -> int:
        """Period of a data set's source."""
        if did not in SOURCES:
            return FAST_NS
        imu_ns = self._imu_ns if self._imu_source == "imu" else self._period_ns
        return {NAV: self._period_ns, IMU: imu_ns, SLOW: SLOW_NS, GNSS: self._gnss_ns}[SOURCES[did].pace]

    def _make(self) -> None:
        """All packets of the current block that have not been sent."""
        made: list[tuple[int, int, bytes]] = []
        shared: dict[tuple[int, bool], SignalSamples] = {}
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
        for did in self.streams.keys() - SOURCES.keys():
            times = self._times(FAST_NS * self.streams[did])
            made += [(time, len(SOURCES), frames.build(DATA, did, self.value(did, time))) for time in times]
        for number, every in self.memory.sentences.items():
            source = nmea.source_of(number)
            if source is not None:
                times = self._times(self.period_ns(source) * every)
                made += [(time, 999, nmea.line(number, self.value(source, time))) for time in times]
        self._waiting = [(time, packet) for time, _, packet in sorted(made, reverse=True)]

    def _times(self, period: int) -> list[int]:
        """The multiples of a period in this block that have not been sent."""
        first, end = (-(-block * BLOCK_NS // period) for block in (self._block, self._block + 1))
        return [step * period for step in range(first, end) if step * period > self._sent_ns]

    def _due(self, now: int, out: list[bytes]) -> None:
        while True:
            while self._waiting and self._waiting[-1][0] <= now:
                out.append(self._waiting.pop()[1])
            end = (self._block + 1) * BLOCK_NS
            self._sent_ns = max(self._sent_ns, min(now, end - 1))
            if self._waiting or now < end:
                return
            self._block += 1
            self._make()

    def _choose(self, streams: dict[int, int]) -> None:
        if streams != self.streams:
            self.streams = streams
            self._make()

    # -- answers

    def _answer(self, flags: int, did: int, offset: int, payload: bytes, now: int) -> bytes:
        match flags & frames.TYPE_MASK:
            case frames.GET_DATA if len(payload) >= 8:
                target, size, at, period = struct.unpack_from("<HHHH", payload)
                return self._get(target, size, at, period, now)
            case frames.SET_DATA:
                done = self._set(did, offset, payload, now)
                return _acked(ACK if done else NACK, flags, did, did, len(payload), offset)
            case frames.STOP_DID:
                self._choose({one: every for one, every in self.streams.items() if one != did})
            case frames.STOP_ALL_PORTS | frames.STOP_CURRENT_PORT:
                self.memory.sentences = {}
                self._choose({})
                return _acked(ACK, flags, did, 0, 0, 0)
        return b""

    def _get(self, did: int, size: int, offset: int, period: int, now: int) -> bytes:
        """Start a stream, or send one packet (or a part), or refuse."""
        if (did in BITS or (not offset and size in (0, len(self.value(did, now))))) and self.value(did, now):
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
        """Write; False if that is not possible."""
        if did == RMC and offset == 0 and len(data) >= 8:
            bits, options = int.from_bytes(data[:8], "little"), int.from_bytes(data[8:12], "little")
            dids = {one for one in dids_of(bits) if one in SOURCES}
            dids |= self.streams.keys() if options & RMC_PRESERVE else set()
            self._choose({one: self.streams.get(one, 1) for one in dids})
            if options & RMC_PERSISTENT:
                self._save()
            return True
        if did == SYS_CMD and offset == 0 and len(data) == 8:
            command, inverse = struct.unpack("<II", data)
            return bool(command ^ inverse == 0xFFFFFFFF) and self._command(command, now)
        sentences = dict(self.memory.sentences)
        done = self.memory.write(did, offset, data, now)
        if sentences != self.memory.sentences:
            self._make()
        return done

    def _command(self, command: int, now: int) -> bool:
        """Run a system command; False for those it lacks: bridges, bootloaders, the maker's own."""
        if command == SAVE_PERSISTENT:
            self._save()
        elif command == RESET:
            self._reset(now)
        return command in DONE

    def _save(self) -> None:
        """Save streams and sentences over a reset."""
        self.persistent = dict(self.streams)
        self.memory.saved_sentences = dict(self.memory.sentences)

    def _text(self, line: str, now: int) -> bytes:
        words = line.strip()[1:-3].split(",")
        match words:
            case ["STPB"] | ["STPC"]:
                self.memory.sentences = {}
                self._choose({})
                self._make()
            case ["PERS"]:
                self._save()
            case ["SRST"]:
                self._reset(now)
            case ["INFO"]:
                return nmea.info(self._info())
            case ["ASCE"]:
                return nmea.periods(self.memory.sentences)
            case ["ASCE", *rest] if periods := nmea.chosen(rest):
                self.memory.choose(periods[1], keep=bool(periods[0] & RMC_PERSISTENT))
                self._make()
        return b""

    def _reset(self, now: int) -> None:
        """Restart as after a power failure: time starts over, stored periods take effect."""
        nav_ms, imu_ms, gnss_ms = self.memory.periods_ms
        if nav_ms != max(1, round(self._period_ns / 1e6)):
            self._period_ns = max(nav_ms, 1) * 1_000_000
        if imu_ms != max(1, round(self._imu_ns / 1e6)):
            self._imu_ns = max(imu_ms, 1) * 1_000_000
        self._gnss_ns = max(gnss_ms, 50) * 1_000_000
        self.baud = self.memory.baud
        self._start_ns += round(now / self._speed)
        self.run = SignalSource(self._seed, self.run.vibration, None, self.run.utc_ns + now, self.run.setup)
        self._is_awake, self._waiting, self.streams = False, [], {}
        self._parser = StreamParser(frames.scan, find, STARTS)
        self._received_ns = 0
        self._sent_ns = -1

    def repowered(self, start_ns: int) -> "IsbSimulator":
        """The device after a power cycle, with its stored values."""
        self._reset(max(self._local(start_ns), 0))
        return self

    # -- values

    def value(self, did: int, now: int) -> bytes:
        """A whole data set at this moment; b"" if this device lacks it."""
        if did in SOURCES:
            period = self.period_ns(did)
            steps = np.array([now // period])
            return rows_of(did, moments(self.run, did, period, steps), np.array([0])).tobytes()
        if did == RMC:
            bits = sum(1 << SOURCES[one].bit for one in self.streams if one in SOURCES)
            return struct.pack("<QI", bits, 0)
        if did == DEV_INFO:
            return self._info()
        return self._parameters(now) if did == SYS_PARAMS else self.memory.value(did, now)

    def _info(self) -> bytes:
        out = np.zeros(1, DTYPES[DEV_INFO])
        out["hardwareType"], out["hdwRunState"], out["serialNumber"] = 3, 2, self.serial
        out["hardwareVer"], out["firmwareVer"], out["protocolVer"] = (5, 0, 4, 0), FIRMWARE, (2, 0, 0, 0)
        out["buildNumber"], out["repoRevision"] = 7, 0x2701_0000
        out["manufacturer"] = _text(b"Inertial Sense Inc", 24)
        out["buildType"] = ord("r")
        out["buildYear"], out["buildMonth"], out["buildDay"] = 26, 1, 1
        out["addInfo"] = _text(b"simulator", 24)
        return out.tobytes()

    def _parameters(self, now: int) -> bytes:
        at = SignalSamples(self.run, now // self._period_ns, np.array([now]), self._period_ns)
        out = np.zeros(1, DTYPES[SYS_PARAMS])
        out["timeOfWeekMs"] = at.gps[1] // 10**6
        out["insStatus"], out["hdwStatus"] = at.ins_status, at.hdw_status
        out["imuTemp"] = out["baroTemp"] = out["mcuTemp"] = 24.0 + 14.0 * (1 - np.exp(-now / (600 * S)))
        out["imuSamplePeriodMs"] = max(1, round(self._imu_ns / 1e6))
        out["navOutputPeriodMs"] = out["navUpdatePeriodMs"] = max(1, round(self._period_ns / 1e6))
        out["sensorTruePeriod"], out["upTime"] = self._period_ns / 1e9, now / 1e9
        out["flashCfgChecksum"] = self.memory.word(4)
        return out.tobytes()


def _acked(kind: int, flags: int, header_id: int, did: int, size: int, offset: int) -> bytes:
    """Build an ACK or NACK for a packet. A GET may name a set beyond 255; a NACK cannot."""
    return frames.build(kind, 0, struct.pack("<BBHBHH", flags, header_id, 0, did & 0xFF, size, offset))


def _text(words: bytes, size: int) -> Array:
    return np.frombuffer(words.ljust(size, b"\0"), "S1")
