"""Architecture rules: what exists once, length of files, forbidden contents. Rooms and arrows: test_rooms.py.

Read from the sources themselves (with `ast`, without importing), so a broken arrow fails here with file and line.
"""

import ast
import functools
import io
import json
import re
import subprocess
import tokenize
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.family.plugins import protocol_plugins
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.server.reference.blocks import anchor
from tests.browser.guide_pictures import FOLDER, MAX_BYTES, MOVING_MAX_BYTES, PAINTERS
from tests.rules import architecture_pictures
from tests.rules.rooms import HOUSES
from tests.support.each_row import each_row
from tests.support.source_files import ROOT, facts_of, python_files, text_of, tree_of

# Mechanisms that exist once: the file, and a pattern of further implementations.
ONE_PLACE = {
    "recordings/system/atomic_write.py": r"\bos\.replace\(|\baside\.replace\(",
    "protocols/arrays.py": r"^(Array|Ints|Bytes|Floats) = NDArray",
    "server/system/workers.py": r"create_subprocess_|\bmultiprocessing\b|\bsubprocess\.(Popen|run|call|check_\w+)\(",
    "server/concurrency/limiters.py": r"[+] \(?(now|\w+\.monotonic\(\)) - [\w.]+\)? \* [\w.]*(rate|per_s)|"
    r", now - \w*BURST",
    # a product of quaternions, a rotation matrix, ZYX angles to a quaternion and back
    "protocols/rotations.py": r"\b\w+ \* \w+ - \w+ \* \w+ - \w+ \* \w+ - |\b1 - (2|s) \* \(?\w+ ?(\*|\*\*)|"
    r"\bc\w* \* [cs]\w* \* [cs]\w*\b [+-]|spatial\.transform|arcsin\(np\.clip\(",
    "server/concurrency/backoff.py": r"min\(2 \* \w*(\.\w*)?(pause|retry|again|next)",
}

# Files that start processes without the worker, and why.
STARTS_A_PROCESS = {
    "server/extensions/shares/shared_port_link.py": "the holder outlives the server",
    "protocols/native/compiler/build.py": "runs the C compiler when a package is built, never in a server",
    "server/version.py": "asks git once; the build of the package runs it without ours",
    "server/extensions/rerun/assets.py": "runs once in a thread, at the first opening of the page",
}

# Modules forbidden in pure decoders: sockets, threads, sleeps, clocks, processes, servers.
IMPURE = {
    *("asyncio", "concurrent", "fastapi", "httpx", "multiprocessing", "pty", "select", "selectors", "serial", "signal"),
    *("socket", "socketserver", "ssl", "starlette", "subprocess", "threading", "time", "tty", "uvicorn", "websockets"),
}
SERVING = {"asyncio", "fastapi", "starlette", "uvicorn", "websockets"}

# Tables as data: rows of a specification, one after the other.
TABLES = {"protocols/xbus/data_identifiers.py", "protocols/xbus/messages.py"}
HTTP_API = "http-api.md"
GENERATED = {"web/src/wire/routes.ts", "web/src/wire/types.ts"}
CODE = {".py", ".ts", ".tsx", ".js", ".css", ".html"}
MAX_LINES = 500


IMPORT = re.compile(r"^[ \t]*(?:from|import)\b(?:[^\n(]*\([^)]*\)|[^\n]*)", re.MULTILINE)


