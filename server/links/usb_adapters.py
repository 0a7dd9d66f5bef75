"""Which adapter is at a port, and where is it now?

Linux numbers USB ports in the order in which they are plugged in: what was /dev/ttyUSB0 may come back as /dev/ttyUSB1,
and another adapter may have its name by then. udev knows each by maker, product and serial number:

    /dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A50285BI-if00-port0 -> ../../ttyUSB0

So a link remembers which adapter it found at its port, and looks for that one when it opens again.

Source: systemd, rules.d/60-serial.rules.
"""

from __future__ import annotations

import os
from pathlib import Path

from server.links.base import LinkError

BY_ID = Path("/dev/serial/by-id")


def adapter_at(place: str, root: Path = BY_ID) -> str:
    """The lasting name (a path) of the adapter at a port; "" where it has none, or there is no such port."""
    target = os.path.realpath(place)
    try:
        names = sorted(os.listdir(root))
    except OSError:
        return ""
    return next((str(root / name) for name in names if os.path.realpath(root / name) == target), "")


def port_now(place: str, adapter: str, root: Path = BY_ID) -> str:
    """The port at which an adapter is now.

    Args:
        place: the port at which it was found.
        adapter: its lasting name, "" where it had none.
    Returns:
        `place`, or another port where the adapter is there now.
    Raises:
        LinkError: another adapter has the port's name, and the one that is looked for is nowhere.
    """
    if not adapter:
        return place
    if os.path.exists(adapter):
        now = os.path.realpath(adapter)
        return place if now == os.path.realpath(place) else now
    other = adapter_at(place, root)
    if other:
        hint = "Plug the one before in again; to use this one instead, remove the device here and open the port anew."
        words = f"Another adapter is {place} now: {Path(other).name}, and before it was {Path(adapter).name}."
        raise LinkError("not-found", words, hint)
    return place


def moved(place: str, now: str, adapter: str) -> list[str]:
    """A notice where the adapter is at another port than the source says."""
    if now == place:
        return []
    return [
        f"The adapter of {place} came back as {now}. Open it as {adapter} to have it found under any number, "
        "also when this server is started again."
    ]
