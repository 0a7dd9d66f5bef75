"""Sessions of Zenoh: a router that is absent at first, stops and comes again."""

from contextlib import closing

import pytest

from imuscope.server.extensions.ros2.session import (
    IMPATIENT,
    RouterAbsentError,
    ZenohSessionError,
    open_session,
    router_host,
)
from imuscope.server.settings.setting_types import is_router_address
from tests.server.extensions.ros2.zenoh_router import announced, running_router
from tests.support.each_row import each_row
from tests.support.free_ports import free_port
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until


def test_a_router_may_come_late_and_come_again() -> None:
    port = free_port()
    session = open_session(f"tcp/127.0.0.1:{port}")
    token = session.liveliness().declare_token("@ros2_lv/0/test")
    try:
        for number in range(2):
            with running_router(port) as router:
                block_until(lambda: list(session.info.routers_zid()), f"router {number} is reached")
                block_until(lambda hub=router: announced(hub) == ["@ros2_lv/0/test"], "the token is known to it")
            block_until(lambda: not list(session.info.routers_zid()), f"the end of router {number} is noticed")
    finally:
        token.undeclare()
        session.close()


def test_a_client_of_a_router_elsewhere_finds_it_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """A session that accepts no connections, as seen from nodes of the router's host."""
    monkeypatch.setattr("imuscope.server.extensions.ros2.session._is_here", lambda host: False)
    port = free_port()
    with monkeypatch.context() as patch:
        patch.setattr("imuscope.server.extensions.ros2.session.IMPATIENT", {**IMPATIENT, "connect/timeout_ms": 200})
        with pytest.raises(RouterAbsentError, match=f"There is no Zenoh router at tcp/127.0.0.1:{port}."):
            open_session(f"tcp/127.0.0.1:{port}")
    monkeypatch.setattr(
        "imuscope.server.extensions.ros2.session.IMPATIENT",
        {**IMPATIENT, "connect/timeout_ms": round(PATIENCE_S * 1000)},
    )
    with running_router(port) as router:
        session = open_session(f"tcp/127.0.0.1:{port}")
        token = session.liveliness().declare_token("@ros2_lv/0/test")
        block_until(lambda: announced(router) == ["@ros2_lv/0/test"], "the token is known to the router")
    block_until(lambda: not list(session.info.routers_zid()), "the end of the router is noticed")
    try:
        with running_router(port) as router:
            block_until(lambda: announced(router) == ["@ros2_lv/0/test"], "the token is known to the next router")
    finally:
        token.undeclare()
        session.close()


def test_messages_of_a_client_reach_a_peer_of_the_router(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "imuscope.server.extensions.ros2.session.IMPATIENT",
        {**IMPATIENT, "connect/timeout_ms": round(PATIENCE_S * 1000)},
    )
    port = free_port()
    with running_router(port), closing(open_session(f"tcp/127.0.0.1:{port}")) as peer:
        monkeypatch.setattr("imuscope.server.extensions.ros2.session._is_here", lambda host: False)
        with closing(open_session(f"tcp/127.0.0.1:{port}")) as client:
            received: list[bytes] = []
            peer.declare_subscriber("0/**", lambda sample: received.append(bytes(sample.payload)))
            publisher = client.declare_publisher("0/imu")
            block_until(lambda: publisher.matching_status.matching, "the subscriber is found")
            publisher.put(b"1")
            block_until(lambda: received == [b"1"], "the message arrives")
            assert not list(client.info.peers_zid())


def test_an_address_that_zenoh_cannot_use_is_an_error_of_ours() -> None:
    with pytest.raises(ZenohSessionError, match="cannot be opened"):
        open_session("carrier-pigeon")


@each_row("text", ["tcp/localhost:7447", "tcp/10.0.0.2:7447", "tcp/[::1]:7447", "udp/robot.local:1"])
def test_addresses(text: str) -> None:
    assert is_router_address(text)


@each_row("text", ["", "localhost:7447", "tcp/localhost", "tcp://localhost:7447", "tcp/a:0", "tcp/a:7x"])
def test_other_texts_are_no_address(text: str) -> None:
    assert not is_router_address(text)


@each_row(
    ("text", "host"),
    [("tcp/localhost:7447", ("localhost", 7447)), ("tcp/[::1]:1", ("::1", 1)), ("tls/a.b:2?x=1#y", ("a.b", 2))],
)
def test_host_and_port_of_an_address(text: str, host: tuple[str, int]) -> None:
    assert router_host(text) == host
