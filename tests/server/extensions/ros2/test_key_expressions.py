"""Key expressions of ROS 2 over Zenoh, against the examples in the design document of rmw_zenoh."""

import pytest

from imuscope.server.extensions.ros2.key_expressions import (
    KeyExpressionError,
    QosProfile,
    RosEndpoint,
    RosNode,
    dds_type,
    graph_pattern,
    name_of,
    parse_token,
    parse_topic_key,
    ros_type,
    topic_key,
)
from imuscope.server.extensions.ros2.settings import is_name
from tests.support.each_row import each_row

STRING = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
LISTENER = RosNode(2, "aac3178e146ba6f1fc6e6a4085e77f21", 0, "", "listener")
TALKER = RosNode(2, "8b20917502ee955ac4476e0266340d5c", 0, "", "talker")
DOCUMENTED = {
    "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener": LISTENER,
    "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/10/MS/%/%/listener/%chatter/"
    f"std_msgs::msg::dds_::String_/{STRING}/::,10:,:,:,,": RosEndpoint(
        LISTENER, 10, "subscriber", "/chatter", "std_msgs/msg/String", STRING, QosProfile(depth=10)
    ),
    "@ros2_lv/2/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/"
    f"std_msgs::msg::dds_::String_/{STRING}/::,7:,:,:,,": RosEndpoint(
        TALKER, 10, "publisher", "/chatter", "std_msgs/msg/String", STRING, QosProfile(depth=7)
    ),
}


@each_row("token", DOCUMENTED)
def test_documented_tokens(token: str) -> None:
    assert DOCUMENTED[token].token == token
    assert parse_token(token) == DOCUMENTED[token]


def test_namespaces_are_mangled() -> None:
    node = RosNode(0, "ab12", 3, "/robot/arm", "imu0")
    assert node.token == "@ros2_lv/0/ab12/3/3/NN/%/%robot%arm/imu0"
    assert node.full_name == "/robot/arm/imu0"
    assert parse_token(node.token) == node


def test_messages_of_a_topic() -> None:
    publisher = RosEndpoint(TALKER, 1, "publisher", "/robot/chatter", "std_msgs/msg/String", STRING)
    assert publisher.key == f"2/robot/chatter/std_msgs::msg::dds_::String_/{STRING}"
    assert parse_topic_key(publisher.key) == (2, "/robot/chatter", "std_msgs/msg/String", STRING)
    assert topic_key(2, "/chatter", "std_msgs/msg/String") == "2/chatter/std_msgs::msg::dds_::String_/*"
    assert graph_pattern(2) == "@ros2_lv/2/**"


@each_row(
    ("text", "profile"),
    [
        ("::,:,:,:,,", QosProfile(depth=42)),
        ("2::,5:,:,:,,", QosProfile("best_effort", depth=5)),
        (":1:,1:,:,:,,", QosProfile(durability="transient_local", depth=1)),
        ("2:1:2,100:,:,:,,", QosProfile("best_effort", "transient_local", "keep_all", 100)),
    ],
)
def test_quality_of_service(text: str, profile: QosProfile) -> None:
    assert profile.text == text
    assert QosProfile.parse(text) == profile


def test_defaults_that_are_written_out_are_understood() -> None:
    assert QosProfile.parse("1:2:1,10:9223372036,854775807:,:1,,") == QosProfile(depth=10)


@each_row(
    "token",
    [
        "",
        "@ros2_lv",
        "other/2/ab/0/0/NN/%/%/listener",
        "@ros2_lv/2/ab/0/0/NN/%/%",
        "@ros2_lv/x/ab/0/0/NN/%/%/listener",
        "@ros2_lv/2/ab/0/0/XX/%/%/listener",
        "@ros2_lv/2/ab/0/1/MP/%/%/talker",
        "@ros2_lv/2/ab/0/1/MP/%/%/talker/%chatter/T/H/::x,:,:,:,,",
        "@ros2_lv/2/ab/0/0/NN//%/listener",
    ],
)
def test_other_tokens_are_refused(token: str) -> None:
    with pytest.raises(KeyExpressionError):
        parse_token(token)


@each_row("key", ["", "0", "0/chatter/type", "x/chatter/type/hash", "@ros2_lv/0/a/b"])
def test_other_keys_are_refused(key: str) -> None:
    with pytest.raises(KeyExpressionError):
        parse_topic_key(key)


def test_names_of_types() -> None:
    assert dds_type("sensor_msgs/msg/Imu") == "sensor_msgs::msg::dds_::Imu_"
    assert ros_type("sensor_msgs::msg::dds_::Imu_") == "sensor_msgs/msg/Imu"
    assert ros_type("EMPTY_TOPIC_TYPE") == "EMPTY_TOPIC_TYPE"
    for wrong in ("Imu", "sensor_msgs/Imu", "sensor_msgs::msg::dds_::Imu_", "a/b/c/d", "a/b/*"):
        with pytest.raises(KeyExpressionError):
            dds_type(wrong)


@each_row(
    ("text", "name"),
    [
        ("MTi-680G", "mti_680g"),
        ("MTi-630 (2)", "mti_630_2"),
        ("  ", "device"),
        ("5 µIMU", "device_5_imu"),
        ("a__b", "a_b"),
    ],
)
def test_any_text_becomes_a_name(text: str, name: str) -> None:
    assert name_of(text) == name
    assert is_name(f"/{name}")


@each_row("text", ["", "/", "robot", "/robot/", "/1robot", "/a__b", "/a b", "/a-b", "/a/../b", "/a*"])
def test_invalid_names(text: str) -> None:
    assert not is_name(text)
