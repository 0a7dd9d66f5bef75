"""A protocol family in a separate package, installed beside imuscope, which needs no line of code about it.

The package is tests/plugins/plugin_family. Here it is made visible as pip would: by its folder and a .dist-info on the
path.
"""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.error import HTTPError

import numpy as np
import pytest
from websockets.sync.client import connect

from imuscope.protocols.events import Batch
from imuscope.protocols.family.plugins import GROUP
from imuscope.protocols.registry.families import ProtocolInfo, load_families
from imuscope.protocols.simulator.family import SimulatorRequest
from imuscope.recordings.importers.open_file import open_file
from tests.support.each_row import each_row
from tests.support.forking import fork_server
from tests.support.forking.fork_server import ForkServer
from tests.support.server_process import ROOT, ServerProcess, imuscope
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until

PACKAGE = ROOT / "tests" / "plugins" / "plugin_family"
VECTORS: list[dict[str, str]] = json.loads((PACKAGE / "vectors.json").read_text())
SETTING = "SensorToVehicleRotation"
BROKEN = "imuscope_broken"
Run = Callable[..., str]


def install(folder: Path, project: Path) -> None:
    """Write the metadata of a package as an installer does."""
    declared = tomllib.loads(project.read_text())["project"]
    about = folder / f"{declared['name'].replace('-', '_')}-{declared['version']}.dist-info"
    about.mkdir(parents=True)
    head = f"Metadata-Version: 2.1\nName: {declared['name']}\nVersion: {declared['version']}\n"
    (about / "METADATA").write_text(head)
    rows = "".join(f"{name} = {value}\n" for name, value in declared["entry-points"][GROUP].items())
    (about / "entry_points.txt").write_text(f"[{GROUP}]\n{rows}")


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The package on the path of this process and its children, and one beside it that cannot be loaded."""
    folder = tmp_path_factory.mktemp("site")
    install(folder, PACKAGE / "pyproject.toml")
    broken = folder / "broken.toml"
    broken.write_text(
        f'[project]\nname = "{BROKEN}"\nversion = "9"\n[project.entry-points."{GROUP}"]\nbroken = "{BROKEN}:FAMILY"\n'
    )
    install(folder, broken)
    path = os.pathsep.join([str(folder), str(PACKAGE), *filter(None, [os.environ.get("PYTHONPATH")])])
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", path)
        patch.syspath_prepend(str(PACKAGE))
        yield folder


@pytest.fixture(scope="module")
def family(installed: Path) -> ProtocolInfo:
    """The family, in this process."""
    import imuscope_mip.family

    return imuscope_mip.family.FAMILY


@pytest.fixture(scope="module")
def own(installed: Path) -> ForkServer | None:
    """Starts processes that find the package."""
    return ForkServer() if fork_server.IS_THERE else None


@pytest.fixture(scope="module")
def server(own: ForkServer | None, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    with ServerProcess("sim:mip?rate=50", data=tmp_path_factory.mktemp("data"), fresh=own is None, by=own) as server:
        yield server


@pytest.fixture(scope="module")
def run(own: ForkServer | None) -> Run:
    """Output of `imuscope WORDS` in a new process that has found the package."""

    def run(*words: str, stdin: str = "") -> str:
        done = imuscope(*words, stdin=stdin.encode(), fresh=own is None, by=own)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


def eventually(check: Callable[[], Any]) -> Any:
    """Result of `look` once it is true."""
    return block_until(check, "a result")


@each_row("vector", VECTORS, ids=lambda vector: f"{vector['of']}, {vector['from']}")
def test_packets_of_others_are_read_and_made_again(family: ProtocolInfo, vector: dict[str, str]) -> None:
    packet = bytes.fromhex(vector["packet"])
    lister = family.frames.listing()
    lister.feed(b"\x75\x65noise" + packet[:5])
    lister.feed(packet[5:] + b"\x75")
    [line] = [line for line in lister.drain(stalled=True) if "reject" not in line]
    assert line["message"] == vector["of"]
    assert family.frames.composer is not None
    assert family.frames.composer({}).frame_of(line) == packet


def test_it_is_shown_live_and_identified(server: ServerProcess) -> None:
    device = eventually(
        lambda: next(
            (one for one in server.request("GET", "/api/devices") if one["product"] and one["status"] == "live"), None
        )
    )
    assert (device["protocol"], device["product"]) == ("mip", "3DM-GX5-45")
    assert (device["serial_number"], device["firmware"]) == ("6251.70000", "1.1.21")
    [report] = [one for one in server.request("GET", "/api/capabilities")["protocols"] if one["name"] == "mip"]
    assert (report["short"], report["simulator"], report["plots"][0]) == ("MIP", True, "Acceleration")
    channels: set[str] = set()
    with connect(f"{server.url.rstrip('/').replace('http', 'ws', 1)}/ws", subprotocols=["imuscope.v1"]) as connection:  # type: ignore[list-item]
        while not channels >= {"Acceleration", "RateOfTurn", "Quaternion", "LatLon"}:
            text = connection.recv(PATIENCE_S)
            if isinstance(text, str) and (message := json.loads(text))["op"] == "channels":
                channels |= {one["name"] for one in message["channels"]}


def test_its_frames_are_shown_byte_by_byte(server: ServerProcess) -> None:
    [held] = eventually(
        lambda: [one for one in server.request("GET", "/api/recorder/memory") if one["t1"] - one["t0"] > 1]
    )
    view = server.request("GET", f"/api/devices/1/frames?time={held['t1'] - 0.5}&kind=frame")
    frame = view["packets"][view["at"]]
    assert (view["protocol"], frame["hex"][:4]) == ("mip", "7565")
    assert [part["label"] for part in frame["spans"]][:1] == ["sync"]
    ends = [part["offset"] + part["size"] for part in frame["spans"]]
    assert [part["offset"] for part in frame["spans"]] == [0, *ends[:-1]]
    assert ends[-1] == frame["size"] == len(frame["hex"]) / 2
    assert {part["path"] for part in frame["spans"]} - {""} <= frame["fields"].keys()


def test_a_setting_is_written_and_read_back_on_the_page(server: ServerProcess) -> None:
    eventually(lambda: [one for one in server.request("GET", "/api/devices") if one["status"] == "live"])
    forms = server.request("GET", "/api/devices/1/forms")
    assert [setting["name"] for setting in forms["settings"]] == [SETTING]
    expected = {"roll": 0.5, "pitch": -0.25, "yaw": 1.0}
    server.request("POST", "/api/devices/1/apply", {"changes": {SETTING: expected}, "confirmed": True})
    eventually(lambda: server.request("GET", "/api/devices/1/values")["values"].get(SETTING) == expected)


def test_an_option_of_its_own_is_offered_wherever_options_are(server: ServerProcess, run: Run) -> None:
    [report] = [one for one in server.request("GET", "/api/capabilities")["protocols"] if one["name"] == "mip"]
    [offered] = report["options"]
    assert (offered["name"], offered["kind"], offered["default"]) == ("timestamps", "choice", "device")
    assert [choice["value"] for choice in offered["choices"]] == ["device", "arrival"]
    fields = server.request("GET", "/openapi.json")["components"]["schemas"]["AddDeviceRequest"]["properties"]
    assert fields["timestamps"]["enum"] == ["", "device", "arrival"]
    assert "--timestamps {device,arrival}" in run("decode", "--help")
    assert "timestamps=" in run("serve", "--help")
    changed = server.request("POST", "/api/devices/1/decode-options", {"timestamps": "arrival"})
    assert changed["decode_options"] == {"timestamps": "arrival"}
    with pytest.raises(HTTPError, match="422"):
        server.request("POST", "/api/devices/1/decode-options", {"timestamps": "moon"})
    assert server.request("POST", "/api/devices/1/decode-options", {"timestamps": ""})["decode_options"] == {}


def test_its_decoder_has_the_option_of_a_source_and_of_a_recording(
    family: ProtocolInfo, run: Run, tmp_path: Path
) -> None:
    assert family.simulator is not None
    [device] = family.simulator.make(SimulatorRequest(rate=50))
    sent = device.advance(1_000_000_000)
    for text, timed in (("device", True), ("arrival", False), ("", True)):
        decoder = family.decoding.decoder(**family.settings({"timestamps": text}))
        decoder.feed(sent, 0)
        results = [event for event in decoder.drain() if isinstance(event, Batch)]
        assert {batch.time_ns is not None for batch in results} == {timed}
    path = tmp_path / "by_arrival.mcap"
    run("record", "sim:mip?rate=50&timestamps=arrival", "-o", str(path), "--duration", "1")
    [recorded] = open_file(path).devices.values()
    assert (recorded.identity["timestamps"], recorded.identity["source"]) == ("arrival", "sim:mip?rate=50")


@pytest.fixture(scope="module")
def recording(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two seconds of the simulated device."""
    path = tmp_path_factory.mktemp("recording") / "drive.mcap"
    run("record", "sim:mip?rate=50", "-o", str(path), "--duration", "2")
    return path


