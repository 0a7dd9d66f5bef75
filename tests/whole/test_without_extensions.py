"""The heart of the program without its extensions: a folder that is left out leaves a server and a page without it."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import fields
from http.client import HTTPConnection
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from imuscope.protocols.family.plugins import plugins_of, protocol_plugins
from imuscope.server.services.extension import extensions
from imuscope.server.services.services import Services
from imuscope.server.settings.extension_settings import GROUP, SHIPPED, extension_settings
from tests.support.each_row import each_row
from tests.support.left_out import groups_to_leave_out
from tests.support.server_process import tied
from tests.support.source_files import PACKAGE, ROOT, facts_of, python_files, text_of
from tests.support.timeouts import PATIENCE_S, status_of

NAMES = sorted(path.name for path in (ROOT / "server" / "extensions").iterdir() if (path / "__init__.py").is_file())
FOLDERS = ("protocols", "recordings", "server")
TESTS_OF_THE_HEART = ("protocols", "recordings", "server")
TESTS_OF_EXTENSIONS = ROOT / "tests" / "server" / "extensions"
COPIED = (*FOLDERS, PACKAGE, "pyproject.toml")
ROUTES = {
    "alarms": "/api/alarms",
    "analysis": "/api/analysis",
    "fleet": "/api/uploads",
    "calibration": "/api/devices/1/calibration",
    "viser": "/viser",
    "rerun": "/rerun/",
    "ros2": "/api/ros2",
    "shares": "/api/devices/1/shares",
}
"""A path that only the extension answers."""


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the program, with what Python has compiled of it: only what a process writes meanwhile is left out."""
    folder = tmp_path_factory.mktemp("tree")
    ignored = shutil.ignore_patterns("*.pyc.*")
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name, symlinks=True, ignore=ignored)
        else:
            shutil.copy(ROOT / name, folder / name)
    return folder


@contextlib.contextmanager
def left_out_of(tree: Path, names: Sequence[str], aside: Path) -> Iterator[None]:
    """Without the folders of these extensions, meanwhile."""
    folder = tree / "server" / "extensions"
    for name in names:
        (folder / name).rename(aside / name)
    try:
        yield
    finally:
        for name in names:
            (aside / name).rename(folder / name)


FORKS = """
import ctypes, gc, importlib, json, os, runpy, signal, sys
own, errors = sys.argv[1:]
for name in ("server.app", "server.links.simulator", "protocols.simulator.trajectory"):
    importlib.import_module(f"{own}.{name}")
for name in ("uvicorn.loops.auto", "uvicorn.protocols.http.auto", "uvicorn.lifespan.on", "anyio._backends._asyncio"):
    importlib.import_module(name)
gc.collect()
gc.freeze()
print("ready", flush=True)
for line in sys.stdin:
    if (pid := os.fork()) == 0:
        ctypes.CDLL(None).prctl(1, int(signal.SIGTERM))  # PR_SET_PDEATHSIG
        os.dup2(os.open(errors, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        importlib.invalidate_caches()
        sys.argv[1:] = json.loads(line)
        runpy.run_module(own, run_name="__main__", alter_sys=True)
        sys.exit()
    print("begun", pid, flush=True)
    print("ended", os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), flush=True)
"""
"""A process that has imported the heart while no extension was there, and forks for each command line that it is given.
Extensions are found and imported after that, in the folders that are there then.
"""


