"""Rooms of the house: the parts of each folder, and what each of them imports of the others."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set
from graphlib import TopologicalSorter
from pathlib import Path

from tests.source_files import ROOT, facts_of, python_files

HOUSES = ("server", "recordings", "protocols")
"""Packages of Python; each imports those after it."""
Graph = Mapping[str, Set[str]]

# A row may import the rows that it names, and what those lead to; rows name only rows above them, so that no circle can
# be drawn. A part is a folder, or a file beside them.
ARROWS: Mapping[str, str] = {
    "protocols": """
        arrays
        native
        rotations
        schema
        clocks <- arrays native
        events <- arrays schema
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
}


def table_of(folder: str) -> Graph:
    """The rows of ARROWS: part → the parts that it names."""
    rows = (row.partition("<-") for row in ARROWS[folder].strip().splitlines())
    return {part.strip(): set(names.split()) for part, _, names in rows}


def imports_of(folder: str) -> Iterator[tuple[Path, int, str, str]]:
    """Imports between the parts of a folder: file, line, its part and the other. A part is a folder or a file; imports
    within functions and for types count too.
    """
    depth = len(Path(folder).parts)
    parts = {path.stem for path in (ROOT / folder).iterdir()} - {"__init__", "__pycache__"}
    for path in python_files(folder):
        part = path.relative_to(ROOT / folder).with_suffix("").parts[0]
        for line, module in facts_of(path).imports:
            names = module.split(".")
            if "/".join(names[:depth]) == folder and len(names) > depth and names[depth] in parts - {part}:
                yield path, line, part, names[depth]


def graph_of(folder: str) -> Graph:
    """Parts of a folder, and what each imports of it directly."""
    found: dict[str, set[str]] = {}
    for path in python_files(folder):
        found.setdefault(path.relative_to(ROOT / folder).with_suffix("").parts[0], set())
    for _, _, part, other in imports_of(folder):
        found[part].add(other)
    found.pop("__init__", None)
    return found


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
