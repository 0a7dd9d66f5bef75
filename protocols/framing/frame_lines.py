"""A capture as lines: every frame, text and reject in stream order, as plain values.

Each line has `offset` and `size`; then either `reject`, or `protocol`, `id`, `message`, `fields` and the additions of
the family's json_codec.py.
"""

from collections.abc import Callable, Iterable
from typing import Any, Protocol

from imuscope.protocols.arrays import Ints
from imuscope.protocols.events import RejectedFrame, Text
from imuscope.protocols.framing.stream_buffer import OFFSET, SIZE

FrameLine = dict[str, Any]


class ParsedFrames(Protocol):
    """The part of a parser's result that is listed; see stream_parser.ParseResult."""

    data: bytes
    start: int
    table: Ints
    rejects: list[RejectedFrame]


def frame_lines(
    cut: ParsedFrames, values: Callable[[int, bytes], FrameLine], texts: Iterable[Text] = ()
) -> list[FrameLine]:
    """The lines of one parser's result, by offset.

    Args:
        values: of a frame (its column in the table, its bytes); may add to the rejects.
    """
    lines = [_text_line(text) for text in texts]
    for k, (offset, size) in enumerate(cut.table[[OFFSET, SIZE]].T.tolist()):
        lines.append({"offset": cut.start + offset, "size": size, **values(k, cut.data[offset : offset + size])})
    lines += [{"offset": one.offset, "size": one.size, "reject": one.reason} for one in cut.rejects]
    return sorted(lines, key=lambda line: int(line["offset"]))


def _text_line(text: Text) -> FrameLine:
    line: FrameLine = {"offset": text.offset, "size": text.size, "protocol": text.protocol, "id": None}
    line |= {"message": text.name, "fields": dict(text.fields)}
    if text.protocol != "em1000":  # whose fields are complete
        line["wire"] = {"line": text.line}
    return line
