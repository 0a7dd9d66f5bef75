"""Detection of IDTP.

The score is the share of bytes in valid frames; a Secure frame counts by its header, which needs no key.
"""

from __future__ import annotations

from collections import Counter

from imuscope.protocols.framing import BAD_VERSION, ID, REASONS, SIZE, SUCCESSOR
from imuscope.protocols.idtp.frames import MAJOR, version_at
from imuscope.protocols.idtp.messages import BY_ID, MODE_NAMES
from imuscope.protocols.idtp.replay_guard import MODE
from imuscope.protocols.idtp.stream_parser import IdtpStream


def detection_score(data: bytes) -> tuple[float, str]:
    """(score 0..1, words)."""
    if not data:
        return 0.0, "no bytes"
    stream = IdtpStream(replay_check=False, show_unverified=True)
    stream.feed(data, 0)
    framed = successors = waiting = 0
    versions: Counter[str] = Counter()
    kinds: Counter[int] = Counter()
    modes: Counter[int] = Counter()
    for stalled in (False, True):
        for cut in stream.drain(stalled=stalled):
            framed += int(cut.table[SIZE].sum())
            kinds.update(cut.table[ID].tolist())
            modes.update(cut.verdict.rows[MODE].tolist())
            successors += sum(reject.reason == REASONS[SUCCESSOR] for reject in cut.rejects)
            versions.update(version_at(data, one.offset) for one in cut.rejects if one.reason == REASONS[BAD_VERSION])
        waiting = waiting or stream.buffered
    if framed:
        # an incomplete frame at the end of the data counts neither for nor against
        score = min(1.0, framed / max(len(data) - waiting, framed))
        names = ", ".join(BY_ID[kind].name if kind in BY_ID else f"0x{kind:02X}" for kind, _ in kinds.most_common(3))
        how = " and ".join(MODE_NAMES[mode] for mode, _ in modes.most_common())
        count = sum(kinds.values())
        return score, f"{count} IDTP frame{'s' * (count > 1)} ({names}; {how}) in {framed} of {len(data)} B"
    if successors > 1:
        return 0.1, f"{successors} × INDT, the preamble of IDTP's successor, which is not supported"
    if versions.total() > 1:
        version, count = versions.most_common(1)[0]
        return 0.1, f"{count} frames of IDTP {version}; this program supports IDTP {MAJOR}"
    return 0.0, "no frame in them"
