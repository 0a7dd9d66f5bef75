"""A robot's port, shared: its driver goes on whatever the server does, and the page shows who is there."""

from __future__ import annotations

import json
import os
import select
import socket
import threading
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.events import Batch, RejectedFrame, SampleGap
from imuscope.protocols.xbus.decoder import XbusDecoder
from imuscope.protocols.xbus.driver import XbusDriver
from imuscope.protocols.xbus.frames import build
from imuscope.server.commands.arguments import parse
from imuscope.server.extensions.shares.settings import ShareSettings
from imuscope.server.links.simulated_device import SimulatorOptions, make_device
from imuscope.server.links.simulator import SimulatorThread
from imuscope.server.links.source_url import SourceUrl
from tests.server.extensions.shares.shared_port import opened
from tests.support.each_row import each_row
from tests.support.free_ports import free_port
from tests.support.server_process import ServerProcess, begun, imuscope
from tests.support.timeouts import PATIENCE_S, http_client
from tests.support.waiting import block_until

pytestmark = pytest.mark.usefixtures("runtime")

REQUEST_ID = build(0x00)  # ReqDID


class Driver(threading.Thread):
    """The robot's own driver: it reads its terminal without a pause and decodes what it gets."""

    def __init__(self, path: Path) -> None:
        super().__init__(daemon=True)
        self.fd = opened(path)
        self.samples = 0
        self.faults: list[object] = []
        self._decoder = XbusDecoder()
        self._stopped = threading.Event()
        self.start()

    def run(self) -> None:
        while not self._stopped.is_set():
            if not select.select((self.fd,), (), (), 0.1)[0]:
                continue
            try:
                data = os.read(self.fd, 4096)
            except OSError:
                data = b""
            if not data:
                self.faults.append("hung up")
                return
            self._decoder.feed(data, 0)
            for event in self._decoder.drain():
                if isinstance(event, Batch):
                    self.samples += len(event)
                elif isinstance(event, RejectedFrame | SampleGap):
                    self.faults.append(event)

    def stop(self) -> None:
        self._stopped.set()
        self.join(PATIENCE_S)
        os.close(self.fd)


@pytest.fixture
def simulator() -> Iterator[SimulatorThread]:
    """An MTi at 100 Hz behind a pseudo-terminal."""
    options = SimulatorOptions.of(SourceUrl.parse("sim:xbus"))
    thread = SimulatorThread(lambda start_ns: make_device(options, start_ns, None), options)
    thread.start()
    yield thread
    thread.stop()


def send_request(server: ServerProcess, path: str, body: Any = None, method: str = "") -> Any:
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(
        f"{server.url}/api/devices/1{path}", data, {"content-type": "application/json"}, method=method or None
    )
    try:
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
            return json.load(answer)
    except urllib.error.HTTPError as error:
        error.msg += f" {error.fp.peek(1000).decode()}"  # what the server says, for who reads a failed test
        raise


def refusal(server: ServerProcess, path: str, body: Any = None, method: str = "") -> Any:
    with pytest.raises(urllib.error.HTTPError) as raised:
        send_request(server, path, body, method)
    with raised.value as answer:
        return json.load(answer)


def is_live(server: ServerProcess) -> bool:
    with urllib.request.urlopen(f"{server.url}/api/devices", timeout=PATIENCE_S) as answer:
        return bool(json.load(answer)[0]["status"] == "live")


def first_client(server: ServerProcess) -> Any:
    return next((one for share in send_request(server, "/shares")["shares"] for one in share["clients"]), None)


def test_a_driver_goes_on_while_the_server_configures_dies_and_returns(
    simulator: SimulatorThread, tmp_path: Path
) -> None:
    path, source = tmp_path / "imu0", f"{simulator.slave}?baud=115200"
    with ServerProcess(source, data=tmp_path / "data", arguments=("--share", str(path))) as server:
        block_until(lambda: is_live(server), "a live device")
        driver = Driver(path)
        name = f"(process {os.getpid()})"
        block_until(lambda: first_client(server) and name in first_client(server)["name"], "the driver on the page")
        block_until(lambda: driver.samples > 20, "samples at the driver")
        os.write(driver.fd, REQUEST_ID)
        entry = block_until(
            lambda: next((one for one in send_request(server, "/traffic") if one["name"] == "ReqDID"), None),
            "the request of the driver in the traffic log",
        )
        assert entry["direction"] == "tx"
        assert entry["text"] == first_client(server)["name"]
        job = send_request(server, "/read", {})
        done = block_until(
            lambda: next((one for one in send_request(server, "/jobs")["done"] if one["id"] == job["id"]), None),
            "the settings",
        )
        assert done["state"] == "done", done
        assert not driver.faults, "what it reads is the stream of the device, all of it"
        before = driver.samples
        server.process.kill()
        server.process.wait(PATIENCE_S)
        block_until(lambda: driver.samples > before + 50, "samples at the driver without a server")
        assert not driver.faults
    with ServerProcess(source, data=tmp_path / "data", arguments=("--share", str(path))) as server:
        block_until(lambda: is_live(server), "the device at the new server")
        assert first_client(server)["peer"] == str(path), "the holder was found again"
        assert not driver.faults
        send_request(server, f"/shares?name={urllib.parse.quote(str(path))}", method="DELETE")
        block_until(lambda: driver.faults, "the driver finds its port gone")
        assert driver.faults == ["hung up"]
        assert not os.path.lexists(path)
        block_until(lambda: is_live(server), "the device on the server's own link")
        driver.stop()


