"""Commands on a store, and the tables as another program reads them."""

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
from deltalake import DeltaTable

from imuscope.server.cli import main

ENDLESS = "SELECT sum(range) FROM range(1000000000000000)"
"""A question that only ends by a limit of time: its rows pass by. Two ranges that are crossed would be kept in memory,
whose limit a quick machine reaches first."""


class Commands:
    """`imuscope upload` and `imuscope query`, run in this process.

    Args:
        stores: a folder for stores that are made once, and copied.
    """

    def __init__(self, capsys: pytest.CaptureFixture[str], stores: Path) -> None:
        self._capsys = capsys
        self._stores = stores

    def run(self, *words: str | Path) -> tuple[int, str, str]:
        """Exit status, output and errors of a command."""
        self._capsys.readouterr()
        status = main([str(word) for word in words])
        printed = self._capsys.readouterr()
        return status, printed.out, printed.err

    def upload(self, file: Path, store: Path | str, robot: str = "otter", *more: str) -> str:
        """Upload a file; the line that was printed."""
        status, out, err = self.run("upload", file, "--store", store, "--robot", robot, *more)
        assert (status, err) == (0, "")
        return out

    def uploaded(self, file: Path, store: Path, robot: str = "otter") -> None:
        """Make a store with this recording, for a test that is not about its upload: a copy of one made before."""
        key = hashlib.sha256(file.read_bytes() + robot.encode()).hexdigest()
        if not (self._stores / key).exists():
            self.upload(file, self._stores / key, robot)
        shutil.copytree(self._stores / key, store, dirs_exist_ok=True)

    def query(self, store: Path | str, sql: str) -> list[dict[str, Any]]:
        """The answer to a question, from JSON."""
        status, out, err = self.run("query", "--store", store, sql, "--format", "json")
        assert (status, err) == (0, "")
        rows = json.loads(out)
        assert isinstance(rows, list)
        return rows

    def refused(self, *words: str | Path) -> str:
        """The one line of a command that fails."""
        status, out, err = self.run(*words)
        assert (status, out) == (1, "")
        assert err.startswith("imuscope: ")
        assert err.count("\n") == 1
        return err


def delta(store: Path, table: str) -> pa.Table:
    """A table as a program reads it that knows Delta Lake but not imuscope."""
    return DeltaTable(str(store / "tables" / table)).to_pyarrow_table()
