"""Everything that decides what a decoded recording holds: the sources that the decoding process imports.

A cache of decoded columns is good as long as none of them changed. They are found by following imports, wherever in a
file these stand, from the process that decodes; simulators, which decode nothing, are left out, whoever imports them.
Tables of the protocols that are no code (`.txt`, `.json`) count as well.
"""

from __future__ import annotations

import functools
import hashlib
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
HOUSES = ("protocols", "recordings", "server")
BEGIN = "server.library.decode_worker"
DATA = (".txt", ".json")
_IMPORT = re.compile(r"^[ \t]*(?:from ([\w.]+) import (\([^)]*\)|[^\n]+)|import ([\w., ]+))", re.MULTILINE)


@functools.cache
def decoding_mark() -> str:
    """Names the state of all these sources."""
    digest = hashlib.sha256()
    data = (path for path in (ROOT / "protocols").rglob("*") if path.suffix in DATA)
    for path in (*decoding_sources(), *sorted(data)):
        digest.update(str(path.relative_to(ROOT)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def decoding_sources() -> list[Path]:
    """The files, in order."""
    found: dict[str, Path] = {}
    waiting = [BEGIN]
    while waiting:
        module = waiting.pop()
        path = _path(module)
        if path is None or module in found or is_simulator(module):
            continue
        found[module] = path
        waiting += [".".join(module.split(".")[:n]) for n in range(1, module.count(".") + 1)]
        waiting += _imported(path)
    return sorted(found.values())


def is_simulator(module: str) -> bool:
    """True for a part of a simulated device, and for the module that makes these."""
    house, *inside = module.split(".")
    return module == "server.links.simulated_device" or (house == "protocols" and "simulator" in inside)


def _path(module: str) -> Path | None:
    if module.partition(".")[0] not in HOUSES:
        return None
    place = ROOT.joinpath(*module.split("."))
    return next((path for path in (place.with_suffix(".py"), place / "__init__.py") if path.is_file()), None)


def _imported(path: Path) -> Iterator[str]:
    """Names of modules that a file imports, and of what it imports from them, which may be modules. All imports here
    are absolute; parsing the files would take a second of the start."""
    for base, names, modules in _IMPORT.findall(path.read_text(encoding="utf-8")):
        yield from re.findall(r"[\w.]+", modules)
        if base:
            yield base
            yield from (f"{base}.{name}" for name in re.findall(r"\w+", names))
