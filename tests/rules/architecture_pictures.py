"""Pictures in docs/architecture.md: rooms from their tables (rooms.py), states of a connection from their table.

    python -m tests.rules.architecture_pictures              write them
    python -m tests.rules.architecture_pictures --check      exit status 1 when one is stale

A picture stands between two comments, as text of Mermaid.
"""

import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import PurePath

from imuscope.server.devices.link.connection_state import TRANSITIONS, ConnectionEvent
from imuscope.server.services.extension import extensions
from tests.rules.rooms import HOUSES, PAGE, table_of
from tests.support.source_files import ROOT

DOCUMENT = ROOT / "docs" / "architecture.md"
BEGIN, END = "<!-- picture: {}; python -m tests.rules.architecture_pictures -->\n\n", "\n<!-- end of the picture -->"


def rooms(folders: Sequence[str]) -> Iterator[str]:
    """Subgraphs of folders with the rows of their tables."""
    for folder in folders:
        name = PurePath(folder).parts[0]
        yield f"    subgraph {name}"
        for part, others in table_of(folder).items():
            place = f"{name}_{part}".replace("/", "_")
            yield f'        {place}["{part}"]'
            yield from (f"        {place} --> {name}_{other.replace('/', '_')}" for other in sorted(others))
        yield "    end"


def page_rooms() -> str:
    """Parts of the page."""
    return "\n".join(["flowchart TD", *rooms([PAGE])])


def python_rooms() -> str:
    """Parts of the three packages, and the extensions."""
    lines = ["flowchart TD", "    subgraph extensions"]
    lines += [f"        {one.name}" for one in extensions()]
    lines += [f"        {one.name} --> {other}" for one in extensions() for other in one.requires]
    lines += ["    end", *rooms(HOUSES), "    extensions --> server --> recordings --> protocols"]
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


PICTURES: Mapping[str, Callable[[], str]] = {
    "rooms of the program": python_rooms,
    "rooms of the page": page_rooms,
    "states of a connection": connection,
}


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
