"""The protocols as a session needs them: the rows of protocols/registry.py, imported when first used.

Importing the registry compiles or loads machine code (protocols/jit.py), which takes from a tenth of a second to some
seconds the first time ever; the command line does that where it can say so, before it serves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from protocols.events import Decoder
from server.devices.decode_options import DecodeOptions
from server.devices.ingest import ProtocolTraits
from server.devices.protocol_detection import ProtocolGuess, ProtocolSet


def protocols() -> dict[str, str]:
    """Name → title of every protocol."""
    from protocols.registry import PROTOCOLS

    return {name: info.title for name, info in PROTOCOLS.items()}


def speech() -> ProtocolSet:
    """All protocols of the registry."""

    def decoder(name: str, reading: DecodeOptions, link_kind: str) -> Decoder:
        from protocols.registry import PROTOCOLS

        row = PROTOCOLS[name]
        datagrams = {"datagrams": True} if row.datagrams and link_kind == "udp" else {}
        return row.decoder(**reading.settings(row.settings), **datagrams)

    def guess(data: bytes) -> Sequence[ProtocolGuess]:
        from protocols.registry import detect

        return detect(data)

    def about(name: str) -> ProtocolTraits:
        from protocols.registry import PROTOCOLS

        row = PROTOCOLS[name]
        return ProtocolTraits(row.greeting, row.identity, row.protection, row.sender, row.utc, row.datagrams)

    def messages_in(data: bytes) -> Mapping[str, int]:
        from protocols.registry import count_messages

        return count_messages(data)

    def title(name: str) -> str:
        return protocols().get(name, name)

    return ProtocolSet(decoder=decoder, guess=guess, title=title, about=about, messages_in=messages_in)
