"""Devices as nodes of ROS 2: graph, messages, switches, routers; seen by a session that is a router, too."""

from __future__ import annotations

import os
import signal
import socket
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import zenoh

from imuscope.server.extensions.ros2 import type_support
from imuscope.server.extensions.ros2.attachment import Attachment, gid_of
from imuscope.server.extensions.ros2.key_expressions import RosEndpoint, RosNode, parse_token, parse_topic_key
from imuscope.server.extensions.ros2.service import MODULE
from imuscope.server.extensions.ros2.worker import Ros2Bridge
from tests.server.extensions.ros2.samples import deserialize, info, xyz
from tests.server.extensions.ros2.zenoh_router import announced, running_router
from tests.support.each_row import each_row
from tests.support.forking.forked_workers import workers_of
from tests.support.free_ports import free_port
from tests.support.server_process import ServerProcess, imuscope
from tests.support.timeouts import PATIENCE_S, get
from tests.support.waiting import block_until

OURS = "sim:xbus?product=MTi-680G"
SLOW = "rate=10"  # where only its presence counts: a simulator takes as much processor time as it has samples
DATA = "/imu/imu/data"


@pytest.fixture(scope="module")
def port() -> int:
    return free_port()


@pytest.fixture(scope="module")
def router(port: int) -> Iterator[zenoh.Session]:
    with running_router(port) as session:
        yield session


