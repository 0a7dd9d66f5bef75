"""Generated files that describe the whole server, extensions included, are as the code is."""

from __future__ import annotations

from imuscope.server import generate_docs, generate_ts_types, generated_files


def test_files_are_not_stale() -> None:
    stale = [
        path.name
        for path, text in generate_docs.documents(generated_files.document())
        if not path.exists() or path.read_text(encoding="utf-8") != text
    ]
    assert stale == [], "run python -m imuscope.server.generate_docs"


def test_routes_of_the_page_are_not_stale() -> None:
    """Run `python -m imuscope.server.generate_ts_types` when this fails."""
    assert generate_ts_types.ROUTES.read_text(encoding="utf-8") == generate_ts_types.generate_routes()
