"""What do these bytes look like? The words in which a listened-to port is described.

The judgement is `protocols.registry.guess`, which ranks every protocol by the frames it finds; here it becomes one
short line: "812 B, 11 Xbus frames (MTData2)", "2 304 B, no frame in them", "0 B".
"""

from __future__ import annotations

from dataclasses import dataclass

from server.links.text import grouped

# Frames check out by chance about once in 10^7 bytes of noise, so a third of the bytes in frames is beyond doubt; it is
# not more because text (NMEA) counts half, and the first and the last frame of what was heard are cut.
RECOGNISED = 0.3
CERTAIN = 0.8  # from which on listening longer would add nothing


@dataclass(frozen=True, slots=True)
class DetectionResult:
    """What was heard on a link for a while.

    Attributes:
        size: bytes.
        protocol: name of the likeliest protocol in `protocols.registry`, "" for none.
        score: its likeness, 0..1.
        why: its own words: "11 Xbus frames (MTData2) in 798 of 812 B".
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
        if self.note or self.size == 0:
            return self.note or "0 B"
        what = self.why.partition(" in ")[0] if self.recognised else "no frame in them"
        return f"{grouped(self.size)} B, {what}"


def describe_bytes(data: bytes) -> DetectionResult:
    """Judge `data`; never raises."""
    if not data:
        return DetectionResult()
    from protocols.registry import detect  # when first used: it compiles the decoders, or loads them

    best = detect(data)[0]
    return DetectionResult(len(data), best.protocol, best.score, best.why)
