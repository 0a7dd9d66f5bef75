"""Benchmark of a store: questions over the metadata of many recordings, and the upload of a long one.

    python tests/bench/fleet_store.py [--recordings 100000] [--record-s 300] [--save]

The metadata is synthetic: N recordings in a year of daily files, each with a device and six signals in `minutes`, one
minute each. It is written a day at a time. Then:

    listing     the 50 newest recordings
    questions   each prepared question
    command     `imuscope query` with the listing, as a process: with the start of Python and its imports
    upload      a recording of a device at 1 kHz, and the mean of one of its signals

Every question is the best of three, in this process, with a warm file cache: seconds of wall clock, and of processor.

The yardstick, in the same run: Arrow reads the column `lost` of all files of `recordings`.

Budgets (issue 16), for 1,000,000 recordings: listing ≤ 0.3 s, each prepared question ≤ 3 s.
"""

from __future__ import annotations

import argparse
import datetime as dt
import multiprocessing
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.dataset as ds
from deltalake import write_deltalake

from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.recordings.mcap.writer import McapWriter
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.extensions.fleet.query.prepared_queries import QUESTIONS
from imuscope.server.extensions.fleet.query.query import run_query
from imuscope.server.extensions.fleet.store.store import location
from imuscope.server.extensions.fleet.store.tables import DEVICES, MINUTES, RECORDINGS, StoreTable
from imuscope.server.extensions.fleet.upload.upload import upload
from tests.bench.support.report import options_of, report
from tests.support.server_process import ROOT

DAYS, MONTH = 365, 31
START = dt.date(2025, 1, 1)
RECORDED_NS = 1_760_000_000_000_000_000
LISTING = "SELECT robot, started, lost FROM recordings ORDER BY started DESC, recording LIMIT 50"
SIGNALS = [("RateOfTurn", axis, "rate of turn", "°/s") for axis in "xyz"] + [
    ("Acceleration", "norm", "acceleration", "m/s²"),
    ("Acceleration", "x", "acceleration", "m/s²"),
    ("Temperature", "", "temperature", "°C"),
]


def rows_of(table: StoreTable, columns: dict[str, Any], length: int) -> pa.Table:
    """Rows with these columns; the others are empty."""
    return pa.table(
        [
            pa.array(columns[field.name], field.type) if field.name in columns else pa.nulls(length, field.type)
            for field in table.schema
        ],
        schema=table.schema,
    )


