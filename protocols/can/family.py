"""CAN frames as a protocol: a stream that files have, and that is never searched for in the bytes of a port."""

from typing import Any

import numpy as np

from imuscope.protocols.can.decoder import COUNTER, CanDecoder, utc_of
from imuscope.protocols.can.definition import KINDS, CanDefinition, default_definition, identifier_text, read_definition
from imuscope.protocols.can.lines import DATA, DEFINITION, scan
from imuscope.protocols.family.info import (
    Decoding,
    DeviceTraits,
    FrameFormat,
    PageWords,
    ProtocolInfo,
    StreamTraits,
    position_of_columns,
)
from imuscope.protocols.framing.frame_lines import FrameLine, frame_lines
from imuscope.protocols.framing.stream_buffer import BODY, ID, LENGTH, SENDER
from imuscope.protocols.framing.stream_parser import StreamParser
from imuscope.protocols.schema.fields import Message

_KINDS = ("", "request", "CAN FD", "error")


class CanLister:
    """Chunks in, lines out."""

    def __init__(self, *, direction: str = "to_host") -> None:
        self._stream = StreamParser(scan)
        self._definition: CanDefinition = default_definition()

    def feed(self, data: bytes) -> None:
        """Append a chunk."""
        self._stream.feed(data, 0)

    def drain(self, *, stalled: bool = False) -> list[FrameLine]:
        """Lines of everything complete; see events.Decoder.drain."""
        cut = self._stream.drain(stalled=stalled)

        def values(k: int, line: bytes) -> FrameLine:
            kind, number = int(cut.table[SENDER, k]), int(cut.table[ID, k])
            begin, length = int(cut.table[BODY, k]), int(cut.table[LENGTH, k])
            if kind == DEFINITION:
                definition = read_definition(cut.data[begin : begin + length])
                self._definition = definition or self._definition
                return {"protocol": "can", "id": None, "message": "definition", "fields": {}}
            data = cut.data[begin : begin + 2 * length]
            return {"protocol": "can", "id": identifier_text(number), **self._named(number, kind, data, length)}

        return frame_lines(cut, values)

    def _named(self, number: int, kind: int, digits: bytes, length: int) -> dict[str, Any]:
        row = self._definition.rows.get(number)
        if kind != DATA or row is None or length < row.size:
            return {"message": _KINDS[kind] or "frame", "fields": {"data": digits.decode(errors="replace")}}
        data = np.frombuffer(bytes.fromhex(digits.decode()).ljust(8, b"\0"), np.uint8)[None]
        return {"message": row.name, "fields": {row.name: _plain(row.column(data)[0])}}


def _plain(value: Any) -> Any:
    """A value of a column in plain Python."""
    if value.dtype.names:
        return {name: value[name].item() for name in value.dtype.names}
    return value.tolist()


FAMILY = ProtocolInfo(
    "can",
    "CAN",
    frames=FrameFormat(
        likeness=lambda data: (0.0, ""),
        listing=CanLister,
        sample=b"(1767225600.000000) can0 021#7FFF000000000000\n",
        scan=scan,
        rows=lambda: [Message(row.identifier, row.name, (row.field,)) for kind in KINDS.values() for row in kind.rows],
    ),
    decoding=Decoding(
        decoder=CanDecoder,
    ),
    stream=StreamTraits(
        counts=True,
        counter=COUNTER,
        utc=utc_of,
        is_offered=False,
    ),
    device=DeviceTraits(
        position=position_of_columns,
    ),
    page=PageWords(
        short="CAN",
    ),
)
