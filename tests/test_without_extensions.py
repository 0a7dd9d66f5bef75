"""The heart of the program without its extensions: a folder that is left out leaves a server and a page without it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import pytest

from imuscope.protocols.plugins import plugins_of, protocol_plugins
from imuscope.server.extension import extensions
from imuscope.server.extension_settings import GROUP, SHIPPED, extension_settings
from imuscope.server.services import Services
from tests.each_row import each_row
from tests.server_process import tied
from tests.source_files import PACKAGE, ROOT, facts_of, python_files, text_of
from tests.timeouts import status_of

NAMES = sorted(path.name for path in (ROOT / "server" / "extensions").iterdir() if (path / "__init__.py").is_file())
FOLDERS = ("protocols", "recordings", "server")
TESTS_OF_THE_HEART = ("server", "links", "protocols", "recordings")
COPIED = (*FOLDERS, PACKAGE, "pyproject.toml")
ROUTES = {
    "alarms": "/api/alarms",
    "analysis": "/api/analysis",
    "fleet": "/api/uploads",
    "calibration": "/api/devices/1/calibration",
    "viser": "/api/views/scene",
    "rerun": "/rerun/",
    "ros2": "/api/ros2",
}
"""A path that only the extension answers."""


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the program."""
    folder = tmp_path_factory.mktemp("tree")
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, folder / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / name, folder / name)
    return folder


def served(tree: Path, data: Path) -> Iterator[str]:
    """Address of a server of that tree."""
    environment = os.environ | {"PYTHONPATH": str(tree)}
    words = ["serve", "sim:xbus", "--host", "127.0.0.1", "--port", "0", "--data", str(data)]
    command = tied([sys.executable, "-m", PACKAGE, *words])
    with subprocess.Popen(command, env=environment, cwd=tree, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield next(line for line in process.stdout if line.startswith("http://")).strip()
        finally:
            process.terminate()
    assert process.returncode == 0


def test_every_folder_is_an_extension() -> None:
    assert sorted(one.name for one in extensions()) == NAMES


@each_row("left_out", [*([name] for name in NAMES), NAMES])
def test_a_server_starts_without_an_extension(tree: Path, tmp_path: Path, left_out: list[str]) -> None:
    folder = tree / "server" / "extensions"
    gone = {*left_out}
    for one in extensions():  # each comes after those that it requires
        if gone & {*one.requires}:
            gone.add(one.name)
    for name in left_out:
        (folder / name).rename(tmp_path / name)
    try:
        for url in served(tree, tmp_path / "data"):
            assert status_of(url) == 200
            assert status_of(f"{url}api/devices") == 200
            assert status_of(f"{url}metrics") == 200
            if left_out == NAMES:  # takes a second
                assert status_of(f"{url}openapi.json") == 200
            for name, path in ROUTES.items():
                assert (status_of(url.rstrip("/") + path) == 404) == (name in gone), path
    finally:
        for name in left_out:
            (tmp_path / name).rename(folder / name)


@each_row("name", [*SHIPPED])
def test_a_setting_of_an_extension_that_is_not_installed(tree: Path, tmp_path: Path, name: str) -> None:
    """It names the extension, and how to add it, in place of all valid settings."""
    path = tmp_path / "imuscope.toml"
    path.write_text(f"{SHIPPED[name][0]} = 1\n")
    folder = tree / "server" / "extensions" / name
    folder.rename(tmp_path / name)
    try:
        command = [sys.executable, "-m", PACKAGE, "serve", "sim:xbus", "--config", str(path)]
        environment = os.environ | {"PYTHONPATH": str(tree)}
        done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
    finally:
        (tmp_path / name).rename(folder)
    assert done.returncode == 1, done.stderr
    assert f"is a setting of the extension {name}, which is not installed" in done.stderr
    assert "install imuscope again to add it" in done.stderr


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


MOST_LINES = 61_800
"""Of Python without families and extensions: 60 % of what there was before there were extensions."""
MOST_SERVICES = MOST_IMPORTS = 25
BEHIND_A_DOOR = (
    ROOT / "recordings" / "readers" / "formats",  # one file a format, found by its registration, as families are
    ROOT / "protocols" / "compiler",  # runs when a package is built, never in a server
)


def test_the_heart_stays_small() -> None:
    families = [ROOT.joinpath(*plugin.module.split(".")[1:-1]) for plugin in protocol_plugins() if not plugin.package]
    apart = (*families, ROOT / "server" / "extensions", *BEHIND_A_DOOR)
    heart = [path for path in python_files(*FOLDERS) if not any(path.is_relative_to(folder) for folder in apart)]
    lines = sum(len(text_of(path).splitlines()) for path in heart)
    assert lines <= MOST_LINES
    assert len(fields(Services)) <= MOST_SERVICES
    named = {ROOT.joinpath(*name.split(".")) for _, name in facts_of(ROOT / "server" / "app.py").imports}
    imported = [path for path in named if path.with_suffix(".py").is_file()]
    assert len(imported) <= MOST_IMPORTS, imported


def test_tests_of_the_heart_use_no_extension() -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{line} imports {name}"
        for path in python_files(*(f"tests/{name}" for name in TESTS_OF_THE_HEART))
        for line, name in facts_of(path).imports
        if name.startswith(("server.extensions", "tests.extensions"))
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.slow
def test_the_tests_of_the_heart_pass_without_extensions(tmp_path: Path) -> None:
    """In a copy of the checkout in which no extension is, nor any test of one."""
    checkout = tmp_path / "imuscope"
    subprocess.run(["git", "checkout-index", "--all", f"--prefix={checkout}/"], cwd=ROOT, check=True)
    shutil.copytree(ROOT / "server" / "page", checkout / "server" / "page")
    own = [checkout / "server" / "extensions" / name for name in NAMES]
    for folder in (*own, checkout / "tests" / "extensions", checkout / "tests" / "whole"):
        shutil.rmtree(folder)
    (tmp_path / "shared").symlink_to(ROOT.parent / "shared")
    places = [f"tests/{name}" for name in TESTS_OF_THE_HEART]
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *places]
    environment = os.environ | {"PYTHONPATH": str(checkout)}
    done = subprocess.run(command, cwd=checkout, env=environment, stdout=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:]
