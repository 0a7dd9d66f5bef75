"""A whole server over TLS: page, API, viewers."""

import asyncio
import hashlib
import json
import ssl
from pathlib import Path
from typing import Any

import httpx
import pytest
import viser

from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S, connecting, http_client
from tests.support.waiting import block_until


def test_everything_is_served_over_tls(tmp_path: Path) -> None:
    config = tmp_path / "imuscope.toml"
    config.write_text('control_token = "control-token-of-this-test"\n')
    arguments = ("--tls", "--foxglove", "0", "--config", str(config))
    with ServerProcess("sim:isb?rate=20", data=tmp_path / "data", arguments=arguments) as server:
        assert server.trust is not None
        assert server.url.startswith("https://127.0.0.1:")
        certificate = (tmp_path / "data" / "tls" / "certificate.pem").read_text()
        fingerprint = hashlib.sha256(ssl.PEM_cert_to_DER_cert(certificate)).digest().hex(":").upper()
        assert f"SHA-256 of the certificate: {fingerprint}\n" in server.log
        with http_client(base_url=server.url, verify=server.trust) as client:
            assert client.get("/").status_code == 200
            assert client.get("/api/build").json()["role"] == "control"
            let_in = client.get("/", params={"token": "control-token-of-this-test"})
            assert let_in.status_code == 303
            cookie = {part.strip() for part in let_in.headers["set-cookie"].split(";")}
            assert {"Secure", "HttpOnly", "SameSite=Strict"} <= cookie
            # a busy machine takes its time to start it
            block_until(lambda: client.get("/viser/").status_code == 200, lambda: client.get("/viser/").text)
            assert client.get("/rerun/").status_code == 200
        with pytest.raises(httpx.ConnectError):
            httpx.get(server.url, timeout=PATIENCE_S)  # a client that trusts public authorities only
        with pytest.raises(httpx.HTTPError):
            httpx.get(server.url.replace("https", "http"), timeout=PATIENCE_S)
        asyncio.run(_talk(server))


async def _talk(server: ServerProcess) -> None:
    """Every WebSocket, as a page under https would open it."""
    base, trust = server.url.replace("https", "wss"), server.trust

    async def first(path: str, *subprotocols: Any) -> str | bytes:
        async with connecting(
            base + path,
            ssl=trust,
            subprotocols=subprotocols or None,
            origin=server.url,
            max_size=None,  # type: ignore[arg-type]
        ) as socket:
            return await socket.recv()

    async with asyncio.timeout(PATIENCE_S):
        message = await asyncio.gather(
            first("/ws", "imuscope.v1"),
            first("/viser", f"viser-v{viser.__version__}"),
            first("/rerun/live"),
            first("/foxglove", "foxglove.sdk.v1"),
        )
    assert json.loads(message[0])["op"] == "hello"
    assert all(message[1:3])
    assert json.loads(message[3])["op"] == "serverInfo"
