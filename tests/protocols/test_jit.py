"""Kernels: equal results of plain Python and compiled code, and a cache that detects every change."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from protocols import jit
from protocols.jit import BYTES, INT, INTS, PAIR, Kernel, compiled, inlined
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


def test_an_unwritable_cache_folder() -> None:
    """If the cache is not writable, functions are compiled for this run only."""
    script = (
        "import numba.core.caching as c\n"
        "def refuse(self): raise PermissionError\n"
        "c._CacheLocator.ensure_cache_path = refuse\n"
        "from protocols import checksums\n"
        "checksums.sum8.compile(); checksums.sum8.install(checked=False)\n"
        "assert not checksums.sum8.dispatcher.stats.cache_path\n"
        "import numpy\n"
        "assert checksums.sum8(numpy.frombuffer(b'ab', numpy.uint8), 0, 2) == 195\n"
    )
    subprocess.run([sys.executable, "-c", script], cwd=ROOT, check=True)


DIGESTS = """
import hashlib, sys
from pathlib import Path
from protocols.events import Batch
from protocols import jit, registry
from recordings import mcap_reader
jit.automatic = False
if sys.argv[2] == "checked":
    jit.load(checked=True)
for path in sorted(Path(sys.argv[1]).iterdir()):
    decoder = registry.PROTOCOLS[path.name].decoder()
    digest, data = hashlib.sha256(), path.read_bytes()
    for at in range(0, len(data), 50_000):
        decoder.feed(data[at : at + 50_000], at)
        for event in decoder.drain(stalled=at + 50_000 >= len(data)):
            if isinstance(event, Batch):
                rows = [(name, column.dtype.descr, column.tobytes()) for name, column in event.columns.items()]
                digest.update(repr((event.message.name, len(event), event.offset.tobytes(), rows)).encode())
        if at == 100_000:
            jit.load()
    print(path.name, digest.hexdigest())
"""


def test_all_decoders_give_the_same_whenever_they_are_loaded(tmp_path: Path) -> None:
    """With argument checks, as in tests; and as in a server: plain Python first, then without checks, in the middle of
    a stream. With the streams of the benchmarks and all vectors, slightly damaged.
    """
    streams = (
        ("isb", isb_mixed.stream(8.0)),
        ("idtp", idtp_mixed.mixed(4.0)),
        ("xbus", b"".join(xbus_vectors.everything()) * 3),
    )
    for name, data in streams:
        noisy = bytearray(data)
        noisy[1000::7001] = bytes(len(noisy[1000::7001]))
        (tmp_path / name).write_bytes(noisy)

    def ask(how: str) -> str:
        command = [sys.executable, "-c", DIGESTS, str(tmp_path), how]
        done = subprocess.run(command, cwd=ROOT, env=os.environ, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert ask("checked") == ask("later")
