"""Libraries of a package's kernels, one per kind of processor, compiled by the C compiler of the package `ziglang`.

    PACKAGE/native/kernels.x86_64.so     any 64-bit PC
    PACKAGE/native/kernels.x86_64_v3.so  with AVX2, since about 2013
    PACKAGE/native/kernels.x86_64_v4.so  with AVX-512
    PACKAGE/native/kernels.aarch64.so    Raspberry Pi, Jetson and other 64-bit ARM boards

All are built on any machine, so one wheel serves all. They need nothing but the C library, glibc or musl, and the
interpreter that loads them.
"""

import importlib
import importlib.util
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from imuscope.protocols.native.compiler import extension
from imuscope.protocols.native.kernels import KERNELS, Kernel

COMPILER = "ziglang>=0.13"
TARGETS = {
    "x86_64": ("x86_64-linux", "x86_64"),
    "x86_64_v3": ("x86_64-linux", "x86_64_v3"),
    "x86_64_v4": ("x86_64-linux", "x86_64_v4+prefer_no_gather"),  # a gather of table entries takes longer than loads
    "aarch64": ("aarch64-linux", "generic"),
}
FLAGS = (
    *("-shared", "-fPIC", "-nostdlib", "-O3", "-s", "-fvisibility=hidden", "-Wl,-z,undefs"),
    *("-fwrapv", "-fno-strict-aliasing", "-ffp-contract=off", "-fno-sanitize=all", "-fno-stack-protector"),
    *("-mllvm", "-inline-threshold=2000"),  # a decoder's time state stays in registers: 40 % off its loop
    *("-Werror", "-Wall", "-Wno-unused", "-Wno-parentheses-equality"),
)
"""Integers wrap and floats are rounded at each step, as in plain Python."""
_KERNEL = re.compile(r"^@(compiled\(|inlined$)", re.MULTILINE)


class BuildError(Exception):
    """The libraries could not be built; the message is for the person who builds."""


def modules_of(package: str) -> list[str]:
    """Names of a package's modules that have kernels, by their text.

    Raises:
        BuildError: there is no such package.
    """
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        raise BuildError(f"There is no package {package}.")
    root = Path(spec.origin).parent
    files = [Path(spec.origin)] if spec.submodule_search_locations is None else sorted(_files(root))
    names = []
    for file in files:
        if _KERNEL.search(file.read_text(encoding="utf-8")):
            inner = file.relative_to(root).with_suffix("").parts
            names.append(package if spec.submodule_search_locations is None else ".".join((package, *inner)))
    return names


def _files(root: Path) -> list[Path]:
    """Python files below a folder, through links to folders."""
    return [
        Path(folder) / name
        for folder, _, names in os.walk(root, followlinks=True)
        for name in names
        if name.endswith(".py") and "__pycache__" not in folder
    ]


def kernels_of(package: str) -> list[Kernel]:
    """A package's kernels, by name; imports the modules that have them."""
    for name in modules_of(package):
        importlib.import_module(name)
    prefix = f"{package}."
    return [kernel for name, kernel in sorted(KERNELS.items()) if name.startswith(prefix)]


def build(package: str, folder: Path) -> bool:
    """Build the libraries of a package into a folder, unless they are there. Returns whether anything was built.

    Raises:
        BuildError: there is no compiler, or it failed.
        TranslateError: a kernel has something that is not translated.
    """
    text = extension.text_of(kernels_of(package))
    stamp = folder / ".source.c"
    there = stamp.is_file() and all(_file(folder, one).is_file() for one in TARGETS)
    if there and stamp.read_text(encoding="utf-8") == text:
        return False
    if importlib.util.find_spec("ziglang") is None:
        raise BuildError(f"Building machine code needs a compiler: pip install '{COMPILER}'.")
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        source = Path(place) / "kernels.c"
        source.write_text(text, encoding="utf-8")
        for name in TARGETS:
            made = Path(place) / f"{name}.so"
            compile_source(source, made, name)
            part = folder / f".{made.name}.part"
            part.write_bytes(made.read_bytes())
            part.replace(_file(folder, name))  # a running process keeps the file that it has mapped
    stamp.write_text(text, encoding="utf-8")
    return True


def compile_source(source: Path, made: Path, name: str, *options: str) -> None:
    """Compile a C file for a target.

    Raises:
        BuildError: the compiler failed.
    """
    target, processor = TARGETS[name]
    command = [sys.executable, "-m", "ziglang", "cc", "-target", target, f"-mcpu={processor}", *FLAGS, *options]
    done = subprocess.run([*command, "-o", made, source], capture_output=True, text=True, check=False)
    if done.returncode:
        raise BuildError(f"The compiler failed for {name}: {done.stderr.strip()[-2000:]}")


def _file(folder: Path, name: str) -> Path:
    return folder / f"kernels.{name}.so"
