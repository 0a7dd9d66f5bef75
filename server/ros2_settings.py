"""Settings of ROS 2: their defaults and valid values, without Zenoh.

Source: ROS 2 documentation, "The ROS_DOMAIN_ID"; REP 144 and "Topic and service name mapping" of the design of ROS 2.
"""

from __future__ import annotations

import os
import re

VARIABLE = "ROS_DOMAIN_ID"
MAX_DOMAIN = 232  # what DDS allows; rmw_zenoh has no limit of its own
DEFAULT_ROUTER = "tcp/localhost:7447"
NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_ADDRESS = re.compile(r"(?:tcp|udp|tls|quic|ws)/(?:\[[0-9a-fA-F:.]+\]|[^\s/:\[\]#?]+):(\d{1,5})(?:[?#]\S*)?")


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


def is_router_address(text: str) -> bool:
    """Whether a text is an address of a router: tcp/HOST:PORT."""
    match = _ADDRESS.fullmatch(text)
    return match is not None and 0 < int(match[1]) <= 65_535
