"""Kernels: equal results of plain Python and compiled code, and a cache that detects every change."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imuscope.protocols import jit
from imuscope.protocols.events import Batch
from imuscope.protocols.jit import BYTES, INT, INTS, PAIR, Kernel, compiled, inlined
from imuscope.protocols.registry import PROTOCOLS
from tests.bench import idtp_mixed, isb_mixed
from tests.each_row import each_row
from tests.protocols import xbus_vectors

ROOT = Path(__file__).parents[2]
FACTOR = 3

pytestmark = pytest.mark.skipif(jit.DISABLED, reason="there are no kernels")


@inlined
def scaled(value: int) -> int:
    return value * FACTOR


@compiled(INT, BYTES, INTS)
def total(data: Any, weights: Any) -> int:
    value = 0
    for i in range(len(data)):
        value += scaled(int(data[i])) * weights[i]
    return value


@compiled(PAIR, INT, INT)
def parted(value: int, by: int) -> tuple[int, int]:
    return value // by, value % by


@compiled(INT, INT)
def last_digit(value: int) -> int:
    return parted(value, 10)[1]


def as_kernel(function: Any) -> Kernel:
    assert isinstance(function, Kernel)
    return function


def test_plain_and_compiled_agree() -> None:
    data, weights = np.frombuffer(b"\x01\xff\x10", np.uint8), np.array([1, -2, 1 << 40])
    assert total(data, weights) == as_kernel(total).function(data, weights)
    for n in (-15, 0, 15):
        assert parted(n, 7) == as_kernel(parted).function(n, 7)
    assert last_digit(1234) == as_kernel(last_digit).function(1234) == 4


@each_row("checked", [True, False])
def test_wrong_arguments_and_errors_are_reported(checked: bool) -> None:
    jit.load(checked=True)
    as_kernel(total).install(checked=checked)
    as_kernel(parted).install(checked=checked)
    with pytest.raises(TypeError):
        total(np.zeros(3), np.zeros(3, np.int64))
    with pytest.raises(TypeError):
        parted(1)  # type: ignore[call-arg]
    with pytest.raises(ZeroDivisionError):
        parted(1, 0)


def test_a_changed_callee_gives_another_cache_key(monkeypatch: pytest.MonkeyPatch) -> None:
    """Numba's cache checks only the file of a function; its name contains a fingerprint of everything else it depends
    on.
    """
    before = as_kernel(total).fingerprint()
    assert as_kernel(total).fingerprint() == before
    monkeypatch.setitem(globals(), "FACTOR", 4)
    assert as_kernel(total).fingerprint() != before
    own, calling = as_kernel(parted), as_kernel(last_digit).fingerprint()
    monkeypatch.setattr(own, "function", lambda value, by: (value, by))
    assert as_kernel(last_digit).fingerprint() != calling


def test_an_unwritable_cache_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    """If the cache is not writable, functions are compiled for this run only."""

    def refuse(_: object) -> None:
        raise PermissionError

    caching = importlib.import_module("numba.core.caching")
    monkeypatch.setattr(caching._CacheLocator, "ensure_cache_path", refuse)
    kernel = Kernel(as_kernel(parted).function, as_kernel(parted).signature)
    assert kernel.compile()(17, 5) == (3, 2)
    assert not kernel.dispatcher.stats.cache_path


def test_another_copy_of_the_source_finds_its_functions_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every fresh clone compiled for half a minute, because numba's cache is keyed by the folder."""
    source = (
        "from imuscope.protocols.jit import INT, compiled\n"
        "@compiled(INT, INT)\ndef double(value):\n    return 2 * value\n"
    )
    caching = importlib.import_module("numba.core.caching")
    monkeypatch.setattr(caching.config, "CACHE_DIR", str(tmp_path / "compiled"))
    kernels = []
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "copied.py").write_text(source)
        spec = importlib.util.spec_from_file_location("copied", tmp_path / name / "copied.py")
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, "copied", module)
        spec.loader.exec_module(module)
        kernels.append(module.double)
        module.double.compile()
    assert all(kernel.dispatcher.stats.cache_path for kernel in kernels)
    assert not any(kernels[1].dispatcher.stats.cache_misses.values())
    assert kernels[1].dispatcher(21) == 42


DIGESTS = """
import sys
from pathlib import Path
from imuscope.protocols import jit
from imuscope.protocols.events import Batch
from tests.protocols.test_jit import digests
jit.automatic = False
print(digests(Path(sys.argv[1]), load_at=50_000))
"""
PIECE = 25_000


def digests(folder: Path, *, load_at: int = -1) -> dict[str, str]:
    """What the decoders give for the file named like each of them, as digests; at a position the kernels are loaded."""
    found = {}
    for path in sorted(folder.iterdir()):
        decoder = PROTOCOLS[path.name].decoding.decoder()
        digest, data = hashlib.sha256(), path.read_bytes()
        for at in range(0, len(data), PIECE):
            decoder.feed(data[at : at + PIECE], at)
            for event in decoder.drain(stalled=at + PIECE >= len(data)):
                if isinstance(event, Batch):
                    rows = [(name, column.dtype.descr, column.tobytes()) for name, column in event.columns.items()]
                    digest.update(repr((event.message.name, len(event), event.offset.tobytes(), rows)).encode())
            if at == load_at:
                jit.load()
        found[path.name] = digest.hexdigest()
    return found


def test_all_decoders_give_the_same_whenever_they_are_loaded(tmp_path: Path) -> None:
    """With argument checks, as in tests; and as in a server: plain Python first, then without checks, in the middle of
    a stream. With the streams of the benchmarks and all vectors, slightly damaged.
    """
    streams = (
        ("isb", isb_mixed.stream(4.0)),
        ("idtp", idtp_mixed.mixed(6.0)),
        ("xbus", b"".join(xbus_vectors.everything()) * 9),
    )
    for name, data in streams:
        noisy = bytearray(data)
        noisy[1000::7001] = bytes(len(noisy[1000::7001]))
        assert len(noisy) > 4 * PIECE
        (tmp_path / name).write_bytes(noisy)
    command = [sys.executable, "-c", DIGESTS, str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, env=os.environ, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    jit.load(checked=True)
    assert done.stdout.strip() == str(digests(tmp_path))
