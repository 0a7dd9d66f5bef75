"""Bytes of an MTi described: their score in the detection of a protocol, and their frames, line by line.

The score is the share of bytes in valid frames or in sentences that an MTi can send. A sentence alone does not
distinguish an MTi from another NMEA device, so text counts half.

In the list (protocols/framing/frame_lines.py) an MTData2 frame whose last item does not fit has the items before it,
and the bad item follows as a reject.
"""

from collections import Counter

from imuscope.protocols.events import RejectedFrame
from imuscope.protocols.framing.frame_lines import FrameLine, frame_lines
from imuscope.protocols.framing.stream_buffer import BODY, ID, LENGTH, SIZE
from imuscope.protocols.xbus.data_identifiers import RAW_BLOB, is_known, item
from imuscope.protocols.xbus.frames import MTDATA2, items
from imuscope.protocols.xbus.json_codec import frame_to_json
from imuscope.protocols.xbus.messages import ROWS
from imuscope.protocols.xbus.stream_parser import XbusStreamParser


def detection_score(data: bytes) -> tuple[float, str]:
    if not data:
        return 0.0, "no bytes"
    stream = XbusStreamParser()
    stream.feed(data, 0)
    cuts = [stream.drain()]
    waiting = stream.buffered
    cuts.append(stream.drain(stalled=True))
    framed = sum(int(cut.table[SIZE].sum()) for cut in cuts)
    texts = [text for cut in cuts for text in cut.texts]
    names = Counter(ROWS[mid][0].name for cut in cuts for mid in cut.table[ID].tolist() if mid in ROWS)
    if framed:
        # an incomplete frame at the end of the data counts neither for nor against
        score = min(1.0, (framed + sum(text.size for text in texts)) / max(len(data) - waiting, framed))
        kinds = ", ".join(name for name, _ in names.most_common(3)) or "unlisted messages"
        count = sum(cut.table.shape[1] for cut in cuts)
        return score, f"{count} Xbus frame{'s' * (count > 1)} ({kinds}) in {framed} of {len(data)} B"
    if texts:
        kinds = ", ".join(name for name, _ in Counter(text.name for text in texts).most_common(3))
        score = 0.5 * min(1.0, sum(text.size for text in texts) / max(len(data) - waiting, 1))
        return score, f"{len(texts)} text message{'s' * (len(texts) > 1)} ({kinds})"
    return 0.0, "no frame in them"


class XbusFrameLister:
    """Chunks in, lines out."""

    def __init__(self) -> None:
        self._stream = XbusStreamParser()

    def feed(self, data: bytes) -> None:
        self._stream.feed(data, 0)

    def drain(self, *, stalled: bool = False) -> list[FrameLine]:
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
