"""Names and words in TypeScript: each name is exported once, so that a search finds one thing; times are in UTC."""

from __future__ import annotations

import re
from collections import defaultdict

from tests.support.source_files import ROOT

SOURCES = ROOT / "web" / "src"
EXPORTED = re.compile(
    r"^export (?:declare |abstract |async )*(?:const|let|function\*?|class|interface|type|enum) (\w+)", re.MULTILINE
)
NOT_CHECKED = ("testing/",)  # not part of the page
EVERYWHERE = {"TEXT"}  # the texts of a part of the page, always imported under this name or that of its part


def test_no_name_is_exported_twice() -> None:
    places: defaultdict[str, list[str]] = defaultdict(list)
    for path in sorted(SOURCES.rglob("*.ts*")):
        name = path.relative_to(SOURCES).as_posix()
        if ".test." not in name and not name.endswith(".d.ts") and not name.startswith(NOT_CHECKED):
            for exported in set(EXPORTED.findall(path.read_text(encoding="utf-8"))) - EVERYWHERE:
                places[exported].append(name)
    assert len(places) > 1000
    twice = [f"{name}: {', '.join(files)}" for name, files in sorted(places.items()) if len(files) > 1]
    assert not twice, "\n".join([*twice, "Give each a name that tells it from the other, or export it no longer."])


def test_times_and_numbers_are_written_by_the_page_itself() -> None:
    """Never in the language and time zone of the browser: a time would be of another zone than all others."""
    sources = [path for path in sorted(SOURCES.rglob("*.ts*")) if ".test." not in path.name]
    match = [path.name for path in sources if re.search(r"\.toLocale\w*\(", path.read_text(encoding="utf-8"))]
    assert not match, f"{', '.join(match)}: use web/src/ui/format/format.ts"
