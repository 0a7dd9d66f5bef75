"""Sessions of Zenoh, configured as rmw_zenoh configures those of ROS nodes.

    router    found by its address, never by multicast; it makes nodes known to each other, which then talk directly
    peers     nodes of the same host, over the loopback

A router that is absent, stopped or started again is no error: Zenoh tries again every few seconds, and announces
everything anew when it is there.

Source: rmw_zenoh, DEFAULT_RMW_ZENOH_SESSION_CONFIG.json5.
"""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import zenoh

DEFAULT_ROUTER = "tcp/localhost:7447"
SETTINGS: dict[str, Any] = {
    "mode": "peer",
    "connect/timeout_ms": -1,
    "connect/exit_on_failure": False,
    "connect/retry": {"period_init_ms": 1000, "period_max_ms": 4000, "period_increase_factor": 2},
    "listen/endpoints": ["tcp/localhost:0"],
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": True,
    "scouting/gossip/target": {"router": ["router", "peer"], "peer": ["router"]},
    "scouting/gossip/autoconnect": {"router": [], "peer": ["router", "peer"]},
    "scouting/gossip/autoconnect_strategy": {"peer": {"to_router": "always", "to_peer": "greater-zid"}},
    "timestamping/enabled": {"router": True, "peer": True, "client": True},
    # Ours: 1 MB instead of 128 kB for a subscriber that does not read for a moment, before messages are dropped.
    "transport/link/tx/queue/size/data": 16,
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 20_000,  # µs, instead of 1 ms
}
_ADDRESS = re.compile(r"(?:tcp|udp|tls|quic|ws)/(?:\[[0-9a-fA-F:.]+\]|[^\s/:\[\]#?]+):(\d{1,5})(?:[?#]\S*)?")


class ZenohSessionError(Exception):
    """A session that cannot be opened: the reason as one sentence."""


def is_router_address(text: str) -> bool:
    """Whether a text is an address of a router: tcp/HOST:PORT."""
    found = _ADDRESS.fullmatch(text)
    return found is not None and 0 < int(found[1]) <= 65_535


def router_host(text: str) -> tuple[str, int]:
    """Host and port of a router's address."""
    host, _, port = text.partition("/")[2].partition("?")[0].partition("#")[0].rpartition(":")
    return host.strip("[]"), int(port)


def open_session(router: str) -> zenoh.Session:
    """Open a session. It need not reach the router yet.

    Args:
        router: its address, tcp/HOST:PORT.

    Raises:
        ZenohSessionError: the address cannot be used.
    """
    import zenoh  # here, because it takes a while and few servers need it

    config = zenoh.Config()
    try:
        for name, value in {**SETTINGS, "connect/endpoints": [router]}.items():
            config.insert_json5(name, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise ZenohSessionError(f"The Zenoh session cannot be opened: {error}.") from None
