"""Licences of what is linked (its installed metadata) and of what the page ships: permissive ones only."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, distribution

from packaging.requirements import Requirement

from tests.support.each_row import each_row
from tests.support.server_process import ROOT

# any-OSI (apsw) is SPDX for any licence of choice that OSI has approved; eclipse-zenoh offers Apache-2.0 besides EPL.
PERMISSIVE = re.compile(
    r"\b(MIT|BSD|0BSD|Apache|ISC|PSF|Python Software Foundation|Zlib|CC0|Unlicense|any-OSI)\b", re.I
)
COPYLEFT = re.compile(r"\b(A|L)?GPL|General Public License", re.I)
DATA_ONLY = {"certifi": "root certificates as a file, MPL-2.0, asked for by viser's requests; no code of it is changed"}


def licence(name: str) -> tuple[str, list[str]]:
    """The licence that an installed distribution states, and the distributions that it requires."""
    result = distribution(name)
    about = result.metadata
    classifiers = [line for line in about.get_all("Classifier") or [] if line.startswith("License")]
    words = [line[:80] for name in ("License-Expression", "License") for line in about.get_all(name) or []]
    return " ".join([*words, *classifiers]), result.requires or []


def not_permissive(find: Callable[[str], tuple[str, list[str]]] = licence) -> list[str]:
    """Distributions that we link, directly or through others, under a licence that is not permissive."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = (line for lines in project["optional-dependencies"].values() for line in lines)
    todo, observed, wrong = [Requirement(line) for line in (*project["dependencies"], *extras)], set[str](), []
    while todo:
        expected = todo.pop()
        if expected.name in observed or (expected.marker and not expected.marker.evaluate({"extra": ""})):
            continue
        observed.add(expected.name)
        try:
            words, requires = find(expected.name)
        except PackageNotFoundError:
            continue  # for another platform
        if expected.name not in DATA_ONLY and (COPYLEFT.search(words) or not PERMISSIVE.search(words)):
            wrong.append(f"{expected.name}: {words}")
        todo += [Requirement(line) for line in requires]
    assert len(observed) >= len(project["dependencies"])
    return wrong


def test_linked_libraries_are_permissive() -> None:
    assert not_permissive() == []


@each_row("words", ["GPL-3.0-only", "Eclipse Public License 2.0 (EPL-2.0)", "OSI Approved"])
def test_a_licence_that_is_not_permissive_is_named(words: str) -> None:
    assert not_permissive(lambda name: (words if name == "numpy" else "MIT", [])) == [f"numpy: {words}"]


def test_libraries_of_the_page_are_permissive() -> None:
    packages = json.loads((ROOT / "web" / "package-lock.json").read_text())["packages"]
    words = {name: (str(row.get("license", "")), row.get("dev", False)) for name, row in packages.items()}
    wrong = {
        name: text
        for name, (text, is_dev) in words.items()
        if COPYLEFT.search(text) or not (PERMISSIVE.search(text) or (is_dev and "MPL" in text))
    }
    assert wrong == {}
