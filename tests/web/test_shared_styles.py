"""Style sheets of the page: what two of them need is a class of web/src/ui/, written once."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

from tests.support.source_files import ROOT

SOURCES = ROOT / "web" / "src"
LEAST = 4
"""Declarations of a rule: shorter ones are alike by chance."""
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_RULE = re.compile(r"([^{};]+)\{([^{}]*)\}")


def rules(text: str) -> Iterator[tuple[str, frozenset[str]]]:
    """Selector and declarations of each rule; of a nested one, without what encloses it."""
    for selector, body in _RULE.findall(_COMMENT.sub("", text)):
        yield " ".join(selector.split()), frozenset(" ".join(one.split()) for one in body.split(";") if one.strip())


def test_no_two_style_sheets_have_the_same_rule() -> None:
    places: dict[frozenset[str], list[tuple[Path, str]]] = defaultdict(list)
    for path in sorted(SOURCES.rglob("*.css")):
        for selector, body in rules(path.read_text(encoding="utf-8")):
            if len(body) >= LEAST:
                places[body].append((path.relative_to(SOURCES), selector))
    assert len(places) > 300
    twice = [results for results in places.values() if len({path for path, _ in results}) > 1]
    assert not twice, "share a class:\n" + "\n".join(
        " = ".join(f"{path}: {selector}" for path, selector in results) for results in twice
    )


def test_text_is_decorated_by_properties_that_every_browser_has() -> None:
    """Safari ignores `text-decoration` with more than a line: figures that lead somewhere were not underlined."""
    wrong = [
        f"{path.relative_to(SOURCES)}: {value}"
        for path in sorted(SOURCES.rglob("*.css"))
        for value in re.findall(r"text-decoration:\s*([^;]+);", path.read_text(encoding="utf-8"))
        if " " in value.strip()
    ]
    assert not wrong, "use text-decoration-line, -style and -color:\n" + "\n".join(wrong)