def test_nothing_is_sent_unasked_while_a_driver_uses_the_device(simulator: SimulatorThread, tmp_path: Path) -> None:
    """A click on Record, or a server that started again, silenced a working robot's sensor for a moment."""
    path, source = tmp_path / "imu0", f"{simulator.slave}?baud=115200"
    shared = ("--share", str(path))
    with ServerProcess(source, data=tmp_path / "data", arguments=shared) as server:
        block_until(lambda: is_live(server), "a live device")
        driver = Driver(path)
        block_until(lambda: first_client(server) and driver.samples > 20, "the driver")
        before = sent_by_imuscope(server)
        record(server)
        assert sent_by_imuscope(server) == before
        server.process.kill()
        server.process.wait(PATIENCE_S)
    with ServerProcess(source, data=tmp_path / "data", arguments=(*shared, "--record")) as server:
        block_until(lambda: is_live(server) and first_client(server), "a live device")
        # A client is named after its process a moment after its first bytes, and after the port until then.
        block_until(lambda: f"(process {os.getpid()})" in first_client(server)["name"], "the driver's name")
        place = tmp_path / "data" / "recordings"
        block_until(lambda: any(file.stat().st_size > 2000 for file in place.glob("*.mcap")), "the recording")
        record(server)
        assert sent_by_imuscope(server) == []
        assert not driver.faults
        driver.stop()
        block_until(lambda: not first_client(server), "the end of the driver")
        job = send_request(server, "/read", {})  # asked for
        block_until(
            lambda: any(one["id"] == job["id"] for one in send_request(server, "/jobs")["done"]), "the settings"
        )
        assert sent_by_imuscope(server)


def sent_by_imuscope(server: ServerProcess) -> list[str]:
    """Names of the messages to the device that no client has sent."""
    clients = {one["name"] for share in send_request(server, "/shares")["shares"] for one in share["clients"]}
    return [
        one["name"]
        for one in send_request(server, "/traffic")
        if one["direction"] == "tx" and one["text"] not in clients
    ]


def record(server: ServerProcess) -> None:
    """Record for a moment."""
    with http_client(base_url=server.url) as http:
        http.post("/api/recordings/stop", json={})
        assert http.post("/api/recordings/start", json={}).is_success
        block_until(lambda: http.get("/api/recorder").json()["bytes"] > 2000, "some samples")
        assert http.post("/api/recordings/stop", json={}).is_success


def test_a_port_is_shared_from_the_page_and_the_device_keeps_its_history(
    simulator: SimulatorThread, tmp_path: Path, runtime: Path
) -> None:
    path = runtime / "imuscope" / "imu0"
    with ServerProcess(f"{simulator.slave}?baud=115200", data=tmp_path / "data") as server:
        block_until(lambda: is_live(server), "a live device")
        result = send_request(server, "/shares")
        assert (result["why_not"], result["folder"], result["holder"], result["shares"]) == (
            "",
            str(path.parent),
            0,
            [],
        )
        report = refusal(server, "/shares", {"address": str(tmp_path / "imu0")})
        assert report["kind"] == "file-not-allowed"
        assert str(path.parent) in report["message"]
        assert refusal(server, "/shares", {"address": "imu0"})["kind"] == "bad-value"
        with socket.create_server(("127.0.0.1", 0)) as busy:
            report = refusal(server, "/shares", {"address": f"tcp://127.0.0.1:{busy.getsockname()[1]}"})
        assert "address already in use" in report["message"]
        assert send_request(server, "/shares")["shares"] == []
        block_until(lambda: is_live(server), "a live device on its own link")
        send_request(server, "/shares", {"address": str(path)})
        assert path.exists()
        block_until(lambda: is_live(server), "a live device again")
        driver = Driver(path)
        client = block_until(lambda: first_client(server), "the driver")
        block_until(lambda: driver.samples > 20, "samples at the driver")
        assert refusal(server, f"/shares/clients/{client['number'] + 1}", method="DELETE")["kind"] == "not-found"
        send_request(server, f"/shares/clients/{client['number']}", method="DELETE")
        block_until(lambda: driver.faults, "the driver was disconnected")
        driver.stop()
        assert refusal(server, "/shares?name=tcp://x", method="DELETE")["kind"] == "not-found"
        send_request(server, f"/shares?name={urllib.parse.quote(str(path))}", method="DELETE")
        assert send_request(server, "/shares")["shares"] == []


def test_only_ports_can_be_shared(tmp_path: Path) -> None:
    with ServerProcess("sim:xbus?rate=10", data=tmp_path) as server:
        assert "has no port that can be shared" in send_request(server, "/shares")["why_not"]
        assert refusal(server, "/shares", {"address": "tcp://127.0.0.1:4001"})["kind"] == "not-now"


