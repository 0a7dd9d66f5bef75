"""A device that is not there: simulated bytes behind a real pseudo-terminal, opened by the serial link like any other.

    device ──> Cable ──> master ═══ pseudo-terminal ═══ slave <── SerialLink ──> session
       ^                   │
       └────── Cable <─────┘            all of the left side is one thread, the bench

So what is tested with a twin is what runs with a sensor: the port, the reading thread, the rate, an unplugged cable.

    twin:xbus                       an MTi-630 at 100 Hz on a line of 115 200 Bd; ?product=MTi-680G another product
    twin:isb                        an IMX-5 at 100 Hz on 921 600 Bd; ?imu_source=nav|imu what times DID_IMU
    twin:idtp                       an IDTP device in Safety mode, Imu10 and ImuQuat at 100 Hz; ?mode=lite|safety|secure
                                    (Secure frames are made with the source's key; without one, with one nobody knows)
    ?rate=400                       samples/s
    ?baud=921600                    rate of the line (else the slowest that carries the samples); bytes take their time
                                    on it, and a port at another rate hears noise
    ?dead_baud=921600               a rate that the line cannot carry: at it, both sides hear noise
    ?stubborn=1                     an MTi that does not hear GoToConfig until it has been reset
    ?mute=0.1 ?wrong=0.1            share of its answers that never come, or are answers to something else
    ?late_ms=700                    every answer is late
    ?cut=3                          its power fails between the third setting it takes and storing it
    ?drop=0.01 ?corrupt=0.01        share of frames lost, or with one bit flipped
    ?burst_ms=16                    a USB adapter with its latency timer at 16 ms, or when 62 bytes have gathered;
    ?packet=0                       ... however many have gathered
    ?clock=ms                       an IDTP device whose timestamps count milliseconds; also ns, us, s
    ?drift_ppm=50                   the device clock runs fast by so much
    ?jump_s=20                      after 20 s the device clock jumps ahead by 10 s
    ?reset_s=30                     every 30 s the device resets: its clock begins anew, and so does the sequence of an
                                    IDTP device
    ?unplug_s=30 ?away_s=5          after 30 s it is unplugged, and back, freshly powered, 5 s later
    ?seed=1                         another noise, another sequence of faults
"""

from __future__ import annotations

import asyncio
import errno
import logging
import os
import secrets
import select
import termios
import threading
import time
import tty
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from protocols.xbus.moods import NONE, Moods
from server.links.base import Chunk, Link, LinkError, LinkSettings, Progress
from server.links.cable import Cable, Faults
from server.links.packets import PACKET
from server.links.pump import closed
from server.links.serial import Line, SerialLink
from server.links.sources import Source

log = logging.getLogger(__name__)

TICK_NS = 1_000_000  # how often the device is asked for its bytes when the cable has nothing due earlier
LATE_NS = 10_000_000  # a bench that was held up makes up for it in such steps, so that its line is not full for that
HELD_BYTES = 640 * 1024  # Linux, drivers/tty/tty_buffer.c, TTYB_DEFAULT_MEM_LIMIT: what a port holds for a late reader
JUMP_S = 10.0
LINE_RATES = (115_200, 230_400, 460_800, 921_600, 2_000_000, 4_000_000)
MOODS = ("stubborn", "mute", "wrong", "late_ms", "cut")
OPTIONS = (
    *("product", "mode", "clock", "rate", "baud", "dead_baud", *MOODS, "drop", "corrupt", "burst_ms", "packet"),
    *("drift_ppm", "jump_s", "reset_s", "unplug_s", "away_s", "seed", "imu_source"),
)
MODES = ("lite", "safety", "secure")
CLOCKS: Mapping[str, int] = {"us": 1_000, "ns": 1, "ms": 1_000_000, "s": 1_000_000_000}