class Commands:
    """`imuscope WORDS` in the tree, one after the other."""

    def __init__(self, tree: Path, aside: Path) -> None:
        self.errors = aside / "errors.txt"  # of the last command
        with left_out_of(tree, NAMES, aside):
            self._start(tree)

    def _start(self, tree: Path) -> None:
        self._process = subprocess.Popen(
            tied([sys.executable, "-c", FORKS, PACKAGE, str(self.errors)]),
            env=os.environ | {"PYTHONPATH": str(tree), "PYTHONUNBUFFERED": "1"},
            cwd=tree,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.line("ready")

    def begin(self, *words: str) -> int:
        """Process id of the command, which runs."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(words) + "\n")
        self._process.stdin.flush()
        return int(self.line("begun ").split()[1])

    def line(self, start: str) -> str:
        """The next line of output that starts with this, or with the end of the command."""
        assert self._process.stdout is not None
        return next(line for line in self._process.stdout if line.startswith((start, "ended "))).strip()

    def end(self) -> int:
        """Exit status of the command, which is waited for."""
        return int(self.line("ended ").split()[1])

    def close(self) -> None:
        with self._process as process:
            process.terminate()


@pytest.fixture(scope="module")
def commands(tree: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Commands]:
    running = Commands(tree, tmp_path_factory.mktemp("aside"))
    yield running
    running.close()


def served(commands: Commands, data: Path) -> Iterator[str]:
    """Address of a server of that tree."""
    pid = commands.begin("serve", "sim:xbus", "--host", "127.0.0.1", "--port", "0", "--data", str(data))
    url = commands.line("http://")
    assert url.startswith("http://"), commands.errors.read_text()
    try:
        yield url
    finally:
        os.kill(pid, signal.SIGTERM)
        assert commands.end() == 0, commands.errors.read_text()


def status_there(address: str) -> int:
    """Status of a GET request, which may be that of a redirection: where that leads, a viewer would be started."""
    parts = urlsplit(address)
    connection = HTTPConnection(parts.netloc, timeout=PATIENCE_S)
    with contextlib.closing(connection):
        connection.request("GET", parts.path)
        return connection.getresponse().status


def test_every_folder_is_an_extension() -> None:
    assert sorted(one.name for one in extensions()) == NAMES


@each_row("left_out", [*groups_to_leave_out(NAMES), NAMES])
def test_a_server_starts_without_an_extension(
    tree: Path, commands: Commands, tmp_path: Path, left_out: list[str]
) -> None:
    """Without several at a time, so that of any two each is once there without the other."""
    gone = {*left_out}
    for one in extensions():  # each comes after those that it requires
        if gone & {*one.requires}:
            gone.add(one.name)
    with left_out_of(tree, left_out, tmp_path):
        for url in served(commands, tmp_path / "data"):
            assert status_of(url) == 200
            assert status_of(f"{url}api/devices") == 200
            assert status_of(f"{url}metrics") == 200
            if left_out == NAMES:  # takes a second
                assert status_of(f"{url}openapi.json") == 200
            for name, path in ROUTES.items():
                assert (status_there(url.rstrip("/") + path) == 404) == (name in gone), path


@each_row("name", [*SHIPPED])
def test_a_setting_of_an_extension_that_is_not_installed(
    tree: Path, commands: Commands, tmp_path: Path, name: str
) -> None:
    """It names the extension, and how to add it, in place of all valid settings."""
    path = tmp_path / "imuscope.toml"
    path.write_text(f"{SHIPPED[name][0]} = 1\n")
    with left_out_of(tree, [name], tmp_path):
        commands.begin("serve", "sim:xbus", "--config", str(path))
        status = commands.end()
    errors = commands.errors.read_text()
    assert status == 1, errors
    assert f"is a setting of the extension {name}, which is not installed" in errors
    assert "install imuscope again to add it" in errors


def test_the_settings_of_the_shipped_extensions_are_known() -> None:
    """Without them, too: SHIPPED is what they declare."""
    names = {plugin.module: plugin.name for plugin in plugins_of(GROUP)}
    declared = {names[kind.__module__]: tuple(one.name for one in fields(kind)) for kind in extension_settings()}  # type: ignore[arg-type]
    assert declared == SHIPPED


def test_nothing_outside_imports_an_extension() -> None:
    inside = ROOT / "server" / "extensions"
    requires = {one.name: one.requires for one in extensions()}
    wrong = []
    for path in python_files(*FOLDERS):
        own = path.relative_to(inside).parts[0] if path.is_relative_to(inside) else ""
        for line, module in facts_of(path).imports:
            parts = module.split(".")
            if (
                parts[:2] == ["server", "extensions"]
                and len(parts) > 2
                and parts[2] not in (own, *requires.get(own, ()))
            ):
                wrong.append(f"{path.relative_to(ROOT)}:{line} imports {module}")
    assert not wrong, "\n".join(wrong)


MOST_LINES = 65_000
"""Of Python without families and extensions: 60 % of what there was before there were extensions, and the fork server,
which analyses had to themselves before files from outside were read in its processes, too; units, by which columns are
converted as they are read; and what causes are measured by."""
MOST_SERVICES = MOST_IMPORTS = 25
BEHIND_A_DOOR = (
    ROOT / "recordings" / "readers" / "formats",  # one file a format, found by its registration, as families are
    ROOT / "recordings" / "exporters" / "formats",  # as these
    ROOT / "protocols" / "native" / "compiler",  # runs when a package is built, never in a server
)


def test_the_heart_stays_small() -> None:
    families = [ROOT.joinpath(*plugin.module.split(".")[1:-1]) for plugin in protocol_plugins() if not plugin.package]
    apart = (*families, ROOT / "server" / "extensions", *BEHIND_A_DOOR)
    heart = [path for path in python_files(*FOLDERS) if not any(path.is_relative_to(folder) for folder in apart)]
    lines = sum(len(text_of(path).splitlines()) for path in heart)
    assert lines <= MOST_LINES
    assert len(fields(Services)) <= MOST_SERVICES
    named = {ROOT.joinpath(*name.split(".")) for _, name in facts_of(ROOT / "server" / "app" / "build.py").imports}
    imported = [path for path in named if path.with_suffix(".py").is_file()]
    assert len(imported) <= MOST_IMPORTS, imported


def test_tests_of_the_heart_use_no_extension() -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{line} imports {name}"
        for path in python_files(*(f"tests/{name}" for name in TESTS_OF_THE_HEART))
        if not path.is_relative_to(TESTS_OF_EXTENSIONS)
        for line, name in facts_of(path).imports
        if name.startswith(("server.extensions", "tests.server.extensions"))
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.slow
def test_the_tests_of_the_heart_pass_without_extensions(tmp_path: Path) -> None:
    """In a copy of the checkout in which no extension is, nor any test of one."""
    checkout = tmp_path / "imuscope"
    subprocess.run(["git", "checkout-index", "--all", f"--prefix={checkout}/"], cwd=ROOT, check=True)
    shutil.copytree(ROOT / "server" / "page", checkout / "server" / "page")
    own = [checkout / "server" / "extensions" / name for name in NAMES]
    for folder in (*own, checkout / TESTS_OF_EXTENSIONS.relative_to(ROOT), checkout / "tests" / "whole"):
        shutil.rmtree(folder)
    (tmp_path / "shared").symlink_to(ROOT.parent / "shared")
    places = [f"tests/{name}" for name in TESTS_OF_THE_HEART]
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *places]
    environment = os.environ | {"PYTHONPATH": str(checkout)}
    done = subprocess.run(command, cwd=checkout, env=environment, stdout=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:]
