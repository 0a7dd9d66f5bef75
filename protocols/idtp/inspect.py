"""A capture, line by line: every frame that counts and every reject, in the order of the stream, as plain values.

Each line has `offset` and `size`; then either `reject`, or `protocol`, `id`, `message`, `fields` and what json_codec.py
adds. `verified` is false for a Secure frame that was accepted without a key. `notes` says what is odd about a frame:

    undecodable_short   its payload is shorter than its type, and is given as `data`
    size_mismatch_long  it is longer; the rest is `trailing`
    version             a minor number other than 1
    not_finite          a value is not a number, or infinite
    not_unit            a quaternion that is no rotation
"""

from __future__ import annotations

import math
from typing import Any

from protocols.framing import OFFSET, SIZE
from protocols.idtp.custom_payloads import Schema
from protocols.idtp.frames import SECURE, VERSION
from protocols.idtp.json_codec import frame_to_json
from protocols.idtp.messages import QUATERNION, WIRE
from protocols.idtp.payloads import UNIT_TOLERANCE, row_of
from protocols.idtp.stream_parser import IdtpStream

IdtpFrameLine = dict[str, Any]


class IdtpFrameLister:
    """Chunks in, lines out.

    Args:
        key, min_mode, replay_check, show_unverified: see stream_parser.py. A file has no arrival times, so that nothing
        in it
            is ever silent.
        schema: rows of the vendor's own payload types, see custom_payloads.py.
        time_unit, rotation: of what is decoded; a listing shows what is on the wire.
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
        """Append a chunk."""
        self._stream.feed(data, 0)

    def drain(self, *, stalled: bool = False) -> list[IdtpFrameLine]:
        """Lines of everything complete; see events.Decoder.drain."""
        lines: list[IdtpFrameLine] = []
        for cut in self._stream.drain(stalled=stalled):
            for offset, size in zip(cut.table[OFFSET].tolist(), cut.table[SIZE].tolist(), strict=True):
                lines.append(self._line(cut.start + offset, cut.data[offset : offset + size]))
            lines += [{"offset": one.offset, "size": one.size, "reject": one.reason} for one in cut.rejects]
        return sorted(lines, key=lambda line: int(line["offset"]))

    def _line(self, offset: int, frame: bytes) -> IdtpFrameLine:
        line: IdtpFrameLine = {
            "offset": offset,
            "size": len(frame),
            "protocol": "idtp",
            **frame_to_json(frame, self._schema),
        }
        if line["fields"]["mode"] == SECURE and not self._keyed:
            line["verified"] = False
        notes = self._notes(line)
        if notes:
            line["notes"] = notes
        return line

    def _notes(self, line: IdtpFrameLine) -> list[str]:
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
