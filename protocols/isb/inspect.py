"""Bytes of an Inertial Sense device described: their score in the detection of a protocol, and their packets, line by
line.

The score is the share of bytes in valid packets, or in messages that pass through its ports: text alone, which any
receiver may send, counts half. Packets of protocol 1.x are reported by name, with a low score, because they cannot be
decoded:

    FF … FE    between them no FF, FE, or other start byte as itself: each is sent as FD and its complement
               (so protocol 1.x is known by its shape; SDK 1.x, ISComm.h)

In the list (protocols/framing/frame_lines.py) structures follow the firmware version in an earlier device information.
"""

import re
from collections import Counter

from imuscope.protocols.embedded.finders import STARTS, find
from imuscope.protocols.framing.frame_lines import FrameLine, frame_lines
from imuscope.protocols.framing.stream_buffer import BODY, ID, LENGTH, SIZE
from imuscope.protocols.framing.stream_parser import ParseResult, StreamParser
from imuscope.protocols.isb.classify import FAMILY, FIRMWARE_AT, version_of
from imuscope.protocols.isb.dataset_loader import VERSIONS
from imuscope.protocols.isb.frames import DATA, FLAGS, TYPE_MASK, TYPES, WITH_OFFSET, scan
from imuscope.protocols.isb.json_codec import frame_to_json
from imuscope.protocols.isb.messages import DEVICE_INFOS, ROWS, rules, version_numbers

_OLD = re.compile(rb"\xff(?:[^\x0a\x24\xb5\xd3\xfd\xfe\xff]|\xfd[\xf5\xdb\x4a\x2c\x02\x01\x00]){7,2100}\xfe")
_SEARCH_BYTES = 1 << 16
_OLD_SCORE = 0.25


def detection_score(data: bytes) -> tuple[float, str]:
    if not data:
        return 0.0, "no bytes"
    stream = StreamParser(scan, find, STARTS)
    stream.feed(data, 0)
    cuts = [stream.drain()]
    waiting = stream.buffered
    cuts.append(stream.drain(stalled=True))
    framed = sum(int(cut.table[SIZE].sum()) for cut in cuts)
    texts = [text for cut in cuts for text in cut.texts]
    written = sum(text.size for text in texts)
    if framed:
        # an incomplete packet at the end of the data counts neither for nor against
        score = min(1.0, (framed + written) / max(len(data) - waiting, framed))
        names = Counter(name for cut in cuts for name in _names(cut))
        count = sum(cut.table.shape[1] for cut in cuts)
        kinds = ", ".join(name for name, _ in names.most_common(3))
        return score, f"{count} ISB packet{'s' * (count > 1)} ({kinds}) in {framed} of {len(data)} B"
    old = _OLD.findall(data[:_SEARCH_BYTES])
    if len(old) > 1 and sum(map(len, old)) > len(data[:_SEARCH_BYTES]) // 2:
        words = f"{len(old)} packets of Inertial Sense protocol 1.x, which is not supported: update the firmware to 2.x"
        return _OLD_SCORE, words
    if texts:
        kinds = ", ".join(name for name, _ in Counter(f"{t.protocol} {t.name}" for t in texts).most_common(3))
        score = 0.5 * min(1.0, written / max(len(data) - waiting, 1))
        return score, f"{len(texts)} message{'s' * (len(texts) > 1)} ({kinds})"
    return 0.0, "no packet in them"


def _names(cut: ParseResult) -> list[str]:
    kinds = cut.table[FLAGS] & TYPE_MASK
    numbers = zip(kinds.tolist(), cut.table[ID].tolist(), strict=True)
    return [ROWS[did].name if kind == DATA else TYPES[kind] for kind, did in numbers]


_FAMILIES = rules()[:, FAMILY]
_NUMBERS = version_numbers()


class IsbFrameLister:
    """Chunks in, lines out."""

    def __init__(self) -> None:
        self._stream = StreamParser(scan, find, STARTS)
        self._versions: dict[int, str] = {}  # by family of devices

    def feed(self, data: bytes) -> None:
        self._stream.feed(data, 0)

    def drain(self, *, stalled: bool = False) -> list[FrameLine]:
        cut = self._stream.drain(stalled=stalled)

        def values(k: int, frame: bytes) -> FrameLine:
            did = int(cut.table[ID, k])
            self._learn(cut, k, did)
            return {"protocol": "isb", **frame_to_json(frame, self._versions.get(int(_FAMILIES[did])))}

        return frame_lines(cut, values, cut.texts)

    def _learn(self, cut: ParseResult, k: int, did: int) -> None:
        """Store the firmware named in a device information."""
        if did not in DEVICE_INFOS or cut.table[LENGTH, k] < FIRMWARE_AT + 4:
            return
        if cut.table[FLAGS, k] & (TYPE_MASK | WITH_OFFSET) == DATA:
            index = version_of(cut.array, int(cut.table[BODY, k]), _NUMBERS)
            self._versions[int(_FAMILIES[did])] = VERSIONS[index]
