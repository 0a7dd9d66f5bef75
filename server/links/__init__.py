"""Links: where bytes come from. `open_link(source)` makes the right one; see `server.links.base` for what a link promises.

    link = open_link("serial:///dev/ttyUSB0?baud=921600")
    await link.open(progress=print)
    for chunk in await link.read(): ...
"""
from __future__ import annotations

from server.links.base import Chunk, Link, LinkError, LinkSettings, Progress, Try, steady_clock

__all__ = ["Chunk", "Link", "LinkError", "LinkSettings", "Progress", "Try", "steady_clock"]