@functools.cache
def tracked() -> Sequence[Path]:
    """Files in git, and those about to be."""
    requests = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    try:
        names = subprocess.run(requests, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout")
    return tuple(path for name in names.split("\0") if name and (path := ROOT / name).is_file())


# How a family is named in code: its protocol, vendor, products. Prose (comments, docstrings, documents) may name them.
NAMES_A_FAMILY = re.compile(
    r"xbus|idtp|mtdata2|xsens|inertial.?sense|(?<![a-z])(?:isb|indt|imx|gpx|mti|mip)(?![a-z])|microstrain",
    re.IGNORECASE,
)


def code_lines(path: Path, pattern: re.Pattern[str]) -> Iterator[str]:
    """Lines of Python with the pattern, comments and docstrings left out."""
    text = text_of(path)
    if not pattern.search(text):
        return
    lines = text.splitlines()
    match = {number for number, line in enumerate(lines, 1) if pattern.search(line)}
    match -= facts_of(path).prose
    if any("#" in lines[number - 1] for number in match):
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            line, column = token.start
            if token.type == tokenize.COMMENT and line in match and not pattern.search(token.line[:column]):
                match.remove(line)
    yield from (f"{path.relative_to(ROOT)}:{line}" for line in sorted(match))


def code_outside_families(pattern: re.Pattern[str]) -> list[str]:
    """Lines of Python of the program, outside the folders of the families."""
    inside = [ROOT.joinpath(*plugin.module.split(".")[1:-1]) for plugin in protocol_plugins() if not plugin.package]
    return [
        line
        for path in python_files(*HOUSES)
        if not any(path.is_relative_to(folder) for folder in inside)
        for line in code_lines(path, pattern)
    ]


def test_no_line_outside_the_families_names_one() -> None:
    assert not (result := code_outside_families(NAMES_A_FAMILY)), "\n".join(result)


def names_of_options() -> re.Pattern[str]:
    """Decode options of the built-in families, as declared and as keywords of their decoders.

    Names of one word ("key", "schema") have other meanings too. "below_min_mode" is a reason of a reject.
    """
    names = {
        name
        for family in PROTOCOLS.values()
        for option in family.decoding.options
        for name in (option.name, option.keyword)
        if "_" in name
    }
    assert len(names) > 4
    either = "|".join(sorted(name.replace("_", "[_-]") for name in names))
    return re.compile(rf"(?<!below_)(?<![a-z])(?:{either})(?![a-z])")


def test_no_line_outside_the_families_names_their_decode_options() -> None:
    pattern = names_of_options()
    families = [ROOT / "protocols" / name for name in PROTOCOLS]
    generated = ("types.ts", "routes.ts")
    page = ROOT / "web" / "src"
    paths = [path for path in python_files(*HOUSES) if not any(path.is_relative_to(one) for one in families)]
    paths += [path for path in (*page.rglob("*.ts"), *page.rglob("*.tsx")) if path.name not in generated]
    wrong = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in sorted(paths)
        if ".test." not in path.name
        for number, line in enumerate(text_of(path).splitlines(), 1)
        if pattern.search(line)
    ]
    assert not wrong, "\n".join(wrong)


def test_no_line_of_the_page_names_a_family() -> None:
    assert not (result := code_of_page(NAMES_A_FAMILY)), "\n".join(result)


def test_no_line_outside_the_families_names_a_field_of_their_tables() -> None:
    """Fields of an entry in a list of outputs; names of one word have other meanings too."""
    tables = [
        table for family in PROTOCOLS.values() for table in family.configuration.tables(DeviceContext(), {}).values()
    ]
    names = {name for table in tables for name in (table.key, table.rate, table.interval) if "_" in name}
    assert len(names) > 2
    pattern = re.compile("|".join(names))
    results = [*code_of_page(pattern), *code_outside_families(pattern)]
    assert not results, "\n".join(results)


def code_of_page(pattern: re.Pattern[str]) -> list[str]:
    """Lines of TypeScript with the pattern; comments, tests and generated files left out."""
    source = ROOT / "web" / "src"
    comment = re.compile(r"/\*.*?\*/|(?<!:)//[^\n]*", re.DOTALL)
    return [
        f"{path.relative_to(ROOT)}: {line.strip()}"
        for path in sorted([*source.rglob("*.ts"), *source.rglob("*.tsx")])
        if ".test." not in path.name and path.name not in ("types.ts", "routes.ts", "fixtures.ts", "recorded.ts")
        for line in comment.sub("", path.read_text()).splitlines()
        if pattern.search(line)
    ]


