"""Mark of simulated data: at a device, in its recordings and exports, and when these are played as a device."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
from mcap.reader import make_reader

from imuscope.recordings.mcap.writer import is_simulated
from tests.support.each_row import each_row
from tests.support.server_process import ServerProcess
from tests.support.waiting import block_until

Serve = Callable[..., ServerProcess]


def test_a_simulated_device_is_one_in_its_recording_in_exports_and_when_it_is_played(serve: Serve) -> None:
    """It looked like a sensor with a serial number, but for a grey `sim:xbus`."""
    server = serve("sim:xbus")
    block_until(lambda: server.request("GET", "/api/devices")[0]["status"] == "live", "it sends")
    assert server.request("GET", "/api/devices")[0]["simulated"]
    recording = server.request("POST", "/api/recordings/start", {})["id"]
    block_until(lambda: server.request("GET", "/api/recorder")["bytes"] > 10_000, "something is recorded")
    server.request("POST", "/api/recordings/stop", {})
    [file] = server.data.rglob(f"{recording}.mcap")
    [listed] = server.request("GET", "/api/recordings")
    assert [device["simulated"] for device in listed["devices"]] == [True]
    server.request("POST", "/api/devices", {"source": str(file)})
    block_until(lambda: server.request("GET", "/api/devices")[-1]["status"] == "live", "it is played")
    assert [device["simulated"] for device in server.request("GET", "/api/devices")] == [True, True]
    made = {export_format: exported(server, recording, export_format) for export_format in ("parquet", "mcap", "csv")}
    assert all("simulated" in path.name for path in made.values())
    table: Any = made["parquet"]
    if table.suffix == ".zip":  # of several messages
        archive = zipfile.ZipFile(table)
        table = io.BytesIO(archive.read(archive.namelist()[0]))
    assert pq.read_schema(table).metadata[b"simulated"] == b"true"
    with made["mcap"].open("rb") as mcap:
        [about] = [one.metadata for one in make_reader(mcap).iter_metadata() if one.name == "export"]
    assert about["simulated"] == "MTi-630"


def exported(server: ServerProcess, recording: str, export_format: str) -> Path:
    job = server.request("POST", f"/api/recordings/{recording}/exports", {"format": export_format})["id"]

    def done() -> str:
        jobs = server.request("GET", "/api/recordings/exports")
        [one] = [one for one in jobs if one["id"] == job]
        return str(one["file"]) if one["state"] == "done" else ""

    block_until(done, "it is exported")
    [path] = server.data.rglob(done())
    return path


def test_two_simulators_have_serial_numbers_of_their_own(serve: Serve) -> None:
    """Both were 0080800001: links, settings and names of one were taken for the other's."""
    server = serve("sim:xbus?product=MTi-680G", "sim:xbus", "sim:xbus?seed=0")
    block_until(
        lambda: all(one["serial_number"] for one in server.request("GET", "/api/devices")), "all are identified"
    )
    numbers = [one["serial_number"] for one in server.request("GET", "/api/devices")]
    assert numbers == ["0080800001", "0080800002", "0080800001"], "a seed that was given stays"


@each_row(
    ("about", "simulated"),
    [
        ({"link": "serial"}, False),
        ({"link": "simulator"}, True),
        ({"link": "file", "simulated": "True"}, True),
    ],
)
def test_recordings_of_earlier_versions_are_known_by_their_link(about: dict[str, str], simulated: bool) -> None:
    assert is_simulated(about) is simulated


def test_an_empty_list_of_sources_opens_none(serve: Serve, tmp_path: Path) -> None:
    """Three simulators were started all the same."""
    settings = tmp_path / "imuscope.toml"
    settings.write_text("sources = []\n")
    server = serve(arguments=("--config", str(settings)))
    assert server.request("GET", "/api/devices") == []
    assert "simulated" not in server.log
