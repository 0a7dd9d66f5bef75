"""Which protocol does a device speak? Kept until known: every chunk, so that nothing is lost by guessing.

chunks ──> kept ──> 1 KiB, or 0.4 s gone by ──> guess ── sure enough ──> the protocol, and all that was kept
             ^                                    │
             └── about 16 KiB, newest ── not sure: what it looks like, in words; again with 2 KiB, 4, 8 or after 0.4 s
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol as Shape

from protocols.events import Decoder
from server.devices.decode_options import DecodeOptions
from server.devices.ingest import ProtocolTraits
from server.links.base import Chunk

GUESS_BYTES = 1024
GUESS_S = 0.4  # with fewer bytes than that, after so long
GUESS_SCORE = 0.5
LOOK_BYTES = 4 * 1024  # the newest, at one look
UNKNOWN_BYTES = 16 * 1024  # kept while the protocol is unknown
NEVER = 1 << 60


class ProtocolGuess(Shape):
    """What `protocols.registry.guess` gives, best first."""

    @property
    def protocol(self) -> str: ...
    @property
    def score(self) -> float: ...
    @property
    def why(self) -> str: ...


@dataclass(frozen=True, slots=True)
class ProtocolSet:
    """The protocols a session can speak: usually those of protocols/registry.py."""

    decoder: Callable[[str, DecodeOptions, str], Decoder]  # protocol, what was said about the source, kind of its link
    guess: Callable[[bytes], Sequence[ProtocolGuess]]
    title: Callable[[str], str]
    about: Callable[[str], ProtocolTraits] = lambda protocol: ProtocolTraits()
    messages_in: Callable[[bytes], Mapping[str, int]] = lambda data: {}


def unknown_hint(kind: str) -> str:
    """What may be wrong where nothing is recognised, by the kind of link (wire.DeviceInfo.link)."""
    serial = "Is the baud rate right?" if kind == "serial" else "Is a device at the other end that is read here?"
    return f"{serial} Give the protocol if you know it."


class ProtocolDetector:
    """The bytes of one connection while nobody knows what they mean."""

    def __init__(self, guess: Callable[[bytes], Sequence[ProtocolGuess]]) -> None:
        self._guess = guess
        self._next = 0.0  # when they are looked at, however many they are; unix s
        self._enough = GUESS_BYTES
        self._chunks: deque[Chunk] = deque()
        self.size = 0  # bytes kept

    def __bool__(self) -> bool:
        return bool(self._chunks)

    def add(self, chunk: Chunk) -> None:
        """Keep it, and the newest of the others."""
        self._chunks.append(chunk)
        self.size += len(chunk.data)
        while len(self._chunks) > 1 and self.size - len(self._chunks[0].data) >= UNKNOWN_BYTES:
            self.size -= len(self._chunks.popleft().data)

    def taken(self) -> list[Chunk]:
        """What was kept, which is not kept any more."""
        chunks, self._chunks, self.size = list(self._chunks), deque(), 0
        return chunks

    def is_due(self, now: float, *, final: bool = False) -> bool:
        """Is there enough to guess from, or has it been long enough? `final`: no more will come."""
        self._next = self._next or now + GUESS_S
        return final or self.size >= self._enough or now >= self._next

    def look(self, now: float) -> tuple[ProtocolGuess | None, str]:
        """The protocol and why; or None and what they look like at best ("" for nothing). A look costs as much as
        decoding does, so the next is due when there is twice as much, and then not before a while."""
        self._next = now + GUESS_S
        self._enough = 2 * self.size if 2 * self.size <= UNKNOWN_BYTES else NEVER
        guesses = self._guess(b"".join(chunk.data for chunk in self._chunks)[-LOOK_BYTES:])
        if guesses and guesses[0].score >= GUESS_SCORE:
            return guesses[0], guesses[0].why
        return None, guesses[0].why if guesses and guesses[0].score > 0 else ""

    def words(self, source: str, why: str) -> str:
        """What a person is told while nothing is known."""
        best = f", at best: {why}" if why else ""
        return f"{self.size} B from {source} look like no known protocol{best}."
