"""Does kept machine code do what it did where it was compiled, and is it left alone where it does not fit?"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from protocols import native_cache
from protocols.jit import BYTES, INT, INTS, PAIR, TypeSpec
from server import jit_cache
from tests.bench import idtp_mixed, isb_mixed
from tests.protocols import xbus_vectors

ROOT = Path(__file__).parents[2]


def total(data: Any, weights: Any) -> int:
    value = 0
    for i in range(len(data)):
        value += int(data[i]) * weights[i]
    return value


def parted(value: int, by: int) -> tuple[int, int]:
    return value // by, value % by


def made(function: Any, result: TypeSpec, *arguments: TypeSpec) -> Any:
    return numba.njit(result(numba.types)(*(kind(numba.types) for kind in arguments)), nogil=True)(function)


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kept")
    native_cache.save(folder / "part.bin", {"tests.parted": made(parted, PAIR, INT, INT)})
    native_cache.save(folder / "whole.bin", {"tests.total": made(total, INT, BYTES, INTS)}, folder / "part.bin")
    return folder / "whole.bin"


def test_what_comes_back_gives_the_same(kept: Path) -> None:
    functions = native_cache.load(kept)
    assert set(functions) == {"tests.total", "tests.parted"}
    data, weights = np.frombuffer(b"\x01\xff\x10", np.uint8), np.array([1, -2, 1 << 40])
    assert functions["tests.total"](data, weights) == total(data, weights)
    assert [functions["tests.parted"](n, 7) for n in (-15, 0, 15)] == [parted(n, 7) for n in (-15, 0, 15)]


def test_wrong_arguments_and_errors_are_told_as_ever(kept: Path) -> None:
    functions = native_cache.load(kept)
    with pytest.raises(TypeError, match="unbox array"):
        functions["tests.total"](np.zeros(3), np.zeros(3, np.int64))
    with pytest.raises(TypeError, match="expected 2 arguments, got 1"):
        functions["tests.parted"](1)
    with pytest.raises(ZeroDivisionError):
        functions["tests.parted"](1, 0)


@pytest.mark.parametrize("cut", [0, 10, 36, 200, -1])
def test_a_file_that_is_not_whole_is_as_if_it_were_not_there(kept: Path, tmp_path: Path, cut: int) -> None:
    (tmp_path / "x.bin").write_bytes(kept.read_bytes()[:cut])
    assert not native_cache.is_valid(tmp_path / "x.bin")
    assert native_cache.load(tmp_path / "x.bin") == {}


def test_code_for_another_processor_or_version_is_not_run(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert native_cache.is_valid(kept)
    monkeypatch.setenv("NUMBA_CPU_NAME", "generic")
    assert not native_cache.is_valid(kept)
    monkeypatch.delenv("NUMBA_CPU_NAME")
    monkeypatch.setattr("importlib.metadata.version", lambda name: "0.1")
    assert not native_cache.is_valid(kept)
    monkeypatch.undo()
    monkeypatch.setattr(native_cache, "sources_mark", lambda: "others")
    assert native_cache.load(kept) == {}


def test_another_numba_does_the_work_itself(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its modules in C are nowhere promised."""

    def refuse(name: str) -> Any:
        raise ImportError(f"numba has no {name}")

    monkeypatch.setattr(native_cache, "_extension", refuse)
    assert native_cache.load(kept) == {}


def test_a_file_is_written_whole_or_not_at_all(kept: Path, tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No such file"):
        native_cache.save(tmp_path / "none" / "x.bin", {})
    native_cache.save(tmp_path / "x.bin", {}, kept)
    assert [one.name for one in tmp_path.iterdir()] == ["x.bin"]
    assert set(native_cache.load(tmp_path / "x.bin")) == set(native_cache.load(kept))


DIGESTS = """
import hashlib, sys
from pathlib import Path
from server.commands.common import warm
from protocols.events import Batch
if len(sys.argv) > 2:
    warm(Path(sys.argv[2]))
from protocols import registry
from recordings import mcap_reader
for path in sorted(Path(sys.argv[1]).iterdir()):
    decoder = registry.PROTOCOLS[path.name].decoder()
    digest, data = hashlib.sha256(), path.read_bytes()
    for at in range(0, len(data), 50_000):
        decoder.feed(data[at : at + 50_000], at)
        for event in decoder.drain(stalled=at + 50_000 >= len(data)):
            if isinstance(event, Batch):
                rows = [(name, column.dtype.descr, column.tobytes()) for name, column in event.columns.items()]
                digest.update(repr((event.message.name, len(event), event.offset.tobytes(), rows)).encode())
    print(path.name, digest.hexdigest())
"""


def test_all_decoders_give_the_same_without_numba(tmp_path: Path) -> None:
    """The server's way: machine code kept by one start, used by the next; and numba's, as all tests of decoders use it.

    With the streams of the benchmarks and all vectors, damaged a little.
    """
    streams = tmp_path / "streams"
    streams.mkdir()
    for name, data in (
        ("isb", isb_mixed.stream(8.0)),
        ("idtp", idtp_mixed.mixed(4.0)),
        ("xbus", b"".join(xbus_vectors.everything()) * 3),
    ):
        noisy = bytearray(data)
        noisy[1000::7001] = bytes(len(noisy[1000::7001]))
        (streams / name).write_bytes(noisy)
    place = {native_cache.VARIABLE: "", jit_cache.VARIABLE: os.environ[jit_cache.VARIABLE]}

    def ask(*arguments: str) -> str:
        command = [sys.executable, "-c", DIGESTS + "print('numba' in sys.modules)", str(streams), *arguments]
        done = subprocess.run(command, cwd=ROOT, env=os.environ | place, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    by_numba = ask()
    assert by_numba.endswith("True\n")
    ask(str(tmp_path))  # whatever was compiled before: from now on it is kept
    assert ask(str(tmp_path)) == by_numba.replace("True\n", "False\n")
