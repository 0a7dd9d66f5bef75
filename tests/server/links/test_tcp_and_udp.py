"""TCP both ways and UDP, on the loopback interface with ports that the system chooses."""

from __future__ import annotations

import asyncio
import socket
from typing import Any, cast

import pytest

from imuscope.server.links.source_url import open_link
from imuscope.server.links.tcp import TcpLink, TcpListenLink
from imuscope.server.links.text import is_ours
from imuscope.server.links.udp import MAX_SENDERS, UdpLink
from tests.server.links.link_fixtures import dies, fails, gather, joined, left_behind, opened, settings
from tests.support.each_row import each_row
from tests.support.timeouts import PATIENCE_S


class TcpServer:
    """A device server with one client."""

    def __init__(self) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.client: socket.socket | None = None

    def accept(self) -> socket.socket:
        self.client = self.listener.accept()[0]
        return self.client

    def __enter__(self) -> TcpServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.listener.close()
        if self.client is not None:
            self.client.close()


async def test_tcp_in_both_directions_until_the_peer_closes() -> None:
    with TcpServer() as server:
        attempts: list[str] = []
        link = cast(TcpLink, open_link(f"tcp://127.0.0.1:{server.port}", settings()))
        await link.open(lambda one: attempts.append(f"{one.what}: {one.outcome}"))
        assert attempts == [f"127.0.0.1:{server.port}: connected"]
        assert link._socket is not None
        assert link._socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
        assert link._socket.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
        client = server.accept()
        client.sendall(b"from the device")
        assert joined(await gather(link, 15)) == b"from the device"
        await link.write(b"to the device")
        assert client.recv(100) == b"to the device"
        client.close()
        error = await dies(link)
        assert error.kind == "gone"
        assert "closed" in error.message
        await link.close()


async def test_tcp_reset_is_gone() -> None:
    with TcpServer() as server:
        async with opened(open_link(f"tcp://127.0.0.1:{server.port}", settings())) as link:
            client = server.accept()
            client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
            client.close()
            assert (await dies(link)).kind == "gone"


def test_tcp_connection_refused() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    attempts: list[str] = []
    link = open_link(f"tcp://127.0.0.1:{port}", settings())
    error = asyncio.run(fails(link.open(lambda one: attempts.append(one.outcome))))
    assert error.kind == "refused"
    assert f"127.0.0.1:{port}" in error.message
    assert attempts == [error.message]


async def test_tcp_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    async def silence(*_: object) -> None:
        await asyncio.sleep(60)

    loop = asyncio.get_running_loop()
    monkeypatch.setattr(loop, "sock_connect", silence)
    before = left_behind()
    error = await fails(open_link("tcp://127.0.0.1:9", settings(connect_timeout_s=0.05)).open())
    assert error.kind == "refused"
    assert "0.05 s" in error.message
    assert left_behind() == before


