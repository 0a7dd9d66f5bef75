"""Serial ports of this host, and the traffic on them.

`list_ports` opens nothing: it returns the operating system's list, described by USB maker and product, with the reason
if a port cannot be opened (in use, no permission). `scan` also listens: it opens each free port at one rate after
another and reports the received data, as baud_scan.py describes it. A port in use by a session or by
another program is not opened.
"""

import asyncio
import glob
import json
import os
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TextIO

from serial import SerialException
from serial.tools import list_ports as system_ports

from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.server.links.base import Attempt, LinkError, ScanWindows
from imuscope.server.links.baud_scan import scan as scan_rates
from imuscope.server.links.serial import SerialSettings, gone, holder, lock_of, open_port
from imuscope.server.text.printable import printable

# USB vendor → maker of adapters and boards; sensor makers are in their families. Source: USB Implementers Forum.
MAKERS = {
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
# Serial ports of boards that pyserial does not list: Jetson, i.MX, OMAP, SC16IS7xx, Qualcomm, Zynq, LPUART.
SYS_TTY = "/sys/class/tty"
BOARD_PORTS = ("ttyTHS*", "ttymxc*", "ttyO[0-9]*", "ttySC*", "ttyHS*", "ttyPS*", "ttyLP*")


@dataclass(slots=True)
class PortInfo:
    """One serial port.

    Attributes:
        device: path, which is also a source.
        description: for display: "Xsens USB converter, serial DB1ABC".
        busy: its user, "a session of this server" or the name of a program; "" if it is free.
        denied: one sentence with the group to join; "" if access is allowed.
        attempts: every rate that was tried, in order.
    """

    device: str
    description: str
    busy: str = ""
    denied: str = ""
    attempts: list[Attempt] = field(default_factory=list)


def list_ports(in_use: Collection[str] = ()) -> list[PortInfo]:
    """All serial ports; none is opened.

    Args:
        in_use: paths in use by sessions.
    """
    by_device = {port.device: _describe(port) for port in system_ports.comports() if not _is_empty(port.device)}
    for pattern in BOARD_PORTS:
        for path in glob.glob(f"/dev/{pattern}"):
            by_device.setdefault(path, "serial port of this board")
    in_use_paths = {os.path.realpath(path) for path in in_use}
    return [_info(device, by_device[device], in_use_paths) for device in sorted(by_device, key=_natural)]


def _is_empty(device: str) -> bool:
    """Whether the kernel lists a port without a UART (ttyS1 … ttyS31)."""
    try:
        return Path(SYS_TTY, os.path.basename(device), "type").read_text().strip() == "0"
    except OSError:
        return False


def _info(device: str, description: str, in_use_paths: Collection[str]) -> PortInfo:
    info = PortInfo(device, description)
    if os.path.realpath(device) in in_use_paths:
        info.busy = "a session of this server"
        return info
    info.busy = holder(device)
    if not os.access(device, os.R_OK | os.W_OK):
        who, hint, _ = lock_of(device)
        info.denied = f"No permission: {who}. {hint}"
    return info


def _describe(port: object) -> str:
    """Description of a port, as far as USB provides one: the product if it is known, else maker and product text."""
    vendor, product = getattr(port, "vid", None), getattr(port, "pid", None)
    if vendor is None:
        text = str(getattr(port, "description", "") or "")
        return text if text and text != "n/a" else "serial port"
    families = PROTOCOLS.values()
    name = next((label for one in families if (label := one.device.usb_products.get((vendor, product or 0)))), "")
    if not name:
        known = next((label for one in families if (label := one.device.usb_vendors.get(vendor))), "") or MAKERS.get(
            vendor
        )
        maker = known or getattr(port, "manufacturer", None) or f"USB {vendor:04x}:{product or 0:04x}"
        text = str(getattr(port, "product", None) or "USB serial port")
        name = text if text.lower().startswith(str(maker).lower()) else f"{maker} {text}"
    number = getattr(port, "serial_number", None)
    return f"{name}, serial {number}" if number else name


def _natural(path: str) -> tuple[str, int]:
    """Sort key that puts ttyUSB2 before ttyUSB10."""
    stem = path.rstrip("0123456789")
    return stem, int(path[len(stem) :] or -1)


async def listen(port: str, progress: Callable[[Attempt], None] | None, windows: ScanWindows) -> list[Attempt]:
    """Listen to one free port at each rate until a protocol is recognised.

    Returns:
        Every attempt as text; a port that cannot be opened is one attempt with the reason.
    """
    attempts: list[Attempt] = []

    def report(one: Attempt) -> None:
        attempts.append(one)
        if progress is not None:
            progress(one)

    try:
        opened = await asyncio.to_thread(open_port, port, SerialSettings())
    except LinkError as error:
        report(Attempt("open", str(error), time.time()))
        return attempts
    try:
        result = await scan_rates(opened, progress=report, windows=windows)
        if not any(one.result.size for one in result):
            report(Attempt("all rates", "0 B at every rate: is it powered, and set to send?", time.time()))
    except (OSError, SerialException) as failure:
        report(Attempt("read", str(gone(port, failure)), time.time()))
    finally:
        await asyncio.to_thread(opened.close)
    return attempts


async def scan(
    ports: Sequence[str] | None = None,
    in_use: Collection[str] = (),
    progress: Callable[[str, Attempt], None] | None = None,
    windows: ScanWindows | None = None,
) -> list[PortInfo]:
    """Listen on every free port, all at the same time.

    Args:
        ports: only these; None: all from `list_ports`. A path that is not in that list is scanned as well.
        in_use: paths in use by sessions; they are listed and not opened.
        progress: called with the port's path and each attempt.
        windows: how long each rate is listened at.
    """
    infos = await asyncio.to_thread(list_ports, in_use)
    if ports is not None:
        known = {info.device: info for info in infos}
        in_use_paths = {os.path.realpath(path) for path in in_use}
        infos = [known.get(path) or _info(path, "as named", in_use_paths) for path in ports]

    async def one(info: PortInfo) -> None:
        report = (lambda attempt: progress(info.device, attempt)) if progress is not None else None
        if info.busy:
            attempts = [Attempt("not opened", f"In use by {info.busy}.", time.time())]
        elif info.denied:
            attempts = [Attempt("not opened", info.denied, time.time())]
        else:
            attempts = await listen(info.device, report, windows or ScanWindows())
        info.attempts = attempts
        if report is not None and (info.busy or info.denied):
            report(attempts[0])

    await asyncio.gather(*(one(info) for info in infos))
    return infos


def print_ports(out: TextIO, *, as_json: bool = False) -> None:
    """`imuscope ports`: list every port and print each attempt as it is made; as JSON once all are made."""
    if as_json:
        out.write(json.dumps([asdict(info) for info in asyncio.run(scan())], ensure_ascii=False) + "\n")
        return
    infos = list_ports()
    if not infos:
        print("No serial port is present. Is the sensor plugged in? (`lsusb`, `dmesg | tail`)", file=out)
        return
    for info in infos:
        print(printable(f"{info.device}  {info.description}"), file=out)
    out.flush()
    width = max(len(info.device) for info in infos)

    def report(device: str, attempt: Attempt) -> None:
        print(printable(f"{device:<{width}}  {attempt.what}: {attempt.outcome}"), file=out, flush=True)

    print("Listening…", file=out, flush=True)
    asyncio.run(scan(progress=report))
