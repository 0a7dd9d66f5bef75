"""An extension in a package of its own: the one of docs/add-an-extension.md, installed as written there."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page

from imuscope.protocols.plugins import ProtocolPlugin
from imuscope.server.extension import GROUP, load_extensions
from tests.chromium import until
from tests.server_process import tied
from tests.source_files import PACKAGE, ROOT
from tests.timeouts import PATIENCE_S, status_of
from tests.waiting import block_until

DOCUMENT = (ROOT / "docs" / "add-an-extension.md").read_text()
FILES = ("__init__.py", "counter.py", "routes.py", "command.py")


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Environment of processes that find the package, as an installer writes it."""
    folder = tmp_path_factory.mktemp("site")
    [declared] = re.findall(r"^```toml\n(.*?)^```", DOCUMENT, re.M | re.S)
    project = tomllib.loads(declared)["project"]
    about = folder / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    rows = "".join(f"{name} = {value}\n" for name, value in project["entry-points"][GROUP].items())
    (about / "entry_points.txt").write_text(f"[{GROUP}]\n{rows}")
    blocks = re.findall(r"^```python\n(.*?)^```", DOCUMENT, re.M | re.S)
    (folder / "imuscope_total").mkdir()
    for name, text in zip(FILES, blocks, strict=True):
        (folder / "imuscope_total" / name).write_text(text)
    (folder / "imuscope_total" / "page").mkdir()
    [module] = re.findall(r"^```js\n(.*?)^```", DOCUMENT, re.M | re.S)
    (folder / "imuscope_total" / "page" / "index.js").write_text(module)
    return os.environ | {"PYTHONPATH": os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])}


@pytest.fixture
def url(environment: dict[str, str], tmp_path: Path) -> Iterator[str]:
    words = ["serve", "sim:xbus?rate=50", "--host", "127.0.0.1", "--port", "0", "--data", str(tmp_path)]
    command = tied([sys.executable, "-m", PACKAGE, *words])
    with subprocess.Popen(command, env=environment, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield next(line for line in process.stdout if line.startswith("http://")).strip()
        finally:
            process.terminate()


def test_it_brings_a_part_a_route_and_a_command(url: str, environment: dict[str, str]) -> None:
    def samples() -> int:
        with urllib.request.urlopen(f"{url}api/total", timeout=PATIENCE_S) as answer:
            return int(json.load(answer)["samples"])

    block_until(samples, "samples are counted")
    before = samples()
    words = [sys.executable, "-m", PACKAGE, "total", url]
    printed = subprocess.check_output(words, env=environment, cwd=ROOT, text=True, timeout=PATIENCE_S)
    assert int(printed) >= before
    with urllib.request.urlopen(f"{url}openapi.json", timeout=PATIENCE_S) as answer:
        assert "/api/total" in json.load(answer)["paths"]


def test_it_brings_a_panel(url: str, open_page: Callable[..., Page]) -> None:
    with urllib.request.urlopen(f"{url}api/extensions", timeout=PATIENCE_S) as answer:
        [total] = [one for one in json.load(answer) if one["package"]]
    assert total == {
        "name": "total",
        "title": "Total",
        "package": "imuscope-total 1.0",
        "module": "extensions/total/index.js",
    }
    page = open_page(url)
    until(
        page,
        """[...document.querySelectorAll(".foot-note")].some(one => /^[1-9]\\d* samples, \\w/.test(one.textContent))""",
    )
    assert page.get_by_role("heading", name="Total", exact=True).is_visible()


def test_only_files_of_the_package_are_passed_on(url: str) -> None:
    for path, status in (
        ("extensions/total/index.js", 200),
        ("extensions/total/../counter.py", 404),
        ("extensions/total/%2e%2e/counter.py", 404),
        ("extensions/viser/index.js", 404),
        ("extensions/nothing/index.js", 404),
    ):
        assert status_of(f"{url}{path}") == status, path


@pytest.mark.parametrize("broken", ["counter.py", "routes.py", "command.py"])
def test_one_that_fails_when_it_is_used_stops_nothing(environment: dict[str, str], tmp_path: Path, broken: str) -> None:
    """An import error in a package of others ended every command."""
    site = Path(environment["PYTHONPATH"].split(os.pathsep)[0])
    shutil.copytree(site, tmp_path / "site")
    (tmp_path / "site" / "imuscope_total" / broken).write_text("raise RuntimeError('of the package')\n")
    there = environment | {"PYTHONPATH": str(tmp_path / "site")}
    words = ["serve", "sim:xbus", "--host", "127.0.0.1", "--port", "0", "--data", str(tmp_path / "data")]
    command = tied([sys.executable, "-m", PACKAGE, *words])
    pipe = subprocess.PIPE
    with subprocess.Popen(command, env=there, cwd=ROOT, stdout=pipe, stderr=subprocess.STDOUT, text=True) as process:
        try:
            assert process.stdout is not None
            lines = []
            for line in process.stdout:
                lines.append(line)
                if "cannot be used" in line:
                    break
            url = next(line for line in lines if line.startswith("http://")).strip()
            with urllib.request.urlopen(f"{url}api/devices", timeout=PATIENCE_S) as answer:
                assert json.load(answer)
        finally:
            process.terminate()
    assert "The extension 'total' of imuscope-total 1.0 cannot be used: RuntimeError: of the package." in lines[-1]


def test_doctor_names_what_cannot_be_used(environment: dict[str, str], tmp_path: Path) -> None:
    site = Path(environment["PYTHONPATH"].split(os.pathsep)[0])
    shutil.copytree(site, tmp_path / "site")
    (tmp_path / "site" / "imuscope_total" / "__init__.py").write_text("raise RuntimeError('of the package')\n")
    words = [sys.executable, "-m", PACKAGE, "doctor", "--data", str(tmp_path / "data")]
    there = environment | {"PYTHONPATH": str(tmp_path / "site")}
    printed = subprocess.run(
        words, env=there, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert re.search(
        r"^warning +extension +The extension 'total' of imuscope-total 1\.0 cannot be used", printed.stdout, re.M
    )


def test_what_cannot_be_used_says_why_and_stops_nothing() -> None:
    plugins = [
        ProtocolPlugin("gone", "imuscope_of_nobody:EXTENSION", "imuscope-gone 1.0"),
        ProtocolPlugin("other", "json:loads", "imuscope-other 1.0"),
        ProtocolPlugin("later", "json:loads", "imuscope-later 1.0", 2),
        ProtocolPlugin("viser", "imuscope.server.extensions.viser:EXTENSION"),
        ProtocolPlugin("fleet", "imuscope.server.extensions.fleet:EXTENSION"),
    ]
    found, problems, _ = load_extensions(plugins)
    assert [one.name for one in found] == ["viser"]
    assert problems == [
        "The extension 'gone' of imuscope-gone 1.0 cannot be used: ModuleNotFoundError: No module named "
        "'imuscope_of_nobody'.",
        "The extension 'other' of imuscope-other 1.0 cannot be used: json:loads is not an Extension.",
        "The extension 'later' of imuscope-later 1.0 cannot be used: it is written for version 2 of the plug-in API, "
        "and this imuscope has version 1. Install a newer imuscope.",
        "The extension 'fleet' cannot be used without alarms. Install that, too.",
    ]
