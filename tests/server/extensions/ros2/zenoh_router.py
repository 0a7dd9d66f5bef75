"""A Zenoh router on loopback, for tests: what `zenohd` and `rmw_zenohd` are."""

import json
from collections.abc import Iterator
from contextlib import contextmanager

import zenoh


@contextmanager
def running_router(port: int) -> Iterator[zenoh.Session]:
    """A router on a port of loopback."""
    config = zenoh.Config()
    settings = {"mode": "router", "listen/endpoints": [f"tcp/127.0.0.1:{port}"], "scouting/multicast/enabled": False}
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))
    with zenoh.open(config) as session:
        yield session


def announced(session: zenoh.Session, pattern: str = "@ros2_lv/**") -> list[str]:
    """The liveliness tokens that a session knows."""
    return sorted(str(reply.ok.key_expr) for reply in session.liveliness().get(pattern) if reply.ok)
