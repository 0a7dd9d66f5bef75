"""Which serial ports does this host have, and what is on them?

`list_ports` looks without touching: the operating system's list, described by USB maker and product, with the reason
why a port cannot be opened (in use, no permission). `scan` also listens: it opens each free port at one rate after
another and says what was heard, in the words of `server.links.baud_scan`. A port that a session has, or another
program, is left alone.
"""

from __future__ import annotations

import asyncio
import glob
import os
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TextIO

from serial import SerialException
from serial.tools import list_ports as system_ports

from server.links.base import LinkError, Try
from server.links.baud_scan import scan as scan_rates
from server.links.serial import SerialSettings, gone, holder, lock_of, open_port
from server.printable import printable

# USB vendor → maker. The list of the USB Implementers Forum, as far as inertial sensors and their adapters go.
MAKERS = {
    0x2639: "Xsens",
    0x0403: "FTDI",
    0x10C4: "Silicon Labs",
    0x067B: "Prolific",
    0x1A86: "WCH",
    0x04E2: "MaxLinear",
    0x0483: "STMicroelectronics",
    0x1546: "u-blox",
    0x2341: "Arduino",
    0x16C0: "Teensy",
    0x239A: "Adafruit",
    0x303A: "Espressif",
    0x2E8A: "Raspberry Pi",
}
# (vendor, product) → what it is. Source: Linux drivers/usb/serial/ftdi_sio_ids.h.
PRODUCTS = {
    (0x2639, 0x0101): "Xsens Awinda station",
    (0x2639, 0x0102): "Xsens Awinda dongle",
    (0x2639, 0x0200): "Xsens MTw",
    (0x2639, 0x0300): "Xsens MTi development board",
    (0x2639, 0x0301): "Xsens USB converter",
    (0x2639, 0xD00D): "Xsens USB converter",
    (0x0403, 0xD388): "Xsens USB converter",
    (0x0403, 0xD389): "Xsens wireless receiver",
    (0x0403, 0xD38B): "Xsens USB converter",
    (0x0403, 0xD38C): "Xsens wireless receiver",
    (0x0403, 0xD38D): "Xsens Awinda station",
}
# Serial ports of boards that pyserial does not list: Jetson, i.MX, OMAP, SC16IS7xx, Qualcomm, Zynq, LPUART.
SYS_TTY = "/sys/class/tty"
BOARD_PORTS = ("ttyTHS*", "ttymxc*", "ttyO[0-9]*", "ttySC*", "ttyHS*", "ttyPS*", "ttyLP*")


@dataclass(slots=True)
class PortInfo:
    """One serial port.

    Attributes:
        device: path, which is also a source.
        description: for a person: "Xsens USB converter, serial DB1ABC".
        busy: who has it: "this session" or a program's name; "" when it is free.
        denied: "" or one sentence with the group to join.
        heard: every rate that was tried, in order.
    """

    device: str
    description: str
    busy: str = ""
    denied: str = ""
    heard: list[Try] = field(default_factory=list)


def list_ports(in_use: Collection[str] = ()) -> list[PortInfo]:
    """Every serial port, untouched.

    Args:
        in_use: paths that sessions have open.
    """
    found = {port.device: _describe(port) for port in system_ports.comports() if not _is_empty(port.device)}
    for pattern in BOARD_PORTS:
        for path in glob.glob(f"/dev/{pattern}"):
            found.setdefault(path, "serial port of this board")
    taken = {os.path.realpath(path) for path in in_use}
    return [_info(device, found[device], taken) for device in sorted(found, key=_natural)]


def _is_empty(device: str) -> bool:
    """A place for a port that the kernel keeps (ttyS1 … ttyS31), with no UART in it."""
    try:
        return Path(SYS_TTY, os.path.basename(device), "type").read_text().strip() == "0"
    except OSError:
        return False


