"""Rooms of the house: the parts of each folder, and what each of them imports of the others."""

import functools
import os
import re
from collections.abc import Iterator, Mapping, Sequence, Set
from graphlib import TopologicalSorter
from pathlib import Path

from tests.support.source_files import ROOT, facts_of, python_files, text_of

HOUSES = ("server", "recordings", "protocols")
"""Packages of Python; each imports those after it."""
PAGE = "web/src"
Graph = Mapping[str, Set[str]]
_IMPORTED = re.compile(r"""(?:from|import|declare module)\s+["'](\.{1,2}/[^"'\n]+)["']""")

# A row may import the rows that it names, and what those lead to; rows name only rows above them, so that no circle can
# be drawn. A part is a folder, or a file beside them.
ARROWS: Mapping[str, str] = {
    "protocols": """
        arrays
        native
        clocks <- arrays native
        rotations <- arrays
        schema <- arrays
        events <- schema
        simulator <- rotations
        commands <- events
        framing <- native events
        embedded <- framing
        family <- simulator commands framing
        idtp <- clocks family
        isb <- clocks embedded family
        messages <- clocks family
        xbus <- clocks embedded family
        can <- xbus
        registry <- messages
    """,
    "recordings": """
        capture_timing
        errors
        file_names
        optional_packages
        sources
        system
        columns <- system
        mcap <- errors sources system
        replay <- sources
        tables <- errors sources system
        readers <- file_names mcap tables
        sidecar <- tables
        importers <- capture_timing optional_packages readers sidecar
        exporters <- columns importers
        library <- columns replay importers
    """,
    "server": """
        concurrency
        errors
        packaging
        system
        text
        version
        wire
        links <- concurrency errors system text wire
        streaming <- concurrency version wire
        devices <- links streaming
        configuration <- devices
        diagnostics <- devices
        settings <- devices
        access <- settings
        http <- settings
        library <- configuration settings
        integrations <- access
        reference <- library
        services <- diagnostics http library integrations
        api <- reference services
        app <- api
        commands <- app
        generators <- app
        cli <- commands
        extensions <- commands
    """,
    "server/devices": """
        device
        decode <- device
        link <- decode
    """,
    "server/extensions/fleet": """
        model
        tunnel <- model
        rollouts <- tunnel
        store <- tunnel
        query <- store
        robot <- store
        upload <- robot
        server <- rollouts query upload
    """,
    "server/extensions/analysis": """
        signals
        noise <- signals
        expressions <- noise
        methods <- noise
        compare <- expressions
        jobs <- compare
    """,
    "web/src": """
        ui/dom
        wire
        extension <- wire
        ui/format <- wire
        texts <- ui/format
        data <- texts
        ui/completion <- texts
        ui/controls <- ui/dom texts
        charts <- data ui/controls
        requests <- ui/controls
        signals <- data
        forms <- data requests
        measure <- data
        guide <- ui/controls
        page <- extension signals forms measure
        panels <- page
        plots <- charts page
        recordings <- page
        attitude <- panels
        views <- recordings
        workspace <- panels plots
        pages <- attitude views workspace
        pages/configure <- pages
        pages/recordings <- pages/configure
        extensions <- ui/completion pages/recordings
        shell <- extensions
    """,
}


def table_of(folder: str) -> Graph:
    """The rows of ARROWS: part → the parts that it names."""
    rows = (row.partition("<-") for row in ARROWS[folder].strip().splitlines())
    return {part.strip(): set(names.split()) for part, _, names in rows}


def imports_of(folder: str) -> Iterator[tuple[Path, int, str, str]]:
    """Imports between the parts of a folder: file, line, its part and the other. Imports within functions and for types
    count too; `import()` on the page does not: it is a door to what is shown later.
    """
    of_folder = _page_imports if folder == PAGE else _python_imports
    for path, line, other in of_folder(folder):
        part, used = _part_of(folder, path), _part_of(folder, other)
        if used not in (part, "__init__"):
            yield path, line, part, used


def _part_of(folder: str, path: Path) -> str:
    """A file beside the parts, or the folder below; on the page the longest path that has a row of its own."""
    names = path.relative_to(ROOT / folder).with_suffix("").parts
    rows = table_of(folder) if folder == PAGE else ()
    return next((part for n in range(len(names) - 1, 0, -1) if (part := "/".join(names[:n])) in rows), names[0])


def _python_imports(folder: str) -> Iterator[tuple[Path, int, Path]]:
    depth = len(Path(folder).parts)
    for path in python_files(folder):
        for line, module in facts_of(path).imports:
            names = module.split(".")
            if "/".join(names[:depth]) != folder or len(names) == depth:
                continue
            place = ROOT / folder / names[depth]
            if place.is_dir() or place.with_suffix(".py").is_file():
                yield path, line, place


@functools.cache
def page_files() -> Sequence[Path]:
    """Sources of the page without its tests and what helps them."""
    return tuple(
        path
        for path in sorted((ROOT / PAGE).rglob("*.ts*"))
        if ".test." not in path.name and ROOT / PAGE / "testing" not in path.parents
    )


def _page_imports(folder: str) -> Iterator[tuple[Path, int, Path]]:
    for path in page_files():
        for match in re.finditer(
            r"""(?:from|import|declare module)\s+["'](\.{1,2}/[^"'\n]+)["']""", text := text_of(path)
        ):
            target = Path(os.path.normpath(path.parent / match[1]))
            ends = (target, target.with_name(f"{target.name}.ts"), target.with_name(f"{target.name}.tsx"))
            if (other := next((one for one in ends if one.is_file()), None)) and other.suffix in (".ts", ".tsx"):
                yield path, text.count("\n", 0, match.start()) + 1, other


def graph_of(folder: str) -> Graph:
    """Parts of a folder, and what each imports of it directly."""
    files = page_files() if folder == PAGE else python_files(folder)
    results: dict[str, set[str]] = {_part_of(folder, path): set() for path in files}
    for _, _, part, other in imports_of(folder):
        results[part].add(other)
    results.pop("__init__", None)
    return results


def reach(graph: Graph) -> Graph:
    """For each part everything that it leads to.

    Raises:
        graphlib.CycleError: the imports have a circle.
    """
    reached: dict[str, set[str]] = {}
    for part in TopologicalSorter(graph).static_order():
        reached[part] = set(graph[part]).union(*(reached[other] for other in graph[part]))
    return reached


def reduced(graph: Graph, shown: Set[str]) -> Iterator[tuple[str, str]]:
    """The arrows between shown parts that do not follow from two others."""
    reached = reach(graph)
    for part in sorted(shown):
        targets = reached[part] & shown
        through = set[str]().union(*(reached[other] for other in targets))
        yield from ((part, other) for other in sorted(targets - through))
