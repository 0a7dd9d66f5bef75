"""A capture, line by line: every frame, text and reject in the order of the stream, as plain values.

Each line has `offset` and `size`; then either `reject`, or `protocol`, `id`, `message`, `fields` and what json_codec.py
adds.
An MTData2 frame whose last item does not fit is listed with the items before it, and the bad item as a reject too.
"""

from __future__ import annotations

from typing import Any

from protocols.events import RejectedFrame, Text
from protocols.framing import BODY, ID, LENGTH, OFFSET, SIZE
from protocols.xbus.data_identifiers import RAW_BLOB, is_known, item
from protocols.xbus.frames import MTDATA2, items
from protocols.xbus.json_codec import frame_to_json
from protocols.xbus.stream_parser import Stream

XbusFrameLine = dict[str, Any]


class XbusFrameLister:
    """Chunks in, lines out."""

    def __init__(self) -> None:
        self._stream = Stream()

    def feed(self, data: bytes) -> None:
        """Append a chunk."""
        self._stream.feed(data, 0)

    def drain(self, *, stalled: bool = False) -> list[XbusFrameLine]:
        """Lines of everything complete; see events.Decoder.drain."""
        cut = self._stream.drain(stalled=stalled)
        lines = [_of_text(text) for text in cut.texts]
        rejects = cut.rejects
        for k in range(cut.table.shape[1]):
            offset, size, body, length, mid = (int(cut.table[row, k]) for row in (OFFSET, SIZE, BODY, LENGTH, ID))
            frame = cut.data[offset : offset + size]
            lines.append({"offset": cut.start + offset, "size": size, "protocol": "xbus", **frame_to_json(frame)})
            if mid == MTDATA2:
                rejects += _bad_items(cut.data[body : body + length], cut.start + body)
        lines += [{"offset": reject.offset, "size": reject.size, "reject": reject.reason} for reject in rejects]
        return sorted(lines, key=lambda line: int(line["offset"]))


def _of_text(text: Text) -> XbusFrameLine:
    line: XbusFrameLine = {
        "offset": text.offset,
        "size": text.size,
        "protocol": text.protocol,
        "id": None,
        "message": text.name,
    }
    line["fields"] = dict(text.fields)
    if text.protocol != "em1000":  # whose fields say it all
        line["wire"] = {"line": text.line}
    return line


def _bad_items(payload: bytes, start: int) -> list[RejectedFrame]:
    """Items of a known identifier but a wrong size, and what follows the last whole item."""
    found, covered = items(payload)
    bad = [
        RejectedFrame(start + at - 3, size + 3, "bad_item")
        for identifier, at, size in found
        if identifier != RAW_BLOB and is_known(identifier) and item(identifier, size).dtype == "bytes"
    ]
    if covered < len(payload):
        bad.append(RejectedFrame(start + covered, len(payload) - covered, "bad_item"))
    return bad
