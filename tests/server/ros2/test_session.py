"""Sessions of Zenoh: a router that is absent at first, stops and comes again."""

from __future__ import annotations

import pytest

from server.ros2.session import ZenohSessionError, is_router_address, open_session
from tests.free_ports import free_port
from tests.waiting import block_until
from tests.zenoh_router import announced, running_router


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


def test_an_address_that_zenoh_cannot_use_is_an_error_of_ours() -> None:
    with pytest.raises(ZenohSessionError, match="cannot be opened"):
        open_session("carrier-pigeon")


@pytest.mark.parametrize("text", ["tcp/localhost:7447", "tcp/10.0.0.2:7447", "tcp/[::1]:7447", "udp/robot.local:1"])
def test_addresses(text: str) -> None:
    assert is_router_address(text)


@pytest.mark.parametrize("text", ["", "localhost:7447", "tcp/localhost", "tcp://localhost:7447", "tcp/a:0", "tcp/a:7x"])
def test_other_texts_are_no_address(text: str) -> None:
    assert not is_router_address(text)
