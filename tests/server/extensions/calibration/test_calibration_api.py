"""Calibrations over HTTP: a running one, seen alike by all, and one of a stretch; and exports that others can read."""

import csv
import io
import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from imuscope.protocols.simulator.setups import HARD_IRON, SOFT_IRON, SensorSetup
from imuscope.server import wire
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.jobs.service import AnalysisService
from imuscope.server.extensions.calibration.kinds import METHODS, CalibrationInputs, CalibrationOptions, evaluated
from imuscope.server.extensions.calibration.session import MAX_SAMPLES, SampleCollector
from imuscope.server.extensions.calibration.stretch import CalibrationJob
from imuscope.server.links.source_url import open_link
from imuscope.server.settings.config import Config
from imuscope.server.streaming.channel_rows import ChannelRows
from imuscope.server.streaming.channel_store import ChannelStore
from tests.support.each_row import each_row
from tests.support.in_process_server import InProcessServer, table_server
from tests.support.problems import assert_problem
from tests.support.waiting import block_until

START = 1_760_000_000.0
SETUP = SensorSetup(motion="tumble", hard_iron=0.3, soft_iron=0.1)
T = np.arange(0, 60, 0.02)
FIELD = 48.0 * SETUP.field(SETUP.motion_at(T).field)


def vector(device: str, name: str, unit: str) -> wire.ChannelInfo:
    columns = [wire.ColumnInfo(axis, "f8", unit, label=axis) for axis in "xyz"]
    return wire.ChannelInfo(0, device, "M", name, name, "vector", unit, "", columns)


class Rows:
    """Channels of a live device, fed by the test."""

    def __init__(self, running: InProcessServer, device: str) -> None:
        self.running, self.device = running, device
        self.bus = running.services.telemetry.bus
        self.ids: dict[str, int] = {}

    def feed(self, name: str, unit: str, values: Any, rate: float = 50.0, begin: float | None = None) -> None:
        """Rows of a vector, the last of them now."""
        if name not in self.ids:
            self.ids[name] = self.running.call(self.bus.advertise, vector(self.device, name, unit))
        values = np.asarray(values, np.float64)
        last = self.bus.now() if begin is None else begin + (len(values) - 1) / rate
        time = last - np.arange(len(values))[::-1] / rate
        self.running.call(self.bus.publish, [ChannelRows(self.ids[name], [time, time, *values.T])])


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[InProcessServer]:
    """A server with one device, and a recording "turned" of a magnetometer."""
    rows = "".join(f"{START + t:.3f},{x:.6f},{y:.6f},{z:.6f}\n" for t, (x, y, z) in zip(T, FIELD, strict=True))
    head = "time,MagneticField.x (µT),MagneticField.y (µT),MagneticField.z (µT)\n"
    with table_server(tmp_path_factory.mktemp("data"), turned=head + rows) as running:
        yield running


@pytest.fixture
def device(running: InProcessServer) -> Rows:
    [info] = block_until(lambda: running.client.get("/api/devices").json(), "the device")
    running.client.delete(f"/api/devices/{info['id']}/calibration")
    return Rows(running, info["id"])


def url(device: Rows, rest: str = "") -> str:
    return f"/api/devices/{device.device}/calibration{rest}"


def latest(device: Rows) -> Any:
    return device.running.client.get(url(device)).json()


def until(device: Rows, condition: Any) -> Any:
    def state() -> Any:
        result = latest(device)
        return result if result["report"] and condition(result) else None

    return block_until(state, "the report")


def test_a_calibration_names_its_sensor_where_there_are_two() -> None:
    """Regression: of a rate of turn in two messages the newest was taken without a word."""
    both = [replace(vector("1", "RateOfTurn", "°/s"), id=at, message=message) for at, message in enumerate(("A", "B"))]
    method = METHODS["gyroscope"]
    for infos, notes in (
        (both, ["This is RateOfTurn of B; the device also has RateOfTurn of A."]),
        (both[:1], []),
    ):
        triads = method.triads(CalibrationInputs.of(infos))
        assert evaluated(method, triads, {}, CalibrationOptions()).notes == notes


