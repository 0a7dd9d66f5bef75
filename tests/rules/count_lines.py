"""Count hand-written lines of sources and of tests, by language.

    python -m tests.rules.count_lines [REVISION …]      of the files as they are, or of these revisions

Generated files say so in their first lines and are left out, and so are pictures, recordings and golden files.
"""

import io
import subprocess
import sys
import tarfile
from collections import Counter
from collections.abc import Iterator

from tests.support.source_files import ROOT

LANGUAGES = {".py": "Python", ".pyi": "Python", ".ts": "TypeScript", ".tsx": "TSX", ".css": "CSS"}
MARK, MARKED_LINES = "generated", 3
CEILING = 191_340 + 6_000  # what tiles, analysis beside the plots and a library for 500 drives may add
"""Of the sources, in lines. A feature that needs more says so where it raises it."""


def files_of(revision: str) -> Iterator[tuple[str, str]]:
    """Path and text of each file of a language; "" for the files as they are, those not yet in git too."""
    if not revision:
        requests = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
        names = subprocess.run(requests, cwd=ROOT, capture_output=True, check=True, text=True).stdout.split("\0")
        for path in (ROOT / name for name in names if name):
            if path.suffix in LANGUAGES and path.is_file() and not path.is_symlink():
                yield path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")
        return
    packed = subprocess.run(["git", "archive", revision], cwd=ROOT, capture_output=True, check=True).stdout
    with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
        for member in archive:
            suffix = "." + member.name.rpartition(".")[2]
            if member.isfile() and suffix in LANGUAGES and (file := archive.extractfile(member)):
                yield member.name, file.read().decode()


def is_test(name: str) -> bool:
    """Whether a file is a test or helps tests."""
    return name.startswith("tests/") or ".test." in name or name.startswith(("web/tests/", "web/src/testing/"))


def counts(revision: str = "") -> Counter[tuple[str, str]]:
    """Lines by kind ("sources", "tests") and language."""
    results: Counter[tuple[str, str]] = Counter()
    for name, text in files_of(revision):
        lines = text.splitlines()
        if "/golden/" in name or any(MARK in line.lower() for line in lines[:MARKED_LINES]):
            continue
        results["tests" if is_test(name) else "sources", LANGUAGES["." + name.rpartition(".")[2]]] += len(lines)
    return results


def total(results: Counter[tuple[str, str]], kind: str) -> int:
    """Lines of one kind in all languages."""
    return sum(lines for (one, _), lines in results.items() if one == kind)


def main(revisions: list[str]) -> int:
    """The command line."""
    for revision in revisions or [""]:
        result = counts(revision)
        print(revision or "as they are")
        for kind in ("sources", "tests"):
            parts = ", ".join(
                f"{language} {lines:,}" for (one, language), lines in sorted(result.items()) if one == kind
            )
            print(f"  {kind:8} {total(result, kind):>8,}   {parts}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
