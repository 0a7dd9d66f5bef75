"""Kernels: the same answers as plain Python and as machine code, which is used for its own source only."""

import hashlib
import importlib
import inspect
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.native import kernels as compiled
from imuscope.protocols.native.compiler import build, extension
from imuscope.protocols.native.compiler.expressions import TranslateError
from imuscope.protocols.native.compiler.translate import CSource
from imuscope.protocols.native.kernels import INT, Kernel, kernel_of, plain
from tests.protocols.damaged_streams import write_streams
from tests.protocols.decoder_digests import digests
from tests.protocols.native import kernel_examples
from tests.support.cache_folder import cache_folder
from tests.support.each_row import each_row
from tests.support.source_files import ROOT, python_files, text_of
from tests.support.timeouts import PATIENCE_S

PACKAGE = "kernel_package"

pytestmark = pytest.mark.skipif(compiled.DISABLED, reason="there is no machine code")
NUMBERS = st.integers(-(2**40), 2**40)


def compile_package(folder: Path, package: str = PACKAGE) -> str:
    """As the author of a protocol family does."""
    command = [sys.executable, "-m", "imuscope.protocols.native.compiler", package]
    env = os.environ | {"PYTHONPATH": f"{folder}{os.pathsep}{ROOT}"}
    done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A package with the example kernels and its own library."""
    folder = tmp_path_factory.mktemp("package")
    (folder / PACKAGE).mkdir()
    (folder / PACKAGE / "__init__.py").write_text("")
    shutil.copy(kernel_examples.__file__, folder / PACKAGE / "examples.py")
    assert "built" in compile_package(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        yield folder
    for name in [name for name in sys.modules if name.partition(".")[0] == PACKAGE]:
        del sys.modules[name]


@pytest.fixture(scope="module")
def native(package: Path) -> Any:
    """The example kernels as machine code."""
    module = importlib.import_module(f"{PACKAGE}.examples")
    own = [name for name in compiled.KERNELS if name.startswith(PACKAGE)]
    assert len(own) > 10
    assert compiled.missing(PACKAGE) == []
    return module


def agree(native: ModuleType, name: str, *arguments: Any) -> None:
    """Both give the same, also in the arrays that they write."""
    mine = [one.copy() if isinstance(one, np.ndarray) else one for one in arguments]
    expected = plain(getattr(native, name))(*mine)
    assert getattr(native, name)(*arguments) == expected
    for a, b in zip(arguments, mine, strict=True):
        if isinstance(a, np.ndarray):
            np.testing.assert_array_equal(a, b)


@given(data=st.binary(max_size=40), weight=NUMBERS)
def test_bytes(native: ModuleType, data: bytes, weight: int) -> None:
    array = np.frombuffer(data, np.uint8)
    agree(native, "total", array, np.arange(len(array)) * weight)
    agree(native, "squares", array, 0, len(array))
    agree(native, "short_sums", array, weight)


@given(value=NUMBERS, by=st.integers(-50, 50))
def test_numbers(native: ModuleType, value: int, by: int) -> None:
    agree(native, "last_digit", value)
    agree(native, "shifts", value, by & 31)
    agree(native, "stepped", (value, by), by)
    if by:
        agree(native, "parted", value, by)
        agree(native, "share", value, by)


@given(values=st.lists(NUMBERS, max_size=400), rows=st.integers(1, 5))
def test_arrays(native: ModuleType, values: list[int], rows: int) -> None:
    array = np.array(values, np.int64)
    agree(native, "distinct", array)
    agree(native, "rounded", array / 7, 0.5, np.zeros(len(array), np.int64))
    columns = len(array) // rows
    if columns:
        table = array[: rows * columns].reshape(rows, columns)
        agree(native, "turned", table[:, ::2], np.zeros((rows, len(range(0, columns, 2))), np.int64))


def test_wrong_arguments_are_errors(native: ModuleType) -> None:
    data, weights = np.zeros(3, np.uint8), np.zeros(6, np.int64)
    table = np.zeros((2, 4), np.int64)
    for call, words in (
        (lambda: native.total(np.zeros(3), weights), "argument 1 is an array of other numbers than u2"),
        (lambda: native.total(data.astype(">i8"), weights), "argument 1 is an array of other numbers"),
        (lambda: native.total([1], weights), "argument 1 is not an array"),
        (lambda: native.total(data, weights[::2]), "argument 2 must have 1 dimensions, be contiguous"),
        (lambda: native.total(data, table), "argument 2 must have 1 dimensions"),
        (lambda: native.turned(table, np.frombuffer(bytes(64), np.int64).reshape(2, 4)), "be writable"),
        (lambda: native.parted(1), "takes 2 arguments, not 1"),
        (lambda: native.parted(1, "2"), "str"),
        (lambda: native.stepped((1, 2, 3), 1), "argument 1 must be a tuple of 2"),
    ):
        with pytest.raises(TypeError, match=words):
            call()
    with pytest.raises(OverflowError):
        native.parted(1 << 64, 1)
    for name in ("parted", "share"):
        with pytest.raises(ZeroDivisionError, match=name):
            getattr(native, name)(1, 0)
    assert native.parted(7, 2) == (3, 1)


def test_machine_code_of_another_source_is_not_used(package: Path, tmp_path: Path) -> None:
    shutil.copytree(package / PACKAGE, tmp_path / PACKAGE, ignore=shutil.ignore_patterns("__pycache__"))
    source = tmp_path / PACKAGE / "examples.py"
    source.write_text(source.read_text().replace("FACTOR = 3", "FACTOR = 4"))
    probe = (
        "import numpy as np\n"
        "from kernel_package.examples import total\n"
        "from imuscope.protocols.native.kernels import missing\n"
        "print(not missing('kernel_package'), total(np.ones(1, np.uint8), np.ones(1, np.int64)))"
    )
    env = os.environ | {"PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}

    def run() -> list[str]:
        return subprocess.run(
            [sys.executable, "-c", probe], env=env, check=True, capture_output=True, text=True
        ).stdout.split()

    assert run() == ["False", "4"]
    assert "built" in compile_package(tmp_path)
    assert run() == ["True", "4"]
    assert "fresh" in compile_package(tmp_path)
    for path in (tmp_path / PACKAGE / "native").glob("*.so"):  # torn by a full disk
        path.write_bytes(path.read_bytes()[:100])
    assert run() == ["False", "4"]


def loop_over_items(values: Any) -> int:
    for value in values:
        return int(value)
    return 0


def text(value: int) -> int:
    return len(str(value))


def mixed_signs(value: int) -> int:
    return 1 if compiled.unsigned(value) < value else 0


@each_row(
    "function, words",
    [
        (loop_over_items, "line 2 (for value in values:"),
        (text, "str(…) has no translation"),
        (mixed_signs, "compared with an unsigned one"),
    ],
)
def test_what_cannot_be_translated_is_named(function: Any, words: str) -> None:
    kernel = Kernel(function, (INT, INT), waits=False)
    with pytest.raises(TranslateError) as refused:
        CSource().function(kernel, (INT,))
    assert words in str(refused.value)
    assert function.__name__ in str(refused.value)


def test_every_processor_has_a_library() -> None:
    folder = compiled.library_folder("imuscope")
    assert folder is not None
    assert {path.name for path in folder.glob("*.so")} == {f"kernels.{name}.so" for name in build.TARGETS}
    assert set(compiled.libraries()) <= set(build.TARGETS)
    assert set(compiled.LEVELS) < set(build.TARGETS)
    marks = {name: (folder / f"kernels.{name}.so").read_bytes()[18] for name in build.TARGETS}
    assert marks == {"x86_64": 62, "x86_64_v3": 62, "x86_64_v4": 62, "aarch64": 183}  # e_machine of ELF


@each_row("level", build.TARGETS)
def test_libraries_need_only_the_interpreter_and_the_c_library(level: str) -> None:
    folder = compiled.library_folder("imuscope")
    assert folder is not None
    data = (folder / f"kernels.{level}.so").read_bytes()
    assert b"GLIBC" not in data, "it would need a version of it"
    assert b"libc.so" not in data


@pytest.fixture(scope="module")
def streams(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Streams of the benchmarks and all vectors, slightly damaged: a file for each family."""
    folder = tmp_path_factory.mktemp("streams")
    write_streams(folder)
    return folder