def test_a_magnetometer_is_calibrated_live_and_exported(device: Rows) -> None:
    device.feed("MagneticField", "µT", FIELD[:10])
    client = device.running.client
    began = client.post(url(device), json={"kind": "magnetometer", "field": 48.0})
    assert began.status_code == 200, began.text
    assert began.json()["is_running"] is True
    assert began.json()["report"]["samples"] == 0  # those before the start do not count
    device.feed("MagneticField", "µT", FIELD[:500])
    observed = until(device, lambda result: result["report"]["samples"] == 500)
    assert observed["report"]["refusal"]["message"].startswith("Only ")
    assert observed["report"]["advice"]
    assert_problem(client.post(url(device, "/finish"), json={}), 422, "no-result")
    device.feed("MagneticField", "µT", FIELD[500:])
    done = until(device, lambda result: not result["is_running"])
    report = done["report"]
    assert (report["progress"], report["samples"], report["sensor"]) == (1, len(FIELD), "MagneticField")
    assert report["correction"]["bias"] == pytest.approx(48 * 0.3 * HARD_IRON, abs=1e-3)
    device.feed("MagneticField", "µT", FIELD[:100] + 20)  # after the end nothing is added
    assert latest(device)["report"] == report

    matrix = np.array(report["correction"]["matrix"])
    assert matrix == pytest.approx(np.linalg.inv(np.eye(3) + 0.1 * SOFT_IRON), abs=1e-4)
    texts = {name: client.get(url(device, "/export"), params={"format": name}) for name in ("json", "yaml", "csv", "c")}
    assert json.loads(texts["json"].text)["correction"]["matrix"] == matrix.tolist()
    of = yaml.safe_load(texts["yaml"].text)["magnetometer"]
    assert np.array(of["matrix"]["data"]).reshape(of["matrix"]["rows"], of["matrix"]["cols"]) == pytest.approx(matrix)
    assert of["bias"]["data"] == pytest.approx(report["correction"]["bias"])
    assert of["unit"] == "µT"
    rows = {row["name"]: float(row["value"]) for row in csv.DictReader(io.StringIO(texts["csv"].text))}
    assert [rows[f"matrix_{i}{j}"] for i in "xyz" for j in "xyz"] == pytest.approx(matrix.ravel())
    body = texts["c"].text.split("magnetometer_matrix[3][3]")[1]
    numbers = [float(text) for text in re.findall(r"-?\d\.\d+e[+-]\d+", body)]
    assert numbers == pytest.approx(matrix.ravel())
    assert texts["c"].headers["content-disposition"] == 'attachment; filename="magnetometer.h"'


def test_a_gyroscope_is_calibrated_by_the_rest_of_both_sensors(device: Rows) -> None:
    noise = np.random.default_rng(1).normal(scale=0.05, size=(1600, 3))
    device.feed("RateOfTurn", "°/s", np.zeros((2, 3)))
    device.feed("Acceleration", "m/s²", np.zeros((2, 3)))
    client = device.running.client
    assert client.post(url(device), json={"kind": "gyroscope"}).json()["report"]["refusal"]
    begin = device.bus.now()
    device.feed("RateOfTurn", "°/s", noise + np.array([0.5, 0, -0.2]), begin=begin)
    device.feed("Acceleration", "m/s²", noise + np.array([0, 0, 9.8]), begin=begin)
    report = until(device, lambda result: result["report"]["samples"] == 1600)["report"]
    assert report["correction"]["bias"] == pytest.approx([0.5, 0, -0.2], abs=0.01)
    assert report["rest"]["seconds"] > 30
    assert report["progress"] == 1


def test_a_calibration_is_finished_with_the_samples_until_now(device: Rows) -> None:
    noise = np.random.default_rng(1).normal(scale=0.05, size=(800, 3))
    device.feed("RateOfTurn", "°/s", np.zeros((2, 3)))
    client = device.running.client
    client.post(url(device), json={"kind": "gyroscope"})
    device.feed("RateOfTurn", "°/s", noise + np.array([0.5, 0, -0.2]), begin=device.bus.now())
    until(device, lambda result: result["report"]["samples"] == 800)
    ended = client.post(url(device, "/finish"), json={})
    assert ended.status_code == 200, ended.text
    assert (ended.json()["is_running"], latest(device)["is_running"]) == (False, False)
    assert latest(device)["report"]["correction"]["bias"] == pytest.approx([0.5, 0, -0.2], abs=0.01)


