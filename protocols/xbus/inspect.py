"""A capture, line by line (protocols/frame_lines.py).

An MTData2 frame whose last item does not fit is listed with the items before it, and the bad item also as a reject.
"""

from __future__ import annotations

from imuscope.protocols.events import RejectedFrame
from imuscope.protocols.frame_lines import FrameLine, frame_lines
from imuscope.protocols.framing import BODY, ID, LENGTH
from imuscope.protocols.xbus.data_identifiers import RAW_BLOB, is_known, item
from imuscope.protocols.xbus.frames import MTDATA2, items
from imuscope.protocols.xbus.json_codec import frame_to_json
from imuscope.protocols.xbus.stream_parser import XbusStreamParser


class XbusFrameLister:
    """Chunks in, lines out."""

    def __init__(self) -> None:
        self._stream = XbusStreamParser()

    def feed(self, data: bytes) -> None:
        """Append a chunk."""
        self._stream.feed(data, 0)

    def drain(self, *, stalled: bool = False) -> list[FrameLine]:
        """Lines of everything complete; see events.Decoder.drain."""
        cut = self._stream.drain(stalled=stalled)

        def values(k: int, frame: bytes) -> FrameLine:
            body, length = int(cut.table[BODY, k]), int(cut.table[LENGTH, k])
            if cut.table[ID, k] == MTDATA2:
                cut.rejects.extend(_bad_items(cut.data[body : body + length], cut.start + body))
            return {"protocol": "xbus", **frame_to_json(frame)}

        return frame_lines(cut, values, cut.texts)


def _bad_items(payload: bytes, start: int) -> list[RejectedFrame]:
    """Items with a known identifier but a wrong size, and the bytes after the last whole item."""
    spans, covered = items(payload)
    bad = [
        RejectedFrame(start + at - 3, size + 3, "bad_item")
        for identifier, at, size in spans
        if identifier != RAW_BLOB and is_known(identifier) and item(identifier, size).dtype == "bytes"
    ]
    if covered < len(payload):
        bad.append(RejectedFrame(start + covered, len(payload) - covered, "bad_item"))
    return bad
