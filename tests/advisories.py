"""What is known against the packages that we build on, in a table that is read without a network.

    tests/advisories.json ──▶ of a locked version's package: the ranges of each advisory ──▶ the ones that hold it
                          ──▶ the packages that were looked at: nothing is known of any other

A range begins with `introduced` and ends before `fixed`, or with `last_affected`; without an end no release mends it.
How far the table reaches in time, and what was read for it, it says itself: `gathered`, `newest`, `reach`.
"""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import packaging.version

TABLE = Path(__file__).with_name("advisories.json")
ALWAYS = "0"  # introduced with the first release, and before
SEMVER = re.compile(r"(\d+)(?:\.(\d+))?(?:\.(\d+))?(?:-([0-9A-Za-z.-]+))?(?:\+[0-9A-Za-z.-]+)?")


@dataclass(frozen=True, order=True)
class Version:
    """Of a package, as a lock file has it."""

    ecosystem: str  # "PyPI", "npm"
    name: str
    version: str


@dataclass(frozen=True)
class Range:
    """Versions that are affected, in the order of their ecosystem."""

    introduced: str
    fixed: str = ""
    last_affected: str = ""

    def __str__(self) -> str:
        """Where it ends, which is what one wants to know who is in it."""
        after = f"the one after {self.last_affected}" if self.last_affected else ""
        return f"fixed in {self.fixed or after}" if self.fixed or after else "no fix is known"

    def holds(self, version: Version) -> bool:
        """Whether it is affected."""
        at, ecosystem = rank(version.ecosystem, version.version), version.ecosystem
        if self.introduced != ALWAYS and at < rank(ecosystem, self.introduced):
            return False
        if self.fixed:
            return bool(at < rank(ecosystem, self.fixed))
        return not self.last_affected or bool(at <= rank(ecosystem, self.last_affected))


@dataclass(frozen=True)
class Advisory:
    """One row of the table."""

    id: str
    aliases: tuple[str, ...]
    ecosystem: str
    package: str
    affected: tuple[Range, ...]
    date: str
    summary: str  # in our words, "" when nobody wrote them yet

    @property
    def names(self) -> set[str]:
        """What it is called."""
        return {self.id, *self.aliases}

    def holds(self, version: Version) -> Range | None:
        """The range that a version is in."""
        if (self.ecosystem, self.package) != (version.ecosystem, version.name):
            return None
        return next((one for one in self.affected if one.holds(version)), None)


@dataclass(frozen=True)
class Table:
    """All of it."""

    gathered: str  # the day
    newest: str  # the day of the newest advisory
    reach: str  # what was read for it
    advisories: tuple[Advisory, ...]
    looked_at: dict[str, list[str]]  # ecosystem → packages

    def against(self, version: Version) -> list[tuple[Advisory, Range]]:
        """What is known against a version."""
        return [(one, where) for one in self.advisories if (where := one.holds(version)) is not None]

    def is_looked_at(self, version: Version) -> bool:
        """Whether anybody looked what is known against its package."""
        return version.name in self.looked_at.get(version.ecosystem, ())

    def names_of(self, names: Iterable[str]) -> set[str]:
        """Names, and what else the same advisories are called."""
        wanted = set(names)
        return wanted.union(*(one.names for one in self.advisories if one.names & wanted))


def rank(ecosystem: str, version: str) -> Any:
    """What orders the versions of an ecosystem.

    Raises:
        ValueError: it is none.
    """
    if ecosystem == "PyPI":
        return packaging.version.Version(version)
    parts = SEMVER.fullmatch(version)
    if parts is None:
        raise ValueError(f"no version of {ecosystem}: {version}")
    before = parts[4]  # "beta.2": numbers by their size and before words; all of it before the release itself
    steps = [(0, int(step), "") if step.isdigit() else (1, 0, step) for step in (before or "").split(".")]
    return [int(parts[place] or 0) for place in (1, 2, 3)], before is None, steps


def read(path: Path = TABLE) -> Table:
    """The table as it is kept."""
    told = json.loads(path.read_text())
    rows = told.pop("advisories")
    return Table(advisories=tuple(_row(one) for one in rows), **told)


def _row(told: dict[str, Any]) -> Advisory:
    aliases, affected = tuple(told["aliases"]), tuple(Range(**one) for one in told["affected"])
    return Advisory(**{**told, "aliases": aliases, "affected": affected})


def write(table: Table, path: Path = TABLE) -> None:
    """Keep it, an advisory in each line: so a change is read line by line."""
    head = {name: json.dumps(getattr(table, name)) for name in ("gathered", "newest", "reach")}
    rows = [json.dumps(_told(one), ensure_ascii=False) for one in _sorted(table.advisories)]
    names = {ecosystem: sorted(set(packages)) for ecosystem, packages in sorted(table.looked_at.items())}
    lines = [
        *(f'  "{name}": {value},' for name, value in head.items()),
        '  "advisories": [',
        ",\n".join(f"    {row}" for row in rows),
        "  ],",
        f'  "looked_at": {json.dumps(names, indent=2)}'.replace("\n", "\n  "),
    ]
    path.write_text("\n".join(["{", *(line for line in lines if line), "}", ""]))


def _sorted(advisories: Sequence[Advisory]) -> list[Advisory]:
    return sorted(advisories, key=lambda one: (one.ecosystem, one.package, one.date, one.id))


def _told(one: Advisory) -> dict[str, Any]:
    told = dataclasses.asdict(one)
    told["affected"] = [{end: value for end, value in where.items() if value} for where in told["affected"]]
    return told
