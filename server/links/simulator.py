"""Simulator link: a simulated device behind a real pseudo-terminal, opened by the serial link like any port.

    device ──> SimulatedLine ──> master ═══ pseudo-terminal ═══ slave <── SerialLink ──> session
       ^                   │
       └────── Cable <─────┘            the whole left side is one thread, SimulatorThread

So a test with a simulator covers the same code as a sensor: the port, the reading thread, the rate, an unplugged cable.

    sim:xbus                       an MTi-630 at 100 Hz on a line of 115 200 Bd; ?product=MTi-680G another product
    sim:isb                        an IMX-5 at 100 Hz on 921 600 Bd; ?imu_source=nav|imu clock of DID_IMU
    sim:idtp                       an IDTP device in Safety mode, Imu10 and ImuQuat at 100 Hz; ?mode=lite|safety|secure
                                    (Secure frames use the key of the source, or a random one)
    ?rate=400                       samples/s
    ?bus_ids=1,2                    several MTi on one line, each answering only to its own bus identifier
    ?port=uart                      an MTi of the 600-series, connected by its UART instead of its RS-232
    ?baud=921600                    rate of the line (default: the slowest that carries the samples); bytes take their
                                    time on it, and a port at another rate receives noise
    ?dead_baud=921600               a rate that the line cannot carry: both sides then receive noise
    ?stubborn=1                     an MTi that ignores GoToConfig until it has been reset
    ?mute=0.1 ?wrong=0.1            share of answers that are missing, or belong to another request
    ?late_ms=700                    every answer is late
    ?cut=3                          power fails after the third accepted setting, before it is stored
    ?drop=0.01 ?corrupt=0.01        share of frames lost, or with one bit flipped
    ?burst_ms=16                    a USB adapter that sends every 16 ms (its latency timer), or at 62 bytes;
    ?packet=0                       ... by its timer only
    ?clock=ms                       an IDTP device whose timestamps count milliseconds; also ns, us, s
    ?drift_ppm=50                   the device clock runs 50 ppm fast
    ?jump_s=20                      after 20 s the device clock jumps ahead by 10 s
    ?reset_s=30                     every 30 s the device resets: its clock restarts, and so does the sequence of an
                                    IDTP device
    ?unplug_s=30 ?away_s=5          unplugged after 30 s, plugged in again, freshly powered, 5 s later
    ?motion=tumble                  an MTi or IMX that is turned through all directions; also rest, turn (about the
                                    vertical), positions (on six sides), straight (a drive)
    ?hard_iron=0.3 ?soft_iron=0.1   iron near its magnetometer: offset and distortion, as shares of the Earth's field
    ?gyro_bias=0.5 ?acc_bias=0.2    biases in °/s and m/s²; ?acc_scale=0.02 a scale error
    ?mount=30                       it is turned in the vehicle by 30° about (1, −2, 3)
    ?seed=1                         different noise, different sequence of faults
"""

import asyncio
import contextlib
import errno
import fcntl
import logging
import os
import select
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import count

from imuscope.protocols.family.plugins import protocol_names
from imuscope.protocols.simulator.family import SimulatedDevice
from imuscope.recordings.mcap.read_memory import ReadFollower
from imuscope.server.links.base import Chunk, Link, LinkError, LinkSettings, Progress
from imuscope.server.links.reader_thread import closed
from imuscope.server.links.registry import LinkDefinition, register_link
from imuscope.server.links.serial import SerialLink, SerialSettings
from imuscope.server.links.simulated_device import SimulatorOptions, make_device, members_of, power_cycled, simulators
from imuscope.server.links.simulated_line import LineFaults, SimulatedLine
from imuscope.server.links.source_url import SourceUrl

log = logging.getLogger(__name__)

TICK_NS = 1_000_000  # polling period of the device if the cable has nothing due earlier
IDLE_NS = 10_000_000  # longest period, if the device reports that nothing is due earlier
LATE_NS = 10_000_000  # a delayed thread catches up in steps of this size, so that its line does not overflow
TIOCGPTPEER = 0x5441  # Linux, asm-generic/ioctls.h: open the other end of a terminal, regardless of its name
HELD_BYTES = 640 * 1024  # Linux, drivers/tty/tty_buffer.c, TTYB_DEFAULT_MEM_LIMIT: buffer of a port for a late reader