@dataclass(frozen=True, slots=True)
class Family:
    """What twins of a protocol are like.

    Args:
        products: the first is the usual one; () where there is no choice.
        sample_bytes: sent for each sample in the default configuration.
        more_bytes: sent each second beside that.
        least_baud: rate of its line when it leaves the factory.
        options: which only this family has.
    """

    products: Callable[[], tuple[str, ...]]
    sample_bytes: int
    more_bytes: int = 0
    least_baud: int = 115_200
    options: tuple[str, ...] = ()


def _mti() -> tuple[str, ...]:
    from protocols.xbus.settings import PRODUCTS  # when first used: its tables load what is compiled

    return "MTi-630", *(name for name in PRODUCTS if name != "MTi-630")


FAMILIES: Mapping[str, Family] = {
    "xbus": Family(_mti, 88, options=("product", *MOODS)),
    "isb": Family(lambda: ("IMX-5", "GPX-1"), 132, 8_000, 921_600, ("product", "imu_source")),
    "idtp": Family(lambda: (), 104, options=("mode", "clock")),  # of Safety; Secure has 56 more
}
SECURE_BYTES = 56


class Device(Protocol):
    """The other end of the wire (`protocols.xbus.device.XbusDevice`): no clock of its own."""

    baud: int  # the rate it speaks at; a new one acts after Reset

    def advance(self, now_ns: int) -> bytes:
        """Everything the device sends up to that device time."""

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """Bytes from the host; what the device answers."""


@dataclass(frozen=True, slots=True)
class TwinOptions:
    """What the query of a twin source may say; see the module docstring."""

    protocol: str = "xbus"
    product: str = "MTi-630"
    mode: str = "safety"
    clock: str = "us"
    rate: float = 100.0
    faults: Faults = field(default_factory=lambda: Faults(baud=115_200))
    drift_ppm: float = 0.0
    jump_s: float = 0.0
    reset_s: float = 0.0
    unplug_s: float = 0.0
    away_s: float = 5.0
    seed: int = 0
    imu_source: str = "nav"
    moods: Moods = NONE

    @classmethod
    def of(cls, source: Source) -> TwinOptions:
        """Read a twin source.

        Raises:
            LinkError: kind "bad-source".
        """
        family = FAMILIES.get(source.place)
        if family is None:
            allowed = ", ".join(FAMILIES)
            raise LinkError("bad-source", f"There is no twin of {source.place!r}.", f"Twins exist of: {allowed}.")
        others = {name for other in FAMILIES.values() for name in other.options} - set(family.options)
        source.allow([name for name in OPTIONS if name not in others])
        products = family.products()
        rate = source.number("rate", 100, 1, 2000, "Hz")
        mode = source.choice("mode", "safety", MODES)
        return cls(
            protocol=source.place,
            product=source.choice("product", products[0], products) if products else "",
            mode=mode,
            clock=source.choice("clock", "us", tuple(CLOCKS)),
            rate=rate,
            faults=Faults(
                drop=source.number("drop", 0, 0, 1),
                corrupt=source.number("corrupt", 0, 0, 1),
                burst_ms=source.number("burst_ms", 0, 0, 1000, "ms"),
                packet=source.whole("packet", PACKET, 0, 65_536, "bytes"),
                baud=source.whole("baud", _fitting(family, rate, mode), 4800, 4_000_000, "Bd"),
                dead_baud=source.whole("dead_baud", 0, 0, 4_000_000, "Bd") or None,
            ),
            moods=Moods(
                mute=source.number("mute", 0, 0, 1),
                wrong=source.number("wrong", 0, 0, 1),
                late_ns=round(source.number("late_ms", 0, 0, 60_000, "ms") * 1e6),
                cut=source.whole("cut", 0, 0, 1_000_000),
                stubborn=bool(source.whole("stubborn", 0, 0, 1)),
            ),
            drift_ppm=source.number("drift_ppm", 0, -10_000, 10_000, "ppm"),
            jump_s=source.number("jump_s", 0, 0, 86_400, "s"),
            reset_s=source.number("reset_s", 0, 0, 86_400, "s"),
            unplug_s=source.number("unplug_s", 0, 0, 86_400, "s"),
            away_s=source.number("away_s", 5, 0, 3600, "s"),
            seed=source.whole("seed", 0, 0, 2**31),
            imu_source=source.choice("imu_source", "nav", ("nav", "imu")),
        )