def test_a_running_calibration_is_replaced_and_discarded(device: Rows) -> None:
    client = device.running.client
    device.feed("RateOfTurn", "°/s", np.zeros((2, 3)))
    device.feed("MagneticField", "µT", FIELD[:2])
    assert client.post(url(device), json={"kind": "gyroscope"}).json()["report"]["kind"] == "gyroscope"
    assert client.post(url(device), json={"kind": "magnetometer"}).json()["report"]["kind"] == "magnetometer"
    assert latest(device)["report"]["kind"] == "magnetometer"
    assert client.delete(url(device)).status_code == 204
    assert latest(device)["report"] is None
    assert_problem(client.post(url(device, "/finish"), json={}), 404, "not-found")
    assert_problem(client.get(url(device, "/export")), 404, "not-found")


def test_what_cannot_be_calibrated_gives_the_reason(device: Rows) -> None:
    client = device.running.client
    assert_problem(client.get("/api/devices/99/calibration"), 404, "not-found")
    assert_problem(client.post(url(device), json={"kind": "soul"}), 422, "bad-request")
    device.running.call(device.bus.advertise, vector("bare", "Velocity", "m/s"))
    problem = assert_problem(client.post("/api/calibration/magnetometer", json={"source": "bare"}), 409, "not-now")
    assert "magnetometer" in problem["message"]


