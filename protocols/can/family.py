"""CAN frames as a protocol: a stream that files have, and that is never searched for in the bytes of a port."""

from __future__ import annotations

from imuscope.protocols.can.decoder import COUNTER, CanDecoder, utc_of
from imuscope.protocols.can.definition import KINDS
from imuscope.protocols.can.lines import scan
from imuscope.protocols.can.listing import CanLister
from imuscope.protocols.family.info import (
    Decoding,
    DeviceTraits,
    FrameFormat,
    PageWords,
    ProtocolInfo,
    StreamTraits,
    position_of_columns,
)
from imuscope.protocols.schema.fields import Message

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