class SimulatorThread(threading.Thread):
    """The left side of the drawing: a device, both directions of its cable, and the master of a pseudo-terminal.

    Args:
        make: creates a freshly powered device; called with the power-on time on `now_ns`.
        now_ns: a clock that does not step.
        before: the device before its power was switched off; None for a new one.

    Attributes:
        slave: path of the device's port.
        device: the device at the other end.
    """

    def __init__(
        self,
        make: Callable[[int], SimulatedDevice],
        options: SimulatorOptions,
        now_ns: Callable[[], int] = time.monotonic_ns,
        before: SimulatedDevice | None = None,
    ) -> None:
        super().__init__(name=f"simulator {options.protocol}", daemon=True)
        self._make = make
        self._options = options
        self._now_ns = now_ns
        self.device = before
        self._to_host = SimulatedLine(options.faults, options.seed, options.protocol)
        self._to_device: list[SimulatedLine] = []  # one for each device on the line
        self._stop_read, self._stop_write = os.pipe()
        self._master, self._slave_fd = os.openpty()
        # Otherwise the terminal would echo the device's output back to the device until the port is opened.
        tty.setraw(self._slave_fd)
        os.set_blocking(self._master, False)
        self.slave = os.ttyname(self._slave_fd)
        self._master_lock = threading.Lock()  # held while the master is closed or its other end is opened
        self._backlog = b""  # bytes not accepted yet by the pseudo-terminal, which holds 4 kB
        self._is_used = True  # a program has the port open, or this thread keeps it
        self._stopped = False
        self._cycled = False

    def cycle(self) -> None:
        """Switch the device's power off and on; its port remains."""
        self._cycled = True

    def unplug(self) -> None:
        """Remove the port and the power."""
        self._stopped = True

    def run(self) -> None:
        try:
            self._simulate()
        except Exception:  # top of the thread: a failure looks like an unplugged device, and is logged
            log.exception("The simulator at %s failed.", self.slave)
        finally:
            self._unplug()

    def _simulate(self) -> None:
        options = self._options
        started_ns = powered_ns = advanced_ns = self._now_ns()
        device = power_cycled(self.device, powered_ns, self._make)
        self.device = device
        line = LineFaults(baud=options.faults.baud, dead_baud=options.faults.dead_baud)
        self._to_device = [SimulatedLine(line, options.seed, options.protocol) for _ in members_of(device)]
        bauds = [one.baud for one in members_of(device)]
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        poll.register(self._stop_read, select.POLLIN)
        while not self._stopped:
            now_ns = self._now_ns()
            if options.unplug_s and now_ns - started_ns >= options.unplug_s * 1e9:
                break
            if self._cycled or (options.reset_s and now_ns - powered_ns >= options.reset_s * 1e9):
                self._cycled = False
                powered_ns, device = now_ns, power_cycled(device, now_ns, self._make)
                self.device = device
            for at_ns in (*range(max(advanced_ns, powered_ns) + LATE_NS, now_ns, LATE_NS), now_ns):
                for one, direction in zip(members_of(device), self._to_device, strict=True):
                    self._to_host.baud = direction.baud
                    self._to_host.send(one.advance(at_ns), at_ns)
            advanced_ns = now_ns
            for place, (one, direction) in enumerate(zip(members_of(device), self._to_device, strict=True)):
                self._to_host.baud = direction.baud
                if received := direction.arrived(now_ns, self._host_baud()):
                    self._to_host.send(one.receive(received, now_ns), now_ns)
                if one.baud != bauds[place]:  # changed by a command; until then the source determines the rate
                    bauds[place] = direction.baud = one.baud
            self._put(self._to_host.arrived(now_ns, self._host_baud()))
            silent_until_ns = device.next_ns
            self._wait(poll, now_ns, min(max(now_ns + TICK_NS, silent_until_ns), now_ns + IDLE_NS))

    def _wait(self, poll: select.poll, now_ns: int, until_ns: int) -> None:
        """Wait until something is due, `until_ns` at the latest; bytes from the host are put on the line."""
        due = [at for direction in (self._to_host, *self._to_device) if (at := direction.next_ns) is not None]
        wait_ns = min([until_ns, *due]) - self._now_ns()
        events = poll.poll(max(wait_ns, 0) / 1e6)
        self._follow_use(dict(events).get(self._master, 0))
        for fd, event in events:
            if fd == self._master and event & select.POLLIN:
                try:
                    data = os.read(self._master, 4096)
                    for direction in self._to_device:
                        direction.send(data, now_ns)
                except OSError as error:
                    if error.errno not in (errno.EIO, errno.EAGAIN):  # EIO: the port is not open
                        raise
            elif fd == self._master:
                time.sleep(TICK_NS / 1e9)  # the port is not open, which poll reports without waiting

    def _follow_use(self, event: int) -> None:
        """Note whether a program has the port open. What the last one left unread is gone with it, as at a real port:
        the next one must not take it for new.
        """
        was_used, self._is_used = self._is_used, not event & select.POLLHUP
        if self._is_used or not was_used:
            return
        self._backlog = b""
        with contextlib.suppress(OSError, termios.error), self._master_lock:
            fd = fcntl.ioctl(self._master, TIOCGPTPEER, os.O_RDWR | os.O_NOCTTY | os.O_CLOEXEC)
            try:
                termios.tcflush(fd, termios.TCIFLUSH)
            finally:
                os.close(fd)

    def _put(self, data: bytes) -> None:
        """Write bytes to the port, if it is open. Bytes beyond its buffer are lost, as at a real port that is not read.

        A pseudo-terminal buffers far less than a real port, and its reader shares a process with this thread: both
        are delayed together during a compilation. So the remainder of a real port's buffer is kept here.
        """
        if not self._is_used:
            return
        self._backlog += data
        if not self._backlog:
            return
        try:
            size = os.write(self._master, self._backlog)
        except BlockingIOError:
            size = 0
        is_open = self._slave_fd < 0
        most = HELD_BYTES if is_open else 0  # bytes from before the port was opened are not needed
        rest = self._backlog[size:]
        self._to_host.overflowed += max(0, len(rest) - most)
        self._backlog = rest[:most]

    def _host_baud(self) -> int | None:
        """Rate set by the host, read from the terminal; None if unknown."""
        try:
            return _RATES.get(termios.tcgetattr(self._master)[4])
        except termios.error:
            return None

    def _unplug(self) -> None:
        with self._master_lock:
            os.close(self._master)
            self._master = -1

    def hold_open(self) -> None:
        """Keep the terminal and its settings while the host closes and reopens the port.

        Raises:
            OSError: the device is unplugged. The terminal's name may already belong to another terminal: the system
                reuses the name of a closed terminal first, for any process.
        """
        if self._slave_fd < 0:
            with self._master_lock:
                if self._master < 0:
                    raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
                self._slave_fd = fcntl.ioctl(self._master, TIOCGPTPEER, os.O_RDWR | os.O_NOCTTY | os.O_CLOEXEC)

    def release(self) -> None:
        """Close our own handle on the port once the host has it open, so that the device can be unplugged."""
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


