"""What do we build on, may we, and is something known against it? `python tests/audit.py`, a part of tests/check.py.

    licences      of what is installed and linked (its own words), of what the page ships       fails: not permissive
    known         of every version in uv.lock and web/package-lock.json: tests/advisories.json  fails: one touches it
    looked at     whether the table knows the package at all                                    fails: it does not
    since then    one question to OSV, which knows what the table is too old for                fails: one is known

The table needs no network, so what it knows is always checked; it says itself how far it reaches. When OSV cannot be
reached nothing newer is known, and that is what is said, loudly and last: NOT CHECKED. It is no failure then, because
a build without a network is none, unless IMUSCOPE_AUDIT=required is set, as for a release.

Where OSV is reached, `python tests/audit.py --gather` writes the table anew: after a new dependency, and now and then.
What is known and does not touch us is listed in `ACCEPTED` with its reason.
"""

from __future__ import annotations

import datetime
import functools
import json
import os
import re
import sys
import tomllib
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from tests import advisories, osv  # noqa: E402  (the project's root must be on the path first)
from tests.advisories import Table, Version  # noqa: E402

PERMISSIVE = re.compile(r"\b(MIT|BSD|0BSD|Apache|ISC|PSF|Python Software Foundation|Zlib|CC0|Unlicense)\b", re.I)
COPYLEFT = re.compile(r"\b(A|L)?GPL|General Public License", re.I)
DATA_ONLY = {"certifi": "root certificates as a file, MPL-2.0, asked for by viser's requests; no code of it is changed"}
ACCEPTED: dict[str, str] = {}  # id of a vulnerability, or another name of it → why it does not touch us
GATHERED = "All that OSV knew on that day. An advisory without words is new: say in a line of ours what it is about."


# ── licences ──


@functools.cache
def licence(name: str) -> tuple[str, list[str]]:
    """What an installed distribution says its licence is, and what it requires."""
    found = distribution(name)
    about = found.metadata
    classifiers = [line for line in about.get_all("Classifier") or [] if line.startswith("License")]
    words = [line[:80] for name in ("License-Expression", "License") for line in about.get_all(name) or []]
    return " ".join([*words, *classifiers]), found.requires or []