def elsewhere(streams: Path, **variables: str) -> str:
    """Their digests in a process with these variables."""
    command = [sys.executable, "-m", "tests.protocols.decoder_digests", str(streams)]
    env = os.environ | variables
    done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@each_row("level", compiled.libraries())
def test_decoders_give_the_same_on_every_processor(streams: Path, tmp_path: Path, level: str) -> None:
    """By the library of each kind of processor that this one can be."""
    folder = compiled.library_folder("imuscope")
    assert folder is not None
    shutil.copy(folder / f"kernels.{level}.so", tmp_path)
    assert elsewhere(streams, IMUSCOPE_NATIVE=str(tmp_path)) == f"0 {digests(streams)}"


def test_no_index_is_outside_an_array(streams: Path, tmp_path: Path) -> None:
    """With machine code that checks each index and ends the process at the first that is outside."""
    checked = _checked(tmp_path)
    assert elsewhere(streams, IMUSCOPE_NATIVE=str(checked)) == f"0 {digests(streams)}"
    names = [f"tests/protocols/{file}" for file in CHECKED]
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *names]
    env = {name: value for name, value in os.environ.items() if name != "PYTEST_ADDOPTS"}
    env |= {"IMUSCOPE_NATIVE": str(checked)}
    done = subprocess.run(command, env=env, cwd=ROOT, capture_output=True, check=False)
    assert done.returncode == 0, done.stdout.decode()


