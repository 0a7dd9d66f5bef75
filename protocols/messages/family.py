"""The stream of messages as a protocol, without a device of its own: nothing of it is configured, composed or
simulated, and it is never searched for in the bytes of a port.
"""

from typing import Any

import numpy as np

from imuscope.protocols.arrays import Bytes, Ints
from imuscope.protocols.clocks.dates import UNKNOWN
from imuscope.protocols.events import Batch, RejectedFrame
from imuscope.protocols.family.info import (
    Decoding,
    DeviceTraits,
    FrameFormat,
    PageWords,
    PositionFix,
    ProtocolInfo,
    StreamTraits,
)
from imuscope.protocols.framing.frame_lines import FrameLine
from imuscope.protocols.messages.decoder import STAMP, MessageDecoder
from imuscope.protocols.messages.records import HEAD, MAX_RECORD, PLAUSIBLE, MessageChannel, definition, message_record


class MessageLister:
    """Chunks in, lines out."""

    def __init__(self, *, direction: str = "to_host") -> None:
        self._decoder = MessageDecoder()
        self._held = b""

    def feed(self, data: bytes) -> None:
        self._held += data

    def drain(self, *, stalled: bool = False) -> list[FrameLine]:
        lines: list[FrameLine] = []
        data, at = self._held, 0
        while len(data) - at >= HEAD.size:
            _, length = HEAD.unpack_from(data, at)
            whole = at + HEAD.size + length
            if length >= MAX_RECORD or not PLAUSIBLE.match(data, at):
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


NAME = "messages"
OLDEST_S = 946_684_800  # 2000-01-01: earlier stamps are those of a clock that is not set


def _scan(data: Bytes, at: int, final: bool, table: Ints) -> tuple[int, int, int, int]:
    """No frames: a stream of messages is never mixed with that of a device."""
    return 0, len(data), 0, 0


def _position(batch: Batch) -> PositionFix | None:
    """The newest position of a message with latitude and longitude."""
    for field in batch.message.fields:
        names = [one.name for one in field.fields]
        if "latitude" in names and "longitude" in names and field.name in batch.columns:
            last = batch.columns[field.name][-1]
            height = float(last["altitude"]) if "altitude" in names else None
            return PositionFix(float(last["latitude"]), float(last["longitude"]), height)
    return None


def _utc(batch: Batch) -> Ints | None:
    """Stamps of messages are UTC already, unless they are those of another clock."""
    if STAMP.name not in batch.columns or STAMP not in batch.message.fields:
        return batch.time_ns
    stamps = batch.columns[STAMP.name]
    return np.where(stamps > OLDEST_S, np.round(stamps * 1e9), UNKNOWN).astype(np.int64)


MESSAGES = ProtocolInfo(
    NAME,
    "",
    frames=FrameFormat(
        likeness=lambda data: (0.0, ""),
        listing=MessageLister,
        sample=definition(MessageChannel(1, "/imu", "json")) + message_record(1, b'{"x": 1}'),
        scan=_scan,
    ),
    decoding=Decoding(
        decoder=MessageDecoder,
    ),
    stream=StreamTraits(
        datagrams=True,
        stamped=True,
        utc=_utc,
    ),
    device=DeviceTraits(
        position=_position,
    ),
    page=PageWords(
        short="Messages",
    ),
)
