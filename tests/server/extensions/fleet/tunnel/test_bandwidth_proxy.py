"""A line of limited rate: bytes arrive whole and not faster, and nobody else may use it."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest

from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.extensions.fleet.store.store import StoreError, limited, location
from imuscope.server.extensions.fleet.tunnel import bandwidth_proxy
from imuscope.server.extensions.fleet.tunnel.bandwidth_proxy import BURST_S, LimitedLine, LineRate
from imuscope.server.extensions.fleet.upload.upload import upload
from tests.support.free_ports import free_port
from tests.support.manual_clock import SleptTime
from tests.support.timeouts import PATIENCE_S

RATE = 200_000.0


@pytest.fixture(autouse=True)
def slept(monkeypatch: pytest.MonkeyPatch) -> SleptTime:
    """The time of the line."""
    made = SleptTime()
    monkeypatch.setattr(bandwidth_proxy, "time", made)
    return made


@pytest.fixture
def echo() -> Iterator[int]:
    """Port of an HTTP server that answers with the body of a request."""
    listener = socket.create_server(("127.0.0.1", 0))

    def serve(client: socket.socket) -> None:
        with client, client.makefile("rb") as lines:
            while first := lines.readline():
                size = 0
                while (line := lines.readline()) not in (b"\r\n", b""):
                    if line.lower().startswith(b"content-length:"):
                        size = int(line.split(b":")[1])
                body = lines.read(size)
                assert first
                client.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: %d\r\n\r\n" % len(body) + body)

    def accept() -> None:
        while True:
            try:
                client, _ = listener.accept()
            except OSError:
                return
            threading.Thread(target=serve, args=(client,), daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()
    yield listener.getsockname()[1]
    listener.shutdown(socket.SHUT_RDWR)
    listener.close()


def test_bytes_pass_whole_at_the_rate_in_each_direction(echo: int, slept: SleptTime) -> None:
    body = os.urandom(100_000)
    with LimitedLine(RATE) as line, httpx.Client(proxy=line.url, timeout=PATIENCE_S) as client:
        answers = [client.put(f"http://127.0.0.1:{echo}/a", content=body) for _ in range(2)]
    assert [answer.content for answer in answers] == [body, body]
    assert slept.monotonic() >= 4 * len(body) / RATE * 0.9, "each is sent before it is answered"


def test_a_tunnel_passes_what_it_is_given(echo: int) -> None:
    body = os.urandom(50_000)
    with LimitedLine(RATE) as line, socket.create_connection(("127.0.0.1", port_of(line)), PATIENCE_S) as client:
        secret = httpx.BasicAuth("imuscope", str(urlsplit(line.url).password))._auth_header
        client.sendall(f"CONNECT 127.0.0.1:{echo} HTTP/1.1\r\nProxy-Authorization: {secret}\r\n\r\n".encode())
        with client.makefile("rb") as answer:
            assert b" 200 " in answer.readline()
            assert answer.readline() == b"\r\n"
            client.sendall(b"PUT /a HTTP/1.1\r\nContent-Length: %d\r\n\r\n" % len(body) + body)
            while answer.readline() != b"\r\n":
                pass
            assert answer.read(len(body)) == body


def port_of(line: LimitedLine) -> int:
    return int(urlsplit(line.url).port or 0)


def test_without_its_secret_nothing_passes(echo: int) -> None:
    with LimitedLine(RATE) as line:
        for url in (f"http://127.0.0.1:{port_of(line)}", f"http://imuscope:wrong@127.0.0.1:{port_of(line)}"):
            with httpx.Client(proxy=url, timeout=PATIENCE_S) as client:
                assert client.get(f"http://127.0.0.1:{echo}/a").status_code == 407


def test_a_server_that_is_not_there_is_reported() -> None:
    with LimitedLine(RATE) as line, httpx.Client(proxy=line.url, timeout=PATIENCE_S) as client:
        assert client.get(f"http://127.0.0.1:{free_port()}/a").status_code == 502


def test_a_pace_is_shared(slept: SleptTime) -> None:
    """Whoever comes waits until what was let through before has passed, also by others."""
    pace = LineRate(10_000.0)
    slept.sleep(1.0)
    for _ in range(4):
        pace.wait(2_500)
    assert slept.slept == pytest.approx([1.0, 0.25 - BURST_S, 0.25, 0.25, 0.25])


def test_a_pace_is_shared_by_threads(slept: SleptTime) -> None:
    pace = LineRate(10_000.0)
    threads = [threading.Thread(target=pace.wait, args=(2_500,)) for _ in range(4)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    assert slept.monotonic() >= 0.9


def test_a_folder_is_written_at_the_rate(recording: Path, store: Path, slept: SleptTime) -> None:
    size = recording.stat().st_size
    with limited(location(str(store)), size / 2) as place:
        made = upload(recording, place, "otter", DecodeOptions("", {}))
    assert slept.monotonic() >= 1.9
    assert (store / made.key).read_bytes() == recording.read_bytes()


def test_a_line_with_a_proxy_of_its_own_cannot_be_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HTTPS_PROXY", "http://127.0.0.1:3128")
    with pytest.raises(StoreError, match="HTTPS_PROXY"), limited(location("s3://drives/all"), RATE):
        pytest.fail("it was opened")
