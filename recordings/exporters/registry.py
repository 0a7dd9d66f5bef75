"""Registry of export formats.

Each file of `recordings/exporters/formats/` registers a format when it is imported, and so does each module named in
the entry-point group `imuscope.exporters` of another package. docs/add-an-exporter.md explains how to write one.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from imuscope.protocols.plugins import import_plugins
from imuscope.recordings.exporters import formats
from imuscope.recordings.exporters.request import ExportRequest, ExportStep

GROUP = "imuscope.exporters"
Write = Callable[[ExportRequest, Path, ExportStep], list[Path]]


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """One format.

    Args:
        name: unique: on the wire and in the name of a zip ("csv").
        title: display name.
        suffix: of its files; on the command line it selects the first format with it.
        write: takes a request, a path and a `step` that is called with the progress; returns the files written.
        order: formats are offered in ascending order.
        label: the title in a menu, if shorter.
        words: short description for a menu.
        needs_source: whether it is made from the bytes of one device instead of columns.
        protocol: of the devices whose bytes it can hold; "" for any.
        per_byte: rough size, for each byte of a driving recording, until it is measured.
    """

    name: str
    title: str
    suffix: str
    write: Write
    order: int = 100
    label: str = ""
    words: str = ""
    needs_source: bool = False
    protocol: str = ""
    per_byte: float = 1.0


_registered: dict[str, ExportFormat] = {}


def register_exporter(format: ExportFormat) -> None:
    """Add a format. ValueError: the name is taken."""
    if format.name in _registered:
        raise ValueError(f"there is an export format {format.name!r} already")
    _registered[format.name] = format


def load_formats() -> tuple[dict[str, ExportFormat], list[str]]:
    """All formats by name, in their order, and a sentence about each package whose formats cannot be used."""
    for module in pkgutil.iter_modules(formats.__path__):
        import_module(f"{formats.__name__}.{module.name}")
    problems = import_plugins(GROUP, "exporter")
    return dict(sorted(_registered.items(), key=lambda item: item[1].order)), problems


def lazy(module: str) -> Write:
    """The `write` of a module that is slow to import, imported on first use: a server starts sooner."""

    def write(request: ExportRequest, out: Path, step: ExportStep) -> list[Path]:
        made: list[Path] = import_module(module).write(request, out, step)
        return made

    return write