def _fitting(family: Family, rate: float, mode: str) -> int:
    """The slowest usual rate that carries so many samples/s with a fifth to spare; the fastest where none does."""
    sample = family.sample_bytes + SECURE_BYTES * (mode == "secure")
    needed = sample * rate + family.more_bytes
    fitting = (baud for baud in LINE_RATES if baud >= family.least_baud and 0.8 * baud / 10 >= needed)
    return next(fitting, LINE_RATES[-1])


def make_device(options: TwinOptions, start_ns: int, key: bytes | None = None) -> Device:
    """A freshly powered device.

    Args:
        key: for Secure frames; None for one that nobody knows.
    """
    from protocols.idtp.device import IdtpDevice
    from protocols.isb.device import IsbDevice
    from protocols.isb.gpx import GpxDevice
    from protocols.xbus.device import XbusDevice

    jump = (options.jump_s, JUMP_S) if options.jump_s else None
    seed, drift = options.seed, options.drift_ppm
    if options.protocol == "idtp":
        return IdtpDevice(
            device_id=102 + seed % 1000,
            seed=seed,
            start_ns=start_ns,
            rate=options.rate,
            mode=MODES.index(options.mode),
            key=(key or secrets.token_bytes(32)) if options.mode == "secure" else None,
            clock_drift_ppm=drift,
            clock_jump=jump,
            tick_ns=CLOCKS[options.clock],
        )
    if options.protocol == "isb":
        made = GpxDevice if options.product.startswith("GPX") else IsbDevice
        return made(
            product=options.product,
            rate=options.rate,
            seed=seed,
            start_ns=start_ns,
            clock_drift_ppm=drift,
            clock_jump=jump,
            imu_source=options.imu_source,
            road=1.0,
            baud=options.faults.baud,
        )
    return XbusDevice(
        options.product,
        None,
        seed,
        start_ns,
        rate=options.rate,
        clock_drift_ppm=drift,
        clock_jump=jump,
        road=1.0,
        baud=options.faults.baud,
        moods=options.moods,
    )


def again(device: Device | None, now_ns: int, make: Callable[[int], Device]) -> Device:
    """The device after its power was off: with what it stored, where it has such a memory; otherwise a new one."""
    repowered = getattr(device, "repowered", None)
    if repowered is None:
        return make(now_ns)
    same: Device = repowered(now_ns)
    return same


