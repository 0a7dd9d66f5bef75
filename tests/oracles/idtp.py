"""Slow and simple IDTP decoder, the reference for the fast one.

Pure Python, one candidate at a time, nothing imported from the project. Checksums bit by bit, HMAC from the standard
library's own function, types written here a second time, from the document.

    python -m tests.oracles.idtp

writes tests/golden/idtp/computed.json: a frame of every payload type in every mode, of each kind of type without a
description and of version 2.0, with simple ramps as readings, marked "computed".
"""

import hmac
import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

LITE, SAFETY, SECURE = 0, 1, 2
FAR_NUMBERS = 2**16
SUDDEN = 16

TYPES = {
    0x00: ["acc_x", "acc_y", "acc_z"],
    0x01: ["gyr_x", "gyr_y", "gyr_z"],
    0x02: ["mag_x", "mag_y", "mag_z"],
    0x03: ["acc_x", "acc_y", "acc_z", "gyr_x", "gyr_y", "gyr_z"],
    0x04: ["acc_x", "acc_y", "acc_z", "gyr_x", "gyr_y", "gyr_z", "mag_x", "mag_y", "mag_z"],
    0x05: ["acc_x", "acc_y", "acc_z", "gyr_x", "gyr_y", "gyr_z", "mag_x", "mag_y", "mag_z", "baro"],
    0x06: ["w", "x", "y", "z"],
}


def crc8(data: bytes) -> int:
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1) ^ 0x2F if crc & 0x80 else crc << 1
            crc &= 0xFF
    return crc ^ 0xFF


def crc32(data: bytes) -> int:
    polynomial = int(f"{0xF4ACFB13:032b}"[::-1], 2)
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ polynomial if crc & 1 else crc >> 1
    return crc ^ 0xFFFFFFFF


# -- frames ------------------------------------------------------------------------------------------------------------


@dataclass
class OracleIdtpFrame:
    offset: int
    size: int
    timestamp: int
    sequence: int
    device: int
    version: int
    mode: int
    kind: int
    payload: bytes


@dataclass
class IdtpScan:
    frames: list[OracleIdtpFrame] = field(default_factory=list)
    rejects: list[tuple[int, str]] = field(default_factory=list)
    rest: int = 0  # index from which bytes are undecided


def scan(
    data: bytes, *, final: bool, key: bytes | None = None, min_mode: int = LITE, unverified: bool = False
) -> IdtpScan:
    """Every whole frame and every failed candidate: after a failure go on 4 bytes later."""
    result = IdtpScan()
    at = 0
    while at < len(data):
        head = data[at : at + 4]
        if not b"IDTP".startswith(head) and not b"INDT".startswith(head):
            at += 1
            continue
        if len(head) < 4:
            if not final:
                break
            at += 1
            continue
        verdict = "successor" if head == b"INDT" else _candidate(data[at:], key, min_mode, unverified)
        if verdict == "incomplete" and not final:
            break
        if isinstance(verdict, OracleIdtpFrame):
            verdict.offset = at
            result.frames.append(verdict)
            at += verdict.size
        else:
            result.rejects.append((at, "truncated" if verdict == "incomplete" else verdict))
            at += 4
    result.rest = at
    return result


def _candidate(data: bytes, key: bytes | None, min_mode: int, unverified: bool) -> OracleIdtpFrame | str:
    if len(data) < 20:
        return "incomplete"
    timestamp, sequence, device, length, version, mode, kind, crc = struct.unpack("<IIHHBBBB", data[4:20])
    if crc8(data[:19]) != crc:
        return "bad_crc8"
    if version // 16 != 2:
        return "bad_version"
    if mode > 2:
        return "bad_mode"
    if mode < min_mode:
        return "below_min_mode"
    if length > 972:
        return "bad_size"
    trailer = {LITE: 0, SAFETY: 4, SECURE: 32}[mode]
    size = 20 + length + trailer
    if len(data) < size:
        return "incomplete"
    body, end = data[: size - trailer], data[size - trailer : size]
    if mode == SAFETY and struct.pack("<I", crc32(body)) != end:
        return "bad_crc32"
    if mode == SECURE and key is None and not unverified:
        return "no_key"
    if mode == SECURE and key is not None and hmac.digest(key, body, "sha256") != end:
        return "bad_hmac"
    return OracleIdtpFrame(0, size, timestamp, sequence, device, version, mode, kind, body[20:])


# -- sequences ---------------------------------------------------------------------------------------------------------


@dataclass
class Track:
    """The newest frame of one mode or a stronger one."""

    last: int
    candidate: int | None = None  # number of a dropped frame that the next may confirm
    before: int | None = None  # the last number before a jump that is not settled
    votes: int = 0  # frames accepted from it on
    run: list[int] = field(default_factory=list)  # numbers that contradict it, each continuing the one before

    def skipped(self, number: int) -> bool:
        """Whether the jump that is not settled skipped this number."""
        return self.before is not None and 0 < (number - self.before) % 2**32 < (self.last - self.before) % 2**32

    def contradicted(self, number: int) -> bool:
        """Whether this number, with those before it, outvotes the jump."""
        if not self.skipped(number):
            return False
        if not self.run or not 0 < (number - self.run[-1]) % 2**32 <= SUDDEN:
            self.run = []
        self.run.append(number)
        return len(self.run) > self.votes

    def take(self, number: int, *, back: bool, confirmed: bool) -> None:
        ahead = (number - self.last) % 2**32
        if back:
            self.before, self.votes, self.run = None, 0, []
        elif self.before is not None:
            self.votes += 1
            if self.votes == 8:
                self.before, self.votes = None, 0
        elif ahead > SUDDEN:
            self.before, self.votes, self.run = self.last, 1 + confirmed, []
        self.last, self.candidate = number, None


