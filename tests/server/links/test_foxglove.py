"""foxglove:// against a server of Foxglove's own SDK, with messages made by rosbags."""

import asyncio
import json
import time

import numpy as np
import pytest

from imuscope.server.links.base import LinkError, LinkSettings, steady_clock
from imuscope.server.links.source_url import open_link
from tests.server.links import rosbags_messages as ros
from tests.server.links.message_sources import SdkServer, has, sdk_server, sending, watched
from tests.support.each_row import each_row
from tests.support.free_ports import free_port
from tests.support.waiting import until

IMU_TOPICS = {"/imu/data": ros.IMU, "/fix": ros.FIX, "/imu/mag": ros.FIELD}


async def test_messages_of_a_ros_2_driver_are_quantities_with_units_frames_and_their_stamps() -> None:
    stamps: list[int] = []

    def send(server: SdkServer, n: int) -> None:
        stamps.append(time.time_ns() - 4_000_000)
        server.log("/imu/data", ros.imu(n, stamps[-1]))
        if n % 10 == 0:
            server.log("/fix", ros.fix(n, stamps[-1]))
            server.log("/imu/mag", ros.field(stamps[-1]))

    with sdk_server(free_port(), IMU_TOPICS) as server:
        async with watched(f"foxglove://127.0.0.1:{server.port}") as made:
            await until(lambda: "topic" in made.session.info.message or made.session.info.is_open, "it is open")
            with sending(lambda n: send(server, n), rate=200):
                arrival, measured, *gyro = await has(made, 100, "angular_velocity", "/imu/data")
                await has(made, 3, "position", "/fix")
                await has(made, 3, "magnetic_field", "/imu/mag")
            n = np.rint(gyro[0] / (0.001 * 180 / np.pi)).astype(int)
            np.testing.assert_array_equal(np.diff(n), 1)
            np.testing.assert_allclose(gyro[1], np.degrees(-1.0))
            np.testing.assert_allclose(measured, np.array(stamps)[n] / 1e9, rtol=0, atol=1e-6)
            assert ((arrival - measured > 0.003) & (arrival - measured < 5)).all()
            turn = made.info("orientation")
            assert (turn.kind, turn.frame) == ("quaternion", "ENU from body")
            assert [column.name for column in turn.columns] == ["w", "x", "y", "z"]
            *_, w, x, _, z = made.rows("orientation", "/imu/data")
            np.testing.assert_allclose(2 * np.arctan2(z, w), 0.01 * np.rint(2 * np.arctan2(z, w) / 0.01), atol=1e-9)
            assert not x.any()
            assert (made.info("linear_acceleration").unit, made.info("angular_velocity").unit) == ("m/s²", "°/s")
            assert made.info("linear_acceleration").frame == "body"
            place = made.rows("position", "/fix")
            assert [column.name for column in made.info("position").columns] == [
                "latitude",
                "longitude",
                "altitude",
            ]
            assert (place[2][0], place[3][0], place[4][0]) == (pytest.approx(48.0, abs=0.1), 11.5, 520.0)
            *_, bx, _, bz = made.rows("magnetic_field", "/imu/mag")
            assert (bx[0], bz[0]) == (pytest.approx(20.0), pytest.approx(-43.0))  # µT
            assert made.status == "live"
            assert made.session.info.protocol == "messages"
            health = made.session.health(made.telemetry.bus.now())
            assert (health.rejects, health.lost) == (0, 0)
            assert {one.name for one in health.messages} == set(IMU_TOPICS)
            assert made.notices == ""


async def test_an_orientation_that_the_driver_does_not_have_is_absent() -> None:
    with sdk_server(free_port(), {"/imu/data_raw": ros.IMU}) as server:
        async with watched(f"foxglove://127.0.0.1:{server.port}/imu/data_raw?type={ros.IMU}") as made:
            with sending(lambda n: server.log("/imu/data_raw", ros.imu(n, time.time_ns(), orientation=False))):
                await has(made, 10, "linear_acceleration", "/imu/data_raw")
            assert "orientation" not in made.titles
            assert "angular_velocity" in made.titles


async def test_stamps_of_another_clock_are_replaced_by_the_arrival_and_reported() -> None:
    with sdk_server(free_port(), {"/a": ros.IMU, "/b": ros.IMU}) as server:
        async with watched(f"foxglove://127.0.0.1:{server.port}") as made:
            await until(lambda: server.is_subscribed, "it has subscribed")
            for n in range(10):  # another clock is trusted after twenty
                server.log("/a", ros.imu(n, time.time_ns() - 7200 * 10**9))
                server.log("/b", ros.imu(n, 0))  # not stamped by its driver: the server's time is used
            _, measured, *_ = await has(made, 10, "angular_velocity", "/a")
            arrival, published, *_ = await has(made, 10, "angular_velocity", "/b")
            assert np.isnan(measured).all()
            assert (np.abs(published - arrival) < 5).all()
            assert "Stamps of /a are 2 h behind the time of arrival" in made.notices
            assert "/b" not in made.notices


