"""An extension in a package of its own: the one of docs/add-an-extension.md, installed as written there."""

from __future__ import annotations

import json
import os
import re
import shutil
import tomllib
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from playwright.sync_api import Page

from imuscope.protocols.family.plugins import ProtocolPlugin
from imuscope.server.services.extension import GROUP, load_extensions
from tests.support.chromium import until
from tests.support.forking import fork_server
from tests.support.forking.fork_server import ForkServer
from tests.support.server_process import ROOT, ServerProcess, imuscope
from tests.support.timeouts import PATIENCE_S, status_of
from tests.support.waiting import block_until

DOCUMENT = (ROOT / "docs" / "add-an-extension.md").read_text()
FILES = ("__init__.py", "counter.py", "routes.py", "command.py")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the package, as an installer writes it."""
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
    return folder


@contextmanager
def finding(site: Path) -> Iterator[None]:
    """Processes that are started meanwhile find the package."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join([str(site), *filter(None, [os.environ.get("PYTHONPATH")])]))
        yield


@pytest.fixture(scope="module")
def own(site: Path) -> Iterator[ForkServer | None]:
    """Starts commands that find the package."""
    with finding(site):
        yield ForkServer() if fork_server.IS_THERE else None


@pytest.fixture(scope="module")
def url(own: ForkServer | None, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    data = tmp_path_factory.mktemp("data")
    with ServerProcess("sim:xbus?rate=50", data=data, fresh=own is None, by=own) as server:
        yield f"{server.url}/"


def test_it_brings_a_part_a_route_and_a_command(url: str, own: ForkServer | None) -> None:
    def samples() -> int:
        with urllib.request.urlopen(f"{url}api/total", timeout=PATIENCE_S) as answer:
            return int(json.load(answer)["samples"])

    block_until(samples, "samples are counted")
    before = samples()
    done = imuscope("total", url, fresh=own is None, by=own)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) >= before
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


def renamed(site: Path, folder: Path, name: str) -> Path:
    """A copy of the package, by another name in all that it is called."""
    for path in site.rglob("*"):
        if path.is_file() and path.suffix != ".pyc":
            copy = folder / str(path.relative_to(site)).replace("total", name)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_text(path.read_text().replace("total", name).replace("the counter", f"the counter of {name}"))
    return folder / f"imuscope_{name}"


def test_those_that_fail_when_they_are_used_stop_nothing(site: Path, tmp_path: Path) -> None:
    """An import error in a package of others ended every command."""
    texts = {"open": "its route /figures/open needs no token; put it below /api"}
    for name, broken in (("one", "counter.py"), ("two", "routes.py"), ("three", "command.py")):
        (renamed(site, tmp_path / "site", name) / broken).write_text("raise RuntimeError('of the package')\n")
        texts[name] = "RuntimeError: of the package."
    routes = renamed(site, tmp_path / "site", "open") / "routes.py"
    routes.write_text(routes.read_text().replace('prefix="/api"', 'prefix="/figures"'))
    with finding(tmp_path / "site"), ServerProcess("sim:xbus", data=tmp_path / "data", fresh=True) as server:
        for name, words in texts.items():
            sentence = f"The extension '{name}' of imuscope-{name} 1.0 cannot be used: {words}"
            block_until(lambda: sentence in server.log, sentence)  # noqa: B023
        assert server.request("GET", "/api/devices")
        assert status_of(f"{server.url}/figures/open") == 404, "anyone could use it without a token"


def test_doctor_names_what_cannot_be_used(site: Path, tmp_path: Path) -> None:
    shutil.copytree(site, tmp_path / "site")
    (tmp_path / "site" / "imuscope_total" / "__init__.py").write_text("raise RuntimeError('of the package')\n")
    with finding(tmp_path / "site"):
        printed = imuscope("doctor", "--data", str(tmp_path / "data"), fresh=True)
    assert re.search(
        r"^warning +extension +The extension 'total' of imuscope-total 1\.0 cannot be used", printed.stdout, re.M
    )


def test_what_cannot_be_used_gives_the_reason_and_stops_nothing() -> None:
    plugins = [
        ProtocolPlugin("gone", "imuscope_of_nobody:EXTENSION", "imuscope-gone 1.0"),
        ProtocolPlugin("other", "json:loads", "imuscope-other 1.0"),
        ProtocolPlugin("later", "json:loads", "imuscope-later 1.0", 2),
        ProtocolPlugin("viser", "imuscope.server.extensions.viser:EXTENSION"),
        ProtocolPlugin("fleet", "imuscope.server.extensions.fleet:EXTENSION"),
    ]
    results, problems, _ = load_extensions(plugins)
    assert [one.name for one in results] == ["viser"]
    assert problems == [
        "The extension 'gone' of imuscope-gone 1.0 cannot be used: ModuleNotFoundError: No module named "
        "'imuscope_of_nobody'.",
        "The extension 'other' of imuscope-other 1.0 cannot be used: json:loads is not an Extension.",
        "The extension 'later' of imuscope-later 1.0 cannot be used: it is written for version 2 of the plug-in API, "
        "and this imuscope has version 1. Install a newer imuscope.",
        "The extension 'fleet' cannot be used without alarms. Install that, too.",
    ]
