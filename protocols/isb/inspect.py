"""A capture, line by line (protocols/frame_lines.py).

Structures follow the firmware version in an earlier device information of the capture.
"""

from __future__ import annotations

from imuscope.protocols.embedded_protocols import STARTS, find
from imuscope.protocols.frame_lines import FrameLine, frame_lines
from imuscope.protocols.framing import BODY, ID, LENGTH
from imuscope.protocols.isb.classify import FAMILY, FIRMWARE_AT, version_of
from imuscope.protocols.isb.dataset_loader import VERSIONS
from imuscope.protocols.isb.frames import DATA, FLAGS, TYPE_MASK, WITH_OFFSET, scan
from imuscope.protocols.isb.json_codec import frame_to_json
from imuscope.protocols.isb.messages import DEVICE_INFOS, rules, version_numbers
from imuscope.protocols.stream_parser import ParseResult, StreamParser

_FAMILIES = rules()[:, FAMILY]
_NUMBERS = version_numbers()


class IsbFrameLister:
    """Chunks in, lines out."""

    def __init__(self) -> None:
        self._stream = StreamParser(scan, find, STARTS)
        self._versions: dict[int, str] = {}  # by family of devices

    def feed(self, data: bytes) -> None:
        """Append a chunk."""
        self._stream.feed(data, 0)

    def drain(self, *, stalled: bool = False) -> list[FrameLine]:
        """Lines of everything complete; see events.Decoder.drain."""
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
