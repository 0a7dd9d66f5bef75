"""Links: sources of bytes. The guarantees of a link are in `imuscope.server.links.base`, the grammar of sources in
`imuscope.server.links.source_url`, the registry of kinds in `imuscope.server.links.registry`.

    link = open_link("serial:///dev/ttyUSB0?baud=921600", LinkSettings(now_ns=steady_clock()))
    await link.open(progress=print)
    while True:
        for chunk in await link.read():
            decoder.feed(chunk.data, chunk.arrival_ns)
"""

from __future__ import annotations

from imuscope.server.links.base import Attempt, Chunk, Link, LinkError, LinkSettings, Progress, steady_clock
from imuscope.server.links.registry import link_kind
from imuscope.server.links.replay import split_devices
from imuscope.server.links.source_url import SourceUrl

__all__ = [
    "Attempt",
    "Chunk",
    "Link",
    "LinkError",
    "LinkSettings",
    "Progress",
    "SourceUrl",
    "open_link",
    "split_devices",
    "steady_clock",
]


def open_link(source: str, settings: LinkSettings | None = None) -> Link:
    """Create the link for a source, not connected yet; `await link.open()` connects it.

    Raises:
        LinkError: kind "bad-source", with the field, the value and the allowed ones.
    """
    settings = settings or LinkSettings(now_ns=steady_clock())
    parsed = SourceUrl.parse(source)
    definition = link_kind(parsed.kind)
    assert definition is not None, "the kind of a parsed source is registered"
    return definition.open(source, settings, parsed)
