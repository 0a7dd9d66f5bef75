"""A device that is not there: simulated bytes behind a real pseudo-terminal, opened by the serial link like any other.

    device ──> SimulatedLine ──> master ═══ pseudo-terminal ═══ slave <── SerialLink ──> session
       ^                   │
       └────── Cable <─────┘            all of the left side is one thread, the bench

So what is tested with a twin is what runs with a sensor: the port, the reading thread, the rate, an unplugged cable.

    twin:xbus                       an MTi-630 at 100 Hz on a line of 115 200 Bd; ?product=MTi-680G another product
    twin:isb                        an IMX-5 at 100 Hz on 921 600 Bd; ?imu_source=nav|imu what times DID_IMU
    twin:idtp                       an IDTP device in Safety mode, Imu10 and ImuQuat at 100 Hz; ?mode=lite|safety|secure
                                    (Secure frames are made with the source's key; without one, with one nobody knows)
    ?rate=400                       samples/s
    ?bus_ids=1,2                    several MTi on one line, each under its bus identifier and answering to it alone
    ?port=uart                      an MTi of the 600-series whose UART, not its RS-232, is where the host listens
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
import select
import termios
import threading
import time
import tty
from collections.abc import Callable

from server.links.base import Chunk, Link, LinkError, LinkSettings, Progress
from server.links.reader_thread import closed
from server.links.serial import SerialLink, SerialSettings
from server.links.simulated_device import Device, SimulatorOptions, make_device, members_of, power_cycled
from server.links.simulated_line import LineFaults, SimulatedLine

log = logging.getLogger(__name__)

TICK_NS = 1_000_000  # how often the device is asked for its bytes when the cable has nothing due earlier
IDLE_NS = 10_000_000  # ... or at most, where the device tells that nothing is due before
LATE_NS = 10_000_000  # a bench that was held up makes up for it in such steps, so that its line is not full for that
HELD_BYTES = 640 * 1024  # Linux, drivers/tty/tty_buffer.c, TTYB_DEFAULT_MEM_LIMIT: what a port holds for a late reader


class SimulatorThread(threading.Thread):
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
        options: SimulatorOptions,
        now_ns: Callable[[], int] = time.monotonic_ns,
        before: Device | None = None,
    ) -> None:
        super().__init__(name=f"twin {options.protocol}", daemon=True)
        self._make = make
        self._options = options
        self._now_ns = now_ns
        self.device = before
        self._to_host = SimulatedLine(options.faults, options.seed, options.protocol)
        self._to_device: list[SimulatedLine] = []  # one for each device on the line
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
            if options.unplug_s and now_ns - born_ns >= options.unplug_s * 1e9:
                break
            if self._cycled or (options.reset_s and now_ns - powered_ns >= options.reset_s * 1e9):
                self._cycled = False
                powered_ns, device = now_ns, power_cycled(device, now_ns, self._make)
                self.device = device
            for at_ns in (*range(max(told_ns, powered_ns) + LATE_NS, now_ns, LATE_NS), now_ns):
                for one, way in zip(members_of(device), self._to_device, strict=True):
                    self._to_host.baud = way.baud
                    self._to_host.send(one.advance(at_ns), at_ns)
            told_ns = now_ns
            for place, (one, way) in enumerate(zip(members_of(device), self._to_device, strict=True)):
                self._to_host.baud = way.baud
                if heard := way.arrived(now_ns, self._host_baud()):
                    self._to_host.send(one.receive(heard, now_ns), now_ns)
                if one.baud != bauds[place]:  # a command changed it; until then the line is as the source says
                    bauds[place] = way.baud = one.baud
            self._put(self._to_host.arrived(now_ns, self._host_baud()))
            silent_until_ns = device.next_ns
            self._take(poll, now_ns, min(max(now_ns + TICK_NS, silent_until_ns), now_ns + IDLE_NS))

    def _take(self, poll: select.poll, now_ns: int, until_ns: int) -> None:
        """Wait until something is due, `until_ns` at the latest, taking what the host sends meanwhile."""
        due = [at for way in (self._to_host, *self._to_device) if (at := way.next_ns) is not None]
        wait_ns = min([until_ns, *due]) - self._now_ns()
        for fd, event in poll.poll(max(wait_ns, 0) / 1e6):
            if fd == self._master and event & select.POLLIN:
                try:
                    data = os.read(self._master, 4096)
                    for way in self._to_device:
                        way.send(data, now_ns)
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


class SimulatorLink(Link):
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
        options: SimulatorOptions,
        make: Callable[[int], Device] | None = None,
        baud: int | None = None,
    ) -> None:
        super().__init__(source, settings)
        self.options = options
        self._make = make or (lambda start_ns: make_device(options, start_ns, self.settings.key))
        self._open_baud = options.faults.baud if baud is None else baud or None
        self._bench: SimulatorThread | None = None
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
            self._bench = SimulatorThread(self._make, self.options, before=self._device)
        except OSError as error:
            hint = "A twin needs pseudo-terminals (/dev/ptmx): in a container, mount devpts."
            raise LinkError("refused", f"No pseudo-terminal for a twin: {error.strerror}.", hint) from None
        self._serial = SerialLink(self.source, self.settings, self._bench.slave, SerialSettings(baud=self._open_baud))
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
