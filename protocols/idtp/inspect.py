"""A capture, line by line (protocols/frame_lines.py): every accepted frame, and every reject.

`verified` is false for a Secure frame that was accepted without a key. `notes` lists irregularities of a frame:

    undecodable_short   its payload is shorter than its type, and is given as `data`
    size_mismatch_long  it is longer; the rest is `trailing`
    version             a minor number other than 1
    not_finite          a value is not a number, or infinite
    not_unit            a quaternion that is not a rotation
"""

from __future__ import annotations

import math
from typing import Any

from imuscope.protocols.frame_lines import FrameLine, frame_lines
from imuscope.protocols.framing import Ints
from imuscope.protocols.idtp.custom_payloads import Schema
from imuscope.protocols.idtp.frames import SECURE, VERSION
from imuscope.protocols.idtp.json_codec import frame_to_json
from imuscope.protocols.idtp.messages import QUATERNION, WIRE
from imuscope.protocols.idtp.payloads import UNIT_TOLERANCE, row_of
from imuscope.protocols.idtp.stream_parser import IdtpStream


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
        """Append many chunks; see events.Decoder."""
        self._stream.feed_chunks(data, ends, arrival_ns)

    def drain(self, *, stalled: bool = False) -> list[FrameLine]:
        """Lines of everything complete; see events.Decoder.drain."""
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