def _info(device: str, description: str, taken: Collection[str]) -> PortInfo:
    info = PortInfo(device, description)
    if os.path.realpath(device) in taken:
        info.busy = "a session of this server"
        return info
    info.busy = holder(device)
    if not os.access(device, os.R_OK | os.W_OK):
        who, hint, _ = lock_of(device)
        info.denied = f"No permission: {who}. {hint}"
    return info


def _describe(port: object) -> str:
    """What a port is, as far as USB tells: the product where it is known, else maker and product text."""
    vendor, product = getattr(port, "vid", None), getattr(port, "pid", None)
    if vendor is None:
        text = str(getattr(port, "description", "") or "")
        return text if text and text != "n/a" else "serial port"
    name = PRODUCTS.get((vendor, product or 0), "")
    if not name:
        maker = MAKERS.get(vendor) or getattr(port, "manufacturer", None) or f"USB {vendor:04x}:{product or 0:04x}"
        text = str(getattr(port, "product", None) or "USB serial port")
        name = text if text.lower().startswith(str(maker).lower()) else f"{maker} {text}"
    number = getattr(port, "serial_number", None)
    return f"{name}, serial {number}" if number else name


def _natural(path: str) -> tuple[str, int]:
    """ttyUSB2 before ttyUSB10."""
    stem = path.rstrip("0123456789")
    return stem, int(path[len(stem) :] or -1)


async def listen(port: str, progress: Callable[[Try], None] | None = None) -> list[Try]:
    """Listen to one free port at each rate until something is recognised.

    Returns:
        Every try in words; a port that cannot be opened is one try that says why.
    """
    heard: list[Try] = []

    def tell(one: Try) -> None:
        heard.append(one)
        if progress is not None:
            progress(one)

    try:
        opened = await asyncio.to_thread(open_port, port, SerialSettings())
    except LinkError as error:
        tell(Try("open", str(error), time.time()))
        return heard
    try:
        found = await scan_rates(opened, progress=tell)
        if not any(one.heard.size for one in found):
            tell(Try("all rates", "0 B at every rate: is it powered, and set to send?", time.time()))
    except (OSError, SerialException) as failure:
        tell(Try("read", str(gone(port, failure)), time.time()))
    finally:
        await asyncio.to_thread(opened.close)
    return heard


async def scan(
    ports: Sequence[str] | None = None,
    in_use: Collection[str] = (),
    progress: Callable[[str, Try], None] | None = None,
) -> list[PortInfo]:
    """Listen on every free port, all at the same time.

    Args:
        ports: only these; None: all that `list_ports` finds. A path that is not in that list is listened to as well.
        in_use: paths that sessions have open; they are listed and left alone.
        progress: told of each try, with the port's path.
    """
    infos = await asyncio.to_thread(list_ports, in_use)
    if ports is not None:
        known = {info.device: info for info in infos}
        taken = {os.path.realpath(path) for path in in_use}
        infos = [known.get(path) or _info(path, "as named", taken) for path in ports]

    async def one(info: PortInfo) -> None:
        tell = (lambda attempt: progress(info.device, attempt)) if progress is not None else None
        if info.busy:
            info.heard = [Try("not opened", f"In use by {info.busy}.", time.time())]
        elif info.denied:
            info.heard = [Try("not opened", info.denied, time.time())]
        else:
            info.heard = await listen(info.device, tell)
            return
        if tell is not None:
            tell(info.heard[0])

    await asyncio.gather(*(one(info) for info in infos))
    return infos


def print_ports(out: TextIO) -> None:
    """`imuscope ports`: list every port and print what is heard while it is heard."""
    infos = list_ports()
    if not infos:
        print("No serial port is present. Is the sensor plugged in? (`lsusb`, `dmesg | tail`)", file=out)
        return
    for info in infos:
        print(printable(f"{info.device}  {info.description}"), file=out)
    out.flush()
    width = max(len(info.device) for info in infos)

    def tell(device: str, attempt: Try) -> None:
        print(printable(f"{device:<{width}}  {attempt.what}: {attempt.outcome}"), file=out, flush=True)

    print("Listening…", file=out, flush=True)
    asyncio.run(scan(progress=tell))