def test_a_calibration_of_a_stretch_has_the_limits_of_an_analysis(
    device: Rows, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It ran in a thread of the server, without limits and turns, and went on when its client had left."""

    async def content(self: AnalysisService, user: str, job: Any) -> Any:
        assert isinstance(await job(), CalibrationJob)
        raise DomainError("full", f"{user} has enough.", "Wait.")

    monkeypatch.setattr(AnalysisService, "content", content)
    answer = device.running.client.post("/api/calibration/magnetometer", json={"source": "turned"})
    assert "has enough" in assert_problem(answer, 409, "full")["message"]


def test_a_stretch_of_a_recording_and_of_memory(device: Rows) -> None:
    client = device.running.client
    path = "/api/calibration/magnetometer"

    def recorded(**more: Any) -> Any:
        return client.post(path, json={"source": "turned", "field": 48.0, **more})

    report = block_until(lambda: recorded().json() if recorded().status_code == 200 else None, "the recording")
    assert report["correction"]["bias"] == pytest.approx(48 * 0.3 * HARD_IRON, abs=1e-3)
    assert report["samples"] == len(FIELD)
    short = recorded(t1=START + 4).json()
    assert short["samples"] == 201
    assert short["correction"] is None
    assert short["refusal"]["hint"]
    assert_problem(recorded(t1=START + 4, format="yaml"), 422, "no-result")
    assert yaml.safe_load(recorded(format="yaml").text)["magnetometer"]["unit"] == "µT"
    assert_problem(recorded(t0=5, t1=4), 422, "bad-span")
    assert_problem(client.post(path, json={"source": "nothing"}), 404, "not-found")
    begin = device.bus.now() - 80
    device.feed("MagneticField", "µT", FIELD, begin=begin)
    live = client.post(path, json={"source": device.device, "t0": begin - 0.01, "t1": begin + 60, "field": 48.0}).json()
    assert live["correction"]["bias"] == pytest.approx(report["correction"]["bias"], abs=0.05)


def test_memory_of_a_calibration_is_bounded() -> None:
    store = ChannelStore(lambda: 0.0)
    info = store.advertise(vector("1", "RateOfTurn", "rad/s"))
    triad = CalibrationInputs.of([info]).triads["gyroscope"]
    assert triad.factor == pytest.approx(57.29577951)
    collector = SampleCollector(triad, store)
    n = 0
    for _ in range(24):
        time = np.arange(n, n + 20_000) / 2000
        store.append([ChannelRows(info.id, [time, time, *(np.radians([[n, 0, 0]]).repeat(20_000, 0).T)])])
        n += 20_000
        collector.catch_up()
        assert len(collector.samples) <= MAX_SAMPLES
    samples = collector.samples
    assert len(samples) > MAX_SAMPLES / 3
    assert collector.lost == 0
    assert samples.time[0] == 0
    assert samples.time[-1] > n / 2000 - 0.01
    steps = np.diff(samples.time)
    assert steps.max() == pytest.approx(steps.min())
    assert samples.values[:, 0] == pytest.approx(np.floor(samples.time * 2000 / 20_000 + 1e-6) * 20_000)


@each_row(
    ("names", "result"),
    [
        (
            ["RateOfTurn", "Acceleration", "FreeAcceleration", "MagneticField"],
            ["Acceleration", "RateOfTurn", "MagneticField"],
        ),
        (
            ["DID_IMU.I.acc", "DID_IMU.I.pqr", "DID_MAGNETOMETER.mag"],
            ["DID_IMU.I.acc", "DID_IMU.I.pqr", "DID_MAGNETOMETER.mag"],
        ),
        (["Velocity", "MagneticFieldStd"], [None, None, None]),
    ],
)
def test_sensors_are_recognised_by_name_and_unit(names: list[str], result: list[str | None]) -> None:
    units = {"acc": "m/s²", "rate": "°/s", "pqr": "°/s", "vel": "m/s", "mag": "", "freeacc": "m/s²"}

    def unit(name: str) -> str:
        return next(unit for key, unit in units.items() if key in name.lower())

    inputs = CalibrationInputs.of([vector("1", name, unit(name)) for name in names])
    expected = ("accelerometer", "gyroscope", "magnetometer")
    assert [inputs.triads[one].name if one in inputs.triads else None for one in expected] == result


def test_a_mounting_rotation_is_written_once_the_settings_were_read(tmp_path: Path) -> None:
    """To a real device, which is silent meanwhile: the test sends the samples of its drive."""
    config = Config(data=tmp_path, sources=("sim:xbus?rate=100&seed=1",))
    with InProcessServer(config, open_link, all_protocols()) as running:
        client = running.client
        jobs = "/api/devices/1/jobs"

        def carried_out(route: str, body: Any) -> Any:
            answer = client.post(f"/api/devices/1/{route}", json={"confirmed": True, **body})
            assert answer.status_code == 202, answer.text
            number = answer.json()["id"]
            return block_until(
                lambda: next((job for job in client.get(jobs).json()["done"] if job["id"] == number), None),
                "the end of the job",
            )

        block_until(lambda: client.get("/api/devices").json()[0]["status"] == "live", "a live device")
        carried_out("run", {"command": "GoToConfig"})
        block_until(lambda: client.get("/api/devices").json()[0]["status"] == "idle", "its silence")
        device = Rows(running, "1")
        device.ids = {one.name: one.id for one in running.services.telemetry.store.of_device("1").values()}
        assert client.post(url(device), json={"kind": "mounting"}).status_code == 200
        setup = SensorSetup(motion="straight", mount=30)
        motion = setup.motion_at(np.arange(0, 30, 0.01))
        begin = device.bus.now()
        noise = np.random.default_rng(1).normal(0, 1e-3, (len(motion.rate), 3))  # without any a sensor counts as stuck
        device.feed("RateOfTurn", "°/s", np.degrees(motion.rate) + noise, 100.0, begin)
        device.feed("Acceleration", "m/s²", motion.force + noise, 100.0, begin)
        write = until(device, lambda result: not result["is_running"])["write"]
        assert (write["setting"], write["values"]) == ("AlignmentRotation.RotSensor", None)
        assert "not been read" in write["problem"]
        carried_out("read", {})
        values = latest(device)["write"]["values"]
        job = carried_out("apply", {"changes": {write["setting"]: values}})
        assert (job["state"], job["outcomes"]) == ("done", []), job
        stored = client.get("/api/devices/1/values").json()["values"][write["setting"]]
        assert [stored[name] for name in ("q0", "q1", "q2", "q3")] == pytest.approx(
            setup.q_vehicle_from_sensor, abs=0.02
        )
