"""Rooms: arrows between folders, files beside one another, docstrings of packages."""

from collections import Counter

from tests.rules.rooms import ARROWS, HOUSES, graph_of, imports_of, page_files, reach, reduced, table_of
from tests.support.each_row import each_row
from tests.support.source_files import ROOT, facts_of, module_docstring, python_files

TOP, MAX_ROOM_FILES = 12, 35


@each_row("house", HOUSES)
def test_a_house_imports_only_those_below_it(house: str) -> None:
    allowed = HOUSES[HOUSES.index(house) :]
    wrong = [
        f"{path.relative_to(ROOT)}:{line} imports {module}"
        for path in python_files(house)
        for line, module in facts_of(path).imports
        if (top := module.split(".")[0]) in {*HOUSES, "web", "tests"} and top not in allowed
    ]
    assert not wrong, "\n".join(wrong)


@each_row("folder", ARROWS)
def test_rows_of_the_table_name_rows_above(folder: str) -> None:
    parts = list(table_of(folder))
    wrong = [
        f"{part} <- {other}"
        for part, others in table_of(folder).items()
        for other in others
        if other not in parts[: parts.index(part)]
    ]
    assert not wrong, ", ".join(wrong)


@each_row("folder", ARROWS)
def test_rooms_import_what_the_table_states(folder: str) -> None:
    reached = reach(table_of(folder))
    wrong = [
        f"{path.relative_to(ROOT)}:{line} imports {other}"
        for path, line, part, other in imports_of(folder)
        if other not in reached.get(part, ())
    ]
    assert not wrong, "\n".join(wrong)


@each_row("folder", ARROWS)
def test_the_table_has_each_part_and_no_arrow_that_nothing_uses(folder: str) -> None:
    graph = graph_of(folder)
    assert set(table_of(folder)) == set(graph)
    arrows = {(part, other) for part, names in table_of(folder).items() for other in names}
    assert arrows == set(reduced(graph, set(graph)))


def test_a_folder_can_be_read_at_a_glance() -> None:
    """At most 12 files at the top of a package and of the tests, 35 in any room."""
    files = [*python_files(*HOUSES, "tests"), *page_files()]
    counts = Counter(path.parent for path in files if path.name != "__init__.py")
    tops = {ROOT / top for top in (*HOUSES, "tests", *(f"tests/{house}" for house in HOUSES))}
    wrong = [
        f"{folder.relative_to(ROOT)}: {number} files"
        for folder, number in counts.items()
        if number > (TOP if folder in tops else MAX_ROOM_FILES)
    ]
    assert not wrong, ", ".join(wrong)


@each_row("house", HOUSES)
def test_a_package_states_what_it_is(house: str) -> None:
    packages = [ROOT / house, *(path.parent for path in python_files(house) if path.name == "__init__.py")]
    wrong = [
        f"{folder.relative_to(ROOT)}/__init__.py"
        for folder in packages
        if not (folder / "__init__.py").exists() or not (module_docstring(folder / "__init__.py") or "").strip()
    ]
    assert not wrong, "packages without a docstring: " + ", ".join(wrong)
