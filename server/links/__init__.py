"""Links: where bytes come from. What a link promises is in `server.links.base`, how a source is written in
`server.links.source_url`.

    link = open_link("serial:///dev/ttyUSB0?baud=921600", LinkSettings(now_ns=steady_clock()))
    await link.open(progress=print)
    while True:
        for chunk in await link.read():
            decoder.feed(chunk.data, chunk.arrival_ns)
"""

from __future__ import annotations

from server.links.base import Chunk, Link, LinkError, LinkSettings, Progress, Try, steady_clock
from server.links.capture_file import SPEEDS, FileLink
from server.links.pipe import PipeLink, is_pipe
from server.links.replay import OPTIONS, ReplayLink, is_recording, split_devices
from server.links.serial import SerialLink, SerialSettings
from server.links.simulated_device import SimulatorOptions
from server.links.simulator import SimulatorLink
from server.links.source_url import SourceUrl
from server.links.tcp import TcpLink, TcpListenLink
from server.links.udp import UdpLink

__all__ = [
    "Chunk",
    "Link",
    "LinkError",
    "LinkSettings",
    "Progress",
    "SourceUrl",
    "Try",
    "open_link",
    "split_devices",
    "steady_clock",
]


def open_link(source: str, settings: LinkSettings | None = None) -> Link:
    """The link for a source, not connected yet: `await link.open()` does that.

    Raises:
        LinkError: kind "bad-source", with the field, the value and what is allowed.
    """
    settings = settings or LinkSettings(now_ns=steady_clock())
    parsed = SourceUrl.parse(source)
    match parsed.kind:
        case "serial":
            return SerialLink(source, settings, parsed.place, SerialSettings.of(parsed))
        case "tcp":
            parsed.allow(())
            return TcpLink(source, settings, *parsed.address(listening=False))
        case "tcp-listen":
            parsed.allow(())
            return TcpListenLink(source, settings, *parsed.address(listening=True))
        case "udp":
            parsed.allow(())
            return UdpLink(source, settings, *parsed.address(listening=True))
        case "file":
            if is_recording(parsed.place) or {"device", "from", "to"} & parsed.options.keys():
                parsed.allow(OPTIONS)
                return ReplayLink(source, settings, parsed)
            if is_pipe(parsed.place):
                parsed.allow(())
                return PipeLink(source, settings, parsed.place)
            parsed.allow(("speed", "loop"))
            return FileLink(source, settings, parsed.place, parsed.number("speed", 1, *SPEEDS), parsed.switch("loop"))
        case "twin":
            return SimulatorLink(source, settings, SimulatorOptions.of(parsed))
