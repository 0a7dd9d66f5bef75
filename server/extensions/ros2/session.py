"""Sessions of Zenoh, configured as rmw_zenoh configures those of ROS nodes.

    router on this host     peer: the router makes nodes known to each other, which then talk directly on the loopback
    router elsewhere        client: everything goes through the router, because nodes accept connections of their own
                            host only (in ROS, each host has a router for that)

A router is found by its address, never by multicast. One that is restarted is not an error: Zenoh tries
again every few seconds, and announces everything again when it is connected. A peer need not reach it at first either.

Source: rmw_zenoh, DEFAULT_RMW_ZENOH_SESSION_CONFIG.json5.
"""

import ipaddress
import json
from typing import TYPE_CHECKING, Any

from imuscope.server.settings.setting_types import is_router_address

if TYPE_CHECKING:
    import zenoh

CLIENT_S = 3.0  # time of a client to reach its router
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
CLIENT: dict[str, Any] = {"mode": "client", "listen/endpoints": []}
IMPATIENT: dict[str, Any] = {"connect/timeout_ms": round(CLIENT_S * 1000), "connect/exit_on_failure": True}


class ZenohSessionError(Exception):
    """A session that cannot be opened: the reason as one sentence."""


class RouterAbsentError(ZenohSessionError):
    """A router that a client does not reach; it may be there later."""


def router_host(text: str) -> tuple[str, int]:
    """Host and port of a router's address."""
    host, _, port = text.partition("/")[2].partition("?")[0].partition("#")[0].rpartition(":")
    return host.strip("[]"), int(port)


def is_elsewhere(router: str) -> bool:
    """Whether an address is that of a router on another host."""
    return is_router_address(router) and not _is_here(router_host(router)[0])


def open_session(router: str, *, patient: bool = False) -> "zenoh.Session":
    """Open a session. If the router is on this host, the session need not reach it yet; otherwise this takes a while.

    Args:
        router: its address, tcp/HOST:PORT.
        patient: wait for a router elsewhere for as long as it takes, also after it was lost. Otherwise a session that
            has lost it may not find it again.

    Raises:
        RouterAbsentError: there is no router at an address elsewhere.
        ZenohSessionError: the address cannot be used.
    """
    import zenoh  # here, because it takes a while and few servers need it

    config = zenoh.Config()
    try:
        is_client = is_elsewhere(router)
        settings = {**SETTINGS, "connect/endpoints": [router]}
        if is_client:
            settings |= CLIENT if patient else {**CLIENT, **IMPATIENT}
        for name, value in settings.items():
            config.insert_json5(name, json.dumps(value))
    except zenoh.ZError as error:
        raise ZenohSessionError(f"The Zenoh session cannot be opened: {error}.") from None
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        if is_client:
            raise RouterAbsentError(f"There is no Zenoh router at {router}.") from None
        raise ZenohSessionError(f"The Zenoh session cannot be opened: {error}.") from None


def _is_here(host: str) -> bool:
    """Whether a host is the loopback of this one."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
