"""Protocol detection. Chunks are stored until the protocol is known, so that no data is lost.

chunks ──> stored ──> 1 KiB, or after 0.4 s ──> guess ── sure enough ──> the protocol, and all stored chunks
             ^                                    │
             └── newest 16 KiB or so ── not sure: report the best guess; again with 2 KiB, 4, 8 or after 0.4 s
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol as Shape

from imuscope.protocols.events import Decoder
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.device.ingest import ProtocolTraits
from imuscope.server.links.base import Chunk

GUESS_BYTES = 1024
GUESS_S = 0.4  # time-out with fewer bytes
GUESS_SCORE = 0.5
SAMPLE_BYTES = 4 * 1024  # newest bytes that one guess uses
UNKNOWN_BYTES = 16 * 1024  # stored while the protocol is unknown
NEVER_NS = 1 << 60


class ProtocolGuess(Shape):
    """Result of `imuscope.protocols.registry.families.guess`, best first."""

    @property
    def protocol(self) -> str: ...
    @property
    def score(self) -> float: ...
    @property
    def reason(self) -> str: ...


@dataclass(frozen=True, slots=True)
class ProtocolSet:
    """The protocols available to a session: usually those of protocols/registry/families.py."""

    decoder: Callable[[str, DecodeOptions, str], Decoder]  # protocol, decode options of the source, kind of its link
    guess: Callable[[bytes], Sequence[ProtocolGuess]]
    title: Callable[[str], str]
    about: Callable[[str], ProtocolTraits] = lambda protocol: ProtocolTraits()
    count_messages: Callable[[bytes], Mapping[str, int]] = lambda data: {}


def unknown_hint(kind: str) -> str:
    """Hint for an unrecognised stream, by kind of link (wire.DeviceInfo.link)."""
    check = "Check the baud rate." if kind == "serial" else "Check that a supported device is at the other end."
    return f"{check} Give the protocol if you know it."


class ProtocolDetector:
    """Stores the bytes of one connection while the protocol is unknown, and detects it."""

    def __init__(self, guess: Callable[[bytes], Sequence[ProtocolGuess]]) -> None:
        self._guess = guess
        self._next = 0.0  # time of the next guess, whatever the number of bytes; unix s
        self._enough = GUESS_BYTES
        self._chunks: deque[Chunk] = deque()
        self.size = 0  # bytes kept

    def __bool__(self) -> bool:
        return bool(self._chunks)

    def add(self, chunk: Chunk) -> None:
        """Store a chunk, and drop the oldest beyond the limit."""
        self._chunks.append(chunk)
        self.size += len(chunk.data)
        while len(self._chunks) > 1 and self.size - len(self._chunks[0].data) >= UNKNOWN_BYTES:
            self.size -= len(self._chunks.popleft().data)

    def take(self) -> list[Chunk]:
        """Take the buffered chunks; the buffer is empty afterwards."""
        chunks, self._chunks, self.size = list(self._chunks), deque(), 0
        return chunks

    def is_due(self, now: float, *, final: bool = False) -> bool:
        """Whether there are enough bytes for a guess, or enough time has passed. `final`: no more will arrive."""
        self._next = self._next or now + GUESS_S
        return final or self.size >= self._enough or now >= self._next

    def detect(self, now: float) -> tuple[ProtocolGuess | None, str]:
        """The protocol and the reason; or None and the best guess ("" for none). A guess costs as much as decoding, so
        the next one is due at twice the number of bytes, later only after a time-out.
        """
        self._next = now + GUESS_S
        self._enough = 2 * self.size if 2 * self.size <= UNKNOWN_BYTES else NEVER_NS
        guesses = self._guess(b"".join(chunk.data for chunk in self._chunks)[-SAMPLE_BYTES:])
        if guesses and guesses[0].score >= GUESS_SCORE:
            return guesses[0], guesses[0].reason
        return None, guesses[0].reason if guesses and guesses[0].score > 0 else ""

    def words(self, source: str, why: str) -> str:
        """Status text while the protocol is unknown."""
        best = f"; best guess: {why}" if why else ""
        return f"{self.size} B from {source} do not match a known protocol{best}."
