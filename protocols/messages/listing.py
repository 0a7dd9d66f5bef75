"""A stream of messages, line by line: what `imuscope inspect` prints of a recording of messages."""

from __future__ import annotations

from typing import Any

from imuscope.protocols.events import Batch, RejectedFrame
from imuscope.protocols.framing.frame_lines import FrameLine
from imuscope.protocols.messages.decoder import MessageDecoder
from imuscope.protocols.messages.records import HEAD, LONGEST, PLAUSIBLE


class MessageLister:
    """Chunks in, lines out."""

    def __init__(self, *, direction: str = "to_host") -> None:
        self._decoder = MessageDecoder()
        self._held = b""

    def feed(self, data: bytes) -> None:
        """Append a chunk."""
        self._held += data

    def drain(self, *, stalled: bool = False) -> list[FrameLine]:
        """Lines of everything complete; see events.Decoder.drain."""
        lines: list[FrameLine] = []
        data, at = self._held, 0
        while len(data) - at >= HEAD.size:
            _, length = HEAD.unpack_from(data, at)
            whole = at + HEAD.size + length
            if length >= LONGEST or not PLAUSIBLE.match(data, at):
                match = PLAUSIBLE.search(data, at + 1)
                whole = match.start() if match is not None else len(data)
            if whole > len(data):
                break
            self._decoder.feed(data[at:whole], 0)
            lines += self._lines(whole - at, stalled=False)
            at = whole
        self._held = data[at:]
        if stalled:
            self._decoder.feed(self._held, 0)
            self._held = b""
            lines += self._lines(0, stalled=True)
        return lines

    def _lines(self, size: int, *, stalled: bool) -> list[FrameLine]:
        lines: list[FrameLine] = []
        for event in self._decoder.drain(stalled=stalled):
            if isinstance(event, RejectedFrame):
                lines.append({"offset": event.offset, "size": event.size, "reject": event.reason})
            elif isinstance(event, Batch):
                fields = {name: _plain(column[0].tolist()) for name, column in event.columns.items()}
                line: FrameLine = {"offset": int(event.offset[0]), "size": size, "protocol": "messages", "id": None}
                lines.append(line | {"message": event.message.name, "fields": fields})
        return lines


def _plain(value: Any) -> Any:
    return list(map(_plain, value)) if isinstance(value, tuple | list) else value
