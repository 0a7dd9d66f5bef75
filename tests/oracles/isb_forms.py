"""Vectors of ISB forms beyond the data sets in their present structure, derived from the facts alone.

    python -m tests.oracles.isb_forms FACTS.json VERSIONS.json

writes tests/golden/isb/forms.json, all of it marked "computed", with simple ramps as values:

    packet     a packet of each type
    raw        raw GNSS data of each kind: what the bytes after its head are follows `dataType`
    velocity   a receiver's velocity in each frame: its status says which
    firmware   each structure that older (or the next) firmware has of a set, and which fields of the present one are
               in it at the same place: those of a shorter one that it holds wholly, without what was added or moved
               since
"""

from __future__ import annotations

import json
import struct
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.oracles.isb import GOLDEN, Format, _leaves, build, formats, ramp, values

NEXT = "origin_develop"
TYPES = ("ACK", "NACK", "GET_DATA", "DATA", "SET_DATA", "STOP_BROADCASTS_ALL_PORTS", "STOP_DID_BROADCAST")
LISTED = 12  # names of a change that the facts list at most
DEVICE_INFOS, FIRMWARE_AT = ("1", "93", "120"), 12
RAW_SETS, RAW_HEAD, OBSERVATIONS = ("60", "69", "70"), 4, 3
KINDS = {1: "obsd_t", 2: "eph_t", 3: "geph_t", 4: "sbsmsg_t", 5: "sta_t", 6: "ion_model_utc_alm_t"}


def _packets() -> Iterator[dict[str, Any]]:
    bodies = {1: bytes(9), 2: bytes(9), 3: struct.pack("<HHHH", 4, 0, 0, 1), 4: bytes(80), 5: bytes(4)}
    for kind, name in enumerate((*TYPES, "STOP_BROADCASTS_CURRENT_PORT"), 1):
        did = 4 if kind in (4, 7) else 12 if kind == 5 else 0
        yield {
            "form": "packet",
            "type": name,
            "kind": kind,
            "did": did,
            "packet": build(kind, did, bodies.get(kind, b"")),
        }


def _raw(facts: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for did in RAW_SETS:
        for kind, name in KINDS.items():
            row = facts["substructs"][name]
            leaves: list[Format] = []
            for one in row["fields"]:
                _leaves(one, one["name"], 0, leaves)
            count = OBSERVATIONS if kind == 1 else 1
            payload = bytes([1, kind, count if kind == 1 else 0, 0]) + ramp(leaves, row["size"]) * count
            message = values(leaves, payload[RAW_HEAD:])
            yield {
                **{"form": "raw", "did": int(did), "kind": kind, "struct": name, "count": count, "values": message},
                "packet": build(4, int(did), payload),
            }


def _velocities(rows: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for did in ("30", "31"):
        for status, frame in ((0, "ECEF"), (0x8000, "NED")):
            payload = bytearray(ramp(rows[did]["fields"], rows[did]["size"]))
            (at,) = (offset for name, _, _, offset in rows[did]["fields"] if name == "status")
            struct.pack_into("<I", payload, at, status)
            yield {"form": "velocity", "did": int(did), "frame": frame, "packet": build(4, int(did), bytes(payload))}


def _lost(
    changes: list[dict[str, Any]], versions: list[str], version: str, present: str, order: list[str]
) -> tuple[set[str], bool]:
    """Fields of the present structure, given in `order`, that `version` has not, or elsewhere; and whether it is quite
    another set. The facts stop after 12 names: then all fields from the first of them on are taken as lost.
    """
    lost: set[str] = set()
    other = False
    here, now = versions.index(version), versions.index(present)
    renamed: dict[str, str] = {}  # by what is later than the change looked at: name then → name now
    for change in sorted(changes, key=lambda one: versions.index(one["at"]), reverse=True):
        at = versions.index(change["at"])
        if not (here < at <= now or now < at <= here):
            continue
        other = other or ("name" in change and None in change.get("size", ()))
        if change.get("kind") == "layout":
            names = [*change["moved"], *change["added" if at <= now else "removed"]]
            results = {renamed.get(name, name) for name in names}
            if any(len(change[kind]) >= LISTED for kind in ("removed", "added", "moved")):
                first = min(order.index(name) for name in results if name in order)
                results |= set(order[first:])
            lost |= results
        elif change.get("kind") == "rename only":
            renamed |= {old: renamed.get(new, new) for old, new in zip(change["removed"], change["added"], strict=True)}
    return lost, other


def _firmware(rows: dict[str, Any], facts: dict[str, Any]) -> Iterator[dict[str, Any]]:
    versions = facts["versions"]
    present = versions[-2]
    changes = {str(one["did"]): one["changes"] for one in facts["changes"]}
    for did, by_version in facts["sizes"].items():
        row = rows.get(did)
        visited: set[tuple[int, frozenset[str]]] = set()
        for version in reversed(versions):
            size = by_version.get(version, {}).get("size")
            if row is None or size is None or not row["fields"]:
                continue
            order = list(dict.fromkeys(one[0].partition("[")[0] for one in row["fields"]))
            lost, other = _lost(changes.get(did, []), versions, version, present, order)
            if version == present or (size == row["size"] and not lost) or (size, frozenset(lost)) in visited:
                continue
            visited.add((size, frozenset(lost)))
            payload = (ramp(row["fields"], row["size"]) + bytes(size))[:size]
            if did in DEVICE_INFOS:
                numbers = bytes(int(word) for word in version.split("."))
                payload = payload[:FIRMWARE_AT] + numbers + payload[FIRMWARE_AT + len(numbers) :]
            entries = [] if other else [one for one in row["fields"] if not _is_lost(one[0], lost)]
            yield {
                **{
                    "form": "firmware",
                    "did": int(did),
                    "version": "next" if version == NEXT else version,
                    "size": size,
                },
                **{"values": values(entries, payload), "packet": build(4, int(did), payload)},
            }


def _is_lost(name: str, lost: set[str]) -> bool:
    return any(name == one or name.startswith((one + ".", one + "[")) for one in lost)


def main() -> None:
    """Write the golden file from the facts."""
    facts, versions = (json.loads(Path(name).read_text()) for name in sys.argv[1:3])
    rows = formats(facts)
    results = [*_packets(), *_raw(facts), *_velocities(rows), *_firmware(rows, versions)]
    lines = [
        json.dumps(
            {**{k: v for k, v in one.items() if k != "packet"}, "source": "computed", "packet_hex": one["packet"].hex()}
        )
        for one in results
    ]
    (GOLDEN / "forms.json").write_text("[\n" + ",\n".join(lines) + "\n]\n")


if __name__ == "__main__":
    main()
