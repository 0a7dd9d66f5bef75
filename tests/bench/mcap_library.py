"""Benchmark of the writer of recordings beside that of the mcap library.

    python tests/bench/mcap_library.py [--save]

Chunks of 80 bytes, as 1 kHz of an MTi gives them, in runs of 8, as the recorder hands them over. For each writer: how
many it writes in a second, and how many of those handed over can be read after SIGKILL, of 20 000:

    own                recordings/mcap/writer.py: one write() a run, without a buffer
    library            mcap.writer.Writer without chunks, flushed after each run
    library_buffered   … not flushed
    library_chunked    … in chunks, as it writes by default
    own_packed         recordings/mcap/compaction.py, which chunks and compresses a closed recording (speed only)

The yardstick, in the same run: the same bytes by os.write, a run at a time.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from mcap.writer import Writer

from imuscope.recordings.mcap.compaction import compact
from imuscope.recordings.mcap.reader import McapReader
from imuscope.recordings.mcap.writer import McapWriter
from tests.bench.support.report import report

CHUNK, RUN, CHUNKS, SURVIVORS_OF, ROUNDS = bytes(range(80)), 8, 200_000, 20_000, 5
START = 1_760_000_000_000_000_000
Run = list[tuple[bytes, int]]


def _own(path: Path) -> Callable[[Run], None]:
    writer = McapWriter(path, {})
    return lambda run: writer.runs([("1", "rx", run)])


def _library(path: Path, *, flushed: bool = False, chunked: bool = False) -> Callable[[Run], None]:
    file = path.open("xb")
    writer = Writer(file, use_chunking=chunked)
    writer.start("imuscope")
    channel = writer.register_channel("rx/1", "application/octet-stream", 0)

    def write(run: Run) -> None:
        for data, at in run:
            writer.add_message(channel, at, data, at)
        if flushed:
            file.flush()

    return write


WRITERS: dict[str, Callable[[Path], Callable[[Run], None]]] = {
    "own": _own,
    "library": lambda path: _library(path, flushed=True),
    "library_buffered": _library,
    "library_chunked": lambda path: _library(path, chunked=True),
}


def _runs(count: int) -> list[Run]:
    return [[(CHUNK, START + k * 1_000_000) for k in range(at, at + RUN)] for at in range(0, count, RUN)]


def _per_s(path: Path, open_writer: Callable[[Path], Callable[[Run], None]]) -> float:
    runs = _runs(CHUNKS)
    write = open_writer(path)
    begin = time.perf_counter()
    for run in runs:
        write(run)
    return CHUNKS / (time.perf_counter() - begin)


def _packed_per_s(path: Path) -> float:
    writer = McapWriter(path, {})
    for run in _runs(CHUNKS):
        writer.runs([("1", "rx", run)])
    writer.close()
    begin = time.perf_counter()
    compact(path)
    return CHUNKS / (time.perf_counter() - begin)


def _by_os(path: Path) -> Callable[[Run], None]:
    file = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL)
    block = bytes((len(CHUNK) + 31) * RUN)

    def write(run: Run) -> None:
        os.write(file, block)

    return write


def _survivors(path: Path, name: str) -> int:
    subprocess.run([sys.executable, __file__, "--killed", name, path], check=False)
    if path.stat().st_size == 0:
        return 0
    with McapReader(path) as reader:
        return sum(block.table.shape[1] for block in reader.blocks())


def _killed(name: str, path: Path) -> None:
    write = WRITERS[name](path)
    for run in _runs(SURVIVORS_OF):
        write(run)
    os.kill(os.getpid(), signal.SIGKILL)


def main() -> None:
    if "--killed" in sys.argv:
        _killed(sys.argv[2], Path(sys.argv[3]))
    figures: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, open_writer in {"yardstick": _by_os, **WRITERS}.items():
            speeds = [_per_s(Path(folder) / f"{name}-{k}.mcap", open_writer) for k in range(ROUNDS)]
            figures[f"{name}_thousand_per_s"] = max(speeds) / 1000
        figures["own_packed_thousand_per_s"] = (
            max(_packed_per_s(Path(folder) / f"{k}.mcap") for k in range(ROUNDS)) / 1000
        )
        for name in WRITERS:
            figures[f"{name}_left_of_{SURVIVORS_OF}"] = _survivors(Path(folder) / f"{name}.mcap", name)
    report("mcap-library", figures)


if __name__ == "__main__":
    main()
