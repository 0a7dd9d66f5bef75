"""Mutations of a stream: edits of a list of pieces, which are frames and the bytes between them.

Every edit draws from one `random.Random`, so a seed repeats it. Edits of bytes leave checksums wrong; a target's `mend`
makes them right again, for contents that are hostile rather than damaged.
"""

from collections.abc import Callable, Sequence
from random import Random
from typing import Protocol

from tests.fuzz import foreign

Pieces = list[bytes]


class Frames(Protocol):
    """Protocol details needed by edits."""

    words: Sequence[bytes]  # byte strings that mean something: preambles, special floats, lengths

    def mend(self, frame: bytes, random: Random, *, length: bool) -> bytes:
        """The frame with right checksums, and with `length` the right length too."""

    def lie(self, frame: bytes, random: Random) -> bytes:
        """The frame with another length in its header."""

    def make(self, random: Random) -> bytes:
        """A newly built frame with unusual contents."""

    def body(self, frame: bytes) -> tuple[int, int]:
        """Start and end of the payload of a frame."""


Edit = Callable[[Pieces, Frames, Random], None]
_MAX_PIECES = 60


def _pick(pieces: Pieces, random: Random) -> int:
    return random.randrange(len(pieces))


def turn_bits(pieces: Pieces, frames: Frames, random: Random) -> None:
    """A line with noise on it."""
    at = _pick(pieces, random)
    piece = bytearray(pieces[at])
    for _ in range(random.choice((1, 1, 2, 5))):
        if piece:
            piece[random.randrange(len(piece))] ^= 1 << random.randrange(8)
    pieces[at] = bytes(piece)


def put_word(pieces: Pieces, frames: Frames, random: Random) -> None:
    """A word that means something, over or between the bytes; mended or not."""
    at = _pick(pieces, random)
    piece = pieces[at]
    word = random.choice(frames.words)
    begin, end = frames.body(piece) if random.random() < 0.7 else (0, len(piece))
    spot = random.randint(begin, max(begin, end))
    skipped = len(word) if random.random() < 0.7 else 0
    piece = piece[:spot] + word + piece[spot + skipped :]
    pieces[at] = frames.mend(piece, random, length=True) if random.random() < 0.7 else piece


def spoil_payload(pieces: Pieces, frames: Frames, random: Random) -> None:
    """Random bytes in a payload under a right checksum."""
    at = _pick(pieces, random)
    piece = bytearray(pieces[at])
    begin, end = frames.body(pieces[at])
    for _ in range(random.choice((1, 2, 4, 12))):
        if end > begin:
            piece[random.randrange(begin, end)] = random.choice((0, 0xFF, 0x7F, 0x80, random.randrange(256)))
    pieces[at] = frames.mend(bytes(piece), random, length=False)


def spoil_header(pieces: Pieces, frames: Frames, random: Random) -> None:
    """Other numbers in a header, under a right checksum."""
    at = _pick(pieces, random)
    piece = bytearray(pieces[at])
    begin, _ = frames.body(pieces[at])
    if piece and begin:
        piece[random.randrange(min(begin, len(piece)))] = random.choice((0, 1, 4, 0x24, 0xFF, random.randrange(256)))
    pieces[at] = frames.mend(bytes(piece), random, length=random.random() < 0.5)


def resize_payload(pieces: Pieces, frames: Frames, random: Random) -> None:
    """A payload that is shorter or longer than its message, under right length and checksum."""
    at = _pick(pieces, random)
    piece = pieces[at]
    begin, end = frames.body(piece)
    spot = random.randint(begin, max(begin, end))
    change = random.choice((1, 1, 2, 3, 8, 40, 250))
    middle = b"" if random.random() < 0.5 else random.randbytes(change)
    rest = piece[spot + change :] if not middle else piece[spot:]
    pieces[at] = frames.mend(piece[:spot] + middle + rest, random, length=True)


def lie_about_length(pieces: Pieces, frames: Frames, random: Random) -> None:
    """A length that is not true; sometimes its checksum is."""
    at = _pick(pieces, random)
    piece = frames.lie(pieces[at], random)
    pieces[at] = frames.mend(piece, random, length=False) if random.random() < 0.3 else piece