@pytest.fixture(scope="module")
def published(router: zenoh.Session, port: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    arguments = ("--ros2", "--ros2-router", f"tcp/127.0.0.1:{port}", "--ros2-domain", "7")
    with ServerProcess(OURS, data=tmp_path_factory.mktemp("data"), arguments=arguments) as server:
        block_until(lambda: has_topic(server, DATA), "the device is identified")
        yield server


def state_of(server: ServerProcess) -> dict[str, Any]:
    answer: dict[str, Any] = get(f"{server.url}/api/ros2").json()
    return answer


def switched(server: ServerProcess, key: str, *, enabled: bool) -> httpx.Response:
    body = {"key": key, "enabled": enabled}
    return httpx.patch(f"{server.url}/api/ros2/topics", json=body, timeout=PATIENCE_S)


def topics_of(server: ServerProcess) -> dict[str, dict[str, Any]]:
    return {row["name"]: row for row in state_of(server)["topics"]}


def has_topic(server: ServerProcess, name: str) -> bool:
    return name in topics_of(server)


@contextmanager
def received(session: zenoh.Session, key: str = "7/**") -> Iterator[dict[str, list[tuple[Any, Attachment]]]]:
    """Messages by topic, each with its attachment."""
    result: dict[str, list[tuple[Any, Attachment]]] = defaultdict(list)

    def on_sample(sample: zenoh.Sample) -> None:
        _, topic, type_name, type_hash = parse_topic_key(str(sample.key_expr))
        assert type_hash == type_support.type_hash(type_name)
        assert sample.attachment is not None
        message = deserialize(bytes(sample.payload), type_name)
        result[topic].append((message, Attachment.decode(bytes(sample.attachment))))

    subscriber = session.declare_subscriber(key, on_sample)
    try:
        yield result
    finally:
        subscriber.undeclare()


def announced_types(session: zenoh.Session, domain: int) -> dict[str, str]:
    """Types of the topics in the graph."""
    entities = map(parse_token, announced(session, f"@ros2_lv/{domain}/**"))
    return {one.topic: one.type for one in entities if isinstance(one, RosEndpoint)}


def test_a_device_is_a_node_with_publishers(router: zenoh.Session, published: ServerProcess) -> None:
    def listed_types() -> dict[str, str]:
        return {name: row["type"] for name, row in topics_of(published).items()}

    # a topic comes with its data, so the graph grows until each of them has been received
    known = {f"/imu/{name}" for name in ("imu/data", "imu/data_raw", "gnss/fix", "velocity", "time_reference")}
    known |= {"/imu/pressure", "/imu/temperature", "/imu/twist", "/imu/odometry", "/diagnostics"}
    block_until(lambda: set(announced_types(router, 7)) >= known, "all data of the device has come")
    block_until(lambda: listed_types() == announced_types(router, 7), "what is announced is listed")
    entities = [parse_token(token) for token in announced(router, "@ros2_lv/7/**")]
    nodes = [one for one in entities if isinstance(one, RosNode)]
    topics = {one.topic: one for one in entities if isinstance(one, RosEndpoint)}
    assert [node.full_name for node in nodes] == ["/imu"]
    assert {one.kind for one in topics.values()} == {"publisher"}
    assert set(topics) == known  # without /imu/imu/mag
    (missing,) = state_of(published)["missing"]
    assert (missing["topic"], "tesla" in missing["reason"]) == ("/imu/imu/mag", True)


class WorkerClient:
    """What a publisher knows of a server; the reports of its topics."""

    def __init__(self) -> None:
        self.devices = [{"id": "1", "name": "MTi-680G", "protocol": "xbus", "serial_number": "", "topic": "imu"}]
        self.channels = {1: info(1, "Acceleration", xyz("m/s²"))}
        self.health: dict[str, Any] = {}
        self.listed: list[dict[str, str]] = []

    def subscribe(self, channels: list[int]) -> None: ...

    def send(self, op: str, **words: Any) -> None:
        if op == "state":
            self.listed.append({row["name"]: row["type"] for row in words["topics"]})


def test_a_topic_is_listed_as_soon_as_it_is_announced(router: zenoh.Session, port: int) -> None:
    """It was listed at the next second, and the page lacked a topic that others already saw."""
    client = WorkerClient()
    bridge = Ros2Bridge(client)  # type: ignore[arg-type]
    try:
        bridge.announce("1", "imu", {})
        bridge.serve({"router": f"tcp/127.0.0.1:{port}", "domain": 8})
        block_until(lambda: client.listed, "the device is announced")
        date = {"year": "", "month": "", "day": "", "hour": "h", "min": "min", "sec": "s", "valid": "", "nano": "ns"}
        client.channels[2] = info(2, "GNSS solution", date, kind="record")
        bridge.configure()
        assert set(client.listed[-1]) - set(client.listed[0]) == {"/imu/time_reference"}
        block_until(lambda: announced_types(router, 8) == client.listed[-1], "it is announced")
        reports = len(client.listed)
        bridge.configure()
        assert len(client.listed) == reports
        before = announced(router, "@ros2_lv/8/**")
        client.devices = [client.devices[0] | {"name": "MTi-630", "product": "MTi-630"}]
        bridge.configure()
        bridge.announce("1", "imu", {"tilt": 0.1})
        assert announced(router, "@ros2_lv/8/**") == before  # what is learnt of a device renames nothing
    finally:
        bridge.close()


def test_messages_have_values_stamps_and_numbers(router: zenoh.Session, published: ServerProcess) -> None:
    with received(router) as results:
        block_until(lambda: len(results[DATA]) >= 100 and len(results["/diagnostics"]) >= 1, "messages come")
    tokens = {one.topic: one.token for one in map(parse_token, announced(router)) if isinstance(one, RosEndpoint)}
    messages, attachments = zip(*results[DATA][-100:], strict=True)
    stamps = np.array([one.header.stamp.sec + one.header.stamp.nanosec / 1e9 for one in messages])
    assert np.diff(stamps) == pytest.approx(0.01, abs=0.003)
    assert abs(stamps[-1] - time.time()) < 20
    assert np.diff([one.sequence for one in attachments]).tolist() == [1] * 99
    assert {one.gid for one in attachments} == {gid_of(tokens[DATA])}
    assert abs(attachments[-1].time_ns / 1e9 - time.time()) < 20
    norms = [np.linalg.norm([q.w, q.x, q.y, q.z]) for q in (one.orientation for one in messages)]
    assert np.array(norms) == pytest.approx(1, abs=1e-6)
    lengths = [np.linalg.norm([a.x, a.y, a.z]) for a in (one.linear_acceleration for one in messages)]
    assert np.mean(lengths) == pytest.approx(9.81, abs=1.5)
    assert all(message.header.frame_id == "imu" for message in messages)
    (status,) = results["/diagnostics"][0][0].status
    assert status.name == "imuscope: imu"
    assert float({one.key: one.value for one in status.values}["stamp_uncertainty_ms"]) > 0


def test_nothing_is_made_for_a_topic_without_subscribers(router: zenoh.Session, published: ServerProcess) -> None:
    raw = f"{DATA}_raw"
    block_until(lambda: topics_of(published)[raw]["subscribers"] == 0, "no subscribers are left")
    before = topics_of(published)
    with received(router, f"7{DATA}/**") as result:
        block_until(lambda: len(result[DATA]) >= 20, "messages come")
        block_until(lambda: topics_of(published)[DATA]["messages"] > before[DATA]["messages"], "they are counted")
        block_until(lambda: topics_of(published)[DATA]["rate"] > 50, "their rate is counted")
        after = topics_of(published)
    assert (after[DATA]["subscribers"], after[raw]["subscribers"]) == (1, 0)
    assert after[DATA]["messages"] > before[DATA]["messages"]
    assert after[DATA]["bytes"] > before[DATA]["bytes"]
    assert after[raw]["messages"] == before[raw]["messages"]
    block_until(lambda: topics_of(published)[DATA]["subscribers"] == 0, "the end of the subscription is noticed")


def test_a_topic_can_be_switched_off_and_on(router: zenoh.Session, published: ServerProcess) -> None:
    def switch(enabled: bool) -> None:
        row = topics_of(published)[DATA]
        answer = switched(published, row["key"], enabled=enabled).json()
        assert {one["name"]: one["enabled"] for one in answer["topics"]}[DATA] is enabled

    def is_announced() -> bool:
        return any("%imu%imu%data/" in token for token in announced(router))

    assert is_announced()
    switch(False)
    block_until(lambda: not is_announced(), "the topic is withdrawn")
    assert not topics_of(published)[DATA]["enabled"]
    switch(True)
    block_until(is_announced, "the topic is back")


def test_a_topic_stays_switched_off_after_a_restart(router: zenoh.Session, port: int, tmp_path: Path) -> None:
    arguments = ("--ros2", "--ros2-router", f"tcp/127.0.0.1:{port}", "--ros2-domain", "9")
    with ServerProcess(f"{OURS}&{SLOW}", data=tmp_path, arguments=arguments) as server:
        block_until(lambda: has_topic(server, DATA), "the device is identified")
        switched(server, topics_of(server)[DATA]["key"], enabled=False)
    with ServerProcess(f"{OURS}&{SLOW}", data=tmp_path, arguments=arguments) as server:
        block_until(lambda: has_topic(server, DATA), "the device is identified again")
        assert {name for name, row in topics_of(server).items() if not row["enabled"]} == {DATA}
        block_until(lambda: announced(router, "@ros2_lv/9/**"), "the node is announced")
        assert not any("%imu%data/" in token for token in announced(router, "@ros2_lv/9/**"))


def test_a_subscriber_of_another_type_is_named(router: zenoh.Session, published: ServerProcess) -> None:
    other = RosEndpoint(RosNode(7, "ab", 0, "", "odd"), 1, "subscriber", DATA, "std_msgs/msg/String", "RIHS01_0")
    token = router.liveliness().declare_token(other.token)
    try:
        block_until(lambda: topics_of(published)[DATA]["problem"], "it is noticed")
        assert topics_of(published)[DATA]["problem"] == "/odd subscribes as std_msgs/msg/String, and receives nothing."
    finally:
        token.undeclare()


def test_it_comes_back_after_a_crash(router: zenoh.Session, published: ServerProcess) -> None:
    before = announced(router)
    (worker,) = workers_of(published.process.pid, MODULE)
    os.kill(worker, signal.SIGKILL)
    block_until(lambda: (now := announced(router)) and not set(now) & set(before), "it is announced anew")
    with received(router) as result:
        block_until(lambda: len(result[DATA]) > 20, "messages come again")


def test_an_absent_router_is_reported_and_found_later(tmp_path: Path) -> None:
    port = free_port()
    arguments = ("--ros2", "--ros2-router", f"tcp/127.0.0.1:{port}")
    with ServerProcess(f"sim:idtp?{SLOW}", data=tmp_path, arguments=arguments) as server:
        block_until(lambda: state_of(server)["problem"], "the absence is reported")
        state = state_of(server)
        assert state["problem"].startswith(f"ROS 2: there is no Zenoh router at tcp/127.0.0.1:{port}")
        assert "rmw_zenohd" in state["hint"]
        for _ in range(2):
            with running_router(port) as hub:
                block_until(lambda: state_of(server)["connected"], "it is found")
                block_until(lambda hub=hub: len(announced(hub)) >= 4, "the device is announced")
                assert state_of(server)["problem"] == ""
                with received(hub, "0/**") as result:
                    block_until(lambda result=result: sum(map(len, result.values())) > 10, "messages come")
            block_until(lambda: "is gone" in state_of(server)["problem"], "its end is reported")


def test_a_removed_device_leaves_the_graph(tmp_path: Path) -> None:
    port = free_port()
    arguments = ("--ros2", "--ros2-router", f"tcp/127.0.0.1:{port}")
    with (
        running_router(port) as hub,
        ServerProcess(f"sim:idtp?{SLOW}", f"sim:isb?{SLOW}", data=tmp_path, arguments=arguments) as server,
    ):
        block_until(lambda: has_topic(server, "/imu_2/imu/data"), "both are identified")
        block_until(lambda: any("%imu%imu%" in token for token in announced(hub)), "the first one is announced")
        assert httpx.delete(f"{server.url}/api/devices/1", timeout=PATIENCE_S).status_code == 204
        block_until(lambda: not any("%imu%imu%" in token for token in announced(hub)), "it has left")
        assert any("%imu_2%imu%" in token for token in announced(hub))


def test_what_is_no_router_is_distinguished_from_none(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        address = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        with ServerProcess(f"sim:idtp?{SLOW}", data=tmp_path, arguments=("--ros2", "--ros2-router", address)) as server:
            block_until(lambda: state_of(server)["problem"], "it is reported")
            state = state_of(server)
    assert state["problem"].startswith(f"ROS 2: the program at {address} is not a Zenoh router of version 1")
    assert "Zenoh 1.x" in state["hint"]


def test_namespace_frames_axes_and_transforms_are_settings(tmp_path: Path) -> None:
    port, config = free_port(), tmp_path / "imuscope.toml"
    config.write_text(
        f'ros2 = true\nros2_router = "tcp/127.0.0.1:{port}"\nros2_namespace = "/robot"\nros2_tf = true\n'
        'ros2_axes = "device"\nros2_reliability = "best_effort"\nros2_depth = 5\n'
        'ros2_frames = { "IMX-5" = "imu_link" }\nros2_map_frame = "odom"\n'
    )
    with (
        running_router(port) as hub,
        ServerProcess(f"sim:isb?{SLOW}", data=tmp_path, arguments=("--config", str(config))),
    ):
        block_until(lambda: any("%tf/" in token for token in announced(hub)), "the device is announced")
        assert all(token.endswith("/2::,5:,:,:,,") for token in announced(hub) if "/MP/" in token)
        with received(hub, "0/**") as result:
            block_until(lambda: result["/tf"] and result["/robot/imu/imu/data_raw"], "messages come")
    (transform,) = result["/tf"][-1][0].transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("odom", "imu_link")
    message = result["/robot/imu/imu/data_raw"][-1][0]
    assert message.header.frame_id == "imu_link"
    assert message.linear_acceleration.z < -7  # as the device sends it: z is down


def test_without_the_option_nothing_is_published(server: ServerProcess) -> None:
    state = state_of(server)
    assert (state["enabled"], state["topics"]) == (False, [])
    answer = switched(server, "/x", enabled=True)
    assert (answer.status_code, "--ros2" in answer.json()["hint"]) == (409, True)


@each_row(
    ("arguments", "words"),
    [
        (("--ros2-router", "localhost:7447"), "ros2_router 'localhost:7447' is not an address"),
        (("--ros2-router", "tcp/localhost:70000"), "ros2_router 'tcp/localhost:70000' is not an address"),
        (("--ros2-domain", "500"), "ros2_domain 500 is outside 0 … 232"),
    ],
)
def test_invalid_settings_are_one_line(arguments: tuple[str, ...], words: str) -> None:
    message = imuscope("serve", "--ros2", *arguments)
    assert message.returncode == 1
    assert words in message.stderr
    assert len(message.stderr.splitlines()) == 1