def judge(
    frames: list[OracleIdtpFrame], *, keyed: bool = False
) -> tuple[list[tuple[OracleIdtpFrame, int]], list[tuple[int, str]]]:
    """Frames that count, each with how many were lost before it (those counted falsely before taken off), and the
    others with the reason. Nothing is silent.
    """
    tracks: dict[tuple[int, int], Track] = {}
    good, bad = [], []
    for frame in frames:
        if frame.mode == SECURE and not keyed:
            good.append((frame, 0))
            continue
        number = frame.sequence
        own, weakest = tracks.get((frame.device, frame.mode)), tracks.get((frame.device, LITE))
        verdict = "new" if own is None else _by_own(own, number, frame.mode)
        older = weakest is not None and not _newer(number, weakest.last) and not weakest.skipped(number)
        if verdict == "new" and frame.mode and older:
            candidate = own.candidate if own else None
            confirmed = candidate is not None and 0 < (number - candidate) % 2**32 <= SUDDEN
            verdict = "overruled" if confirmed else "stale"
            if own is None:  # remembered, though nothing of this mode was accepted
                own = tracks[frame.device, frame.mode] = Track(-1)
            own.candidate = number
        if verdict in ("stale", "far_ahead"):
            bad.append((frame.offset, verdict))
            continue
        good.append((frame, _take(tracks, frame, verdict)))
    return good, bad


def _newer(number: int, last: int) -> bool:
    return last == -1 or 0 < (number - last) % 2**32 < 2**31


def _by_own(own: Track, number: int, mode: int) -> str:
    if own.last == -1:
        return "new"
    ahead = (number - own.last) % 2**32
    if mode == SECURE:
        return "new" if 0 < ahead < 2**31 else "stale"
    if 0 < ahead <= FAR_NUMBERS:
        return "new"
    if own.candidate is not None and 0 < (number - own.candidate) % 2**32 <= FAR_NUMBERS:
        return "confirmed"
    if own.contradicted(number):
        return "returned"
    if 0 < ahead < 2**31:
        own.candidate = number
        return "far_ahead"
    return "stale"


def _take(tracks: dict[tuple[int, int], Track], frame: OracleIdtpFrame, verdict: str) -> int:
    """Take over an accepted frame; returns the change of the number of lost ones."""
    number = frame.sequence
    weakest = tracks.get((frame.device, LITE))
    own = tracks.get((frame.device, frame.mode))
    ahead = (number - weakest.last) % 2**32 if weakest else 1
    lost = ahead - 1 if 0 < ahead < 2**31 or (ahead and verdict == "confirmed") else 0
    if verdict == "overruled":
        assert own is not None
        lost = (number - own.last) % 2**32 - 1 if own.last != -1 else 0
    for mode in range(frame.mode, -1, -1):
        track = tracks.get((frame.device, mode))
        if track is None or track.last == -1:
            tracks[frame.device, mode] = Track(number)
            continue
        back = verdict in ("returned", "overruled")
        accepted = 0
        if mode < frame.mode and verdict == "new" and not _newer(number, track.last):
            if not track.contradicted(number):
                continue
            back, accepted = True, len(track.run) - 1
        if mode == LITE and back and verdict != "overruled" and track.skipped(number) and track.before is not None:
            span = (track.last - track.before) % 2**32
            if span <= FAR_NUMBERS:
                lost = (number - track.before) % 2**32 - 1 - accepted - (span - track.votes)
        track.take(number, back=back, confirmed=verdict == "confirmed")
    return lost


# -- payloads ----------------------------------------------------------------------------------------------------------


def values(frame: OracleIdtpFrame) -> dict[str, float] | None:
    """Readings by the document's names; None if the payload has no definition or is too short."""
    names = TYPES.get(frame.kind) if frame.version % 16 else None
    if names is None or len(frame.payload) < 4 * len(names):
        return None
    return {name: struct.unpack_from("<f", frame.payload, 4 * i)[0] for i, name in enumerate(names)}


# -- computed vectors --------------------------------------------------------------------------------------------------

KEY = bytes(range(32))
OTHERS = (0x07, 0x7F, 0x80, 0xFF)  # reserved, and the vendor's own


def build(kind: int, payload: bytes, mode: int, sequence: int, version: int = 0x21) -> bytes:
    """One frame."""
    head = struct.pack("<4sIIHHBBB", b"IDTP", 1000 * sequence, sequence, 102, len(payload), version, mode, kind)
    frame = head + bytes([crc8(head)]) + payload
    trailer = struct.pack("<I", crc32(frame)) if mode == SAFETY else b""
    return frame + (hmac.digest(KEY, frame, "sha256") if mode == SECURE else trailer)


def computed() -> list[dict[str, Any]]:
    """All computed vectors."""
    rows = []
    for version in (0x21, 0x20):
        for mode in (LITE, SAFETY, SECURE):
            for kind in (*TYPES, *OTHERS):
                names = TYPES.get(kind, ["a", "b"])
                readings = [1.0, 0.0, 0.0, 0.0] if kind == 6 else [0.5 * (i + 1) * (-1) ** i for i in range(len(names))]
                payload = struct.pack(f"<{len(names)}f", *readings)
                frame = build(kind, payload, mode, len(rows) + 1, version)
                row = {"type": kind, "mode": mode, "version": version, "source": "computed", "frame_hex": frame.hex()}
                if kind in TYPES and version % 16:
                    row["values"] = dict(zip(names, readings, strict=True))
                rows.append(row)
    return rows


if __name__ == "__main__":
    target = Path(__file__).parents[1] / "golden" / "idtp" / "computed.json"
    target.write_text("[\n" + ",\n".join(json.dumps(row) for row in computed()) + "\n]\n")
