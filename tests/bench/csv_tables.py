"""Benchmark of CSV: a million rows of an MTi, written by `Recording.export` and opened again, beside pandas.

    python -m tests.bench.csv_tables --rows 1000000

The yardsticks, in the same run, are `DataFrame.to_csv` of the same columns in the same precision, and `read_csv`, which
keeps no columns on disk and looks at no clock. Figures are processor time, the least of some runs.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import imuscope
from tests.bench.support.report import options_of, report, status_of
from tests.bench.support.serial_devices import frames, numbered

RATE_HZ = 1000
BUDGET_RATIO = 2
RUNS = 3


def write(path: Path, rows: int) -> None:
    """Write the bytes of the device."""
    template = frames(0, RATE_HZ, RATE_HZ)
    with path.open("wb") as file:
        for first in range(0, rows, RATE_HZ):
            file.write(numbered(template, first, RATE_HZ).tobytes())


def open_table(path: Path) -> int:
    with imuscope.open(path) as recording:
        return max(map(len, recording.signals))


def least_s(*works: Callable[[], object]) -> list[float]:
    """Processor time of each, s, of runs by turns; the first imports."""
    times: list[list[float]] = []
    for _ in range(RUNS + 1):
        own = []
        for work in works:
            began = time.process_time()
            work()
            own.append(time.process_time() - began)
        times.append(own)
    return np.min(times[1:], axis=0).tolist()  # type: ignore[no-any-return]


def main() -> int:
    """The command line."""
    parser = options_of(__doc__.partition("\n")[0])
    parser.add_argument("--rows", type=int, default=1_000_000)
    rows = parser.parse_args().rows
    with tempfile.TemporaryDirectory() as folder:
        device, csv, other = (Path(folder, name) for name in ("imu.bin", "imu.csv", "pandas.csv"))
        write(device, rows)
        with imuscope.open(device) as recording:
            [table] = recording.export(csv)
            frame = pd.read_csv(table)
            floats = frame.columns[2:][frame.dtypes.iloc[2:] == np.float64]
            single = frame.astype(dict.fromkeys(floats, np.float32))
            written = least_s(lambda: recording.export(csv), lambda: single.to_csv(other, index=False))
        if open_table(table) != rows:
            sys.exit(f"{open_table(table)} of {rows} rows")
        times = [*written, *least_s(lambda: open_table(table), lambda: pd.read_csv(table))]
        figures: dict[str, Any] = {"rows": rows, "columns": len(frame.columns), "mb": table.stat().st_size / 1e6}
    figures |= dict(zip(("write_s", "write_yardstick_s", "read_s", "read_yardstick_s"), times, strict=True))
    figures |= {f"{way}_ratio": figures[f"{way}_s"] / figures[f"{way}_yardstick_s"] for way in ("write", "read")}
    report("csv-tables", {**figures, "budget": {"ratio": BUDGET_RATIO}}, extra_versions={"pandas": pd.__version__})
    return status_of({f"{way} within budget": figures[f"{way}_ratio"] <= BUDGET_RATIO for way in ("write", "read")})


if __name__ == "__main__":
    sys.exit(main())
