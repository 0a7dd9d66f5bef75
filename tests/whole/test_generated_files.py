"""Generated files in git that describe the whole server, extensions included, are as the code is."""

from imuscope.server.generators import docs as generate_docs
from imuscope.server.generators import files as generated_files


def test_files_are_not_stale() -> None:
    stale = [
        path.name
        for path, text in generate_docs.documents(generated_files.document())
        if path.name != generate_docs.HTTP_API and path.read_text(encoding="utf-8") != text
    ]
    assert stale == [], "run python -m imuscope.server.generators.docs"
