"""A case: bytes, cut positions and decoder settings; and the file format of findings.

# isb: a part of a list alone was read as whole            what it showed, in a sentence
# broke: chunks · seed 7 · case 1204
# cuts: 17 408
# settings: {"min_mode": 1}
ef49040450 …                                               the bytes, hex, 60 a line
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

FINDINGS = Path(__file__).parent / "findings"
_WIDTH = 60


@dataclass(frozen=True)
class Case:
    """One input.

    Args:
        cuts: positions at which the data are cut.
        settings: what decoder and listing are told, by keyword.
    """

    data: bytes
    cuts: tuple[int, ...] = ()
    settings: dict[str, Any] = field(default_factory=dict)

    def chunks(self) -> list[bytes]:
        """The data, cut."""
        edges = [0, *sorted(at for at in self.cuts if 0 < at < len(self.data)), len(self.data)]
        return [self.data[a:b] for a, b in pairwise(edges)]


class BrokenError(AssertionError):
    """Violation of an invariant; `kind` names it, the text gives the details."""

    def __init__(self, kind: str, words: str) -> None:
        super().__init__(f"{kind}: {words}")
        self.kind = kind


def write(protocol: str, case: Case, showed: str, about: str, name: str) -> Path:
    """Keep a finding."""
    hexes = case.data.hex()
    lines = [
        f"# {protocol}: {showed}",
        f"# broke: {about}",
        f"# cuts: {' '.join(map(str, case.cuts))}",
        f"# settings: {json.dumps({k: v.hex() if isinstance(v, bytes) else v for k, v in case.settings.items()})}",
        *(hexes[at : at + 2 * _WIDTH] for at in range(0, len(hexes), 2 * _WIDTH)),
    ]
    path = FINDINGS / protocol / f"{name}.hex"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    return path


def write_json(target: str, name: str, showed: str, content: dict[str, Any]) -> Path:
    """Keep a finding that is no stream of bytes."""
    path = FINDINGS / target / f"{name}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"showed": showed, **content}, indent=1) + "\n")
    return path


def read(path: Path) -> Case:
    """A finding again."""
    message: dict[str, str] = {}
    hexes = ""
    for line in path.read_text().splitlines():
        if line.startswith("# "):
            key, _, value = line[2:].partition(":")
            message[key] = value.strip()
        else:
            hexes += line
    settings = json.loads(message.get("settings") or "{}")
    if "key" in settings:
        settings["key"] = bytes.fromhex(settings["key"])
    return Case(bytes.fromhex(hexes), tuple(int(word) for word in message.get("cuts", "").split()), settings)


def findings(protocol: str) -> Iterator[Path]:
    """The files of all findings of a protocol."""
    yield from sorted((FINDINGS / protocol).glob("*.hex"))


def where(error: BaseException) -> str:
    """The innermost frame in the project's code."""
    trace, place = error.__traceback__, ""
    while trace is not None:
        code = trace.tb_frame.f_code
        if "site-packages" not in code.co_filename and "/lib/python" not in code.co_filename:
            place = f"{Path(code.co_filename).name}:{trace.tb_lineno}"
        trace = trace.tb_next
    return place
