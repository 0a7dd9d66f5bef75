"""Settings of ROS 2: their defaults and valid values, without Zenoh.

Source: ROS 2 documentation, "The ROS_DOMAIN_ID"; REP 144 and "Topic and service name mapping" of the design of ROS 2.
"""

import argparse
import os
import re
from dataclasses import dataclass, field
from typing import Annotated, Any

from annotated_types import Interval

from imuscope.protocols.family.sensor_properties import SensorProperties
from imuscope.server.extensions.ros2.covariances import noise_of
from imuscope.server.settings.extension_settings import ExtensionSettings
from imuscope.server.settings.setting_types import Form, is_router_address, one_of

VARIABLE = "ROS_DOMAIN_ID"
MAX_DOMAIN = 232  # what DDS allows; rmw_zenoh has no limit of its own
DEFAULT_ROUTER = "tcp/localhost:7447"
NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def usual_domain() -> int:
    """The domain where no setting names one: that of the environment, as for every node of ROS, else 0.

    Raises:
        ValueError: the variable is not a domain; the text is for a user.
    """
    text = os.environ.get(VARIABLE, "").strip()
    if not text:
        return 0
    if not text.isdecimal() or int(text) > MAX_DOMAIN:
        raise ValueError(f"{VARIABLE} {text!r} of the environment is not a number from 0 to {MAX_DOMAIN}.")
    return int(text)


def is_name(text: str) -> bool:
    """Whether a text is a valid name of a topic or a namespace, with its first slash."""
    return text.startswith("/") and all(NAME.fullmatch(part) and "__" not in part for part in text[1:].split("/"))


def _is_namespace(text: str) -> bool:
    return text in ("", "/") or is_name(text)


def _is_frame(text: str) -> bool:
    return bool(re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9_/.-]{0,99}", text))


_NAMESPACE = "is not a namespace such as /robot: letters, digits and single underscores after each slash"


@dataclass(frozen=True, slots=True)
class Ros2Settings(ExtensionSettings):
    """Settings of ROS 2.

    Args:
        ros2: publish devices as nodes of ROS 2 (service.py).
        ros2_domain, ros2_router, ros2_namespace: ROS domain, address of the Zenoh router, namespace of the nodes.
        ros2_reliability, ros2_depth: quality of service of the publishers.
        ros2_axes: "rep103": ENU and FLU; "device": as the device sends them.
        ros2_names: name of the node of a source; otherwise imu, imu_2, … (server/devices/device/device_names.py).
        ros2_frames: frame_id by source, by name of the node, or of the product; otherwise the name of the node.
        ros2_covariances: noise of a device, named as in ros2_frames (covariances.py).
        ros2_map_frame: frame_id of the world.
        ros2_contract: file with what other nodes rely on (contract.py); "": none.
        ros2_tf: publish the attitude as a transform from that frame to the device's, too.
    """

    ros2: bool = False
    ros2_domain: Annotated[int, Interval(ge=0, le=MAX_DOMAIN)] = 0
    ros2_router: Annotated[str, Form(is_router_address, "is not an address such as tcp/localhost:7447")] = (
        DEFAULT_ROUTER
    )
    ros2_namespace: Annotated[str, Form(_is_namespace, _NAMESPACE)] = ""
    ros2_reliability: Annotated[str, one_of("reliable", "best_effort")] = "reliable"
    ros2_depth: Annotated[int, Interval(ge=1, le=10_000)] = 10
    ros2_axes: Annotated[str, one_of("rep103", "device")] = "rep103"
    ros2_names: dict[str, str] = field(default_factory=dict)
    ros2_frames: dict[str, str] = field(default_factory=dict)
    ros2_covariances: dict[str, str] = field(default_factory=dict)
    ros2_map_frame: Annotated[str, Form(_is_frame, "is not the name of a frame, such as imu_link")] = "map"
    ros2_tf: bool = False
    ros2_contract: str = ""

    @classmethod
    def add_options(cls, command: argparse.ArgumentParser) -> None:
        command.add_argument(
            "--ros2", action="store_true", default=None, help="publish each device as a node of ROS 2, over Zenoh"
        )
        command.add_argument("--ros2-domain", type=int, metavar="N", help="ROS domain (default: ROS_DOMAIN_ID, else 0)")
        command.add_argument(
            "--ros2-router", metavar="ADDRESS", help=f"Zenoh router: tcp/HOST:PORT (default {DEFAULT_ROUTER})"
        )

    @classmethod
    def complete(cls, settings: dict[str, Any]) -> None:
        if settings.get("ros2") and "ros2_domain" not in settings:
            settings["ros2_domain"] = usual_domain()

    def check(self) -> None:
        if self.ros2_contract:
            from imuscope.server.extensions.ros2.contract import read_contract  # which knows names from here

            read_contract(self.ros2_contract)
        for source, name in self.ros2_names.items():
            if not NAME.fullmatch(name) or "__" in name or name.endswith("_"):
                raise ValueError(f"name {name!r} of {source} in ros2_names is not a name of a node such as imu.")
            if list(self.ros2_names.values()).count(name) > 1:
                raise ValueError(f"name {name!r} of {source} in ros2_names is that of another source, too.")
        for name, text in self.ros2_covariances.items():
            try:
                noise_of(text, SensorProperties())
            except ValueError as error:
                raise ValueError(f"ros2_covariances of {name}: {error}") from None
        for name, frame in self.ros2_frames.items():
            if not _is_frame(frame):
                raise ValueError(f"frame {frame!r} of {name} in ros2_frames is not a name such as imu_link.")
