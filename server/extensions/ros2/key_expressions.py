"""Key expressions of ROS 2 over Zenoh: where messages are published, and how nodes and topics are announced. Pure.

    messages        <domain>/<topic>/<type>/<hash>
                    0/imu0/imu/data/sensor_msgs::msg::dds_::Imu_/RIHS01_7d9a…

    liveliness      @ros2_lv/<domain>/<session>/<node>/<entity>/NN/<enclave>/<namespace>/<node name>           a node
                    @ros2_lv/<domain>/<session>/<node>/<entity>/<kind>/<enclave>/<namespace>/<node name>/
                        <topic>/<type>/<hash>/<qos>                                                        an endpoint

    kind            MP publisher, MS subscriber, SS service, SC client
    qos             <reliability>:<durability>:<history>,<depth>:<deadline s>,<ns>:<lifespan s>,<ns>:
                        <liveliness>,<lease s>,<ns>       a part that has its default is empty

A Zenoh session stands for a ROS context; its id is <session>. <node> and <entity> are numbers within it, and a node's
own <entity> is its <node>. In liveliness tokens a slash within a name is written "%", and so is an empty enclave or
namespace, because Zenoh has no empty parts. A topic is written without its first slash where messages are published.

Source: rmw_zenoh, docs/design.md and liveliness_utils.cpp; ROS 2 names: design.ros2.org, "Topic and Service name
mapping to DDS".
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from imuscope.recordings.file_names import device_names
from imuscope.server.extensions.ros2.settings import NAME

ADMIN_SPACE = "@ros2_lv"
DEFAULT_DEPTH = 42  # the depth that is left out of a token
ANY_HASH = "*"

Kind = Literal["publisher", "subscriber", "service", "client"]
Reliability = Literal["reliable", "best_effort"]
Durability = Literal["volatile", "transient_local"]
History = Literal["keep_last", "keep_all"]

_KINDS: Mapping[Kind, str] = {"publisher": "MP", "subscriber": "MS", "service": "SS", "client": "SC"}
_KIND_OF = {code: kind for kind, code in _KINDS.items()}
_RELIABILITY: Mapping[str, Reliability] = {"": "reliable", "0": "reliable", "1": "reliable", "2": "best_effort"}
_DURABILITY: Mapping[str, Durability] = {"": "volatile", "0": "volatile", "1": "transient_local", "2": "volatile"}
_HISTORY: Mapping[str, History] = {"": "keep_last", "0": "keep_last", "1": "keep_last", "2": "keep_all"}

_NODE = "NN"
_SLASH = "%"
_DDS_TYPE = re.compile(r"(\w+)::(\w+)::dds_::(\w+)_")
_ROS_TYPE = re.compile(r"(\w+)/(\w+)/(\w+)")


class KeyExpressionError(ValueError):
    """A name, a type or a token that is not of the form that ROS 2 defines."""


@dataclass(frozen=True, slots=True)
class QosProfile:
    """Quality of service of an endpoint; deadline, lifespan and liveliness are always the defaults."""

    reliability: Reliability = "reliable"
    durability: Durability = "volatile"
    history: History = "keep_last"
    depth: int = 10

    @property
    def text(self) -> str:
        """As written in a token."""
        reliability = "" if self.reliability == "reliable" else "2"
        durability = "" if self.durability == "volatile" else "1"
        history = "" if self.history == "keep_last" else "2"
        depth = "" if self.depth == DEFAULT_DEPTH else str(self.depth)
        return f"{reliability}:{durability}:{history},{depth}:,:,:,,"

    @classmethod
    def parse(cls, text: str) -> "QosProfile":
        """The profile of a token.

        Raises:
            KeyExpressionError: not of the form above.
        """
        try:
            reliability, durability, history, *_ = text.split(":")
            kind, depth = history.split(",")
            return cls(_RELIABILITY[reliability], _DURABILITY[durability], _HISTORY[kind], int(depth or DEFAULT_DEPTH))
        except (ValueError, KeyError):
            raise KeyExpressionError(f"{text!r} is not a quality of service") from None


@dataclass(frozen=True, slots=True)
class RosNode:
    """A node.

    Args:
        session: id of its Zenoh session, hexadecimal.
        number: of the node within the session.
        namespace: "" for the root, else "/robot".
    """

    domain: int
    session: str
    number: int
    namespace: str
    name: str
    enclave: str = ""

    @property
    def token(self) -> str:
        """Key expression of its liveliness token."""
        return self.token_part(self.number, _NODE)

    @property
    def full_name(self) -> str:
        return f"{self.namespace}/{self.name}"

    def token_part(self, entity: int, kind: str) -> str:
        """The part of a token that nodes and endpoints have in common."""
        names = "/".join(mangled(name) for name in (self.enclave or "/", self.namespace or "/", self.name))
        return f"{ADMIN_SPACE}/{self.domain}/{self.session}/{self.number}/{entity}/{kind}/{names}"


@dataclass(frozen=True, slots=True)
class RosEndpoint:
    """A publisher, subscriber, service or client of a node.

    Args:
        number: of the endpoint within the session.
        topic: with its namespace: "/robot/imu/data".
        type: "sensor_msgs/msg/Imu".
        hash: of the type: "RIHS01_…".
    """

    node: RosNode
    number: int
    kind: Kind
    topic: str
    type: str
    hash: str
    qos: QosProfile = field(default_factory=QosProfile)

    @property
    def token(self) -> str:
        topic = "/".join((mangled(self.topic), mangled(dds_type(self.type)), self.hash, self.qos.text))
        return f"{self.node.token_part(self.number, _KINDS[self.kind])}/{topic}"

    @property
    def key(self) -> str:
        """Key expression of its messages."""
        return topic_key(self.node.domain, self.topic, self.type, self.hash)


def topic_key(domain: int, topic: str, type_name: str, rihs: str = ANY_HASH) -> str:
    """Key expression of the messages of a topic.

    Args:
        topic: "/robot/imu/data".
        type_name: "sensor_msgs/msg/Imu".
        rihs: hash of that type; ANY_HASH for a subscriber that takes every version of it.
    """
    return f"{domain}/{topic.strip('/')}/{dds_type(type_name)}/{rihs}"


def parse_topic_key(key: str) -> tuple[int, str, str, str]:
    """Domain, topic, type and hash of a key expression of messages.

    Raises:
        KeyExpressionError: not of that form.
    """
    domain, *topic, dds_name, rihs = key.split("/") if key.count("/") >= 3 else ("", "", "", "")
    if not domain.isdecimal():
        raise KeyExpressionError(f"{key!r} is not a topic of ROS 2")
    return int(domain), "/" + "/".join(topic), ros_type(dds_name), rihs


def graph_pattern(domain: int) -> str:
    """Key expression of all liveliness tokens of a domain."""
    return f"{ADMIN_SPACE}/{domain}/**"


def parse_token(token: str) -> RosNode | RosEndpoint:
    """The node or endpoint that a liveliness token announces.

    Raises:
        KeyExpressionError: not of the form above.
    """
    admin, *parts = token.split("/")
    if admin != ADMIN_SPACE or len(parts) < 8 or not all(parts):
        raise KeyExpressionError(f"{token!r} is not a liveliness token of ROS 2")
    domain, session, number, entity, kind, *names = parts
    if not (domain.isdecimal() and number.isdecimal() and entity.isdecimal()):
        raise KeyExpressionError(f"{token!r} has an invalid number")
    enclave, namespace, name = (demangled(part) for part in names[:3])
    node = RosNode(int(domain), session, int(number), namespace.rstrip("/"), name, enclave.rstrip("/"))
    if kind == _NODE:
        return node
    if kind not in _KIND_OF or len(names) < 7:
        raise KeyExpressionError(f"{token!r} is not a liveliness token of ROS 2")
    topic, dds_name, rihs, qos = names[3:7]  # newer versions may append parts
    return RosEndpoint(
        node, int(entity), _KIND_OF[kind], demangled(topic), ros_type(demangled(dds_name)), rihs, QosProfile.parse(qos)
    )


def mangled(name: str) -> str:
    """A name as one part of a token."""
    return name.replace("/", _SLASH)


def demangled(part: str) -> str:
    """The name in a part of a token."""
    return part.replace(_SLASH, "/")


def dds_type(type_name: str) -> str:
    """The name of a type on the wire: sensor_msgs/msg/Imu is sensor_msgs::msg::dds_::Imu_.

    Raises:
        KeyExpressionError: not of the form package/msg/Name.
    """
    parts = _ROS_TYPE.fullmatch(type_name)
    if parts is None:
        raise KeyExpressionError(f"{type_name!r} is not a type of ROS 2, such as sensor_msgs/msg/Imu")
    return f"{parts[1]}::{parts[2]}::dds_::{parts[3]}_"


def ros_type(dds_name: str) -> str:
    """The name of a type in ROS 2, of its name on the wire; other names stay as they are."""
    parts = _DDS_TYPE.fullmatch(dds_name)
    return dds_name if parts is None else f"{parts[1]}/{parts[2]}/{parts[3]}"


def node_names(devices: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Unique name of the node of each device, by its id."""
    names: dict[str, str] = {}
    for device_id, name in device_names(devices).items():
        full_name = name_of(name)
        names[device_id] = f"{full_name}_{name_of(device_id)}" if full_name in names.values() else full_name
    return names


def name_of(text: str) -> str:
    """A valid part of a ROS 2 name from any text: "MTi-630 (2)" is mti_630_2."""
    name = re.sub(r"[^a-z0-9]+", "_", text.lower(), flags=re.ASCII).strip("_")
    return name if NAME.fullmatch(name) else f"device_{name}".rstrip("_")
