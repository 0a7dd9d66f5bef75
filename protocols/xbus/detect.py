"""Detection of an MTi.

The score is the share of bytes in valid frames or in sentences that an MTi can send. A sentence alone does not
distinguish an MTi from another NMEA device, so text counts half.
"""

from __future__ import annotations

from collections import Counter

from imuscope.protocols.framing import ID, SIZE
from imuscope.protocols.xbus.messages import ROWS
from imuscope.protocols.xbus.stream_parser import XbusStreamParser


def detection_score(data: bytes) -> tuple[float, str]:
    """(score 0..1, words)."""
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