def test_it_is_recorded_inspected_composed_and_exported(run: Run, recording: Path, tmp_path: Path) -> None:
    lines = run("inspect", str(recording), "--format", "jsonl")
    frames = bytes.fromhex("".join(run("compose", "--jsonl", "-", stdin=lines).split()))
    run("decode", str(recording), "-o", str(tmp_path / "out.bin"))
    assert frames in (tmp_path / "out.bin").read_bytes()
    assert len(frames) > 50 * 146
    for suffix in (".csv", ".parquet", ".mcap"):
        run("decode", str(recording), "-o", str(tmp_path / f"decoded{suffix}"))
    made = {path.suffix for path in tmp_path.glob("decoded*")}
    assert made == {".csv", ".parquet", ".mcap"}


def test_a_recording_is_played_again(run: Run, recording: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.mcap"
    run("record", f"{recording}?speed=20", "-o", str(again))
    first, second = (run("inspect", str(path), "--format", "jsonl") for path in (recording, again))
    assert second == first
    assert second.count("ScaledAccelerometer") > 50


def test_the_simulated_device_stands_level(family: ProtocolInfo) -> None:
    assert family.simulator is not None
    [device] = family.simulator.make(SimulatorRequest(rate=50))
    lister = family.frames.listing()
    lister.feed(device.advance(1_000_000_000))
    lines = lister.drain(stalled=True)
    force = [line["fields"]["Acceleration"] for line in lines if "Acceleration" in line["fields"]]
    angles = [line["fields"]["EulerAngles"] for line in lines if "EulerAngles" in line["fields"]]
    assert np.mean(force, axis=0) == pytest.approx([0, 0, -1], abs=0.1), "z is down, as on the vendor's devices"
    assert np.abs(angles)[:, :2].max() < 0.1


def test_a_setting_is_sent_from_the_command_line(run: Run) -> None:
    _, stored = map(json.loads, run("send", "sim:mip", f"Write{SETTING}", "roll=0.5", "pitch=0", "yaw=0").splitlines())
    assert stored == {"setting": SETTING, "fields": {"roll": 0.5, "pitch": 0.0, "yaw": 0.0}}


def test_a_package_that_cannot_be_loaded_is_reported_and_stops_nothing(server: ServerProcess) -> None:
    texts = [line for line in server.lines if BROKEN in line]
    assert len(texts) == 1, server.lines
    assert "cannot be used" in texts[0]


def test_duplicate_names_and_invalid_families() -> None:
    from imuscope.protocols.family.plugins import ProtocolPlugin

    families, problems = load_families(
        [
            ProtocolPlugin("xbus", "imuscope.protocols.xbus.family:FAMILY"),
            ProtocolPlugin("xbus", "json:loads", "other 1"),
        ]
    )
    assert (list(families), problems) == (
        ["xbus"],
        ["The protocol 'xbus' of other 1 cannot be used: json:loads is not a ProtocolInfo."],
    )
