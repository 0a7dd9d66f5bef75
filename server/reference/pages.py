"""The reference pages by name, and their HTML."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from imuscope.server.reference.blocks import Block, Heading, Items, Paragraph, to_html
from imuscope.server.reference.devices import devices
from imuscope.server.reference.http_api import http_api
from imuscope.server.reference.websocket import websocket

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