class Bench(threading.Thread):
    """The left side of the drawing: a device, both directions of its cable, and the master of a pseudo-terminal.

    Args:
        make: a freshly powered device; it is given the time, on `now_ns`, at which power comes.
        now_ns: a clock that does not step.
        before: the device that was here before its power was off; None for a new one.
    Attributes:
        slave: path of the port at which the device is found.
        device: what is at the other end.
    """

    def __init__(
        self,
        make: Callable[[int], Device],
        options: TwinOptions,
        now_ns: Callable[[], int] = time.monotonic_ns,
        before: Device | None = None,
    ) -> None:
        super().__init__(name=f"twin {options.protocol}", daemon=True)
        self._make = make
        self._options = options
        self._now_ns = now_ns
        self.device = before
        self._to_host = Cable(options.faults, options.seed, options.protocol)
        line = Faults(baud=options.faults.baud, dead_baud=options.faults.dead_baud)
        self._to_device = Cable(line, options.seed, options.protocol)
        self._stop_read, self._stop_write = os.pipe()
        self._master, self._slave_fd = os.openpty()
        # Without this the terminal would echo what the device says back to the device until the port is opened.
        tty.setraw(self._slave_fd)
        os.set_blocking(self._master, False)
        self.slave = os.ttyname(self._slave_fd)
        self._held = b""  # bytes that the pseudo-terminal, which has room for 4 kB, did not take yet
        self._stopped = False
        self._cycled = False

    def cycle(self) -> None:
        """Switch the device's power off and on; its port stays."""
        self._cycled = True

    def unplug(self) -> None:
        """Pull the plug: its port goes, and with it the power."""
        self._stopped = True

    def run(self) -> None:
        try:
            self._live()
        except Exception:  # the thread's top: a fault here looks like a pulled plug, and is not silent
            log.exception("The twin at %s failed.", self.slave)
        finally:
            self._unplug()

    def _live(self) -> None:
        """Until it is stopped or unplugged."""
        options = self._options
        born_ns = powered_ns = told_ns = self._now_ns()
        device = again(self.device, powered_ns, self._make)
        self.device = device
        baud = device.baud
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        poll.register(self._stop_read, select.POLLIN)
        while not self._stopped:
            now_ns = self._now_ns()
            if options.unplug_s and now_ns - born_ns >= options.unplug_s * 1e9:
                break
            if self._cycled or (options.reset_s and now_ns - powered_ns >= options.reset_s * 1e9):
                self._cycled = False
                powered_ns, device = now_ns, again(device, now_ns, self._make)
                self.device = device
            for at_ns in (*range(max(told_ns, powered_ns) + LATE_NS, now_ns, LATE_NS), now_ns):
                self._to_host.send(device.advance(at_ns), at_ns)
            told_ns = now_ns
            heard = self._to_device.arrived(now_ns, self._host_baud())
            if heard:
                self._to_host.send(device.receive(heard, now_ns), now_ns)
            if device.baud != baud:  # a command changed it; until then the line is as the source says
                baud = self._to_host.baud = self._to_device.baud = device.baud
            self._put(self._to_host.arrived(now_ns, self._host_baud()))
            self._take(poll, now_ns)

    def _take(self, poll: select.poll, now_ns: int) -> None:
        """Wait until something is due, taking what the host sends meanwhile."""
        due = [at for at in (self._to_host.next_ns, self._to_device.next_ns) if at is not None]
        wait_ns = min([now_ns + TICK_NS, *due]) - self._now_ns()
        for fd, event in poll.poll(max(wait_ns, 0) / 1e6):
            if fd == self._master and event & select.POLLIN:
                try:
                    self._to_device.send(os.read(self._master, 4096), now_ns)
                except OSError as error:
                    if error.errno not in (errno.EIO, errno.EAGAIN):  # EIO: nobody has the port open
                        raise
            elif fd == self._master:
                time.sleep(TICK_NS / 1e9)  # nobody has the port open, which poll reports without waiting

    def _put(self, data: bytes) -> None:
        """Hand bytes to the port. What it cannot hold is lost, as at a real port that nobody reads.

        A pseudo-terminal holds far less than a real port does, and its reader shares a process with this thread: both
        are held up together when something is compiled. So the rest of what a real port would hold is held here.
        """
        self._held += data
        if not self._held:
            return
        try:
            taken = os.write(self._master, self._held)
        except BlockingIOError:
            taken = 0
        is_open = self._slave_fd < 0
        most = HELD_BYTES if is_open else 0  # nobody waits for what came before the port was open
        rest = self._held[taken:]
        self._to_host.overflowed += max(0, len(rest) - most)
        self._held = rest[:most]

    def _host_baud(self) -> int | None:
        """The rate that the host has set, as the terminal knows it."""
        try:
            return _RATES.get(termios.tcgetattr(self._master)[4])
        except termios.error:
            return None

    def _unplug(self) -> None:
        os.close(self._master)
        self._master = -1

    def hold(self) -> None:
        """The host is about to close the port and open it again: keep the terminal, and how it is set, alive."""
        if self._slave_fd < 0:
            self._slave_fd = os.open(self.slave, os.O_RDWR | os.O_NOCTTY)

    def release(self) -> None:
        """The host has the port open: let go of our own handle on it, so that the cable can be pulled."""
        if self._slave_fd >= 0:
            os.close(self._slave_fd)
            self._slave_fd = -1

    def stop(self) -> None:
        """End the thread and free everything."""
        self._stopped = True
        os.write(self._stop_write, b"\0")
        if self.is_alive():
            self.join()
        elif self._master >= 0:
            self._unplug()
        self.release()
        os.close(self._stop_read)
        os.close(self._stop_write)


