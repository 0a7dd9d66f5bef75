"""USB adapters: identity and current port.

Linux numbers USB ports in the order in which they are plugged in: /dev/ttyUSB0 may come back as /dev/ttyUSB1, and
another adapter may have its old name. udev identifies each by maker, product and serial number:

    /dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A50285BI-if00-port0 -> ../../ttyUSB0

So a link stores the name of the adapter at its port, and searches for that adapter when it is reopened.

Source: systemd, rules.d/60-serial.rules.
"""

import os
from pathlib import Path

from imuscope.server.links.base import LinkError

BY_ID = Path("/dev/serial/by-id")


def adapter_at(place: str, root: Path = BY_ID) -> str:
    """Persistent name (a path) of the adapter at a port; "" if it has none, or the port does not exist."""
    target = os.path.realpath(place)
    try:
        names = sorted(os.listdir(root))
    except OSError:
        return ""
    return next((str(root / name) for name in names if os.path.realpath(root / name) == target), "")


def port_now(place: str, adapter: str, root: Path = BY_ID) -> str:
    """Present port of an adapter.

    Args:
        place: the port at which it was found.
        adapter: its persistent name, "" if it had none.

    Returns:
        `place`, or another port if the adapter is there now.

    Raises:
        LinkError: another adapter has the port's name, and the expected one is not present.
    """
    if not adapter:
        return place
    if os.path.exists(adapter):
        now = os.path.realpath(adapter)
        return place if now == os.path.realpath(place) else now
    other = adapter_at(place, root)
    if other:
        hint = "Plug in the previous adapter again; to use this one, remove the device here and open the port again."
        words = f"Another adapter is {place} now: {Path(other).name}; before, it was {Path(adapter).name}."
        raise LinkError("not-found", words, hint)
    return place


def moved(place: str, now: str, adapter: str) -> list[str]:
    """A notice if the adapter is at another port than in the source, else nothing."""
    if now == place:
        return []
    return [
        f"The adapter of {place} came back as {now}. Open it as {adapter} to find it under any number, "
        "also after a restart of this server."
    ]
