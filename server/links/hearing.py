"""What do these bytes look like? The words in which a listened-to port is described.

The judgement is `protocols.registry.guess`, which ranks every protocol by the frames it finds; here it becomes one
short line: "812 B, Xbus, 11 frames", "2 304 B, no frame in them", "0 B".
"""

from __future__ import annotations

from dataclasses import dataclass

RECOGNISED = 0.5  # likeness from which on a protocol is believed: most of the bytes lie in frames that check out
CERTAIN = 0.8  # from which on listening longer would add nothing


@dataclass(frozen=True, slots=True)
class Heard:
    """What was heard on a link for a while.

    Attributes:
        size: bytes.
        protocol: name of the likeliest protocol in `protocols.registry`, "" for none.
        score: its likeness, 0..1.
        why: its own words: "11 frames".
        note: said instead of all that when listening was not possible.
    """

    size: int = 0
    protocol: str = ""
    score: float = 0.0
    why: str = ""
    note: str = ""

    @property
    def recognised(self) -> bool:
        return self.score >= RECOGNISED

    @property
    def certain(self) -> bool:
        return self.score >= CERTAIN

    @property
    def words(self) -> str:
        """One short line for a person."""
        if self.note:
            return self.note
        if self.size == 0:
            return "0 B"
        size = f"{self.size:,} B".replace(",", " ")
        if not self.recognised:
            return f"{size}, no frame in them"
        from protocols import registry

        return ", ".join(part for part in (size, registry.PROTOCOLS[self.protocol].title, self.why) if part)


def hear(data: bytes) -> Heard:
    """Judge `data`; never raises."""
    if not data:
        return Heard()
    from protocols import registry

    guesses = registry.guess(data)
    if not guesses:
        return Heard(len(data))
    best = guesses[0]
    return Heard(len(data), best.protocol, best.score, best.why)
