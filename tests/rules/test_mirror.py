"""Tests mirror the sources: where a test lies, and what it is called, says what it tests."""

from collections.abc import Iterator
from pathlib import Path

from tests.rules.rooms import HOUSES
from tests.support.each_row import each_row
from tests.support.source_files import ROOT, python_files

TESTS = ROOT / "tests"
NOT_OF_ONE_SOURCE = {
    "protocols/test_census.py": "counts the vectors of all families",
    "protocols/test_floods.py": "what endless input costs, for each family",
    "protocols/test_inspect.py": "lists of frames, for each family",
    "protocols/test_properties.py": "properties that every family has",
    "server/test_causes.py": "what proves each cause that any part states",
    "server/test_long_runs.py": "what no part may keep for weeks",
    "server/test_resource_limits.py": "what a client, a query, a pipe or a file may use of each part",
}
"""Tests of a whole house, which therefore lie at its top, and why. Tests of several houses are in tests/whole."""


def subjects(folder: Path) -> Iterator[str]:
    """Names that a test in the mirror of a folder may begin with: the folder's own, its files and its rooms."""
    yield folder.name
    for path in folder.iterdir():
        if path.suffix == ".py" or (path / "__init__.py").is_file():
            yield path.stem


def is_mirror(test: Path) -> bool:
    """Whether a test lies in the mirror of a folder and is called after it, or after a source or a room in it.

    More words may follow, for several tests of one source: `test_recorder_messages.py` for `recorder.py`.
    """
    folder = ROOT / test.parent.relative_to(TESTS)
    name = test.stem.removeprefix("test_")
    return folder.is_dir() and any(f"{name}_".startswith(f"{subject}_") for subject in subjects(folder))


def mirrored_tests() -> list[Path]:
    """Tests of the houses."""
    files = python_files(*(f"tests/{house}" for house in HOUSES))
    return [path for path in files if path.name.startswith("test_")]


def test_a_test_lies_where_its_source_does() -> None:
    tests = mirrored_tests()
    assert len(tests) > 200
    wrong = {path.relative_to(TESTS).as_posix() for path in tests if not is_mirror(path)}
    assert not (result := wrong - NOT_OF_ONE_SOURCE.keys()), "no source of this name there: " + ", ".join(
        sorted(result)
    )
    assert not (gone := NOT_OF_ONE_SOURCE.keys() - wrong), "no longer needed in the list: " + ", ".join(sorted(gone))


@each_row(
    ("name", "expected"),
    [
        ("server/devices/link/test_session.py", True),
        ("server/devices/link/test_session_batching.py", True),
        ("server/devices/link/test_sessionbatching.py", False),
        ("server/devices/link/test_batching.py", False),
        ("server/devices/test_link.py", True),
        ("server/devices/link/test_link.py", True),
        ("server/live/test_session.py", False),
    ],
)
def test_a_test_of_nothing_is_found(name: str, expected: bool) -> None:
    assert is_mirror(TESTS / name) == expected
