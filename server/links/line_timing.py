"""What does a link do to the time at which bytes arrive?

Two things can be known before a byte has come: how long one takes on the line, and for how long an adapter may keep it
back, which Linux tells of some (attribute latency_timer) and which any USB adapter does for a frame of the bus.

A port that is USB itself (ttyACM) has no line: the rate that is set there means nothing.
"""

from __future__ import annotations

import os
from pathlib import Path

from server.links.base import Link

BUS_NS = 1e6  # a frame of the bus: what a full-speed adapter without a timer of its own may wait


def byte_time_ns(link: Link) -> float:
    """How long one byte takes on an open link's line, 0 where there is none or its rate is not known."""
    if not link.baud or not link.capacity or port_of(link).startswith("ttyACM"):
        return 0.0
    return 1e9 / link.capacity


def holds_ns(link: Link) -> float:
    """For how long the adapter of a link may keep a byte back, 0 where there is none."""
    name = port_of(link)
    if not name:
        return 0.0
    devices = Path(link.settings.sys_root, "bus/usb-serial/devices")
    try:
        return max(int((devices / name / "latency_timer").read_text()) * 1e6, BUS_NS)
    except (OSError, ValueError):
        return BUS_NS if name.startswith("ttyACM") or (devices / name).exists() else 0.0


def port_of(link: Link) -> str:
    """What the kernel calls the port of a serial link; "" of any other."""
    place = getattr(link, "place", "")
    return os.path.basename(os.path.realpath(place)) if link.kind == "serial" and place else ""
