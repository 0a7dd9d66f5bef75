"""Supported devices as a document, from the tables of every protocol family."""

from __future__ import annotations

from collections.abc import Iterator

from imuscope.protocols.family.quality import RULES, level_of
from imuscope.protocols.registry.families import PROTOCOLS, log_formats
from imuscope.server.reference.blocks import Block, Heading, Items, Paragraph, TableBlock

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