def cut_short(pieces: Pieces, frames: Frames, random: Random) -> None:
    at = _pick(pieces, random)
    piece = pieces[at]
    spot = random.randint(0, len(piece))
    pieces[at] = piece[:spot] if random.random() < 0.7 else piece[spot:]


def double(pieces: Pieces, frames: Frames, random: Random) -> None:
    """The same again: a replay."""
    at = _pick(pieces, random)
    pieces[at:at] = [pieces[at]] * random.choice((1, 1, 2, 6))


def swap(pieces: Pieces, frames: Frames, random: Random) -> None:
    a, b = _pick(pieces, random), _pick(pieces, random)
    pieces[a], pieces[b] = pieces[b], pieces[a]


def remove(pieces: Pieces, frames: Frames, random: Random) -> None:
    if len(pieces) > 1:
        del pieces[_pick(pieces, random)]


def interleave(pieces: Pieces, frames: Frames, random: Random) -> None:
    """One piece in the middle of another, as where two writers share a port."""
    a, b = pieces[_pick(pieces, random)], _pick(pieces, random)
    spot = random.randint(0, len(pieces[b]))
    pieces[b] = pieces[b][:spot] + a + pieces[b][spot:]


def nest(pieces: Pieces, frames: Frames, random: Random) -> None:
    """One frame as the payload of another, both right."""
    a, b = pieces[_pick(pieces, random)], _pick(pieces, random)
    begin, end = frames.body(pieces[b])
    pieces[b] = frames.mend(pieces[b][:begin] + a + pieces[b][end:], random, length=True)


def splice(pieces: Pieces, frames: Frames, random: Random) -> None:
    """The head of one piece on the tail of another."""
    a, b = pieces[_pick(pieces, random)], _pick(pieces, random)
    piece = a[: random.randint(0, len(a))] + pieces[b][random.randint(0, len(pieces[b])) :]
    pieces[b] = frames.mend(piece, random, length=True) if random.random() < 0.4 else piece


def add_frame(pieces: Pieces, frames: Frames, random: Random) -> None:
    pieces.insert(random.randint(0, len(pieces)), frames.make(random))


def add_foreign(pieces: Pieces, frames: Frames, random: Random) -> None:
    """A message of another protocol, complete or not, between two pieces or within one."""
    one = foreign.make(random)
    if random.random() < 0.8:
        pieces.insert(random.randint(0, len(pieces)), one)
    else:
        at = _pick(pieces, random)
        spot = random.randint(0, len(pieces[at]))
        pieces[at] = pieces[at][:spot] + one + pieces[at][spot:]


def add_noise(pieces: Pieces, frames: Frames, random: Random) -> None:
    """Meaningless bytes, or excessive repetition."""
    kind = random.random()
    if kind < 0.4:
        noise = random.randbytes(random.choice((1, 3, 20, 200)))
    elif kind < 0.8:
        noise = b"".join(random.choice(frames.words) for _ in range(random.randint(1, 12)))
    else:
        noise = random.choice(frames.words) * random.choice((2, 40, 300))
    pieces.insert(random.randint(0, len(pieces)), noise)


EDITS: Sequence[Edit] = (
    *(turn_bits, put_word, put_word, spoil_payload, spoil_payload, spoil_header, resize_payload, lie_about_length),
    *(cut_short, double, swap, remove, interleave, nest, splice, add_frame, add_frame, add_foreign, add_noise),
)


def spoil(pieces: Pieces, frames: Frames, random: Random) -> None:
    """A few edits, in place."""
    for _ in range(random.choice((1, 1, 2, 3, 5, 9))):
        if not pieces:
            pieces.append(frames.make(random))
        random.choice(EDITS)(pieces, frames, random)
        if len(pieces) > _MAX_PIECES:
            start = random.randrange(len(pieces) - _MAX_PIECES)
            pieces[:] = pieces[start : start + _MAX_PIECES]
