"""What OSV (https://osv.dev) knows: it gathers what PyPA, GitHub and npm know, and answers when there is a network.

    versions ──▶ POST v1/querybatch ──▶ ids against each                                  the audit's question
    packages ──▶ POST v1/querybatch ──▶ ids ──▶ GET v1/vulns/ID ──▶ rows of the table     tests/audit.py --gather

Source: https://google.github.io/osv.dev/api/, https://ossf.github.io/osv-schema/
"""

from __future__ import annotations

import json
import urllib.request
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from packaging.utils import canonicalize_name

from tests.advisories import ALWAYS, Advisory, Range, Version, rank

SERVICE = "https://api.osv.dev"
TIMEOUT_S = 8.0
MOST_ANSWER = 16 << 20
MOST_PAGES = 50


class UnreachableError(Exception):
    """The database did not answer, or not in a way that is understood: nothing is known."""


def known_against(versions: Sequence[Version], service: str = SERVICE) -> dict[Version, list[str]]:
    """Ids of what is known against each.

    Raises:
        UnreachableError: nobody answered.
    """
    queries = [{"package": {"name": one.name, "ecosystem": one.ecosystem}, "version": one.version} for one in versions]
    found = zip(versions, _ids(queries, service), strict=True)
    return {version: ids for version, ids in found if ids}


def about(vulnerability: str, service: str = SERVICE) -> str:
    """One line about it, as far as it is told."""
    try:
        told = _asked(f"{service}/v1/vulns/{vulnerability}")
    except UnreachableError:
        return ""
    return str(told.get("summary") or told.get("details") or "").partition("\n")[0][:200]


def gathered(packages: Mapping[str, Iterable[str]], words: Mapping[str, str], service: str = SERVICE) -> list[Advisory]:
    """Every advisory on the packages of each ecosystem. `words` say in one line what an id is about: they stay ours.

    Raises:
        UnreachableError: not all of it was answered.
    """
    asked = [(ecosystem, name) for ecosystem, names in packages.items() for name in names]
    queries = [{"package": {"name": name, "ecosystem": ecosystem}} for ecosystem, name in asked]
    told: dict[str, dict[str, Any]] = {}
    rows = []
    for (ecosystem, name), ids in zip(asked, _ids(queries, service), strict=True):
        for id in ids:
            if id not in told:
                told[id] = _asked(f"{service}/v1/vulns/{id}")
            rows += _row(told[id], ecosystem, name, words)
    return rows


def _row(told: Mapping[str, Any], ecosystem: str, name: str, words: Mapping[str, str]) -> list[Advisory]:
    """What it says of one package: nothing when it was withdrawn, or says it of other packages only."""
    own = [one for one in told.get("affected", []) if _is(one.get("package", {}), ecosystem, name)]
    affected = tuple(dict.fromkeys(where for one in own for where in _ranges(one, ecosystem)))
    if told.get("withdrawn") or not affected:
        return []
    aliases = tuple(sorted(told.get("aliases", [])))
    summary = next((words[one] for one in (told["id"], *aliases) if one in words), "")
    return [Advisory(told["id"], aliases, ecosystem, name, affected, str(told["published"])[:10], summary)]


def _is(package: Mapping[str, Any], ecosystem: str, name: str) -> bool:
    if package.get("ecosystem") != ecosystem:
        return False
    other = str(package.get("name"))
    return other == name or (ecosystem == "PyPI" and canonicalize_name(other) == canonicalize_name(name))


def _ranges(affected: Mapping[str, Any], ecosystem: str) -> list[Range]:
    """Its ranges; where it has none, the versions that it lists, each on its own."""
    ordered = [one for one in affected.get("ranges", []) if one.get("type") in ("ECOSYSTEM", "SEMVER")]
    found = [where for one in ordered for where in _spans(one["events"])]
    if not ordered:
        found = [Range(one, last_affected=one) for one in affected.get("versions", [])]
    return [where for where in found if _is_ordered(where, ecosystem)]


def _spans(events: Iterable[Mapping[str, str]]) -> list[Range]:
    found: list[Range] = []
    begun = ""
    for event in events:
        if "introduced" in event:
            begun = event["introduced"]
        elif begun and ("fixed" in event or "last_affected" in event):
            found.append(Range(begun, event.get("fixed", ""), event.get("last_affected", "")))
            begun = ""
    return [*found, Range(begun)] if begun else found


def _is_ordered(where: Range, ecosystem: str) -> bool:
    """Whether its ends are versions: some of the oldest are not, and nobody locks these."""
    try:
        for end in (where.introduced, where.fixed, where.last_affected):
            _ = end in ("", ALWAYS) or rank(ecosystem, end)
    except ValueError:
        return False
    return True


def _ids(queries: Sequence[dict[str, Any]], service: str) -> list[list[str]]:
    """The ids that answer each question, all pages of them."""
    found: list[list[str]] = [[] for _ in queries]
    todo = list(enumerate(queries))
    for _ in range(MOST_PAGES):
        rows = _asked(f"{service}/v1/querybatch", {"queries": [query for _, query in todo]}).get("results")
        if not isinstance(rows, list) or len(rows) != len(todo):
            raise UnreachableError("the answer is not one for each question")
        more = []
        for (place, query), row in zip(todo, rows, strict=True):
            found[place] += [str(one["id"]) for one in (row or {}).get("vulns", [])]
            if token := (row or {}).get("next_page_token"):
                more.append((place, {**query, "page_token": token}))
        if not more:
            return found
        todo = more
    raise UnreachableError("the answer does not end")


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
