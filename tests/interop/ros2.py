"""hiroz, a native Rust ROS 2 over Zenoh, as a node that subscribes to our topics."""

from __future__ import annotations

import asyncio
import json
import math
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from imuscope.server import wire
from imuscope.server.wire.codec import decode_samples
from tests.interop.running import DiffersError, owned
from tests.server.extensions.ros2.zenoh_router import running_router
from tests.support.free_ports import free_port
from tests.support.server_process import ServerProcess
from tests.support.timeouts import connecting, get
from tests.support.waiting import block_until

SOURCE = "sim:isb?rate=1000&baud=3000000"
RATE, SECONDS = 1000, 60.0
DATA, RAW = "/imx_5/imu/data", "/imx_5/imu/data_raw"
TOPICS = {
    "/diagnostics": "diagnostic_msgs::msg::dds_::DiagnosticArray_",
    "/imx_5/gnss/fix": "sensor_msgs::msg::dds_::NavSatFix_",
    "/imx_5/imu/data": "sensor_msgs::msg::dds_::Imu_",
    "/imx_5/imu/data_raw": "sensor_msgs::msg::dds_::Imu_",
    "/imx_5/pressure": "sensor_msgs::msg::dds_::FluidPressure_",
    "/imx_5/temperature": "sensor_msgs::msg::dds_::Temperature_",
    "/imx_5/time_reference": "sensor_msgs::msg::dds_::TimeReference_",
    "/imx_5/velocity": "geometry_msgs::msg::dds_::TwistStamped_",
}
FLU_FROM_FRD = np.array([1, -1, -1])


def hiroz(folder: Path, scratch: Path) -> str:
    """A minute at 1 kHz: the graph, no message lost, values and stamps equal to those of the page."""
    program = owned("hiroz_host", "tests/interop/hiroz_host, built there by `cargo build --release`")
    port = free_port()
    arguments = ("--ros2", "--ros2-router", f"tcp/127.0.0.1:{port}")
    with running_router(port), ServerProcess(SOURCE, data=scratch / "data", arguments=arguments) as server:
        block_until(lambda: {row["name"] for row in topics(server)} >= set(TOPICS), "the device is announced")
        listen = [program, "listen", f"tcp/127.0.0.1:{port}", "0", str(SECONDS), *TOPICS]
        observed, samples = asyncio.run(_both(listen, server.url))
        block_until(lambda: all(row["subscribers"] == 0 for row in topics(server)), "hiroz is gone")
    _expect(["imx_5", "/"] in observed["nodes"], f"nodes {observed['nodes']}")
    for topic, type_name in TOPICS.items():
        _expect(
            observed["topics"].get(topic) == type_name,
            f"{topic} is {observed['topics'].get(topic)} and not {type_name}",
        )
        _expect(topic in observed["received"], f"nothing came on {topic}")
    _expect(not any(observed["lost"].values()), f"lost: {observed['lost']}")
    raw = observed["received"][RAW]
    _expect(raw["count"] > (SECONDS - 2) * RATE, f"{raw['count']} messages in {SECONDS:g} s")
    _expect(not any(one["backwards"] for one in observed["received"].values()), "stamps go backwards")
    compared = _compare(raw["last"], samples)
    late = np.percentile([(one["at"] - one["stamp"]) / 1e6 for one in raw["last"]], [50, 99])
    ages = f"ages {late[0]:.1f} ms, at most {late[1]:.1f} ms for 99 %"
    return f"{raw['count']} messages, none lost, {compared} compared with the page's; {ages}"


def topics(server: ServerProcess) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = get(f"{server.url}/api/ros2").json()["topics"]
    return rows


async def _both(listen: list[str], url: str) -> tuple[dict[str, Any], dict[str, dict[int, list[float]]]]:
    """What hiroz printed, and the page's samples of its last seconds: by quantity, values by time in ns."""
    process = await asyncio.create_subprocess_exec(*listen, stdout=asyncio.subprocess.PIPE, stderr=sys.stderr)
    printed = asyncio.create_task(process.communicate(), name="hiroz_host: output")
    samples: dict[str, dict[int, list[float]]] = {}
    names: dict[int, str] = {}
    dtypes: dict[int, list[str]] = {}
    end = time.monotonic() + SECONDS - 5
    async with connecting(url.replace("http", "ws", 1) + "/ws", subprotocols=[wire.SUBPROTOCOL], max_size=None) as page:
        await page.send(json.dumps({"op": "subscribe", "history": 0}))
        while not printed.done():
            try:
                async with asyncio.timeout(1.0):
                    message = await page.recv()
            except TimeoutError:
                continue
            if isinstance(message, str):
                for info in json.loads(message).get("channels", ()):
                    dtypes[info["id"]] = [column["dtype"] for column in info["columns"]]
                    names[info["id"]] = info["name"]
            elif time.monotonic() > end:
                for frame in decode_samples(message, dtypes):
                    rows = np.column_stack(frame.columns[1:])
                    result = samples.setdefault(names[frame.channel], {})
                    result.update({round(row[0] * 1e9): row[1:] for row in rows.tolist() if math.isfinite(row[0])})
    text, _ = await printed
    if process.returncode:
        raise DiffersError(f"hiroz_host ended with {process.returncode}")
    return json.loads(text), samples


def _compare(messages: list[dict[str, Any]], samples: dict[str, dict[int, list[float]]]) -> int:
    """Compare each message with the samples of its stamp; returns how many there were."""
    turns, forces = (samples[name] for name in ("DID_IMU.I.pqr", "DID_IMU.I.acc"))
    compared = 0
    for message in messages:
        stamp = message["stamp"]
        if stamp not in turns:
            continue
        compared += 1
        turn = np.radians(turns[stamp]) * FLU_FROM_FRD
        force = np.array(forces[stamp]) * FLU_FROM_FRD
        _expect(np.allclose(message["turn"], turn, atol=1e-9), f"turn {message['turn']} at {stamp}, not {turn}")
        _expect(np.allclose(message["acceleration"], force, atol=1e-9), f"acceleration at {stamp}, not {force}")
    _expect(compared > len(messages) / 2, f"{compared} of {len(messages)} stamps are among the page's")
    return compared


def _expect(is_true: bool, words: str) -> None:
    if not is_true:
        raise DiffersError(words)
