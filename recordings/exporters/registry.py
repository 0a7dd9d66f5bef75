"""Registry of export formats.

Each file of `recordings/exporters/formats/` registers its formats when it is imported, and so does each module named in
the entry-point group `imuscope.exporters` of another package. docs/add-an-exporter.md explains how to write one.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from imuscope.protocols.family.plugins import Registry
from imuscope.recordings.exporters.request import ExportRequest, ExportStep

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
        modules: of packages that a smaller installation may lack (recordings/optional_packages.py).
        extra: what brings them.
        takes_units: whether its values can be in the units of the page, in SI or as sent (recordings/columns/units.py);
            otherwise its units are its own.
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
    takes_units: bool = False
    per_byte: float = 1.0
    modules: tuple[str, ...] = ()
    extra: str = ""


EXPORTERS = Registry[ExportFormat]("exporter", "imuscope.recordings.exporters.formats", "imuscope.exporters")
register_exporter = EXPORTERS.register


def lazy(module: str) -> Write:
    """The `write` of a module that is slow to import, imported on first use: a server starts sooner."""

    def write(request: ExportRequest, out: Path, step: ExportStep) -> list[Path]:
        made: list[Path] = import_module(module).write(request, out, step)
        return made

    return write
