"""Which protocol does a device speak? Kept until known: every chunk, so that nothing is lost by guessing.

chunks ──> kept ──> 1 KiB, or 0.4 s gone by ──> guess ── sure enough ──> the protocol, and all that was kept
             ^                                    │
             └── at most 16 KiB, newest ── not sure: what it looks like, in words
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol as Shape

from protocols.events import Decoder
from server.links.base import Chunk
from server.live.intake import About
from server.live.reading import Reading

GUESS_BYTES = 1024
GUESS_S = 0.4  # with fewer bytes than that, after so long
GUESS_SCORE = 0.5
UNKNOWN_BYTES = 16 * 1024  # kept while the protocol is unknown


class Guess(Shape):
    """What `protocols.registry.guess` gives, best first."""

    @property
    def protocol(self) -> str: ...
    @property
    def score(self) -> float: ...
    @property
    def why(self) -> str: ...


@dataclass(frozen=True, slots=True)
class Speech:
    """The protocols a session can speak: usually those of protocols/registry.py."""

    decoder: Callable[[str, Reading, str], Decoder]  # protocol, what was said about the source, kind of its link
    guess: Callable[[bytes], Sequence[Guess]]
    title: Callable[[str], str]
    about: Callable[[str], About] = lambda protocol: About()
    messages_in: Callable[[bytes], Mapping[str, int]] = lambda data: {}


class Unknown:
    """The bytes of one connection while nobody knows what they mean."""

    def __init__(self, guess: Callable[[bytes], Sequence[Guess]]) -> None:
        self._guess = guess
        self._since = 0.0  # when they were first looked at, unix s
        self.chunks: list[Chunk] = []

    @property
    def size(self) -> int:
        """Bytes kept."""
        return sum(len(chunk.data) for chunk in self.chunks)

    def is_due(self, now: float, *, final: bool = False) -> bool:
        """Is there enough to guess from, or has it been long enough? `final`: no more will come."""
        self._since = self._since or now
        return final or self.size >= GUESS_BYTES or now - self._since >= GUESS_S

    def look(self) -> tuple[Guess | None, str]:
        """The protocol and why; or None and what they look like at best ("" for nothing): then only the newest stay."""
        guesses = self._guess(b"".join(chunk.data for chunk in self.chunks))
        if guesses and guesses[0].score >= GUESS_SCORE:
            return guesses[0], guesses[0].why
        size = self.size
        while size > UNKNOWN_BYTES:
            size -= len(self.chunks.pop(0).data)
        return None, guesses[0].why if guesses and guesses[0].score > 0 else ""
