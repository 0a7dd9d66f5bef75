"""Supported devices as a document, from the tables of every protocol family."""

from __future__ import annotations

from collections.abc import Iterator

from imuscope.protocols.registry import PROTOCOLS, log_formats
from imuscope.server.reference.blocks import Block, Heading, Items, Paragraph, TableBlock

INTRODUCTION = (
    "Every device below is detected automatically, on serial ports, TCP and UDP and in files. All of them can be "
    "shown live, recorded, replayed, exported, inspected and simulated."
)
OTHERS = (
    "NMEA 0183 sentences",
    "UBX and RTCM 3 messages",
)
FILES = (
    "recordings of imuscope, and other MCAP files with numbers (protobuf, ROS 2, JSON)",
    "ROS 2 bags",
    *(f"`{log.suffix}` of {family.title}" for family, log in log_formats()),
    "raw captures of any protocol below",
    "CSV with a header line",
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