def test_tests_import_from_helper_modules_only() -> None:
    """Shared helpers are in helper modules; browser tests, which share page sizes, are exempt."""
    wrong = [
        f"{path.relative_to(ROOT)}:{line} {module}"
        for path in python_files("tests")
        if path.parent.name != "browser" and any("test_" in results for results in IMPORT.findall(text_of(path)))
        for line, module in facts_of(path).imports
        if module.startswith("tests.") and any(part.startswith("test_") for part in module.split("."))
    ]
    assert not wrong, "\n".join(wrong)


@each_row("place", ONE_PLACE)
def test_each_mechanism_is_in_one_place(place: str) -> None:
    pattern = re.compile(ONE_PLACE[place])
    wrong = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in python_files(*HOUSES)
        if path.relative_to(ROOT).as_posix()
        not in ({place, *STARTS_A_PROCESS} if place == "server/system/workers.py" else {place})
        for number, line in enumerate(text_of(path).splitlines(), 1)
        if pattern.search(line)
    ]
    assert not wrong, f"use {place}:\n" + "\n".join(wrong)


@each_row(("house", "forbidden"), [("protocols", IMPURE), ("recordings", SERVING)])
def test_only_the_server_uses_network_and_clock(house: str, forbidden: set[str]) -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{line} imports {module}"
        for path in python_files(house)
        if path != ROOT / "protocols/native/compiler/build.py"  # runs when a package is built
        for line, module in facts_of(path).imports
        if module.split(".")[0] in forbidden
    ]
    assert not wrong, "\n".join(wrong)


def test_no_two_classes_share_a_name() -> None:
    """A class name leads to one file. Private classes, which stay within their file, are left out."""
    places: dict[str, list[str]] = {}
    for path in python_files(*HOUSES):
        for line, name in facts_of(path).classes:
            if not name.startswith("_"):
                places.setdefault(name, []).append(f"{path.relative_to(ROOT)}:{line}")
    assert len(places) > 400
    assert not {name: where for name, where in places.items() if len(where) > 1}


def test_protocols_do_not_read_clocks() -> None:
    clocks = {"now", "utcnow", "today"}
    wrong = [
        f"{path.relative_to(ROOT)}:{node.lineno} calls {ast.unparse(node.func)}"
        for path in python_files("protocols")
        if any(f".{clock}(" in text_of(path) for clock in clocks)
        for node in ast.walk(tree_of(path))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr in clocks
        and "date" in ast.unparse(node.func.value)
    ]
    assert not wrong, "\n".join(wrong)


def test_the_page_imports_nothing_outside_web() -> None:
    package = json.loads((ROOT / "web" / "package.json").read_text())
    shipped = set(package["dependencies"])
    source = ROOT / "web" / "src"
    pattern = re.compile(r"""^[^"'\n]*\b(?:from |import |import\()["']([^"'\n]+)["']""", re.MULTILINE)
    wrong = []
    for path in sorted([*source.rglob("*.ts"), *source.rglob("*.tsx")]):
        is_test = ".test." in path.name or path.parent == source / "testing"
        allowed = shipped | (set(package["devDependencies"]) if is_test else set())
        for name in pattern.findall(path.read_text()):
            if name.startswith("."):
                # Vectors are shared by both languages, so tests of the page read them where they are.
                homes = [source, ROOT / "tests" / "golden"] if is_test else [source]
                place = (path.parent / name).resolve()
                inside = any(place.is_relative_to(home) for home in homes)
                inside = inside and (is_test or not place.is_relative_to(source / "testing"))
            else:
                parts = name.split("/")
                inside = "/".join(parts[: 2 if name.startswith("@") else 1]) in allowed
                inside = inside or (is_test and name.startswith("node:"))
            if not inside:
                wrong.append(f"{path.relative_to(ROOT)} imports {name}")
    assert not wrong, "\n".join(wrong)


def test_no_code_file_is_long() -> None:
    long = [
        f"{name}: {lines} lines"
        for path in tracked()
        if path.suffix in CODE and (name := path.relative_to(ROOT).as_posix()) not in TABLES | GENERATED
        if (lines := len(path.read_text().splitlines())) > MAX_LINES
    ]
    assert not long, "\n".join(long)


