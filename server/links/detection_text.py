"""Description of received bytes as one short line.

`imuscope.protocols.registry.families.detect` ranks every protocol by the frames it finds; the result is described here
as "812 B, 11 Xbus frames (MTData2)", "2 304 B, no frame in them" or "0 B".
"""

from dataclasses import dataclass

from imuscope.protocols.registry.families import detect
from imuscope.server.links.text import grouped

# A checksum matches by chance about once in 10^7 bytes of noise, so a third of the bytes in frames is certain. The
# limit is not higher because text (NMEA) counts half, and the first and last received frames may be incomplete.
MIN_FRAME_SHARE = 0.3
CERTAIN_FRAME_SHARE = 0.8  # listening longer would not improve the result


@dataclass(frozen=True, slots=True)
class DetectionResult:
    """Result of listening to a link for a while.

    Attributes:
        size: bytes.
        protocol: name of the most likely protocol in `imuscope.protocols.registry.families`, "" for none.
        score: its likelihood, 0..1.
        reason: its explanation: "11 Xbus frames (MTData2) in 798 of 812 B".
        note: text used instead if listening was not possible.
    """

    size: int = 0
    protocol: str = ""
    score: float = 0.0
    reason: str = ""
    note: str = ""

    @property
    def recognised(self) -> bool:
        return self.score >= MIN_FRAME_SHARE

    @property
    def certain(self) -> bool:
        return self.score >= CERTAIN_FRAME_SHARE

    @property
    def words(self) -> str:
        """One short line for display."""
        if self.note or self.size == 0:
            return self.note or "0 B"
        what = self.reason.partition(" in ")[0] if self.recognised else "no frame in them"
        return f"{grouped(self.size)} B, {what}"


def describe_bytes(data: bytes) -> DetectionResult:
    """Detect the protocol of `data`; never raises."""
    if not data:
        return DetectionResult()
    best = detect(data)[0]
    return DetectionResult(len(data), best.protocol, best.score, best.reason)
