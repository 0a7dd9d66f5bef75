"""Recordings of a source of messages: the messages as they came, for every MCAP reader; and the same numbers again."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from imuscope.recordings.exporters import export
from imuscope.recordings.exporters.request import ExportError, ExportRequest
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.library.probe import probe
from imuscope.recordings.mcap.compaction import compact
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.library.decode import decode
from tests.server.links import rosbags_messages as ros
from tests.server.links.message_sources import has, sdk_server, sending, watched
from tests.support.free_ports import free_port
from tests.support.recorder_harness import recorded, recorder
from tests.support.waiting import until

TOPICS = ros.TOPICS


def by_topic(path: Path) -> dict[str, list[tuple[Any, Any, Any]]]:
    """Schema, channel and message of every message, as another reader finds them."""
    results: dict[str, list[tuple[Any, Any, Any]]] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            results.setdefault(channel.topic, []).append((schema, channel, message))
    return results


def live(made: Any, title: str, message: str) -> list[np.ndarray]:
    """Arrival, time and columns of a quantity in the server's memory."""
    for session in made.sessions.all:
        session.access.decode()
    (one,) = (one for one in made.telemetry.store.all if (one.info.title, one.info.message) == (title, message))
    return one.ring.read()


async def test_a_recording_holds_the_messages_as_they_came_and_gives_the_same_numbers(tmp_path: Path) -> None:
    sent: dict[str, list[bytes]] = {topic: [] for topic in TOPICS}

    with sdk_server(free_port(), TOPICS) as server:

        def send(n: int) -> None:
            stamp = time.time_ns()
            for topic, data in (("/imu/data", ros.imu(n, stamp)), ("/fix", ros.fix(n, stamp))):
                sent[topic].append(data)
                server.log(topic, data, stamp)

        async with recorder(tmp_path) as (made, one):
            session = made.sessions.add(f"foxglove://127.0.0.1:{server.port}")
            with sending(send):
                await until(lambda: session.info.status == "live", "it is live")
                await one.start()  # after the schemas have come
                await until(lambda: one.state.bytes > 60_000, "a hundred messages are recorded")
            await one.stop()
            whole = {
                title: live(made, title, topic) for title, topic in (("orientation", "/imu/data"), ("position", "/fix"))
            }

    path = recorded(tmp_path)
    results = by_topic(path)
    for topic, name in TOPICS.items():
        schema, channel, _ = results[topic][0]
        assert (schema.name, schema.encoding, schema.data) == (name, "ros2msg", ros.definition(name))
        assert channel.message_encoding == "cdr"
        bodies = [message.data for _, _, message in results[topic]]
        first = sent[topic].index(bodies[0])
        assert bodies == sent[topic][first : first + len(bodies)]
        assert len(bodies) > 30
        last = ros.STORE.deserialize_cdr(bodies[-1], name)
        stamp = last.header.stamp.sec * 10**9 + last.header.stamp.nanosec
        assert stamp == results[topic][-1][2].publish_time
        assert 0 <= results[topic][-1][2].log_time - stamp < 10**10

    for packed in (False, True):
        if packed:
            compact(path)
            assert by_topic(path).keys() >= TOPICS.keys()
        columns = decode(open_file(path), tmp_path / f"store{packed}", all_protocols())
        (device,) = columns.manifest["devices"]
        assert (device["protocol"], device["link"]) == ("messages", "foxglove")
        assert columns.manifest["damage"] == []
        assert columns.manifest["figures"]["1"]["rejects"] == 0
        infos = {info["title"]: info for info in columns.manifest["channels"]}
        assert (infos["orientation"]["kind"], infos["orientation"]["frame"]) == ("quaternion", "ENU from body")
        for title, rows in whole.items():
            again = columns.exact(infos[title]["id"], 0, 1 << 20)
            first = int(np.flatnonzero(rows[0] == again.arrival[0])[0])
            part = slice(first, first + len(again.arrival))
            np.testing.assert_array_equal(again.arrival, rows[0][part])
            np.testing.assert_array_equal(again.time, rows[1][part])
            for a, b in zip(again.columns, rows[2:], strict=True):
                np.testing.assert_array_equal(a, b[part])
    with pytest.raises(ExportError, match="holds messages, not the bytes"):
        export("bytes", ExportRequest(columns, path), tmp_path / "run.bin")
    assert export("csv", ExportRequest(columns, path), tmp_path / "run.csv")
    about = probe(path)
    assert about is not None
    assert [device.protocol for device in about.devices] == ["messages"]
    assert about.devices[0].messages != 0

    async with watched(f"{path}?speed=4") as again:  # replayed like any other recording
        *_, w, _, _, z = await has(again, 20, "orientation", "/imu/data")
        np.testing.assert_allclose(np.diff(2 * np.arctan2(z, w)), 0.01, atol=1e-9)
        assert again.session.info.protocol == "messages"


async def test_a_replayed_file_of_another_program_can_be_recorded_again(tmp_path: Path) -> None:
    theirs = ros.bag(tmp_path / "theirs")
    async with recorder(tmp_path) as (made, one):
        session = made.sessions.add(f"{theirs}?speed=0.2&loop=1")
        await until(lambda: session.info.status == "live", "it is live")
        await one.start()
        await until(lambda: one.state.bytes > 20_000, "it is recorded")
        await one.stop()
    (schema, channel, message), *_ = by_topic(recorded(tmp_path))["/imu/data"]
    assert (schema.name, channel.message_encoding) == ("sensor_msgs/msg/Imu", "cdr")
    assert message.data in [one.data for _, _, one in by_topic(theirs)["/imu/data"]]


def test_a_bag_of_rosbags_has_the_numbers_that_a_live_source_would_give(tmp_path: Path) -> None:
    columns = decode(open_file(ros.bag(tmp_path / "bag")), tmp_path / "store", all_protocols())
    infos = {info["title"]: info for info in columns.manifest["channels"]}
    assert infos["orientation"]["kind"] == "quaternion"
    turn = columns.exact(infos["orientation"]["id"], 0, 200)
    n = np.arange(100)
    np.testing.assert_array_equal(turn.columns[0], np.cos(0.005 * n))
    np.testing.assert_array_equal(turn.columns[3], np.sin(0.005 * n))
    np.testing.assert_allclose(turn.arrival - turn.time, 0.003, atol=1e-6)
    acceleration = columns.exact(infos["linear_acceleration"]["id"], 0, 200)
    np.testing.assert_array_equal(acceleration.columns[0], 0.25 * n)
    place = columns.exact(infos["position"]["id"], 0, 200)
    np.testing.assert_array_equal(place.columns[0], 48.0 + 1e-5 * n)
    assert columns.manifest["figures"]["1"]["messages"] == {"/imu/data": 100, "/fix": 100}
