"""A smaller installation, without viewers, ROS 2 and fleet: all else works, and what is missing is named with the
command that adds it.
"""

import os
import subprocess
import tomllib
from collections.abc import Callable, Iterator
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from playwright.sync_api import Page

from imuscope.recordings.optional_packages import EXTRAS, installation_of
from tests.support.chromium import until
from tests.support.forking import fork_server
from tests.support.forking.fork_server import ForkServer
from tests.support.server_process import ROOT, ServerProcess, imuscope

Run = Callable[..., subprocess.CompletedProcess[str]]
ABSENT = sorted({module for modules in EXTRAS.values() for module in modules})
HIDE = f"import sys; sys.modules |= dict.fromkeys({ABSENT})"
"""In every process that imports it: these are not installed."""
CAPTURE = bytes.fromhex("fa ff 36 05 10 20 02 00 01 93") * 50


@pytest.fixture(scope="module")
def smaller(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ForkServer | None]:
    """Starts commands of such an installation."""
    folder = tmp_path_factory.mktemp("hidden")
    (folder / "sitecustomize.py").write_text(HIDE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", f"{folder}{os.pathsep}{ROOT}")
        yield ForkServer() if fork_server.IS_THERE else None


@pytest.fixture
def run(smaller: ForkServer | None) -> Run:
    """Run a command of such an installation."""

    def start(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
        return imuscope(*map(str, arguments), fresh=smaller is None, by=smaller)

    return start


def test_each_extra_brings_its_modules() -> None:
    """And they are not among what every installation has."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    of_module = packages_distributions()
    extras = project["optional-dependencies"]
    for extra, modules in EXTRAS.items():
        inner = extras["ros2"] if "imuscope[ros2]" in extras[extra] else []
        listed = " ".join([*extras[extra], *inner])
        for module in modules:
            assert any(name in listed for name in of_module[module]), f"{module} is not in {extra}"
            assert not any(name in " ".join(project["dependencies"]) for name in of_module[module]), module


def test_commands_name_what_they_lack(run: Run, tmp_path: Path) -> None:
    (tmp_path / "x.raw").write_bytes(CAPTURE)
    upload = run("upload", tmp_path / "x.raw", tmp_path)
    assert upload.returncode == 1
    assert installation_of("fleet") in upload.stderr
    rerun = run("decode", tmp_path / "x.raw", "-o", tmp_path / "x.rrd")
    assert rerun.returncode == 1
    assert installation_of("viewers") in rerun.stderr
    for suffix in ("csv", "mcap", "parquet"):
        done = run("decode", tmp_path / "x.raw", "-o", tmp_path / f"x.{suffix}")
        assert done.returncode == 0, done.stderr
    doctor = run("doctor", "--data", tmp_path)
    for extra in EXTRAS:
        assert installation_of(extra) in doctor.stdout


def test_the_page_offers_only_what_is_there(
    open_page: Callable[..., Page], smaller: ForkServer | None, tmp_path: Path
) -> None:
    with ServerProcess("sim:idtp", data=tmp_path, fresh=smaller is None, by=smaller) as server:
        page = open_page(server.url)
        until(page, "window.imuscope?.store.channels.value.length > 0")
        assert page.get_by_title("Show in").count() == 0
        page.keyboard.press("?")
        help_text = page.get_by_role("dialog").inner_text()
        for extra in EXTRAS:
            assert installation_of(extra) in help_text
