"""Serial port link.

pyserial only opens and configures the port: its own read costs twice the processor time of `os.read` in a waiting
thread (`imuscope.server.links.reader_thread`), and its exceptions hide the cause.

    baud, bits, parity, stop ──> capacity = baud / (1 start + bits + parity + stop)   bytes/s

## Unplugged ports

An unplugged port shows in three ways, depending on the driver: `read` fails with EIO or ENODEV, poll reports a hang-up,
or `read` returns nothing although the port was reported readable. The last also happens occasionally on a healthy port
(flushed by another program in between), so it counts only with a hang-up or if it repeats at once.

## The latency timer

An FTDI adapter holds bytes back until it has 62 or its latency timer (default 16 ms) expires, which turns a 400 Hz
stream into bursts and blurs every arrival time. Linux shows the timer in sysfs, and root can set it; a value over 1 ms
is reported as a notice with a temporary and a permanent fix.

Sources: termios(3), tty_ioctl(4); Linux drivers/usb/serial/ftdi_sio.c (attribute latency_timer); the measurements of
xsenssupport/Xsens_MTi_ROS_Driver_and_Ntrip_Client issue 53.
"""

import asyncio
import errno
import os
import termios
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import serial

from imuscope.server.links.base import Chunk, Link, LinkError, LinkSettings, Progress
from imuscope.server.links.baud_scan import find_baud
from imuscope.server.links.reader_thread import (
    DISCONNECTED_ERRNOS,
    READ_BYTES,
    ThreadedLink,
    closed,
    hung_up,
    write_all,
)
from imuscope.server.links.registry import LinkDefinition, register_link
from imuscope.server.links.source_url import LINE_OPTIONS, SourceUrl
from imuscope.server.links.usb_adapters import adapter_at, moved, port_now
from imuscope.server.system.open_files import OWN, Program, programs_with, readers_of, session_on, unblock_steps
from imuscope.server.system.terminals import PTS, is_another, may_be_terminal, pseudo_terminal

PARITIES = {"none": "N", "even": "E", "odd": "O", "mark": "M", "space": "S"}
FLOWS = ("none", "rtscts", "xonxoff", "dsrdtr")
MAX_BAUD = 12_000_000  # the fastest USB adapters (FT2232H)
EMPTY_READS = 3  # consecutive empty reads after which the port counts as gone


@dataclass(frozen=True, slots=True)
class SerialSettings:
    """Line settings. `baud` None: detect it."""

    baud: int | None = None
    bits: int = 8
    parity: str = "none"
    stop: float = 1
    flow: str = "none"

    @classmethod
    def of(cls, source: SourceUrl) -> "SerialSettings":
        """The options of a serial source.

        Raises:
            LinkError: kind "bad-source".
        """
        source.allow(LINE_OPTIONS)
        return cls(
            baud=source.whole("baud", 0, 50, MAX_BAUD, "Bd") or None,
            bits=source.whole("bits", 8, 5, 8),
            parity=source.choice("parity", "none", tuple(PARITIES)),
            stop=float(source.choice("stop", "1", ("1", "1.5", "2"))),
            flow=source.choice("flow", "none", FLOWS),
        )

    def capacity(self, baud: int) -> float:
        """Bytes/s that the line can carry at `baud`."""
        return baud / (1 + self.bits + (self.parity != "none") + self.stop)


