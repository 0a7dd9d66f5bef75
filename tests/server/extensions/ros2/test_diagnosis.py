"""The finding of `imuscope doctor` about the router of ROS 2."""

import socket

from imuscope.server.extensions.ros2.diagnosis import findings
from imuscope.server.extensions.ros2.settings import Ros2Settings
from imuscope.server.settings.config import Config


def test_a_router_that_answers_and_one_that_does_not() -> None:
    with socket.create_server(("127.0.0.1", 0)) as router:
        settings = Ros2Settings(ros2=True, ros2_router=f"tcp/127.0.0.1:{router.getsockname()[1]}")
        config = Config(extensions=(settings,))
        assert [one.status for one in findings(config)] == ["ok"]
    [finding] = findings(config)
    assert (finding.status, finding.about) == ("warning", "ROS 2")
    assert "connection refused" in finding.message


def test_nothing_where_ros_2_is_off() -> None:
    assert list(findings(Config())) == []
