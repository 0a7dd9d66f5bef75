"""The protocols as a session needs them: the rows of protocols/registry.py, imported when first used.

Importing the registry compiles or loads machine code (protocols/jit.py), which takes from a tenth of a second to some
seconds the first time ever; the command line does that where it can say so, before it serves.
"""

from __future__ import annotations

from collections.abc import Sequence

from protocols.events import Decoder
from server.session import Guess, Speech


def protocols() -> dict[str, str]:
    """Name → title of every protocol."""
    from protocols.registry import PROTOCOLS

    return {name: info.title for name, info in PROTOCOLS.items()}


def speech() -> Speech:
    """All protocols of the registry."""

    def decoder(name: str) -> Decoder:
        from protocols.registry import PROTOCOLS

        return PROTOCOLS[name].decoder()

    def guess(data: bytes) -> Sequence[Guess]:
        from protocols.registry import guess

        return guess(data)

    return Speech(decoder=decoder, guess=guess, title=lambda name: protocols().get(name, name))
