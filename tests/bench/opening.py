"""Benchmark of opening a long recording: first plot, second opening, zoom.

    python tests/bench/opening.py [--minutes 60] [--save]

An MTi at 1 kHz, 80 bytes a frame with counter, time, orientation, acceleration, rate of turn and status, in chunks of
8 ms as a serial port gives them; packed as a closed recording is. A process of its own opens it, so that its memory is
its own:

    first      nothing is kept yet: decode until it is first shown, then ask for 2 000 buckets of every channel over the
               whole length, of which that much is there
    decode     until all of it is there
    again      the store is there: open it, ask the same
    seek       2 000 buckets of every channel, at 60 places and zooms from the whole length down to a second; p95

The yardstick, in the same run: reading the file once and its zlib.adler32.

Budgets (design, section 9), for an hour: first ≤ 4 s, again ≤ 0.3 s, seek ≤ 100 ms; memory bounded whatever the size.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from tests.bench.support.report import percentile, report

RATE, CHUNK_FRAMES = 1000, 8
START = 1_760_000_000_000_000_000
WIDTH = 2000
ITEMS = np.dtype(
    [
        *(("head", "u1", 4), ("counter_id", "u1", 3), ("counter", ">u2"), ("time_id", "u1", 3), ("time", ">u4")),
        *(("q_id", "u1", 3), ("q", ">f4", 4), ("acc_id", "u1", 3), ("acc", ">f4", 3)),
        *(("turn_id", "u1", 3), ("turn", ">f4", 3), ("status_id", "u1", 3), ("status", ">u4"), ("check", "u1")),
    ]
)


def frames(first: int, count: int) -> np.ndarray[Any, Any]:
    """Frames as bytes: (count, size) uint8."""
    out = np.zeros(count, ITEMS)
    index = np.arange(first, first + count)
    ids = {"counter": (0x10, 0x20, 2), "time": (0x10, 0x60, 4), "q": (0x20, 0x10, 16), "acc": (0x40, 0x20, 12)}
    for name, item in {**ids, "turn": (0x80, 0x20, 12), "status": (0xE0, 0x20, 4)}.items():
        out[f"{name}_id"] = item
    out["head"] = (0xFA, 0xFF, 0x36, ITEMS.itemsize - 5)
    out["counter"], out["time"] = index & 0xFFFF, (index * 10) & 0xFFFFFFFF
    angle = index * 4e-4
    out["q"] = np.column_stack((np.cos(angle / 2), 0 * angle, 0 * angle, np.sin(angle / 2)))
    noise = np.random.default_rng(first).normal(size=(count, 6)).astype(np.float32)
    out["acc"] = noise[:, :3] * 0.02 + (0.1, 0.2, 9.81)
    out["turn"] = noise[:, 3:] * 0.001
    out["status"] = 3
    rows = out.view(np.uint8).reshape(count, ITEMS.itemsize)
    rows[:, -1] = -rows[:, 1:-1].astype(np.uint32).sum(axis=1) & 0xFF
    return rows


def make(path: Path, minutes: float) -> None:
    """The recording."""
    from imuscope.recordings.mcap.compaction import compact
    from imuscope.recordings.mcap.writer import McapWriter

    writer = McapWriter(path, {"title": "An hour"})
    writer.device("1", {"source": "/dev/ttyUSB0", "link": "serial", "baud": 2_000_000, "protocol": "xbus"})
    step = CHUNK_FRAMES * ITEMS.itemsize
    jitter = np.random.default_rng(2)
    for first in range(0, round(minutes * 60 * RATE), 60_000):
        data = frames(first, 60_000).tobytes()
        late = jitter.exponential(2e5, 60_000).astype(np.int64)
        for n, at in enumerate(range(0, len(data), step)):
            arrival = START + (first + (n + 1) * CHUNK_FRAMES) * (1_000_000_000 // RATE) + int(late[n])
            writer.chunk("1", "rx", data[at : at + step], arrival)
    writer.close()
    compact(path)


def measure(path: Path, store: Path) -> dict[str, float]:
    """Work of the separate process; figures in s and MB."""
    from imuscope.recordings.columns.store import ColumnStore
    from imuscope.recordings.mcap.source import McapSource
    from imuscope.server.devices.decode.protocol_set import all_protocols
    from imuscope.server.library.decode import decode

    resource_before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    start, cpu = time.perf_counter(), time.process_time()
    firsts: list[float] = []

    def shown(folder: Path) -> None:
        if not firsts:
            part = ColumnStore(folder)
            span = part.span()
            assert span is not None
            for number in part.shapes:
                part.query(number, *span, WIDTH)
            firsts.append(time.perf_counter() - start)

    columns = decode(McapSource(path), store, all_protocols(), shown=shown)
    decoded = time.perf_counter() - start
    cpu = time.process_time() - cpu
    first = firsts[0] if firsts else decoded
    whole = columns.span()
    assert whole is not None
    start = time.perf_counter()
    columns = ColumnStore(store)
    for number in columns.shapes:
        columns.query(number, *whole, WIDTH)
    again = time.perf_counter() - start
    seeks = []
    places = np.random.default_rng(3)
    for _ in range(60):
        span = (whole[1] - whole[0]) ** places.random()
        t0 = whole[0] + places.random() * (whole[1] - whole[0] - span)
        start = time.perf_counter()
        for number in columns.shapes:
            columns.query(number, t0, t0 + span, WIDTH)
        seeks.append(time.perf_counter() - start)
    rows = sum(columns.rows(number) for number in columns.shapes)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    store_mb = sum(file.stat().st_size for file in store.iterdir()) / 1e6
    return {
        "decode_s": decoded,
        "decode_cpu_s": cpu,
        "first_s": first,
        "again_s": again,
        "seek_p95_ms": 1000 * percentile(seeks, 0.95),
        "peak_mb": peak,
        "before_mb": resource_before,
        "store_mb": store_mb,
        "rows": rows,
    }


def main() -> None:
    if "--measure" in sys.argv:
        at = sys.argv.index("--measure")
        print(json.dumps(measure(Path(sys.argv[at + 1]), Path(sys.argv[at + 2]))))
        return
    minutes = float(sys.argv[sys.argv.index("--minutes") + 1]) if "--minutes" in sys.argv else 60.0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "hour.mcap"
        make(path, minutes)
        start = time.perf_counter()
        zlib.adler32(path.read_bytes())
        yardstick = time.perf_counter() - start
        command = [sys.executable, __file__, "--measure", str(path), str(Path(folder) / "store")]
        figures = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        raw_mb = minutes * 60 * RATE * ITEMS.itemsize / 1e6
        report(
            "opening",
            {
                "minutes": minutes,
                "raw_mb": raw_mb,
                "file_mb": path.stat().st_size / 1e6,
                **figures,
                "read_and_adler32_s": yardstick,
            },
        )


if __name__ == "__main__":
    main()
