"""The WebSocket as a document: the specification in server/wire/, and its types in TypeScript."""

from __future__ import annotations

import inspect
from collections.abc import Iterator

from imuscope.server import wire
from imuscope.server.reference import typescript
from imuscope.server.reference.blocks import Block, Code, Heading, Paragraph, parse

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
