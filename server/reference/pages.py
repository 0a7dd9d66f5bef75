"""The reference pages by name, and their HTML."""

import inspect
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from imuscope.protocols.family.quality import RULES, level_of
from imuscope.protocols.registry.families import PROTOCOLS, log_formats
from imuscope.server import wire
from imuscope.server.reference import typescript
from imuscope.server.reference.blocks import Block, Code, Heading, Items, Paragraph, TableBlock, parse, to_html
from imuscope.server.reference.http_api import http_api

TYPES = "Every text frame is one of `ServerText` or `BrowserText`, written here as TypeScript."


def websocket() -> Iterator[Block]:
    """The blocks of the document."""
    yield Heading(1, "WebSocket")
    _, _, specification = inspect.cleandoc(wire.__doc__ or "").partition("\n\n")
    yield from parse(specification)
    yield Heading(2, "Types")
    yield Paragraph(TYPES)
    target = next(target for target in typescript.TARGETS if target.module is wire)
    _, _, types = typescript.generate(target).partition("\n\n")
    yield Code(types, "ts")


INTRODUCTION = (
    "Every device below is detected automatically, on serial ports, TCP and UDP and in files. All of them can be "
    "shown live, recorded, replayed, exported, inspected and simulated."
)
OTHERS = (
    "NMEA 0183 sentences, with the ASCII messages of VectorNav",
    "UBX messages: position, velocity, attitude, time and sensors of a u-blox receiver; RTCM 3 messages",
)
FILES = (
    "recordings of imuscope, and other MCAP files with numbers (protobuf, ROS 2, JSON)",
    *(f"`{log.suffix}` of {family.title}" for family, log in log_formats()),
    "raw captures of any protocol below",
    "bags of ROS 1 and 2, logs of flight controllers and of a CAN bus, arrays, tables: see Recordings in the guide",
)


def devices() -> Iterator[Block]:
    """The blocks of the document."""
    yield Heading(1, "Supported devices")
    yield Paragraph(INTRODUCTION)
    yield Paragraph("These are also detected among the frames of any device:")
    yield Items(OTHERS)
    yield Paragraph("Files that can be opened:")
    yield Items(FILES)
    for row in PROTOCOLS.values():
        yield Heading(2, row.title)
        yield Paragraph(f"Protocol name on the command line: `{row.name}`.")
        for table in row.page.supported():
            yield Heading(3, table.title)
            if table.about:
                yield Paragraph(table.about)
            yield TableBlock(table.head, table.rows)
    yield from _ladder()


def _ladder() -> Iterator[Block]:
    """The rules of protocols/family/quality.py, and whether each family fulfils them."""
    families = [*PROTOCOLS.values()]
    yield Heading(2, "What each family offers")
    yield Paragraph(
        "Levels: "
        + ", ".join(f"{one.title} is {level_of(one)}" for one in families)
        + ". A number stands for a reason "
        "why a rule does not apply."
    )
    reasons = [*dict.fromkeys(reason for one in families for reason in one.page.exempt.values())]
    rows = []
    for rule in RULES:
        cells = []
        for family in families:
            reason = family.page.exempt.get(rule.name)
            cells.append("yes" if rule.is_fulfilled(family) else f"({reasons.index(reason) + 1})" if reason else "no")
        rows.append((rule.level, rule.words, *cells))
    yield TableBlock(("level", "rule", *(one.short_title for one in families)), tuple(rows))
    yield Items(tuple(f"({number}) {reason}" for number, reason in enumerate(reasons, 1)))


OpenApi = Callable[[], Mapping[str, Any]]


@dataclass(frozen=True, slots=True)
class ReferencePage:
    """One document.

    Args:
        name: in its address and its file name.
        title, about: for the list of pages.
        blocks: creates its blocks from the API's description.
    """

    name: str
    title: str
    about: str
    blocks: Callable[[Mapping[str, Any]], Iterable[Block]]


PAGES = {
    page.name: page
    for page in (
        ReferencePage("http-api", "HTTP API", "All requests with their parameters and responses.", http_api),
        ReferencePage("websocket", "WebSocket", "Live data: text and binary frames.", lambda _: websocket()),
        ReferencePage("supported-devices", "Supported devices", "Products, firmware and data.", lambda _: devices()),
    )
}


class ReferencePages:
    """The pages as HTML, each generated at the first request."""

    def __init__(self) -> None:
        self._html: dict[str, str] = {}
        self._lock = threading.Lock()

    def html(self, name: str, openapi: OpenApi) -> str:
        """The content of a page; of the list of pages with the name "".

        Args:
            openapi: the description of the API, as served at /openapi.json.

        Raises:
            KeyError: unknown name.
        """
        with self._lock:
            if name not in self._html:
                blocks = PAGES[name].blocks(openapi()) if name else _index()
                self._html[name] = to_html(blocks)
            return self._html[name]


def _index() -> Iterable[Block]:
    yield Heading(1, "Reference")
    yield Paragraph("These pages describe the server that serves them; they need no network beyond it.")
    pages = (f"[{page.title}](/docs/{page.name}): {page.about}" for page in PAGES.values())
    yield Items((*pages, "`/openapi.json`: the HTTP API for programs, as OpenAPI."))
