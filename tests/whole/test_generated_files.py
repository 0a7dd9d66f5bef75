"""Generated files that describe the whole server, extensions included, are as the code is."""

from __future__ import annotations

from imuscope.server.generators import docs as generate_docs
from imuscope.server.generators import files as generated_files
from imuscope.server.generators import ts_types as generate_ts_types


def test_files_are_not_stale() -> None:
    stale = [
        path.name
        for path, text in generate_docs.documents(generated_files.document())
        if not path.exists() or path.read_text(encoding="utf-8") != text
    ]
    assert stale == [], "run python -m imuscope.server.generators.docs"


def test_routes_of_the_page_are_not_stale() -> None:
    """Run `python -m imuscope.server.generators.ts_types` when this fails."""
    assert generate_ts_types.ROUTES.read_text(encoding="utf-8") == generate_ts_types.generate_routes()
