"""The house stands as drawn: which way imports point, how long files are, what may not be in them.

    web → (wire) → server → recordings → protocols        never back

Read from the sources themselves (with `ast`, without importing), so a broken arrow fails here with file and line.
"""

from __future__ import annotations

import ast
import json
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests import audit
from tests.server_process import ROOT

HOUSES = ("protocols", "recordings", "server")
KNOWS = {"protocols": {"protocols"}, "recordings": {"recordings", "protocols"}, "server": set(HOUSES)}

# What a pure decoder has no business with: sockets, threads, sleeps, clocks, processes, servers.
IMPURE = {
    *("asyncio", "concurrent", "fastapi", "httpx", "multiprocessing", "pty", "select", "selectors", "serial", "signal"),
    *("socket", "socketserver", "ssl", "starlette", "subprocess", "threading", "time", "tty", "uvicorn", "websockets"),
}
SERVING = {"asyncio", "fastapi", "starlette", "uvicorn", "websockets"}

# Tables as data: rows of a specification, one after the other.
TABLES = {"protocols/xbus/data_identifiers.py", "protocols/xbus/messages.py"}
CODE = {".py", ".ts", ".tsx", ".js", ".css", ".html"}
LONGEST = 500


def python_files(*folders: str) -> Iterator[Path]:
    """Sources of these folders, built pages left out."""
    for folder in folders:
        yield from sorted((ROOT / folder).rglob("*.py"))


def imports(path: Path) -> Iterator[tuple[int, str]]:
    """Line and full name of every module that a file imports, wherever in it."""
    package = path.relative_to(ROOT).with_suffix("").parts[:-1]
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            base = ".".join([*above, *([node.module] if node.module else [])])
            yield node.lineno, base
            yield from ((node.lineno, f"{base}.{alias.name}") for alias in node.names)


def tracked() -> list[Path]:
    """Files in git, and those about to be."""
    asked = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    try:
        names = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout")
    return [path for name in names.split("\0") if name and (path := ROOT / name).is_file()]


@pytest.mark.parametrize("house", HOUSES)
def test_arrows_point_one_way(house: str) -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{line} imports {module}"
        for path in python_files(house)
        for line, module in imports(path)
        if (top := module.split(".")[0]) in {*HOUSES, "web", "tests"} and top not in KNOWS[house]
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(("house", "forbidden"), [("protocols", IMPURE), ("recordings", SERVING)])
def test_only_the_server_meets_the_world(house: str, forbidden: set[str]) -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{line} imports {module}"
        for path in python_files(house)
        for line, module in imports(path)
        if module.split(".")[0] in forbidden
    ]
    assert not wrong, "\n".join(wrong)


def test_protocols_read_no_clock() -> None:
    clocks = {"now", "utcnow", "today"}
    wrong = [
        f"{path.relative_to(ROOT)}:{node.lineno} calls {ast.unparse(node.func)}"
        for path in python_files("protocols")
        for node in ast.walk(ast.parse(path.read_text()))
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
        allowed = shipped | (set(package["devDependencies"]) if ".test." in path.name else set())
        for name in pattern.findall(path.read_text()):
            if name.startswith("."):
                # Vectors are shared by both languages, so tests of the page read them where they are.
                homes = [source, ROOT / "tests" / "golden"] if ".test." in path.name else [source]
                inside = any((path.parent / name).resolve().is_relative_to(home) for home in homes)
            else:
                parts = name.split("/")
                inside = "/".join(parts[: 2 if name.startswith("@") else 1]) in allowed
                inside = inside or (".test." in path.name and name.startswith("node:"))
            if not inside:
                wrong.append(f"{path.relative_to(ROOT)} imports {name}")
    assert not wrong, "\n".join(wrong)


def test_no_code_file_is_long() -> None:
    long = [
        f"{name}: {lines} lines"
        for path in tracked()
        if path.suffix in CODE and (name := path.relative_to(ROOT).as_posix()) not in TABLES
        if (lines := len(path.read_text().splitlines())) > LONGEST
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
        for number, line in enumerate(text.splitlines(), 1):
            if found := home.search(line) or private.search(line):
                wrong.append(f"{path.relative_to(ROOT)}:{number}: {found[0]}")
    assert not wrong, "\n".join(wrong)


def test_lock_files_name_public_hosts_only() -> None:
    # As committed (or about to be): whoever runs this with an index of their own may have a lock file of their own.
    asked = subprocess.run(["git", "show", ":uv.lock"], cwd=ROOT, capture_output=True, text=True, check=False)
    lock = asked.stdout if asked.returncode == 0 else (ROOT / "uv.lock").read_text()
    assert set(re.findall(r"https?://([^/\"]+)", lock)) <= {"pypi.org", "files.pythonhosted.org"}
    packages = json.loads((ROOT / "web" / "package-lock.json").read_text())["packages"]
    assert [name for name, row in packages.items() if "resolved" in row] == []
    assert all("integrity" in row for name, row in packages.items() if name)


def test_what_we_link_is_permissive() -> None:
    wrong = audit.unfree_linked()
    assert not wrong, "\n".join(wrong)


def test_what_the_page_ships_is_permissive() -> None:
    wrong = audit.unfree_shipped()
    assert not wrong, "\n".join(wrong)


def test_the_readme_is_true() -> None:
    readme = (ROOT / "README.md").read_text()
    start = "python3 -m venv .venv && .venv/bin/pip install uv && .venv/bin/uv run"
    serve, check = f"{start} --no-dev imuscope", f"{start} tests/check.py"
    assert serve in readme
    assert check in readme
    assert check in (ROOT / ".ci" / "run").read_text()
    links = re.findall(r"\]\((?!https?://|#)([^)#]+)", readme)
    assert [link for link in links if not (ROOT / link).exists()] == []


@pytest.mark.parametrize("name", ["CONTRIBUTING.md", "docs/architecture.md"])
def test_a_document_names_files_that_exist(name: str) -> None:
    text = (ROOT / name).read_text()
    named = re.findall(r"\b((?:protocols|recordings|server|web|tests)/[\w/.-]*[\w/])", text)
    links = [str(Path(name).parent / link) for link in re.findall(r"\]\((?!https?://|#)([^)#]+)", text)]
    assert len(named) > 3
    assert [path for path in [*named, *links] if not (ROOT / path).exists()] == []