def _checked(aside: Path) -> Path:
    """Folder of machine code that checks each index, made once for all runs with the same source and compiler."""
    text = extension.text_of(build.kernels_of("imuscope"))
    [*_, name] = compiled.libraries()
    of = "\0".join((text, inspect.getsource(build), version("ziglang"), name))
    folder = cache_folder("checked") / hashlib.sha256(of.encode()).hexdigest()[:16]
    if not folder.is_dir():
        source, made = aside / "kernels.c", Path(tempfile.mkdtemp(dir=folder.parent))
        source.write_text(text)
        build.compile_source(source, made / f"kernels.{name}.so", name, "-DCHECKED")
        try:
            made.rename(folder)
        except OSError:  # somebody else has made it meanwhile
            shutil.rmtree(made)
    return folder


CHECKED = (
    *("xbus/test_decoder.py", "isb/test_decoder.py", "idtp/test_decoder.py", "clocks/test_counters.py"),
    *("clocks/test_kernels.py", "clocks/test_chunk_boundaries.py"),
    "test_properties.py::test_like_the_oracle",
)


def test_kernels_know_themselves() -> None:
    names = [name for name, kernel in compiled.KERNELS.items() if kernel.signature is not None]
    assert len([name for name in names if name.startswith("imuscope.")]) > 40
    one = compiled.KERNELS["imuscope.protocols.framing.checksums.sum8"]
    assert kernel_of(one.native) is one


def test_every_kernel_has_machine_code() -> None:
    """One that calls a function defined below it would not know itself when it is defined, and run as plain Python."""
    for path in python_files("protocols", "recordings", "server"):
        if "@compiled(" in text_of(path) and "compiler" not in path.parts:
            importlib.import_module(".".join(("imuscope", *path.relative_to(ROOT).with_suffix("").parts)))
    assert compiled.missing() == [], "define what they call above them"
