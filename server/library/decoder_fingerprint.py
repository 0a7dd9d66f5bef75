"""Inputs that determine the content of a decoded recording: the source files that the decoding process imports.

Cached columns are valid as long as none of them changed. They are found by following all imports from the decoding
process; simulators are excluded, because they do not decode. Data tables of the protocols (`.txt`, `.json`) are
included.
"""

import functools
import hashlib
import importlib.util
import re
from collections.abc import Iterator
from pathlib import Path

from imuscope.protocols.family.plugins import plugins_of, plugins_of_others, protocol_plugins

PACKAGE = Path(__file__).absolute().parents[2]
COMPUTED_SIGNALS = "imuscope.computed_signals"  # see computed_signals.py, which is too large to import here
BEGIN = "imuscope.server.library.decode_worker"
READERS = "imuscope.recordings.readers.formats"  # found by their folder
OTHER_READERS = "imuscope.readers"
DATA = (".txt", ".json")
_IMPORT = re.compile(r"^[ \t]*(?:from ([\w.]+) import (\([^)]*\)|[^\n]+)|import ([\w., ]+))", re.MULTILINE)


@functools.cache
def decoding_mark() -> str:
    """Hash of the state of all these sources."""
    digest = hashlib.sha256()
    data = (path for path in (PACKAGE / "protocols").rglob("*") if path.suffix in DATA)
    for path in (*decoding_sources(), *sorted(data)):
        digest.update(str(path.relative_to(PACKAGE)).encode())
        digest.update(path.read_bytes())
    for path in _sources_of_others():
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _sources_of_others() -> Iterator[Path]:
    """Files of packages with further protocol families or readers."""
    for plugin in (*protocol_plugins(), *plugins_of_others(OTHER_READERS)):
        if not plugin.package:
            continue
        try:
            spec = importlib.util.find_spec(plugin.module.partition(".")[0])
        except (ImportError, ValueError):
            continue
        for folder in (spec.submodule_search_locations or ()) if spec is not None else ():
            yield from sorted(path for path in Path(folder).rglob("*") if path.suffix in (".py", *DATA))


def decoding_sources() -> list[Path]:
    """Source files imported by the decoding process, sorted."""
    sources: list[Path] = []
    visited: set[str] = set()
    computing = (plugin.module for plugin in plugins_of(COMPUTED_SIGNALS) if plugin.is_there)
    readers = (f"{READERS}.{path.stem}" for path in PACKAGE.joinpath(*READERS.split(".")[1:]).glob("*.py"))
    waiting = [BEGIN, *computing, *readers, *(plugin.module for plugin in protocol_plugins())]
    while waiting:
        module = waiting.pop()
        if module in visited:
            continue
        visited.add(module)
        path = _path(module)
        if path is None or is_simulator(module):
            continue
        sources.append(path)
        waiting += [".".join(module.split(".")[:n]) for n in range(1, module.count(".") + 1)]
        waiting += _imported(path)
    return sorted(sources)


def is_simulator(module: str) -> bool:
    """Whether a module is part of a simulated device."""
    package, house, *inside = [*module.split("."), ""]
    return (package, house) == (PACKAGE.name, "protocols") and "simulator" in inside


def _path(module: str) -> Path | None:
    package, *inside = module.split(".")
    if package != PACKAGE.name:
        return None
    place = PACKAGE.joinpath(*inside)
    return next((path for path in (place.with_suffix(".py"), place / "__init__.py") if path.is_file()), None)


def _imported(path: Path) -> Iterator[str]:
    """Names of modules that a file imports, and of objects that it imports from them, which may be modules. All imports
    here are absolute; parsing the files instead would take a second at the start.
    """
    for base, names, modules in _IMPORT.findall(path.read_text(encoding="utf-8")):
        yield from re.findall(r"[\w.]+", modules)
        if base:
            yield base
            yield from (f"{base}.{name}" for name in re.findall(r"\w+", names))
