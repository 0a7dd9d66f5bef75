"""What do we build on, may we, and is something known against it? `python tests/audit.py`, a part of tests/check.py.

    licences           of what is installed and linked (its own words), of what the page ships    fails: not permissive
    vulnerabilities    of every version in uv.lock and web/package-lock.json: one question to OSV    fails: one is known

OSV (https://osv.dev) gathers what PyPA, GitHub and npm know. When it cannot be reached nothing is known, and that is
what is said, loudly and last: NOT CHECKED. It is no failure then, because a build without a network is none, unless
IMUSCOPE_AUDIT=required is set, as for a release.

What is known and does not touch us is listed in `ACCEPTED` with its reason.
"""

from __future__ import annotations

import functools
import json
import os
import re
import sys
import tomllib
import urllib.error
import urllib.request
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parent.parent
OSV = "https://api.osv.dev"
TIMEOUT_S = 8.0
MOST_ANSWER = 16 << 20

PERMISSIVE = re.compile(r"\b(MIT|BSD|0BSD|Apache|ISC|PSF|Python Software Foundation|Zlib|CC0|Unlicense)\b", re.I)
COPYLEFT = re.compile(r"\b(A|L)?GPL|General Public License", re.I)
DATA_ONLY = {"certifi": "root certificates as a file, MPL-2.0, asked for by viser's requests; no code of it is changed"}
ACCEPTED: dict[str, str] = {}  # id of a vulnerability → why it does not touch us


@dataclass(frozen=True, order=True)
class Version:
    """Of a package, as a lock file has it."""

    ecosystem: str  # "PyPI", "npm"
    name: str
    version: str


class UnreachableError(Exception):
    """The database did not answer: nothing is known."""


# ── licences ──


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


# ── vulnerabilities ──


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


def known_against(versions: Sequence[Version], service: str = OSV) -> dict[Version, list[str]]:
    """Ids of what is known against each, accepted ones left out.

    Raises:
        UnreachableError: nobody answered, or not in a way that is understood.
    """
    queries = [{"package": {"name": one.name, "ecosystem": one.ecosystem}, "version": one.version} for one in versions]
    answer = _asked(f"{service}/v1/querybatch", {"queries": queries})
    rows = answer.get("results")
    if not isinstance(rows, list) or len(rows) != len(versions):
        raise UnreachableError("the answer is not one for each question")
    found = {}
    for version, row in zip(versions, rows, strict=True):
        ids = [str(one["id"]) for one in (row or {}).get("vulns", []) if one["id"] not in ACCEPTED]
        if ids:
            found[version] = ids
    return found


def about(vulnerability: str, service: str = OSV) -> str:
    """One line about it, as far as it is told."""
    try:
        told = _asked(f"{service}/v1/vulns/{vulnerability}")
    except UnreachableError:
        return ""
    return str(told.get("summary") or told.get("details") or "").partition("\n")[0][:200]


def _asked(address: str, question: Any = None) -> dict[str, Any]:
    body = None if question is None else json.dumps(question).encode()
    request = urllib.request.Request(address, body, {"content-type": "application/json"})
    try:
        with urllib.request.urlopen(request, timeout=TIMEOUT_S) as answer:
            told = json.loads(answer.read(MOST_ANSWER))
    except (OSError, ValueError) as error:
        raise UnreachableError(str(getattr(error, "reason", "") or error)) from None
    if not isinstance(told, dict):
        raise UnreachableError("the answer is no object")
    return told


def audit(service: str, is_required: bool) -> int:
    """All of it, told line by line; the exit status."""
    unfree = [*unfree_linked(), *unfree_shipped()]
    for line in unfree:
        print(f"NOT PERMISSIVE  {line}")
    licences = f"{len(unfree)} licences not permissive" if unfree else "licences permissive"
    versions = locked()
    try:
        found = known_against(versions, service)
    except UnreachableError as error:
        print(f"\n!!  VULNERABILITIES WERE NOT CHECKED: {service} cannot be reached ({error}).")
        print("!!  Nothing is known about the versions in the lock files. This is no all-clear.\n")
        print(f"{licences}; vulnerabilities of {len(versions)} packages NOT CHECKED (no database reached)")
        return 1 if unfree or is_required else 0
    for version, ids in found.items():
        for id in ids:
            print(f"VULNERABLE  {version.ecosystem} {version.name} {version.version}: {id} {about(id, service)}")
    known = f"{sum(map(len, found.values()))} KNOWN" if found else "none known"
    print(f"{licences}; vulnerabilities of {len(versions)} packages: {known}")
    return 1 if unfree or found else 0


if __name__ == "__main__":
    sys.exit(audit(os.environ.get("IMUSCOPE_OSV", OSV), os.environ.get("IMUSCOPE_AUDIT") == "required"))