class SerialLink(ThreadedLink):
    """A serial port.

    Args:
        place: path of the port.
        line: line settings; without a baud rate `open` tries each rate until a protocol is detected.
    """

    kind = "serial"

    def __init__(self, source: str, settings: LinkSettings, place: str, line: SerialSettings) -> None:
        super().__init__(source, settings)
        self.place = place
        self.line = line
        self._port: Any = None  # serial.Serial, which has no types
        self._empty_reads = self._received = 0
        self._adapter = ""  # persistent name of the adapter found there first
        self._terminal: tuple[object, int] | None = None  # that was opened last

    async def open(self, progress: Progress | None = None) -> None:
        await self.close()
        where = port_now(self.place, self._adapter, self.settings.by_id)
        if is_another(where, self._terminal):
            raise terminal_ended(self.place)
        # Opening queries the adapter over USB, which may take long, so not on the loop.
        self._port = await asyncio.to_thread(open_port, where, self.line)
        self._terminal = pseudo_terminal(where)
        try:
            self.baud = self.line.baud or await find_baud(
                self._port, self.place, progress, self.settings.windows, owed=lambda: self.owed
            )
        except (OSError, serial.SerialException) as error:
            await self.close()
            raise gone(self.place, error) from None
        except BaseException:
            await self.close()
            raise
        self.capacity = self.line.capacity(self.baud)
        self._adapter = adapter_at(where, self.settings.by_id)
        self.notices = [
            *moved(self.place, where, self._adapter),
            *latency_notices(where, self.settings.sys_root),
        ]
        self._empty_reads = self._received = 0
        self._start_loop(self._port.fileno(), self._on_readable)

    @property
    def detects_baud(self) -> bool:
        return self.line.baud is None

    @property
    def local_path(self) -> str:
        try:
            return port_now(self.place, self._adapter, self.settings.by_id)
        except LinkError:  # another adapter has its name
            return self._adapter

    async def reopen(self, baud: int | None = None) -> None:
        before = self.line
        self.line = replace(self.line, baud=baud or self.baud or self.line.baud)
        await self.close()
        try:
            await self.open()
        except LinkError as error:
            if error.kind == "refused":  # the port does not support that rate; other errors are retried with it
                self.line = before
            raise

    def other_reader(self) -> LinkError | None:
        port = self._port
        readers = readers_of(port.name) if port is not None else []
        return busy(self.place, readers) if readers else None

    async def check_rate(self, baud: int) -> None:
        if self._port is None:
            raise closed(self.source)
        await asyncio.to_thread(try_rate, self._port, self.place, baud)

    def _on_readable(self) -> None:
        assert self._queue is not None
        fd = self._port.fd
        try:
            data = os.read(fd, READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            raise gone(self.place, error) from None
        arrival_ns = self.settings.now_ns()
        if data:
            self._queue.put(Chunk(data, arrival_ns))
            return
        if self._queue.received != self._received:  # by the compiled loop, since the last empty read
            self._received, self._empty_reads = self._queue.received, 0
        self._empty_reads += 1
        if self._empty_reads >= EMPTY_READS or hung_up(fd):
            raise gone(self.place)

    async def write(self, data: bytes) -> None:
        if self._port is None:
            raise closed(self.source)
        try:
            await write_all(self._port.fd, data)
        except TimeoutError:
            hint = "Check the flow control: the other side holds the line, or its wires are not connected."
            raise LinkError("refused", f"{self.place} accepted no bytes for 5 s.", hint) from None
        except OSError as error:
            raise gone(self.place, error) from None

    async def _release(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            await asyncio.to_thread(port.close)  # waits until the last bytes are out


SHARE_FIRST = "To use the port beside it, start imuscope first, with --share PATH, and give that path to the program."


def open_port(place: str, line: SerialSettings) -> Any:
    """Open and configure a port for exclusive use.

    Returns:
        serial.Serial, non-blocking; at 115 200 Bd if `line` has no rate.

    Raises:
        LinkError: with cause and remedy. A port that another program reads is not opened: even without its lock, each
            would get a part of the bytes, and the other may be the robot's driver.
    """
    try:
        if not may_be_terminal(place):
            raise OSError(errno.ENOTTY, os.strerror(errno.ENOTTY))
        session = session_on(place)
        if session is not None:
            raise taken_by_session(place, session)
        if readers := readers_of(place):
            raise busy(place, readers)
        return serial.Serial(
            place,
            line.baud or 115_200,
            bytesize=line.bits,
            parity=PARITIES[line.parity],
            stopbits=line.stop,
            rtscts=line.flow == "rtscts",
            xonxoff=line.flow == "xonxoff",
            dsrdtr=line.flow == "dsrdtr",
            timeout=0,
            exclusive=True,
        )
    except termios.error as error:  # pyserial passes it on; it is not an OSError
        raise cannot_open(place, line, OSError(*error.args)) from None
    except (serial.SerialException, OSError, ValueError) as error:
        raise cannot_open(place, line, error) from None


def try_rate(port: Any, place: str, baud: int) -> None:
    """Set a rate, check that it is set, and restore the previous one.

    Raises:
        LinkError: "refused".
    """
    before = port.baudrate
    try:
        port.baudrate = baud
        code = getattr(termios, f"B{baud}", None)
        if code is not None and termios.tcgetattr(port.fd)[5] != code:
            raise ValueError("the driver set another rate")
    except (OSError, ValueError, termios.error, serial.SerialException) as error:
        if hung_up(port.fd):
            raise gone(place) from None
        hint = "Choose a rate that the adapter supports, or use another adapter."
        raise LinkError("refused", f"{place} cannot be set to {baud} Bd: {error}.", hint) from None
    finally:
        with suppress(OSError, termios.error):  # it is gone
            port.baudrate = before


def cannot_open(place: str, line: SerialSettings, error: Exception) -> LinkError:
    """Error for a port that could not be opened, with cause and remedy."""
    number = getattr(error, "errno", None)
    if number in (errno.EACCES, errno.EPERM):
        return denied(place)
    if number in (errno.EBUSY, errno.EAGAIN):
        return busy(place)
    if number in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        return LinkError("not-found", f"There is no port {place}.", present_ports())
    if number == errno.EIO:  # it was pulled while it was opened
        return gone(place, error)
    if number == errno.ENOTTY or (number is None and "onfigure" in str(error)):
        return LinkError("refused", f"{place} is not a serial port.", present_ports())
    rate = f" at {line.baud} Bd" if line.baud else ""
    hint = "Check that the adapter supports this rate, data bits, parity and stop bits."
    return LinkError("refused", f"{place} could not be opened{rate}: {error}.", hint)


def denied(place: str) -> LinkError:
    """Error for missing permission, with the name of the group to join."""
    who, hint, group = lock_of(place)
    if group:
        hint += f" In a container, add the group when it is started (`--group-add {group}`)."
    return LinkError("denied", f"No permission to open {place}: {who}.", hint)


def lock_of(place: str) -> tuple[str, str, str]:
    """Group that owns a port, and how to join it; "" if joining would not help.

    If the group cannot be determined, Debian's group of ports, dialout, is named.
    """
    try:
        import grp  # not on Windows
        import pwd

        about = os.stat(place)
        if about.st_gid == 0 or about.st_mode & 0o060 != 0o060:
            owner = pwd.getpwuid(about.st_uid).pw_name
            now = f"`sudo chgrp dialout {place} && sudo chmod g+rw {place}`"
            return (
                f"only its owner, {owner}, may",
                f"Give the group of port users access: {now}; permanently, with a udev rule.",
                "",
            )
        group = grp.getgrgid(about.st_gid).gr_name
    except (ImportError, OSError, KeyError):
        group = "dialout"
    join = f"Run `sudo usermod -aG {group} $USER`, then log out and in again."
    return f"it belongs to the group {group}", join, group


def busy(place: str, programs: Sequence[Program] = ()) -> LinkError:
    """Error for a port that another program has, and how both can use it.

    Args:
        programs: those that have it, if they are known.
    """
    programs = programs or programs_with(place)
    other = next((one for one in programs if one.name != OWN and one.pid != os.getpid()), None)
    if other is not None:
        return LinkError("busy", f"{place} is in use by {other}.", " ".join(unblock_steps(place, other.name)))
    if any(one.pid == os.getpid() for one in programs):
        hint = "A port can have only one source: remove the other, or choose another port."
        return LinkError("busy", f"{place} is in use by this server.", hint)
    if programs:
        return LinkError("busy", f"{place} is in use by {programs[0]}.", "Open the page of that one, or stop it.")
    hint = f"Close the program that has it (minicom, ModemManager?). As root, `fuser {place}` shows it."
    return LinkError("busy", f"{place} is in use by another program.", f"{hint} {SHARE_FIRST}")


def taken_by_session(place: str, program: Program) -> LinkError:
    """Error for the terminal of a shell or a login prompt: its input would be read as a sensor's."""
    if place.startswith(PTS):
        hint = "Choose the port of the sensor."
    else:
        hint = (
            "`systemctl list-units 'serial-getty@*' 'nvgetty*'` shows a login prompt, `sudo systemctl disable --now "
            "NAME` ends it. Or choose another port."
        )
    return LinkError("busy", f"{place} is the terminal of {program}.", hint)


def terminal_ended(place: str) -> LinkError:
    """Error for a pseudo-terminal that was closed, whose number belongs to whatever was opened next."""
    hint = (
        "Give a link to it as the source, which is followed (imuscope simulate --pty PATH, socat's link=PATH), or add "
        "the source again."
    )
    return LinkError("gone", f"{place} was closed, and may now be the terminal of another program.", hint)


def holder(place: str) -> str:
    """The program that has `place` open, as "minicom (process 1234)"; "" if it is not visible."""
    return next(("this server" if one.pid == os.getpid() else str(one) for one in programs_with(place)), "")


def present_ports() -> str:
    """Ports present, as a hint."""
    from serial.tools import list_ports

    names = sorted(port.device for port in list_ports.comports())
    there = f"Present now: {', '.join(names)}." if names else "No serial port is present now."
    return f"Check that it is plugged in. {there}"


def gone(place: str, error: Exception | None = None) -> LinkError:
    """Error for a port that is no longer present."""
    number = getattr(error, "errno", None)
    why = f" ({os.strerror(number)})" if number is not None and number not in DISCONNECTED_ERRNOS else ""
    return LinkError("gone", f"{place} is gone{why}.", "Plug it in again; it is opened as soon as it is back.")


def latency_notices(place: str, sys_root: Path = Path("/sys")) -> list[str]:
    """A notice with its fix if a USB adapter's latency timer is over 1 ms, else nothing."""
    tty = os.path.basename(os.path.realpath(place))
    timer = sys_root / "bus/usb-serial/devices" / tty / "latency_timer"
    try:
        milliseconds = int(timer.read_text())
    except (OSError, ValueError):
        return []  # not a USB adapter, or one without a timer
    if milliseconds <= 1:
        return []
    return [
        f"The USB adapter of {place} delivers in bursts of up to {milliseconds} ms: its latency timer is "
        f"{milliseconds} ms. Temporarily: `echo 1 | sudo tee {timer}`. Permanently: a file "
        '/etc/udev/rules.d/99-latency.rules with `ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", '
        'ATTR{latency_timer}="1"`.'
    ]


def _open(source: str, settings: LinkSettings, parsed: SourceUrl) -> Link:
    return SerialLink(source, settings, parsed.place, SerialSettings.of(parsed))


register_link(
    LinkDefinition(
        "serial",
        "Serial port",
        _open,
        "/dev/ttyUSB0, serial:///dev/ttyUSB0?baud=921600",
        usage=(
            (
                "/dev/ttyUSB0?baud=921600&bits=8&parity=none|even|odd&stop=1|2&flow=none|hardware",
                "a serial port; without baud its rate is detected",
            ),
        ),
        examples=lambda: [
            ("/dev/ttyUSB0", "a serial port with automatic baud rate detection"),
            ("serial:///dev/ttyUSB0?baud=921600", "a serial port at a given rate"),
        ],
        order=0,
        shareable=True,
    )
)