_RATES = {value: int(name[1:]) for name, value in vars(termios).items() if name[0] == "B" and name[1:].isdigit()}


class TwinLink(Link):
    """A twin with its cable and port.

    Args:
        make: makes the device; tests give their own.
        baud: how the host opens the port; None: as the twin's line is, 0: by listening.
    """

    kind = "twin"

    def __init__(
        self,
        source: str,
        settings: LinkSettings,
        options: TwinOptions,
        make: Callable[[int], Device] | None = None,
        baud: int | None = None,
    ) -> None:
        super().__init__(source, settings)
        self.options = options
        self._make = make or (lambda start_ns: make_device(options, start_ns, self.settings.key))
        self._open_baud = options.faults.baud if baud is None else baud or None
        self._bench: Bench | None = None
        self._serial: SerialLink | None = None
        self._device: Device | None = None  # as it was when the link was last open: it keeps what it stores
        self._away_until_s = 0.0

    async def open(self, progress: Progress | None = None) -> None:
        await self.close()
        if time.monotonic() < self._away_until_s:
            raise LinkError("not-found", f"{self.source} is unplugged.", "It comes back by itself in a few seconds.")
        # The first device loads what is compiled: not on the loop, and before the port exists.
        await asyncio.to_thread(self._make, 0)
        try:
            self._bench = Bench(self._make, self.options, before=self._device)
        except OSError as error:
            hint = "A twin needs pseudo-terminals (/dev/ptmx): in a container, mount devpts."
            raise LinkError("refused", f"No pseudo-terminal for a twin: {error.strerror}.", hint) from None
        self._serial = SerialLink(self.source, self.settings, self._bench.slave, Line(baud=self._open_baud))
        self._serial.flow = self.flow
        try:
            if self._open_baud is None:
                self._bench.start()  # there must be something to listen to
                await self._serial.open(progress)
            else:
                await self._serial.open(progress)  # opening clears the port: its first frames would be lost, or cut
                self._bench.start()
        except BaseException:
            await self.close()
            raise
        self._bench.release()
        self.baud, self.capacity, self.notices = self._serial.baud, self._serial.capacity, self._serial.notices

    @property
    def finds_rate(self) -> bool:
        return self._open_baud is None

    def give_up(self, error: LinkError) -> None:
        if self._serial is not None:
            self._serial.give_up(error)

    async def read(self) -> list[Chunk]:
        if self._serial is None:
            raise closed(self.source)
        try:
            return await self._serial.read()
        except LinkError as error:
            if error.kind == "gone" and self.options.unplug_s:
                self._away_until_s = time.monotonic() + self.options.away_s
            raise

    async def write(self, data: bytes) -> None:
        if self._serial is None:
            raise closed(self.source)
        await self._serial.write(data)

    async def relink(self, baud: int | None = None) -> None:
        """The port is closed and opened; the device at its other end stays as it is."""
        self._open_baud = baud or self._open_baud
        if self._serial is None or self._bench is None or not os.path.exists(self._bench.slave):
            if self._bench is not None:  # unplugged just now
                self._away_until_s = max(self._away_until_s, time.monotonic() + self.options.away_s)
            await self.open()
            return
        self._bench.hold()
        try:
            await self._serial.relink(baud)
        finally:
            self._bench.release()
        self.baud, self.capacity = self._serial.baud, self._serial.capacity

    async def check_rate(self, baud: int) -> None:
        if self._serial is None:
            raise closed(self.source)
        await self._serial.check_rate(baud)

    async def close(self) -> None:
        if self._serial is not None:
            await self._serial.close()
            self._serial = None
        if self._bench is not None:
            self._bench.stop()
            self._device = self._bench.device
            self._bench = None