class SimulatorLink(Link):
    """A simulator with its cable and port.

    Args:
        make: creates the device; tests pass their own.
        baud: rate at which the host opens the port; None: the rate of the simulator's line, 0: detect it.
    """

    kind = "simulator"
    is_simulated = True

    def __init__(
        self,
        source: str,
        settings: LinkSettings,
        options: SimulatorOptions,
        make: Callable[[int], SimulatedDevice] | None = None,
        baud: int | None = None,
    ) -> None:
        super().__init__(source, settings)
        self.options = options
        self._make = make or (lambda start_ns: make_device(self.options, start_ns, self.settings.decode_options))
        self._open_baud = options.faults.baud if baud is None else baud or None
        self._simulator: SimulatorThread | None = None
        self._serial: SerialLink | None = None
        self._device: SimulatedDevice | None = None  # from the last connection, with its stored settings
        self._away_until_s = 0.0

    def distinguish(self, others: Iterable[Link]) -> None:
        """Take a seed, on which the serial number depends, that no other has of this protocol; a given one stays."""
        if "seed" in SourceUrl.parse(self.source).options:
            return
        alike = [one.options for one in others if isinstance(one, SimulatorLink)]
        used = {one.seed for one in alike if one.protocol == self.options.protocol}
        self.options = replace(self.options, seed=next(seed for seed in count() if seed not in used))

    async def open(self, progress: Progress | None = None) -> None:
        await self.close()
        if time.monotonic() < self._away_until_s:
            raise LinkError("not-found", f"{self.source} is unplugged.", "It comes back by itself in a few seconds.")
        # The first device imports its family: not on the event loop, and before the port exists.
        await asyncio.to_thread(self._make, 0)
        try:
            self._simulator = SimulatorThread(self._make, self.options, before=self._device)
        except OSError as error:
            hint = "A simulator needs pseudo-terminals (/dev/ptmx): in a container, mount devpts."
            raise LinkError("refused", f"No pseudo-terminal for a simulator: {error.strerror}.", hint) from None
        self._serial = SerialLink(
            self.source, self.settings, self._simulator.slave, SerialSettings(baud=self._open_baud)
        )
        self._serial.flow = self.flow
        try:
            if self._open_baud is None:
                self._simulator.start()  # baud detection needs data
                await self._serial.open(progress)
            else:
                await self._serial.open(progress)  # opening clears the port, which would lose or cut the first frames
                self._simulator.start()
        except BaseException:
            await self.close()
            raise
        self._simulator.release()
        self.baud, self.capacity, self.notices = self._serial.baud, self._serial.capacity, self._serial.notices

    @property
    def detects_baud(self) -> bool:
        return self._open_baud is None

    @property
    def backlog(self) -> int:
        return 0 if self._serial is None else self._serial.backlog

    @property
    def waiting_since_ns(self) -> int | None:
        return None if self._serial is None else self._serial.waiting_since_ns

    def fail(self, error: LinkError) -> None:
        if self._serial is not None:
            self._serial.fail(error)

    def read_now(self, again_ns: int) -> list[Chunk]:
        return [] if self._serial is None else self._serial.read_now(again_ns)

    def follow(self) -> ReadFollower | None:
        return None if self._serial is None else self._serial.follow()

    def unfollow(self) -> None:
        if self._serial is not None:
            self._serial.unfollow()

    @property
    def is_followed(self) -> bool:
        return self._serial is not None and self._serial.is_followed

    def expect_reply(self) -> None:
        if self._serial is not None:
            self._serial.expect_reply()

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

    async def reopen(self, baud: int | None = None) -> None:
        """Close and open the port; the device at its other end is not affected."""
        self._open_baud = baud or self._open_baud
        if self._serial is None or self._simulator is None:
            await self.open()
            return
        try:
            self._simulator.hold_open()
        except OSError:  # unplugged just now
            self._away_until_s = max(self._away_until_s, time.monotonic() + self.options.away_s)
            await self.open()
            return
        try:
            await self._serial.reopen(baud)
        finally:
            self._simulator.release()
        self.baud, self.capacity = self._serial.baud, self._serial.capacity

    async def check_rate(self, baud: int) -> None:
        if self._serial is None:
            raise closed(self.source)
        await self._serial.check_rate(baud)

    async def close(self) -> None:
        if self._serial is not None:
            await self._serial.close()
            self._serial = None
        if self._simulator is not None:
            self._simulator.stop()
            self._device = self._simulator.device
            self._simulator = None


