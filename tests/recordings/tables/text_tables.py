"""Text tables for tests: made of an expression of the row's number, and read."""

import os
from pathlib import Path

from imuscope.recordings.tables.options import TableOptions
from imuscope.recordings.tables.table_rows import TableRows
from imuscope.recordings.tables.table_source import CsvSource

N = 300
EPOCH = 1_500_000_000
GYRO = ",".join(("gx", "gy", "gz"))
WRITTEN = 1_790_000_000


def read(path: Path, text: str, options: TableOptions | None = None) -> tuple[CsvSource, TableRows]:
    """A table of one block."""
    path.write_text(text, encoding="utf-8")
    os.utime(path, (WRITTEN, WRITTEN))
    source = CsvSource(path, options)
    [rows] = list(source.rows())
    return source, rows


def table(heading: str, cell: str, separator: str = ",") -> str:
    """A table with that expression of the row's number as its times."""
    lines = [f"{eval(cell, {'n': n})}{separator}{separator.join((str(n % 5), '0', '0'))}" for n in range(N)]
    return "\n".join([f"{heading}{separator}{GYRO.replace(',', separator)}", *lines]) + "\n"