def unfree_linked() -> list[str]:
    """What we link and what it links, that is not permissive."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    todo, seen, wrong = [Requirement(line) for line in project["dependencies"]], set[str](), []
    while todo:
        wanted = todo.pop()
        if wanted.name in seen or (wanted.marker and not wanted.marker.evaluate({"extra": ""})):
            continue
        seen.add(wanted.name)
        try:
            words, requires = licence(wanted.name)
        except PackageNotFoundError:
            continue  # for another platform
        if wanted.name not in DATA_ONLY and (COPYLEFT.search(words) or not PERMISSIVE.search(words)):
            wrong.append(f"{wanted.name}: {words}")
        todo += [Requirement(line) for line in requires]
    assert len(seen) >= len(project["dependencies"])
    return wrong


def unfree_shipped() -> list[str]:
    """What the page ships or is built with, that is not permissive."""
    return [
        f"{name}: {row.get('license')}"
        for name, row in _npm().items()
        if COPYLEFT.search(words := str(row.get("license", "")))
        or not (PERMISSIVE.search(words) or (row.get("dev") and "MPL" in words))
    ]


# ── what the lock files name ──


@functools.cache
def locked() -> list[Version]:
    """Every version that either lock file names."""
    lock = tomllib.loads((ROOT / "uv.lock").read_text())["package"]
    python = {Version("PyPI", row["name"], row["version"]) for row in lock if "registry" in row["source"]}
    page = {Version("npm", _npm_name(name, row), row["version"]) for name, row in _npm().items() if name}
    return sorted(python | page)


def _npm() -> dict[str, Any]:
    packages: dict[str, Any] = json.loads((ROOT / "web" / "package-lock.json").read_text())["packages"]
    return packages


def _npm_name(path: str, row: Mapping[str, Any]) -> str:
    return str(row.get("name") or path.rpartition("node_modules/")[2])


# ── what is known against it ──


def tabled(versions: Sequence[Version], table: Table) -> list[str]:
    """A line for each version that the table knows something against, or knows nothing of."""
    lines = []
    for version in versions:
        name = f"{version.ecosystem} {version.name} {version.version}"
        if not table.is_looked_at(version):
            lines.append(f"NOT LOOKED AT  {name}: where OSV is reached, python tests/audit.py --gather")
        for one, where in table.against(version):
            if not one.names & ACCEPTED.keys():
                lines.append(f"VULNERABLE  {name}: {' '.join([one.id, *one.aliases])} ({where}) {one.summary}".rstrip())
    return lines


def since_then(versions: Sequence[Version], table: Table, service: str) -> list[str]:
    """A line for each that OSV knows beyond the table.

    Raises:
        UnreachableError: it cannot be asked.
    """
    told = {version: {name for one, _ in table.against(version) for name in one.names} for version in versions}
    accepted = table.names_of(ACCEPTED)
    return [
        f"VULNERABLE  {version.ecosystem} {version.name} {version.version}: {id} {osv.about(id, service)}"
        for version, ids in osv.known_against(versions, service).items()
        for id in ids
        if id not in accepted | told[version]
    ]


def audit(service: str, is_required: bool, table: Table | None = None) -> int:
    """All of it, told line by line; the exit status."""
    table = table or advisories.read()
    versions = locked()
    unfree = [f"NOT PERMISSIVE  {line}" for line in (*unfree_linked(), *unfree_shipped())]
    known = tabled(versions, table)
    print(*unfree, *known, sep="\n", end="\n" if unfree or known else "")
    try:
        newer = since_then(versions, table, service)
        print(*newer, sep="\n", end="\n" if newer else "")
        last = f"OSV: {len(newer)} more KNOWN" if newer else "OSV: none known"
        status = 1 if unfree or known or newer else 0
    except osv.UnreachableError as error:
        print(f"\n!!  {service} cannot be reached ({error}).")
        print(f"!!  Of what became known after {table.newest} nothing is known here. This is no all-clear.\n")
        last = "OSV not reached, newer ones NOT CHECKED"
        status = 1 if unfree or known or is_required else 0
    print(f"{_licences(unfree)}; {_tabled(len(versions), known, table)}; {last}")
    return status


def _licences(unfree: Sequence[str]) -> str:
    return f"{len(unfree)} licences not permissive" if unfree else "licences permissive"


def _tabled(count: int, known: Sequence[str], table: Table) -> str:
    those = f"{len(table.advisories)} advisories known {table.gathered}"
    return (
        f"{count} packages: {len(known)} KNOWN or not looked at, {those}"
        if known
        else f"{count} packages: none of {those} touches them"
    )


def gather(service: str, path: Path = advisories.TABLE) -> int:
    """Write the table anew from OSV; what we said of an advisory stays."""
    words = {name: one.summary for one in advisories.read(path).advisories if one.summary for name in one.names}
    versions = locked()
    looked_at = {
        ecosystem: sorted({one.name for one in versions if one.ecosystem == ecosystem}) for ecosystem in ("PyPI", "npm")
    }
    try:
        found = osv.gathered(looked_at, words, service)
    except osv.UnreachableError as error:
        print(f"the table stays as it is: {service} cannot be reached ({error})")
        return 1
    newest = max((one.date for one in found), default="")
    today = datetime.date.today().isoformat()
    advisories.write(Table(today, newest, GATHERED, tuple(found), looked_at), path)
    print(f"{len(found)} advisories; without words: {' '.join(one.id for one in found if not one.summary) or 'none'}")
    return 0


if __name__ == "__main__":
    address = os.environ.get("IMUSCOPE_OSV", osv.SERVICE)
    if "--gather" in sys.argv[1:]:
        sys.exit(gather(address))
    sys.exit(audit(address, os.environ.get("IMUSCOPE_AUDIT") == "required"))
