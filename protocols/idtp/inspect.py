"""Bytes of IDTP described: their score in the detection of a protocol, and their frames, line by line.

The score is the share of bytes in valid frames; a Secure frame counts by its header, which needs no key.

The list (protocols/framing/frame_lines.py) has every accepted frame, and every reject.

`verified` is false for a Secure frame that was accepted without a key. `notes` lists irregularities of a frame:

    undecodable_short   its payload is shorter than its type, and is given as `data`
    size_mismatch_long  it is longer; the rest is `trailing`
    version             a minor number other than 1
    not_finite          a value is not a number, or infinite
    not_unit            a quaternion that is not a rotation
"""

import math
from collections import Counter
from typing import Any

from imuscope.protocols.arrays import Ints
from imuscope.protocols.framing.frame_lines import FrameLine, frame_lines
from imuscope.protocols.framing.stream_buffer import BAD_VERSION, ID, REASONS, SIZE, SUCCESSOR
from imuscope.protocols.idtp.custom_payloads import Schema
from imuscope.protocols.idtp.frames import MAJOR, SECURE, VERSION, version_at
from imuscope.protocols.idtp.json_codec import frame_to_json
from imuscope.protocols.idtp.messages import BY_ID, MODE_NAMES, QUATERNION, WIRE
from imuscope.protocols.idtp.payloads import row_of
from imuscope.protocols.idtp.replay_guard import MODE
from imuscope.protocols.idtp.stream_parser import IdtpStream
from imuscope.protocols.rotations import UNIT_TOLERANCE


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


class IdtpFrameLister:
    """Chunks in, lines out.

    Args:
        key, min_mode, replay_check, show_unverified: see stream_parser.py.
        schema: rows of the vendor's own payload types, see custom_payloads.py.
        time_unit, rotation: options of the decoder; a listing shows the values on the wire.
    """

    def __init__(
        self,
        *,
        key: bytes | None = None,
        min_mode: int | None = None,
        replay_check: bool = True,
        show_unverified: bool = False,
        schema: Schema | None = None,
        time_unit: str = "us",
        rotation: str = "enu_from_body",
    ) -> None:
        self._stream = IdtpStream(
            key=key, min_mode=min_mode, replay_check=replay_check, show_unverified=show_unverified
        )
        self._keyed = key is not None
        self._schema: Schema = schema or {}

    def feed(self, data: bytes) -> None:
        """Append a chunk. Without arrival times, as in a capture, there is no silence."""
        self._stream.feed(data, 0)

    def feed_chunks(self, data: bytes, ends: Ints, arrival_ns: Ints) -> None:
        self._stream.feed_chunks(data, ends, arrival_ns)

    def drain(self, *, stalled: bool = False) -> list[FrameLine]:
        cuts = self._stream.drain(stalled=stalled)
        return [line for cut in cuts for line in frame_lines(cut, lambda _, frame: self._values(frame))]

    def _values(self, frame: bytes) -> FrameLine:
        line = {"protocol": "idtp", **frame_to_json(frame, self._schema)}
        if line["fields"]["mode"] == SECURE and not self._keyed:
            line["verified"] = False
        notes = self._notes(line)
        if notes:
            line["notes"] = notes
        return line

    def _notes(self, line: FrameLine) -> list[str]:
        fields = line["fields"]
        notes = []
        if "data" in fields and row_of(line["id"], fields["version"] & 0xF == 0, self._schema):
            notes.append("undecodable_short")
        if "wire" in line:
            notes.append("size_mismatch_long")
        if fields["version"] != VERSION:
            notes.append("version")
        if any(isinstance(value, dict) for value in _flat(fields.values())):
            notes.append("not_finite")
        if line["message"] == "ImuQuat" and "data" not in fields:
            parts = [fields[name] for name in WIRE[QUATERNION.name]]
            if any(isinstance(part, dict) for part in parts) or abs(math.hypot(*parts) - 1) > UNIT_TOLERANCE:
                notes.append("not_unit")
        return notes


def _flat(values: Any) -> list[Any]:
    return [one for value in values for one in (value if isinstance(value, list) else [value])]
