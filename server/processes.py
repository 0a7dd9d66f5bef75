"""Programs that have a file open, from /proc: those of other users are visible to root only."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

OWN = "imuscope"
ROOT = Path("/")


@dataclass(frozen=True, slots=True)
class Program:
    """A running program; `name` is "imuscope" for each part of it."""

    pid: int
    name: str

    def __str__(self) -> str:
        return f"{self.name} (process {self.pid})"


def program_of(folder: Path) -> Program:
    """The program of a folder of /proc."""
    try:
        line = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
        name = (folder / "comm").read_text(errors="replace").strip()
    except OSError:
        line, name = "", "another program"
    is_own = any(part in line for part in ("imuscope", "server.cli", "server.holder"))
    return Program(int(folder.name), OWN if is_own else name)


def process_folders(root: Path = ROOT) -> list[Path]:
    """The folders of all processes in /proc."""
    try:
        return [one for one in (root / "proc").iterdir() if one.name.isdecimal()]
    except OSError:
        return []


def open_files(is_wanted: Callable[[str], bool], root: Path = ROOT) -> dict[str, list[Program]]:
    """Programs by the wanted file that they have open, in the order of their processes."""
    found: dict[str, list[Program]] = {}
    for folder in sorted(process_folders(root), key=lambda one: int(one.name)):
        try:
            links = list((folder / "fd").iterdir())
        except OSError:
            continue
        places = set()
        for link in links:
            try:
                places.add(os.readlink(link))
            except OSError:
                continue
        for place in filter(is_wanted, places):
            found.setdefault(place, []).append(program_of(folder))
    return found


def programs_with(path: str, root: Path = ROOT) -> list[Program]:
    """The programs that have a file open, this one left out."""
    place = os.path.realpath(path)
    return [one for one in open_files(place.__eq__, root).get(place, ()) if one.pid != os.getpid()]