def test_no_machine_path_and_no_private_host() -> None:
    home = re.compile(r"(?<![\w.~$}])/(?:root|work|home/\w+|Users/\w+)/")
    private = re.compile(r"https?://[\w.-]*(?:artifactory|nexus|mirror|proxy|internal|corp)[\w.-]*", re.I)
    wrong = []
    for path in tracked():
        try:
            text = path.read_text()
        except UnicodeDecodeError:
            continue  # a picture, a capture
        if not (home.search(text) or private.search(text)):
            continue  # as are all, so lines need no look
        for number, line in enumerate(text.splitlines(), 1):
            if match := home.search(line) or private.search(line):
                wrong.append(f"{path.relative_to(ROOT)}:{number}: {match[0]}")
    assert not wrong, "\n".join(wrong)


def test_lock_files_name_public_hosts_only() -> None:
    # As committed or staged: a user with another package index may have a different lock file.
    request = subprocess.run(["git", "show", ":uv.lock"], cwd=ROOT, capture_output=True, text=True, check=False)
    lock = request.stdout if request.returncode == 0 else (ROOT / "uv.lock").read_text()
    assert set(re.findall(r"https?://([^/\"]+)", lock)) <= {"pypi.org", "files.pythonhosted.org"}
    packages = json.loads((ROOT / "web" / "package-lock.json").read_text())["packages"]
    assert [name for name, row in packages.items() if "resolved" in row] == []
    assert all("integrity" in row for name, row in packages.items() if name)


def test_the_readme_is_true() -> None:
    readme = (ROOT / "README.md").read_text()
    start = "python3 -m venv .venv && .venv/bin/pip install uv && .venv/bin/uv run"
    serve, check = f"{start} --no-dev imuscope", f"{start} tests/check.py"
    assert serve in readme
    assert check in readme
    assert check in (ROOT / ".ci" / "run").read_text()
    assert len(readme.splitlines()) <= 80, "what is longer belongs into docs/"


@each_row("name", ["CONTRIBUTING.md", "docs/architecture.md"])
def test_a_document_names_files_that_exist(name: str) -> None:
    named = re.findall(r"\b((?:protocols|recordings|server|web|tests)/[\w/.-]*[\w/])", (ROOT / name).read_text())
    assert len(named) > 3
    assert [path for path in named if not (ROOT / path).exists()] == []


def test_the_pictures_of_the_architecture_are_not_stale() -> None:
    document = architecture_pictures.DOCUMENT.read_text()
    assert architecture_pictures.with_pictures(document) == document, "run python -m tests.rules.architecture_pictures"


def test_every_link_of_a_document_leads_to_a_file_and_a_heading() -> None:
    wrong = []
    for path in tracked():
        if path.suffix != ".md" or "golden" in path.parts:
            continue
        for link in re.findall(r"\]\((?!https?://)([^)\s]+)", path.read_text()):
            place, _, fragment = link.partition("#")
            target = (path.parent / place).resolve() if place else path
            if target.name == HTTP_API:  # it is not in git: building the site checks these links
                continue
            if not target.exists() or (fragment and fragment not in headings(target)):
                wrong.append(f"{path.relative_to(ROOT)}: {link}")
    assert not wrong, "\n".join(wrong)


@functools.cache
def headings(path: Path) -> set[str]:
    """Fragments that address the headings of a document."""
    return {anchor(title) for title in re.findall(r"^#+ (.+)$", path.read_text(), re.MULTILINE)}


def test_pictures_of_the_guide_are_used_and_small() -> None:
    documents = "".join(path.read_text() for path in tracked() if path.suffix == ".md")
    pictures = [path for path in tracked() if path.parent == FOLDER]
    assert {path.stem for path in pictures} == set(PAINTERS)
    assert [path.name for path in pictures if f"images/{path.name})" not in documents] == []
    most = {".png": MAX_BYTES, ".webp": MOVING_MAX_BYTES}
    assert [path.name for path in pictures if path.stat().st_size > most[path.suffix]] == []
