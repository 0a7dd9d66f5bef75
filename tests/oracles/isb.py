"""Slow and simple ISB decoder, the reference for the fast one.

Pure Python, one byte at a time, nothing imported from the project. The structures come straight from the facts, not
from the project's table, so that a slip there does not repeat itself.

    python -m tests.oracles.isb FACTS.json

writes tests/golden/isb/formats.json, the fields of every structure as [name, code, count, offset], and computed.json: a
vector for every data set that the vendor's vectors do not meet, marked "computed", with simple ramps as values.
"""

from __future__ import annotations

import json
import struct
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.oracles.checksums import fletcher

GOLDEN = Path(__file__).parents[1] / "golden" / "isb"
CODES = {
    **{"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i", "u64": "Q", "i64": "q"},
    **{"f32": "f", "f64": "d", "char": "s"},
}

# -- packets -----------------------------------------------------------------------------------------------------------


@dataclass
class OracleIsbPacket:
    offset: int
    size: int
    kind: int
    did: int
    part: int | None  # the offset into the data set, None where the packet has none
    payload: bytes


@dataclass
class IsbScan:
    packets: list[OracleIsbPacket] = field(default_factory=list)
    rejects: list[tuple[int, str]] = field(default_factory=list)
    rest: int = 0  # index from which bytes are undecided


def scan(data: bytes, *, final: bool) -> IsbScan:
    """Every packet and every failed candidate, by the rule: after a failure go on one byte later."""
    result = IsbScan()
    at = 0
    while at < len(data):
        if data[at : at + 2] != b"\xef\x49" and data[at:] != b"\xef":
            at += 1
            continue
        verdict = _candidate(data[at:])
        if verdict == "incomplete" and not final:
            break
        if isinstance(verdict, OracleIsbPacket):
            verdict.offset = at
            result.packets.append(verdict)
            at += verdict.size
            continue
        if verdict != "incomplete" or data[at:] != b"\xef":
            result.rejects.append((at, "truncated" if verdict == "incomplete" else str(verdict)))
        at += 1
    result.rest = at
    return result


def _candidate(data: bytes) -> OracleIsbPacket | str:
    if len(data) < 3:
        return "incomplete"
    kind, with_offset = data[2] % 16, data[2] // 32 % 2 == 1
    if kind == 0 or kind > 8:
        return "bad_type"
    if len(data) < 6:
        return "incomplete"
    did, size = data[3], data[4] + 256 * data[5]
    if 6 + size + 2 > 2048:
        return "bad_size"
    if kind in (4, 5):
        carried = size - 2 if with_offset else size
        if carried < 0 or carried > 1024:
            return "bad_size"
        if with_offset and len(data) >= 8:
            reach = data[6] + 256 * data[7] + size
            if reach > 2048 and did not in (42, 43, 44):
                return "bad_size"
    if kind == 3 and size >= 4 and len(data) >= 10 and data[8] + 256 * data[9] > 1024:
        return "bad_size"
    if len(data) < 6 + size + 2:
        return "incomplete"
    if fletcher(data[: 6 + size]) != data[6 + size : 8 + size]:
        return "bad_checksum"
    body = data[6 : 6 + size]
    part = None
    if kind in (4, 5) and with_offset:
        part, body = body[0] + 256 * body[1], body[2:]
    return OracleIsbPacket(0, 6 + size + 2, kind, did, part, body)


def build(kind: int, did: int, body: bytes) -> bytes:
    """A packet around `body`, which starts with the offset if the flags say so."""
    packet = bytes([0xEF, 0x49, kind, did, len(body) % 256, len(body) // 256]) + body
    return packet + fletcher(packet)


# -- values ------------------------------------------------------------------------------------------------------------

Format = list[Any]  # [name, struct code, count, offset]


def values(fields: list[Format], payload: bytes) -> dict[str, list[Any]]:
    """Every leaf of a structure that is completely in the payload: numbers, or text without trailing zeros."""
    results: dict[str, list[Any]] = {}
    for name, code, count, offset in fields:
        size = struct.calcsize("<" + code)
        if offset + size * count > len(payload):
            continue
        raw = payload[offset : offset + size * count]
        if code == "s":
            results[name] = [raw.rstrip(b"\0").decode("latin-1")]
        else:
            results[name] = [struct.unpack("<" + code, raw[i : i + size])[0] for i in range(0, len(raw), size)]
    return results


def formats(facts: dict[str, Any]) -> dict[str, Any]:
    """The leaves of every structure, by data set."""
    out = {}
    for row in facts["dids"].values():
        leaves: list[Format] = []
        for one in row["fields"]:
            _leaves(one, one["name"], 0, leaves)
        out[str(row["id"])] = {"name": row["name"], "size": row["size_bytes"], "fields": leaves}
    return out


def _leaves(one: dict[str, Any], name: str, base: int, leaves: list[Format]) -> None:
    at = base + one["offset"]
    if "element_fields" in one:
        for k in range(one["count"]):
            for part in one["element_fields"]:
                _leaves(part, f"{name}[{k}].{part['name']}", at + k * one["element_size"], leaves)
    elif one["c_type"] == "union None":
        leaves.append([name + ".u32", "I", 1, at])
    elif one["c_type"] in CODES:
        leaves.append([name, CODES[one["c_type"]], one["count"], at])


def ramp(fields: list[Format], size: int) -> bytes:
    """A payload in which every field has a distinct value."""
    payload = bytearray(size)
    for index, (_, code, count, offset) in enumerate(fields):
        for k in range(count):
            value: Any = index % 100 + k
            if code in "fd":
                value = value / 4 + 1
            elif code == "s":
                value = bytes([97 + value % 26]) if k < count // 2 else b"\0"
            struct.pack_into("<" + code, payload, offset + k * struct.calcsize("<" + code), value)
    return bytes(payload)


def main() -> None:
    """Write the golden files from the facts."""
    facts = json.loads(Path(sys.argv[1]).read_text())
    rows = formats(facts)
    met = {vector["did"] for vector in json.loads((GOLDEN / "data.json").read_text())}
    computed = []
    for did, row in rows.items():
        if int(did) in met:
            continue
        size = row["size"] or 16
        payload = ramp(row["fields"], size) if row["fields"] else bytes(range(1, size + 1))
        packet = build(4, int(did), payload).hex()
        computed.append({"did": int(did), "did_name": row["name"], "source": "computed", "packet_hex": packet})
    for name, content in (("formats.json", rows), ("computed.json", computed)):
        lines = ",\n".join(
            f'"{key}": {json.dumps(row)}' if isinstance(content, dict) else json.dumps(row)
            for key, row in (content.items() if isinstance(content, dict) else enumerate(content))
        )
        (GOLDEN / name).write_text(f"{{\n{lines}\n}}\n" if isinstance(content, dict) else f"[\n{lines}\n]\n")


if __name__ == "__main__":
    main()
