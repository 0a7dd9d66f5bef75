"""ros2:// against a Zenoh router and publishers in the form of rmw_zenoh, with messages made by rosbags."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from imuscope.server.extensions.ros2.graph import RosGraph, TopicPublisher
from imuscope.server.extensions.ros2.key_expressions import QosProfile
from imuscope.server.extensions.ros2.link import Ros2Link
from imuscope.server.extensions.ros2.session import open_session
from imuscope.server.links.base import LinkError, LinkSettings, steady_clock
from imuscope.server.links.message_link import SeenTopic
from imuscope.server.links.source_url import open_link
from tests.server.extensions.ros2.zenoh_router import announced, running_router
from tests.server.links import rosbags_messages as ros
from tests.server.links.message_sources import has, sending, watched
from tests.support.each_row import each_row
from tests.support.free_ports import free_port
from tests.support.waiting import until


class Driver:
    """A node of ROS 2 that publishes."""

    def __init__(self, port: int, domain: int = 0) -> None:
        self.session = open_session(f"tcp/127.0.0.1:{port}")
        self.graph = RosGraph(self.session, domain, QosProfile(), lambda: None)
        self.node = self.graph.add_node("/robot", "driver")

    def publisher(self, topic: str, type_name: str) -> TopicPublisher:
        return self.graph.add_publisher(self.node, topic, type_name)

    def close(self) -> None:
        self.graph.close()
        self.session.close()


@contextmanager
def driver(port: int, domain: int = 0) -> Iterator[Driver]:
    made = Driver(port, domain)
    try:
        yield made
    finally:
        made.close()


async def test_topics_are_found_by_their_publishers_and_losses_are_counted() -> None:
    port = free_port()
    with running_router(port) as router, driver(port, 3) as robot:
        imu, fix = robot.publisher("/imu/data", ros.IMU), robot.publisher("/fix", ros.FIX)
        async with watched(f"ros2://127.0.0.1:{port}/imu/data,/fix?domain=3") as made:
            await until(lambda: imu.has_subscribers and fix.has_subscribers, "both topics are subscribed to")

            def send(n: int) -> None:
                if n == 30:
                    imu._sequence += 4  # four messages that get lost
                imu.publish([ros.imu(n, time.time_ns() - 2_000_000)])
                fix.publish([ros.fix(n, time.time_ns())])

            with sending(send):
                arrival, measured, x, y, _ = await has(made, 60, "angular_velocity", "/imu/data")
                await has(made, 10, "position", "/fix")
            np.testing.assert_allclose(np.diff(x), np.degrees(0.001))
            np.testing.assert_allclose(y, np.degrees(-1.0))
            assert ((arrival - measured >= 0.002) & (arrival - measured < 5)).all()
            health = made.session.health(made.telemetry.bus.now())
            assert (health.lost, health.gaps, health.rejects) == (4, 1, 0)
            assert made.notices == ""
            tokens = announced(router, "@ros2_lv/3/**")
            own = [token for token in tokens if "imuscope" in token]
            assert len(own) == 3  # the node and two subscribers
            assert sum("/MS/" in token for token in own) == 2
        await until(lambda: not imu.has_subscribers, "it has left")
        assert not [token for token in announced(router, "@ros2_lv/3/**") if "imuscope" in token]


async def test_a_topic_that_is_absent_unknown_or_of_another_type_is_explained() -> None:
    port = free_port()
    with running_router(port), driver(port) as robot:
        robot.publisher("/imu/data", ros.IMU)
        where = f"ros2://127.0.0.1:{port}"
        for source, words in (
            (f"{where}/imu/dota", "No publisher of /imu/dota; topics seen: /imu/data (sensor_msgs/msg/Imu)."),
            (f"{where}/", "No topic is given. Topics seen: /imu/data (sensor_msgs/msg/Imu)."),
            (f"{where}/imu/data?type=sensor_msgs/msg/Range", "/imu/data is sensor_msgs/msg/Imu, not sensor_msgs"),
        ):
            async with watched(source) as made:
                await until(lambda made=made, words=words: words in made.notices, f"it says {words}")


async def test_notices_are_made_while_topics_are_subscribed_to(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a thread does it while the page is told why a topic is not shown."""
    port = free_port()
    with running_router(port):
        async with watched(f"ros2://127.0.0.1:{port}/imu/data?type={ros.IMU}") as made:
            link = made.session.access.link
            assert isinstance(link, Ros2Link)
            await until(lambda: link._subscribed, "it has subscribed")

            class Subscribing(SeenTopic):
                """A topic that becomes subscribed to when it is looked at."""

                def __getattribute__(self, name: str) -> Any:
                    link._subscribed[f"/topic{len(link._subscribed)}"] = ros.IMU
                    return super().__getattribute__(name)

            monkeypatch.setattr(Ros2Link, "_available", [Subscribing("/imu/data", ros.IMU)])
            assert link.notices == []


async def test_a_router_that_is_absent_is_one_sentence_and_one_that_returns_is_found() -> None:
    port = free_port()
    made_settings = LinkSettings(now_ns=steady_clock(), connect_timeout_s=0.3)
    link = open_link(f"ros2://127.0.0.1:{port}/imu/data", made_settings)
    with pytest.raises(LinkError, match=f"No Zenoh router answers at 127.0.0.1:{port}"):
        await link.open()
    with running_router(port) as router:
        async with watched(f"ros2://127.0.0.1:{port}/imu/data") as made:
            await until(lambda: made.session.info.is_open, "it is open")
            with driver(port) as robot, sending_imu(robot):
                await has(made, 10, "angular_velocity", "/imu/data")
                router.close()
                await until(lambda: "known go on" in made.notices, "the end of the router is reported")
            await until(lambda: made.status == "lost", "the end of the node is noticed")
            with running_router(port), driver(port) as robot, sending_imu(robot):
                before = made.count("angular_velocity", "/imu/data")
                await has(made, before + 10, "angular_velocity", "/imu/data")
                await until(lambda: made.status == "live", "it is live again")
                assert made.notices == ""


@contextmanager
def sending_imu(robot: Driver) -> Iterator[None]:
    publisher = robot.publisher("/imu/data", ros.IMU)
    with sending(lambda n: publisher.publish([ros.imu(n, time.time_ns())])):
        yield


def test_the_domain_is_that_of_the_environment_unless_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def domain_of(source: str) -> int:
        link = open_link(source, LinkSettings(now_ns=steady_clock()))
        assert isinstance(link, Ros2Link)
        return link.domain

    monkeypatch.setenv("ROS_DOMAIN_ID", "42")
    assert domain_of("ros2://robot/imu") == 42
    assert domain_of("ros2://robot/imu?domain=3") == 3
    monkeypatch.setenv("ROS_DOMAIN_ID", "robot")
    with pytest.raises(LinkError, match="ROS_DOMAIN_ID 'robot' of the environment is not a number from 0 to 232"):
        domain_of("ros2://robot/imu")
    monkeypatch.delenv("ROS_DOMAIN_ID")
    assert domain_of("ros2://robot/imu") == 0


@each_row(
    ("source", "words"),
    [
        ("ros2://robot/imu-data", "'/imu-data' is not a name of a topic"),
        ("ros2://robot/imu?type=Imu", "'Imu' is not a type of ROS 2"),
        ("ros2://robot/imu?domain=400", "domain is '400'"),
        ("ros2://robot/imu?qos=1", "no option 'qos'"),
    ],
)
def test_an_invalid_source_is_explained(source: str, words: str) -> None:
    with pytest.raises(LinkError, match=words):
        open_link(source, LinkSettings(now_ns=steady_clock()))