def synthetic(folder: Path, recordings: int) -> None:
    """Write the metadata of a year, a month at a time, so that memory is bounded."""
    for table in (RECORDINGS, DEVICES, MINUTES):
        place = folder / "tables" / table.name
        place.mkdir(parents=True)
        for first in range(0, DAYS, MONTH):
            days = range(first, min(DAYS, first + MONTH))
            each = -(-recordings // DAYS)
            rows = (batch for day in days for batch in day_of(table, day, each).to_batches())
            reader = pa.RecordBatchReader.from_batches(table.schema, rows)
            write_deltalake(str(place), reader, partition_by=["date"], mode="append")


def day_of(table: StoreTable, day: int, each: int) -> pa.Table:
    """Rows of a day, each recording ten minutes of a robot."""
    random = np.random.default_rng(day)
    date = START + dt.timedelta(days=day)
    morning = dt.datetime(date.year, date.month, date.day, 6, tzinfo=dt.UTC)
    started = [morning + dt.timedelta(seconds=36_000 * n / each) for n in range(each)]
    ids = [f"{day:05d}{n:019d}" for n in range(each)]
    keys = {"date": [date] * each, "robot": [f"robot-{n % 1000}" for n in range(each)], "recording": ids}
    lost = random.poisson(3, each)
    shared = {"duration_s": [600.0] * each, "lost": lost, "messages": [60_000] * each}
    if table is RECORDINGS:
        return rows_of(RECORDINGS, {**keys, **shared, "started": started}, each)
    if table is DEVICES:
        serials, adapters = [f"00808{n % 1000:05d}" for n in range(each)], [f"usb-{n % 12}" for n in range(each)]
        own = {"device": ["1"] * each, "serial_number": serials, "adapter": adapters, "gaps": lost, "rejects": lost}
        sheet = {"product": ["MTi-630"] * each, "gyro_noise": [1.2e-4] * each, "accelerometer_noise": [6e-4] * each}
        return rows_of(DEVICES, {**keys, **shared, **own, **sheet, "link": ["serial"] * each}, each)
    parts = []
    for name, axis, quantity, unit in SIGNALS:
        values = random.normal(25 if quantity == "temperature" else 0.1, 0.05, each)
        peaks = values + random.exponential(2.5, each)  # of the accelerations some are above 3 g
        figures = {"mean": values, "sigma": abs(values) / 10, "max": peaks, "noise": abs(values) / 100}
        words: dict[str, Any] = {
            "device": ["1"] * each,
            "signal": [f"{name}.{axis or 'value'}"] * each,
            "axis": [axis] * each,
        }
        words |= {"quantity": [quantity] * each, "unit": [unit] * each, "minute": started}
        parts.append(rows_of(MINUTES, {**keys, **words, **figures, "count": [6000] * each}, each))
    return pa.concat_tables(parts)


def record(path: Path, seconds: float) -> None:
    """A recording of a device at 1 kHz."""
    device = XbusSimulator(start_ns=0, rate=1000)
    writer = McapWriter(path, {})
    writer.device("1", {"source": "/dev/ttyUSB0", "link": "serial", "baud": 921600, "protocol": "xbus"})
    for n in range(1, round(seconds * 100)):
        if data := device.advance(n * 10_000_000):
            writer.chunk("1", "rx", data, RECORDED_NS + n * 10_000_000)
    writer.close()


def best(work: Callable[[], object]) -> dict[str, float]:
    """Wall clock of the shortest of three runs, and least processor time, s."""
    walls, processors = [], []
    for _ in range(3):
        wall, processor = time.perf_counter(), time.process_time()
        work()
        walls.append(time.perf_counter() - wall)
        processors.append(time.process_time() - processor)
    return {"s": min(walls), "cpu_s": min(processors)}


def query(folder: Path, sql: str) -> int:
    """Rows of an answer."""
    with run_query(location(str(folder)), sql) as reader:
        return sum(batch.num_rows for batch in reader)


def commanded(folder: Path) -> None:
    """The listing, by the command."""
    words = [sys.executable, "-m", "imuscope.server.cli", "query", "--store", str(folder), LISTING]
    subprocess.run(words, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)


def main() -> None:
    """Measure, and report."""
    parser = options_of(__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--recordings", type=int, default=100_000)
    parser.add_argument("--record-s", type=float, default=300.0, help="length of the recording that is uploaded")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="imuscope-") as name:
        folder = Path(name)
        year = folder / "year"
        writing = multiprocessing.get_context("spawn").Process(target=synthetic, args=(year, options.recordings))
        writing.start()  # in a process of its own, so that the memory is that of the questions
        writing.join()
        files = list((year / "tables").rglob("*.parquet"))
        results: dict[str, Any] = {
            "recordings": query(year, "SELECT recording FROM recordings"),
            "minutes": query(year, "SELECT 1 FROM minutes"),
            "files": len(files),
            "parquet_mb": sum(path.stat().st_size for path in files) / 1e6,
        }
        rows = str(year / "tables" / "recordings")
        results["yardstick"] = best(lambda: ds.dataset(rows, format="parquet").to_table(columns=["lost"]))
        results["listing"] = best(lambda: query(year, LISTING))
        results["questions"] = {key: best(partial(query, year, one.sql)) for key, one in QUESTIONS.items()}
        results["command_s"] = best(lambda: commanded(year))["s"]
        results["memory_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        record(folder / "drive.mcap", options.record_s)
        start = time.perf_counter()
        upload(folder / "drive.mcap", location(str(folder / "one")), "robot", DecodeOptions())
        one = [path.stat().st_size for path in (folder / "one" / "tables").rglob("*.parquet")]
        results["upload"] = {
            "recorded_s": options.record_s,
            "s": time.perf_counter() - start,
            "mcap_mb": (folder / "drive.mcap").stat().st_size / 1e6,
            "parquet_mb": sum(one) / 1e6,
            "signal": best(lambda: query(folder / "one", "SELECT avg(value) FROM samples('Acceleration.x')")),
        }
    report("fleet-store", results, extra_versions={name: version(name) for name in ("duckdb", "deltalake", "pyarrow")})


if __name__ == "__main__":
    main()