async def test_a_topic_that_is_absent_or_of_another_type_is_explained() -> None:
    with sdk_server(free_port(), {"/imu/data": ros.IMU}) as server:
        where = f"foxglove://127.0.0.1:{server.port}"
        async with watched(f"{where}/imu/dota") as made:
            await until(lambda: "topics seen" in made.notices, "it says which topics there are")
            assert "No publisher of /imu/dota; topics seen: /imu/data (sensor_msgs/msg/Imu)." in made.notices
        async with watched(f"{where}/imu/data?type=sensor_msgs/msg/Temperature") as made:
            words = "/imu/data is sensor_msgs/msg/Imu, not sensor_msgs/msg/Temperature: leave type out"
            await until(lambda: words in made.notices, "it says which type it is")


async def test_an_absent_server_is_one_sentence_and_its_return_is_noticed() -> None:
    port = free_port()
    async with watched(f"foxglove://127.0.0.1:{port}/imu/data") as made:
        await until(lambda: made.session.info.next_attempt, "the first attempt fails")
        assert made.session.info.message == f"Nothing listens at 127.0.0.1:{port}."
        for number in range(2):
            with (
                sdk_server(port, {"/imu/data": ros.IMU}) as server,
                sending(lambda n, server=server: server.log("/imu/data", ros.imu(n, time.time_ns()))),
            ):
                made.session.retry()
                before = made.count("angular_velocity", "/imu/data")
                await has(made, before + 10, "angular_velocity", "/imu/data")
            await until(lambda: made.status == "lost", f"the end of server {number} is noticed")


async def test_json_and_protobuf_are_read_and_others_are_named() -> None:
    from foxglove.messages import LocationFix

    with sdk_server(free_port(), {}) as server:
        schema = LocationFix.get_schema()
        place = server.channel("/place", schema.name, "protobuf", schema.data)
        motor = server.channel("/motor", "Motor", "json", b'{"type": "object"}')
        server.channel("/odd", "Odd", "cbor", b"")
        async with watched(f"foxglove://127.0.0.1:{server.port}/place,/motor,/odd") as made:

            def send(n: int) -> None:
                place.log(LocationFix(latitude=48.0, longitude=11.0, altitude=float(n)).encode())
                motor.log(json.dumps({"speed": n, "phase": [1, 2, 3]}).encode())

            with sending(send):
                *_, lat, lon, high = await has(made, 10, "position", "/place")
                *_, speed = await has(made, 10, "speed", "/motor")
            assert (lat[0], lon[0]) == (48.0, 11.0)
            assert np.diff(high).tolist() == [1.0] * (len(high) - 1)
            assert np.diff(speed).tolist() == [1.0] * (len(speed) - 1)
            assert "/odd is cbor" in made.notices


async def test_damaged_messages_are_counted_and_the_others_are_shown() -> None:
    with sdk_server(free_port(), {"/imu/data": ros.IMU}) as server:
        async with watched(f"foxglove://127.0.0.1:{server.port}/imu/data") as made:

            def send(n: int) -> None:
                good = ros.imu(n, time.time_ns())
                server.log("/imu/data", good if n % 2 else good[: 20 + n % 200])

            with sending(send, 200):
                *_, turn, _, _ = await has(made, 40, "angular_velocity", "/imu/data")
            assert np.diff(turn) == pytest.approx(np.full(len(turn) - 1, np.degrees(0.002)))
            health = made.session.health(made.telemetry.bus.now())
            assert health.rejects_by["bad_item"] == pytest.approx(len(turn), abs=5)


@each_row(
    ("source", "words"),
    [
        ("foxglove://:8765/imu", "host is missing"),
        ("foxglove://robot:0/imu", "port is '0'"),
        ("foxglove://robot:8765/imu?qos=1", "no option 'qos'"),
        ("foxglove://fe80::1:8765", "host is 'fe80::1'"),
        ("foxglove://", "nothing follows"),
    ],
)
def test_an_invalid_source_is_explained(source: str, words: str) -> None:
    with pytest.raises(LinkError, match=words):
        open_link(source, LinkSettings(now_ns=steady_clock()))


def test_nothing_can_be_sent() -> None:
    link = open_link("foxglove://robot", LinkSettings(now_ns=steady_clock()))
    with pytest.raises(LinkError, match="nothing can be sent"):
        asyncio.run(link.write(b"x"))