def _open(source: str, settings: LinkSettings, parsed: SourceUrl) -> Link:
    return SimulatorLink(source, settings, SimulatorOptions.of(parsed))


def _examples() -> list[tuple[str, str]]:
    """One example with the simulated devices of all families: "a simulated MTi; sim:isb an IMX-5"."""
    devices = {f"sim:{name}": one.device or f"a device of {name}" for name, one in simulators().items()}
    if not devices:
        return []
    (first, device), *others = devices.items()
    simulated = f"a simulated {device.removeprefix('an ').removeprefix('a ')}"
    rest = ", ".join(f"{source} {words}" for source, words in others)
    return [(first, f"{simulated}; {rest}" if rest else simulated)]


NAMES = "|".join(protocol_names())
register_link(
    LinkDefinition(
        "simulator",
        "Simulator",
        _open,
        "sim:NAME, a simulated device",
        scheme="sim",
        short_form=f"sim:{NAMES}",
        usage=(
            (
                "sim:NAME?rate=400",
                f"a simulated device ({NAMES}); also product=, mode=, clock=, baud=, drop=,\n"
                "corrupt=, drift_ppm=, jump_s=, reset_s=, unplug_s=, away_s=, burst_ms=, seed=,\n"
                "port=; bus_ids=1,2: several devices on one line (server/links/simulator.py)",
            ),
        ),
        examples=_examples,
        order=50,
    )
)
