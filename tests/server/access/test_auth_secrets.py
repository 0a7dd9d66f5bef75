"""Tokens are never printed, written or sent. That one is in no address after its first use: test_api.py."""

import asyncio
import contextlib
import socket
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest
from websockets.exceptions import InvalidStatus

from tests.support.server_process import ServerProcess
from tests.support.timeouts import connecting, http_client

VIEW, CONTROL, NEAR_TOKEN = "view-7Qx1-of-this-test", "control-9Zk4-of-this-test", "control-9Zk4-of-this-tesT"
SECRETS = (VIEW, CONTROL, NEAR_TOKEN)  # also an almost correct one: a mistyped token reveals most of the right one


PROXIED = {"x-forwarded-for": "203.0.113.5"}  # requests through a proxy need a token


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    folder = tmp_path_factory.mktemp("folder")
    config = folder / "imuscope.toml"
    config.write_text(f'view_token = "{VIEW}"\ncontrol_token = "{CONTROL}"\nlog_level = "debug"\nfoxglove = 0\n')
    arguments = ("--config", str(config), "--record")
    with ServerProcess("sim:xbus?rate=10", data=folder / "data", arguments=arguments, fresh=True) as server:
        yield server


def test_a_token_is_in_nothing_that_is_printed_or_written(guarded: ServerProcess) -> None:
    answers = use(guarded.url)
    titles = processes(guarded.process.pid)
    guarded.stop()
    messages = [f"{answer.status_code} {answer.headers} {answer.text}" for answer in answers]
    assert any("429" in one for one in messages)
    assert any("view-only" in one for one in messages)
    assert "This token is not valid." in guarded.log
    everything = {"printed": guarded.log, "process titles": titles}
    everything |= {f"answer {n}": one for n, one in enumerate(messages)}
    for path in guarded.data.rglob("*"):
        if path.is_file():
            everything[str(path)] = path.read_bytes().decode("latin-1")
    assert len(everything) > len(messages) + 2  # something was written
    results = {where: secret for where, text in everything.items() for secret in SECRETS if secret in text}
    # The cookie is the only place: it is set once, for a client that has presented the token.
    assert {where: everything[where][:2000] for where in results if "set-cookie" not in everything[where]} == {}
    assert len(results) == 2
    assert "Traceback" not in guarded.log


def use(url: str) -> list[httpx.Response]:
    """Hit a server with tokens, rightly and wrongly, in every way there is."""
    answers = []
    with http_client(base_url=url, headers=PROXIED) as client:
        for token in (VIEW, CONTROL, NEAR_TOKEN):
            bearer = {"authorization": f"Bearer {token}"}
            answers += [
                client.get("/", params={"token": token, "keep": "1"}),
                client.get("/api/build", params={"token": token}),
                client.get("/api/build", headers=bearer),
                client.get("/openapi.json", headers=bearer),
                client.get("/metrics", headers=bearer),
                client.get("/api/nothing", params={"token": token}),
                client.get("/api/recordings/nothing", params={"token": token}),
                client.delete("/api/devices/none", params={"token": token}),
                client.put("/api/recordings/upload", params={"token": token, "name": "x"}, content=b"x"),
                client.post("/api/devices", headers={**bearer, "origin": "http://x.example"}, json={}),
                client.post("/api/devices", headers=bearer, json={"source": "nonsense://x"}),
                client.get("/api/build", headers={"authorization": f"Basic {token}"}),
            ]
            client.cookies.clear()
        answers += [client.get("/api/build", params={"token": NEAR_TOKEN}) for _ in range(12)]
    answers = [one for one in answers if not urlsplit(str(one.url)).path.endswith(SECRETS)]  # it names the request
    asyncio.run(_sockets(url.replace("http", "ws")))
    with (
        contextlib.suppress(OSError),
        socket.create_connection((urlsplit(url).hostname, urlsplit(url).port), 10) as raw,
    ):
        raw.sendall(
            f"GET /?token={VIEW} HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {CONTROL}\r\nbroken\r\n\r\n".encode()
        )
        raw.recv(100)
    return answers


async def _sockets(url: str) -> None:
    for path in ("/ws", "/viser/none", "/foxglove", "/ws/scene/none", "/nothing"):
        for token in SECRETS:
            with contextlib.suppress(InvalidStatus):
                async with connecting(
                    f"{url}{path}?token={token}", additional_headers=PROXIED, subprotocols=["imuscope.v1"]
                ) as one:  # type: ignore[list-item]
                    await one.send(f'{{"op": "{token}"}}')
                    await one.recv()


def processes(parent: int) -> str:
    """Command lines and environments of a server's processes, as every user or this one can see them."""
    results = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            if parent in (int(stat.parent.name), int(stat.read_text().rpartition(")")[2].split()[1])):
                results += [
                    (stat.parent / name).read_bytes().decode("latin-1") for name in ("cmdline", "environ", "comm")
                ]
    return "\0".join(results)