@each_row(
    ("words", "error"),
    [
        (("sim:xbus", "--share", "/tmp/x"), "has no port that can be shared"),
        (("/dev/ttyUSB0", "--share", "/tmp/x"), "the rate of /dev/ttyUSB0 is not given"),
        (("/dev/ttyUSB0?baud=115200", "--share", "x"), "is not an absolute path"),
    ],
)
def test_hold_refuses_what_it_cannot_share(words: tuple[str, ...], error: str) -> None:
    done = imuscope("hold", *words)
    assert done.returncode == 1
    assert error in done.stderr
    assert done.stderr.count("\n") == 1


def test_shares_follow_their_source_on_the_command_line() -> None:
    done = imuscope("serve", "--share", "/run/x", "sim:xbus")
    assert done.returncode == 1
    assert "--share /run/x has no source before it" in done.stderr
    options = parse(
        ["serve", "/dev/a", "--share", "/run/a", "--record", "/dev/b", "--share=/run/b", "--share", "/run/c"]
    )
    result = ShareSettings.from_options(options)["shares"]
    assert result == {"/dev/a": ["/run/a"], "/dev/b": ["/run/b", "/run/c"]}


def test_a_holder_of_its_own_is_found_by_a_server(simulator: SimulatorThread, tmp_path: Path) -> None:
    path, source = tmp_path / "imu0", f"{simulator.slave}?baud=115200"
    holder = begun("hold", source, "--share", str(path))
    try:
        block_until(path.exists, "the terminal of the holder")
        driver = Driver(path)
        block_until(lambda: driver.samples > 20, "samples at the driver")
        with ServerProcess(source, data=tmp_path / "data") as server:
            block_until(lambda: is_live(server), "a live device")
            assert [one["name"] for one in send_request(server, "/shares")["shares"]] == [str(path)]
        before = driver.samples
        block_until(lambda: driver.samples > before + 50, "samples at the driver after the server")
        assert not driver.faults
        driver.stop()
    finally:
        holder.terminate()
        assert holder.wait(PATIENCE_S) == 0
        if holder.stdout:
            holder.stdout.close()
    assert not os.path.lexists(path)


def test_what_a_client_configures_is_shown_and_kept(simulator: SimulatorThread, tmp_path: Path) -> None:
    path, source = tmp_path / "imu0", f"{simulator.slave}?baud=115200"
    driver_of, known = XbusDriver(), DeviceContext()
    outputs = [{"data_identifier": 0x2010, "output_frequency": 50}]
    with ServerProcess(source, data=tmp_path / "data", arguments=("--share", str(path))) as server:
        block_until(lambda: is_live(server), "a live device")
        job = send_request(server, "/read", {})
        block_until(
            lambda: any(one["id"] == job["id"] for one in send_request(server, "/jobs")["done"]), "the settings"
        )
        driver = Driver(path)
        block_until(lambda: driver.samples > 20, "samples at the driver")
        client = first_client(server)
        os.write(driver.fd, driver_of.frame("GoToConfig", {}, known))
        block_until(lambda: send_request(server, "/shares")["configuring"], "a configuration")
        assert send_request(server, "/shares")["speaker"] == client["name"]
        request = refusal(server, "/shares/take-over", {})
        assert request["kind"] == "confirm"
        assert request["message"].startswith(f"{client['name']} is configuring the device and has not finished")
        block_until(
            lambda: "GoToConfigAck" in {one["name"] for one in send_request(server, "/traffic")}, "the config state"
        )
        os.write(driver.fd, driver_of.frame("SetOutputConfiguration", {"outputs": outputs}, known))
        block_until(
            lambda: "SetOutputConfigurationAck" in {one["name"] for one in send_request(server, "/traffic")},
            "an answer",
        )
        os.write(driver.fd, driver_of.frame("GoToMeasurement", {}, known))
        change = block_until(lambda: send_request(server, "/shares")["changes"], "what it changed")[0]
        assert change["client"] == client["name"]
        assert {"title": "Quaternion", "unit": "", "before": "100 Hz", "after": "50 Hz"} in [
            {**row, "title": row["title"].partition(",")[0]} for row in change["rows"]
        ], change
        (entry,) = [one for one in send_request(server, "/snapshots") if one["name"] == change["snapshot"]]
        assert client["name"] in entry["reason"]
        assert send_request(server, "/shares")["configuring"] is False
        driver.stop()


def test_a_client_that_leaves_is_named_in_the_events(simulator: SimulatorThread, tmp_path: Path) -> None:
    number = free_port()
    shares = ("--share", f"tcp://127.0.0.1:{number}")
    with ServerProcess(f"{simulator.slave}?baud=115200", data=tmp_path / "data", arguments=shares) as server:
        block_until(lambda: is_live(server), "the device is live")
        with socket.create_connection(("127.0.0.1", number)) as client:
            name = "{}:{}".format(*client.getsockname())
            block_until(lambda: f"{name} is connected to the shared port and may write." in server.log, "it came")
        block_until(lambda: f"{name} left the shared port." in server.log, lambda: server.log)
