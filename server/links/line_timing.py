"""Timing of a link: delays between the line and the host.

Two delays are known before the first byte: its duration on the line, and the longest time for which an adapter may
hold it back. Linux reports the latter for some adapters (attribute latency_timer); any USB adapter holds bytes back
for one frame of the bus.

A native USB port (ttyACM) has no line: its baud rate has no effect.
"""

import os
from pathlib import Path

from imuscope.server.links.base import Link

BUS_NS = 1e6  # frame of the bus: longest delay of a full-speed adapter without a timer


def byte_time_ns(link: Link) -> float:
    """Duration of one byte on an open link's line; 0 if there is no line or its rate is unknown."""
    if not link.baud or not link.capacity or port_of(link).startswith("ttyACM"):
        return 0.0
    return 1e9 / link.capacity


def holds_ns(link: Link) -> float:
    """Longest time for which the adapter of a link may hold a byte back; 0 without an adapter."""
    name = port_of(link)
    if not name:
        return 0.0
    devices = Path(link.settings.sys_root, "bus/usb-serial/devices")
    try:
        return max(int((devices / name / "latency_timer").read_text()) * 1e6, BUS_NS)
    except (OSError, ValueError):
        return BUS_NS if name.startswith("ttyACM") or (devices / name).exists() else 0.0


def port_of(link: Link) -> str:
    """Kernel name of the port of a serial link; "" for any other link."""
    place = getattr(link, "place", "")
    return os.path.basename(os.path.realpath(place)) if link.kind == "serial" and place else ""
