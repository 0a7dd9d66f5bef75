"""Zenoh sessions of a fleet: that of a robot, which connects and never listens, and that of the fleet server.

    robot            client of the router, found by its address. Opening waits until the router is there; one that is
                     lost is tried again every few seconds, and everything is announced again.
    fleet server     a router itself (`--listen`), or a client of one (`--router`).

Nothing is found by multicast, and no session of a robot talks to another.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import zenoh

MAX_SESSIONS = 100_000
MAX_MESSAGE = 1024 * 1024  # bytes: larger ones are refused by Zenoh itself
SLOW_LINE_US = 60_000_000
"""A robot's line that accepts nothing for so long is reopened; the usual 5 s are short for a bad line."""
SETTINGS: Mapping[str, Any] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "transport/shared_memory/enabled": False,
    "transport/link/rx/max_message_size": MAX_MESSAGE,
    "connect/timeout_ms": -1,
    "connect/exit_on_failure": False,
    "connect/retry": {"period_init_ms": 1000, "period_max_ms": 8000, "period_increase_factor": 2},
}


LOOPBACK = ("127.0.0.1", "localhost", "[::1]")


class FleetBusError(Exception):
    """A session that cannot be opened: the reason as one sentence."""


@dataclass(frozen=True, slots=True)
class BusCredentials:
    """Credentials that a side shows to the other, as Zenoh has them; "" for what it has not.

    Args:
        user, password: of a robot at its router.
        ca: PEM file of the authority that signed the other side's certificate.
        certificate, key: PEM files of the own certificate.
    """

    user: str = ""
    password: str = ""
    ca: str = ""
    certificate: str = ""
    key: str = ""


def is_loopback_address(address: str) -> bool:
    """Whether an address of a router, such as tcp/127.0.0.1:7447, is on this machine."""
    return address.partition("/")[2].rpartition(":")[0] in LOOPBACK


def client_settings(router: str, credentials: BusCredentials) -> dict[str, Any]:
    settings = {
        **SETTINGS,
        "mode": "client",
        "connect/endpoints": [router],
        "listen/endpoints": [],
        "transport/link/tx/queue/congestion_control/block/wait_before_close": SLOW_LINE_US,
        "transport/auth/usrpwd/user": credentials.user or None,
        "transport/auth/usrpwd/password": credentials.password or None,
        "transport/link/tls/root_ca_certificate": credentials.ca or None,
        "transport/link/tls/connect_certificate": credentials.certificate or None,
        "transport/link/tls/connect_private_key": credentials.key or None,
        "transport/link/tls/enable_mtls": True if credentials.certificate else None,
    }
    return {name: value for name, value in settings.items() if value is not None}


def open_bus(settings: Mapping[str, Any]) -> "zenoh.Session":
    """Open a session. A client waits here until its router is there.

    Raises:
        FleetBusError: the settings cannot be used, or the address cannot be listened on.
    """
    import zenoh  # here, because it takes a while and a robot without a fleet does not need it

    config = zenoh.Config()
    try:
        for name, value in settings.items():
            config.insert_json5(name, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise FleetBusError(f"The session of the fleet cannot be opened: {error!s:.300}.") from None
