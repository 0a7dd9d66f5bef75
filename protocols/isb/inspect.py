"""A capture, line by line: every packet, text and reject in the order of the stream, as plain values.

Each line has `offset` and `size`; then either `reject`, or `protocol`, `id`, `message`, `fields` and what json_codec.py
adds. Structures follow the firmware version that a device information earlier in the capture told.
"""

from __future__ import annotations

from typing import Any

from protocols.embedded_protocols import STARTS, find
from protocols.events import Text
from protocols.framing import BODY, ID, LENGTH, OFFSET, SIZE
from protocols.isb.classify import FAMILY, FIRMWARE_AT, version_of
from protocols.isb.dataset_loader import VERSIONS
from protocols.isb.frames import DATA, FLAGS, TYPE_MASK, WITH_OFFSET, scan
from protocols.isb.json_codec import frame_to_json
from protocols.isb.messages import DEVICE_INFOS, rules, version_numbers
from protocols.stream_parser import ParseResult, StreamParser

IsbFrameLine = dict[str, Any]

_FAMILIES = rules()[:, FAMILY]
_NUMBERS = version_numbers()


class IsbFrameLister:
    """Chunks in, lines out."""

    def __init__(self) -> None:
        self._stream = StreamParser(scan, find, STARTS)
        self._versions: dict[int, str] = {}  # of each family of devices

    def feed(self, data: bytes) -> None:
        """Append a chunk."""
        self._stream.feed(data, 0)

    def drain(self, *, stalled: bool = False) -> list[IsbFrameLine]:
        """Lines of everything complete; see events.Decoder.drain."""
        cut = self._stream.drain(stalled=stalled)
        lines = [_of_text(text) for text in cut.texts]
        for k in range(cut.table.shape[1]):
            offset, size, did = (int(cut.table[row, k]) for row in (OFFSET, SIZE, ID))
            self._learn(cut, k, did)
            values = frame_to_json(cut.data[offset : offset + size], self._versions.get(int(_FAMILIES[did])))
            lines.append({"offset": cut.start + offset, "size": size, "protocol": "isb", **values})
        lines += [{"offset": reject.offset, "size": reject.size, "reject": reject.reason} for reject in cut.rejects]
        return sorted(lines, key=lambda line: int(line["offset"]))

    def _learn(self, cut: ParseResult, k: int, did: int) -> None:
        """The firmware that a device information tells."""
        if did not in DEVICE_INFOS or cut.table[LENGTH, k] < FIRMWARE_AT + 4:
            return
        if cut.table[FLAGS, k] & (TYPE_MASK | WITH_OFFSET) == DATA:
            told = version_of(cut.array, int(cut.table[BODY, k]), _NUMBERS)
            self._versions[int(_FAMILIES[did])] = VERSIONS[told]


def _of_text(text: Text) -> IsbFrameLine:
    line: IsbFrameLine = {
        "offset": text.offset,
        "size": text.size,
        "protocol": text.protocol,
        "id": None,
        "message": text.name,
    }
    return {**line, "fields": dict(text.fields), "wire": {"line": text.line}}
