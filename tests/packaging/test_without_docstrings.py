"""A server without docstrings, as docs/guide/deployment.md sets it up for a small computer."""

from __future__ import annotations

from pathlib import Path

from tests.support.server_process import ServerProcess
from tests.support.waiting import block_until


def test_a_server_without_docstrings_records_a_device(tmp_path: Path) -> None:
    without = ("env", "PYTHONOPTIMIZE=2")
    with ServerProcess("sim:xbus", data=tmp_path, prefix=without, arguments=("--record",)) as server:
        block_until(lambda: server.request("GET", "/api/devices")[0]["status"] == "live", "it is live")
        block_until(lambda: server.request("GET", "/api/recorder")["bytes"] > 10_000, "it is recorded")
        assert server.request("GET", "/openapi.json")["paths"]
