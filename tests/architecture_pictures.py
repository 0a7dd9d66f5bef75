"""Pictures in docs/architecture.md: parts of the server from their imports, states of a connection from their table.

    python -m tests.architecture_pictures              write them
    python -m tests.architecture_pictures --check      exit status 1 when one is stale

A picture stands between two comments, as text of Mermaid. An arrow that follows from two others is left out.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator, Mapping, Set
from graphlib import TopologicalSorter

from imuscope.server.devices.connection_state import TRANSITIONS, ConnectionEvent
from imuscope.server.extension import extensions
from tests.source_files import ROOT, facts_of, python_files

DOCUMENT = ROOT / "docs" / "architecture.md"
BEGIN, END = "<!-- picture: {}; python -m tests.architecture_pictures -->\n\n", "\n<!-- end of the picture -->"
SHOWN_FILES = {"app", "services", "cli"}  # of server/ itself; of the others only what they lead to is shown
Graph = Mapping[str, Set[str]]


def imports() -> Graph:
    """Parts of server/ and what each imports of it, directly."""
    found: dict[str, set[str]] = {}
    for path in python_files("server"):
        part = path.relative_to(ROOT / "server").with_suffix("").parts[0]
        if part in ("__init__", "extensions"):
            continue
        modules = (module.split(".") for _, module in facts_of(path).imports)
        others = {module[1] for module in modules if module[0] == "server" and len(module) > 1}
        found.setdefault(part, set()).update(others - {part, "extensions"})
    return {part: others & found.keys() for part, others in found.items()}


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


def parts() -> str:
    """Folders of server/, extensions, and the two packages below."""
    graph = imports()
    used = set[str]().union(*graph.values())
    folders = {part for part in graph if (ROOT / "server" / part).is_dir() and (graph[part] or part in used)}
    shown = folders | (SHOWN_FILES & graph.keys())
    lines = ["flowchart TD", "    subgraph extensions"]
    lines += [f"        {one.name}" for one in extensions()]
    lines += [f"        {one.name} --> {other}" for one in extensions() for other in one.requires]
    lines += ["    end", "    subgraph server"]
    lines += [f"        {part}" for part in sorted(shown)]
    lines += [f"        {part} --> {other}" for part, other in reduced(graph, shown)]
    lines += ["    end", "    extensions --> server --> recordings --> protocols"]
    return "\n".join(lines)


def connection() -> str:
    """The states of a connection."""
    lines = ["stateDiagram-v2", "    [*] --> closed"]
    for state, row in TRANSITIONS.items():
        by_target: dict[str, list[str]] = {}
        for event, target in row.items():
            if event is not ConnectionEvent.CLOSE:
                by_target.setdefault(target.value, []).append(event.value)
        lines += [f"    {state.value} --> {target}: {', '.join(events)}" for target, events in by_target.items()]
    closing = [state.value for state, row in TRANSITIONS.items() if ConnectionEvent.CLOSE in row]
    lines += ["    note right of closed", f"        close leads here from: {', '.join(closing)}", "    end note"]
    return "\n".join(lines)


PICTURES: Mapping[str, Callable[[], str]] = {"parts of the server": parts, "states of a connection": connection}


def with_pictures(document: str) -> str:
    """The document with its pictures as they are now.

    Raises:
        ValueError: it has no place for one.
    """
    for name, drawn in PICTURES.items():
        begin = BEGIN.format(name)
        place = re.compile(re.escape(begin) + ".*?" + re.escape(END), re.DOTALL)
        if len(place.findall(document)) != 1:
            raise ValueError(f"{DOCUMENT.name} has no place, or several, for the picture of {name}")
        text = f"{begin}```mermaid\n{drawn()}\n```\n{END}"
        document = place.sub(lambda _, text=text: text, document)  # type: ignore[misc]
    return document


def main(arguments: list[str]) -> int:
    """The command line."""
    document = DOCUMENT.read_text(encoding="utf-8")
    now = with_pictures(document)
    if "--check" in arguments:
        return int(now != document)
    DOCUMENT.write_text(now, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