def test_tcp_unknown_host(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(*_: object, **__: object) -> None:
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    error = asyncio.run(fails(open_link("tcp://no-such-robot:4001", settings()).open()))
    assert error.kind == "not-found"
    assert "no-such-robot" in error.message


async def test_listener_serves_one_device_after_another() -> None:
    link = cast(TcpListenLink, open_link("tcp-listen://127.0.0.1:0", settings()))
    async with opened(link):
        assert "Waiting" in link.notices[0]
        assert (await fails(link.write(b"x"))).kind == "gone"
        with socket.create_connection(link.address) as device:
            device.sendall(b"hello")
            assert joined(await gather(link, 5)) == b"hello"
            name = f"127.0.0.1:{device.getsockname()[1]}"
            assert link.notices == [f"{name} is connected."]
            await link.write(b"answer")
            assert device.recv(10) == b"answer"
        error = await dies(link)
        assert error.kind == "gone"
        assert name in error.message
        assert f":{link.address[1]}" in error.hint
    await link.open()  # as the session's retry does
    with socket.create_connection(link.address) as device:
        device.sendall(b"again")
        assert joined(await gather(link, 5)) == b"again"
    await link.close()


async def test_listener_turns_a_second_device_away_while_the_first_one_talks() -> None:
    link = cast(TcpListenLink, open_link("tcp-listen://127.0.0.1:0", settings()))
    async with opened(link):
        with socket.create_connection(link.address) as first:
            first.sendall(b"1")
            await gather(link, 1)
            with socket.create_connection(link.address) as second:
                second.settimeout(PATIENCE_S)
                assert second.recv(1) == b""
                assert "turned away" in link.notices[1]
            first.sendall(b"2")
            assert joined(await gather(link, 1)) == b"2"


async def test_listener_lets_a_returning_device_replace_its_silent_connection() -> None:
    now = 0
    source = settings()
    link = cast(TcpListenLink, open_link("tcp-listen://127.0.0.1:0", type(source)(now_ns=lambda: now)))
    async with opened(link):
        with socket.create_connection(link.address) as dead:
            dead.sendall(b"1")
            await gather(link, 1)
            now += 2_000_000_000
            with socket.create_connection(link.address) as back:
                back.sendall(b"2")
                assert joined(await gather(link, 1)) == b"2"
                assert f"127.0.0.1:{back.getsockname()[1]} is connected" in link.notices[0]
                assert f"the place of 127.0.0.1:{dead.getsockname()[1]}" in link.notices[0]


@each_row("scheme", ["tcp-listen", "udp"])
def test_a_port_in_use(scheme: str) -> None:
    kind = socket.SOCK_STREAM if scheme == "tcp-listen" else socket.SOCK_DGRAM
    with socket.socket(socket.AF_INET, kind) as busy:
        busy.bind(("127.0.0.1", 0))
        if kind == socket.SOCK_STREAM:
            busy.listen()
        port = busy.getsockname()[1]
        error = asyncio.run(fails(open_link(f"{scheme}://127.0.0.1:{port}", settings()).open()))
    assert error.kind == "busy"
    assert str(port) in error.message
    assert "in use by this server itself" in error.message, "it said: another program"


def test_a_port_of_another_program() -> None:
    assert is_ours(1) is False


@each_row("scheme", ["tcp-listen", "udp"])
def test_an_address_of_another_host(scheme: str) -> None:
    error = asyncio.run(fails(open_link(f"{scheme}://192.0.2.1:0", settings()).open()))
    assert error.kind == "not-found"
    assert f"{scheme}://:0" in error.hint


async def test_udp_keeps_datagrams_apart_and_answers_the_last_sender() -> None:
    link = cast(UdpLink, open_link("udp://127.0.0.1:0", settings()))
    async with opened(link):
        assert (await fails(link.write(b"x"))).kind == "refused"
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device:
            device.settimeout(PATIENCE_S)
            for data in (b"first", b"", b"second", b"x" * 1400):
                device.sendto(data, link.address)
            chunks = await gather(link, 5 + 6 + 1400)
            assert [chunk.data for chunk in chunks] == [b"first", b"second", b"x" * 1400]
            name = f"127.0.0.1:{device.getsockname()[1]}"
            assert link.notices == [f"Datagrams come from {name}."]
            await link.write(b"answer")
            assert device.recv(10) == b"answer"


async def test_udp_reports_two_devices_on_one_port() -> None:
    now = 0
    link = cast(UdpLink, open_link("udp://127.0.0.1:0", settings()))
    link.settings = type(link.settings)(now_ns=lambda: now)
    async with opened(link):
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
        ):
            for device in (one, other):
                device.sendto(b"x", link.address)
                await gather(link, 1)
            assert "mixed" in link.notices[1]
            for _ in range(3):
                now += 1_500_000_000
                other.sendto(b"x", link.address)
                await gather(link, 1)
            assert link.notices == [f"Datagrams come from 127.0.0.1:{other.getsockname()[1]}."]


async def test_thousands_of_senders_cost_no_more_than_a_few() -> None:
    """Regression: each datagram from a new port sorted and listed all senders, and the notice grew to 47 kB."""
    link = cast(UdpLink, open_link("udp://127.0.0.1:0", settings()))
    async with opened(link):
        for _ in range(200):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device:
                device.sendto(b"x", link.address)
        await gather(link, 200)
        assert link.notices[0] == f"Datagrams come from {MAX_SENDERS} places or more."
        assert sum(map(len, link.notices)) < 500
        assert len(link._sender_ns) == MAX_SENDERS


@pytest.mark.skipif(not hasattr(socket, "CMSG_SPACE"), reason="the system does not count its losses")
async def test_udp_counts_datagrams_dropped_by_the_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    """A small receive buffer, a reading thread that is held up: the losses are counted and named."""
    monkeypatch.setattr("imuscope.server.links.udp.BUFFER_BYTES", 1)

    link = cast(UdpLink, open_link("udp://127.0.0.1:0", settings()))
    async with opened(link):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as device:
            for _ in range(400):
                device.sendto(b"x" * 1000, link.address)
            await asyncio.sleep(0.05)
            got = len(await link.read())
            device.sendto(b"last", link.address)  # losses are reported with the next datagram that gets through
            await gather(link, until=lambda data: data.endswith(b"last"))
            assert link.lost >= 400 - got - 400  # never negative, never more than were sent
            assert link.lost <= 400
            if link.lost:
                assert f"{link.lost} datagrams were lost" in link.notices[-1]


@each_row("source", ["tcp-listen://127.0.0.1:0", "udp://127.0.0.1:0"])
async def test_no_threads_or_descriptors_are_left(source: str) -> None:
    before = left_behind()
    link = open_link(source, settings())
    for _ in range(5):
        await link.open()
        await link.close()
        await link.close()
    async with opened(link):
        kind = socket.SOCK_DGRAM if link.kind == "udp" else socket.SOCK_STREAM
        with socket.socket(socket.AF_INET, kind) as device:
            device.connect(cast(Any, link).address)
            device.send(b"x")
            await gather(link, 1)
    assert left_behind() == before
