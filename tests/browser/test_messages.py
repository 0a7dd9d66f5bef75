"""A sensor whose protocol imuscope does not speak: the messages of its ROS 2 driver, with the panels of any device."""

import time
from collections.abc import Callable

from playwright.sync_api import Page, expect

from tests.server.links import rosbags_messages as ros
from tests.server.links.message_sources import sdk_server, sending
from tests.support.chromium import until
from tests.support.free_ports import free_port
from tests.support.server_process import ServerProcess
from tests.support.timeouts import get

LENGTH = """() => { const c = window.imuscope?.store.channels.value.find(c => c.info.title === "angular_velocity");
                    return c && c.ring.length > 50; }"""


def test_a_topic_is_plotted_with_attitude_and_place_and_claims_nothing_it_cannot_know(
    serve: Callable[..., ServerProcess], open_page: Callable[..., Page]
) -> None:
    topics = {"/imu/data": ros.IMU, "/fix": ros.FIX}
    with sdk_server(free_port(), topics) as robot:

        def send(n: int) -> None:
            robot.log("/imu/data", ros.imu(n, time.time_ns()))
            robot.log("/fix", ros.fix(n, time.time_ns()))

        with sending(send):
            server = serve(f"foxglove://127.0.0.1:{robot.port}")
            page = open_page(server.url)
            until(page, LENGTH)
            expect(page.get_by_text("messages of its driver")).to_be_visible()
            expect(page.get_by_text("from /imu/data")).to_be_visible()  # the attitude
            expect(page.get_by_text("angular_velocity").first).to_be_visible()
            expect(page.get_by_text("linear_acceleration").first).to_be_visible()
            expect(page.get_by_text("11.500 000 0")).to_be_visible()  # the longitude beside the map
            expect(page.get_by_text("lost ones cannot be counted")).to_be_visible()
            expect(page.get_by_text("Clock drift")).to_be_hidden()
            answer = get(f"{server.url}/api/devices/1/forms")
            assert (answer.status_code, answer.json()["kind"]) == (409, "no-driver")
            assert "configure it with the program that publishes them" in answer.json()["hint"]
