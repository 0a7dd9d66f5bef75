"""The ports of viewers' processes, which are on loopback: no page of strangers and no other user of this machine comes
through them past our rules; and what who may only look can do to a scene that all share.
"""

import asyncio
import json
import re
import socket
from collections.abc import Iterator
from http import HTTPStatus
from pathlib import Path
from typing import Any

import msgspec
import pytest
from websockets.datastructures import Headers
from websockets.exceptions import InvalidStatus
from websockets.http11 import Request, Response

from imuscope.server.access.auth import Access
from imuscope.server.extensions.foxglove.worker import ConnectionGuard
from imuscope.server.integrations.shared_secret import HEADER, SecretEndpoint, has_secret
from imuscope.server.settings.config import Config
from tests.server.extensions.viser.viser_client import messages, subprotocol, viewing
from tests.support.each_row import each_row
from tests.support.forking.forked_workers import workers_of
from tests.support.server_process import ServerProcess
from tests.support.timeouts import PATIENCE_S, connecting, get

pytestmark = pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="asks Linux who listens")
FOXGLOVE = "foxglove.sdk.v1"


def ports_of(parent: int) -> dict[str, int]:
    """Ports of the viewer processes of a server: {"viser": port, "foxglove": port}."""
    inodes: dict[str, int] = {}
    for line in Path("/proc/net/tcp").read_text().splitlines()[1:]:
        fields = line.split()
        if fields[3] == "0A":  # LISTEN
            inodes[f"socket:[{fields[9]}]"] = int(fields[1].partition(":")[2], 16)
    results = {}
    for name in ("viser", "foxglove"):
        for pid in workers_of(parent, f"imuscope.server.extensions.{name}.worker"):
            held = [path.readlink().name for path in Path(f"/proc/{pid}/fd").iterdir()]
            results.update((name, inodes[inode]) for inode in held if inode in inodes)
    return results


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    """A server that needs tokens, with all its views."""
    data = tmp_path_factory.mktemp("data")
    with ServerProcess("sim:isb?rate=20", data=data, arguments=("--host", "0.0.0.0", "--foxglove", "0")) as server:
        yield server


@pytest.fixture(scope="module")
def tokens(guarded: ServerProcess) -> dict[str, str]:
    view, control = re.findall(r"token=(\S+)", guarded.log)[:2]
    return {"view": view, "control": control}


@pytest.fixture(scope="module")
def ports(guarded: ServerProcess, tokens: dict[str, str]) -> dict[str, int]:
    """Ports of viser and Foxglove, once both listen."""
    request = get(f"{guarded.url}/viser/", params={"token": tokens["view"]}, timeout=PATIENCE_S)
    assert request.status_code == 200
    asyncio.run(_status(guarded.url.replace("http", "ws") + f"/foxglove?token={tokens['view']}", FOXGLOVE))
    return ports_of(guarded.process.pid)


async def _status(address: str, *subprotocols: Any, **options: Any) -> int:
    try:
        async with asyncio.timeout(PATIENCE_S), connecting(address, subprotocols=subprotocols or None, **options):
            return 101
    except InvalidStatus as refused:
        return refused.response.status_code


def test_viser_is_reachable_only_through_us(
    ports: dict[str, int], guarded: ServerProcess, tokens: dict[str, str]
) -> None:
    here = f"127.0.0.1:{ports['viser']}"
    for headers in ({}, {HEADER: "guess"}, {HEADER: ""}):
        for path in ("/", "/index.html", "/assets/x.js"):
            assert get(f"http://{here}{path}", headers=headers).status_code == 403
        assert asyncio.run(_status(f"ws://{here}", subprotocol(), additional_headers=headers)) == 403
    assert asyncio.run(_status(f"ws://{here}", subprotocol(), origin="https://elsewhere.example")) == 403
    ours = guarded.url.replace("http", "ws") + "/viser?token="
    assert asyncio.run(_status(ours + tokens["view"], subprotocol())) == 101
    assert asyncio.run(_status(ours + "wrong", subprotocol())) == 401


def test_the_foxglove_port_has_the_rules_of_the_main_port(ports: dict[str, int], tokens: dict[str, str]) -> None:
    here = f"ws://127.0.0.1:{ports['foxglove']}"

    def status(path: str = f"/?token={tokens['view']}", **headers: str) -> int:
        return asyncio.run(_status(here + path, FOXGLOVE, additional_headers=headers))

    assert status("/") == 401
    assert status("/?token=wrong") == 401
    assert status("/", **{HEADER: "guess"}) == 401
    assert status() == 101
    assert status("/", Authorization=f"Bearer {tokens['control']}") == 101
    assert status(Origin="https://elsewhere.example") == 403
    assert status(Origin="null") == 403  # a page in a sandbox
    assert (
        status(Origin="file://") == 101
    )  # a program of this machine: Foxglove's and Lichtblick's are pages of Electron
    refused = get(here.replace("ws:", "http:") + "/", headers={"host": "rebound.example"})
    assert refused.status_code == 403
    assert refused.json()["kind"] == "bad-host"


class FakeConnection:
    """The part of a connection's interface that is used."""

    remote_address = ("127.0.0.1", 5)

    def respond(self, status: HTTPStatus, text: str) -> Response:
        return Response(status, "", Headers({"content-type": "text/plain"}), text.encode())


@each_row(
    ("headers", "status"),
    [
        ({}, None),
        ({"Origin": "file://"}, None),
        ({"Origin": "https://elsewhere.example"}, 403),
        ({"Origin": "http://localhost:3000"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": ""}, 403),
        ({"Origin": "https://fleet.example"}, None),
        ({"Host": "rebound.example"}, 403),
        ({"X-Forwarded-For": "203.0.113.5"}, 401),
        ({"Origin": "https://elsewhere.example", HEADER: "secret"}, None),
    ],
)
def test_without_tokens_other_origins_still_cannot_read(headers: dict[str, str], status: int | None) -> None:
    porter = ConnectionGuard("secret", Access(Config(allowed_origins=("https://fleet.example",))).rules())
    request = Request("/", Headers({"Host": "127.0.0.1:8765", **headers}))
    refused = porter.accept(FakeConnection(), request)  # type: ignore[arg-type]
    assert (refused and refused.status_code) == status
    if refused is not None:
        assert set(json.loads(refused.body)) == {"kind", "message", "hint"}
        assert refused.headers["content-type"] == "application/json"


def test_malformed_requests_to_viewers_are_refused(ports: dict[str, int]) -> None:
    for port in ports.values():
        with socket.create_connection(("127.0.0.1", port), 10) as plain:
            lines = ["GET / HTTP/1.1", "Host: localhost", "Host: localhost", f"{HEADER}: a", f"{HEADER}: b"]
            plain.sendall("\r\n".join([*lines, "", ""]).encode())
            assert plain.recv(1000).split()[1] in (b"400", b"403", b"500")
    door = SecretEndpoint(1, "secret")
    assert has_secret(door.headers, "secret")
    assert not has_secret({}, "secret")
    assert "secret" not in repr(door)


async def test_viewers_change_nothing_in_a_shared_scene(
    ports: dict[str, int], guarded: ServerProcess, tokens: dict[str, str]
) -> None:
    async def boxes(address: Any) -> dict[str, tuple[str, bool]]:
        """The check boxes of the panel as they stand: uuid and value by label."""
        labels: dict[str, str] = {}
        values: dict[str, bool] = {}
        while True:
            for one in messages(await address.recv()):
                if one["type"] == "GuiCheckboxMessage":
                    labels[one["props"]["label"]], values[one["uuid"]] = one["uuid"], one["value"]
                elif one["type"] == "GuiUpdateMessage" and "value" in one["updates"]:
                    values[one["uuid"]] = one["updates"]["value"]
                elif one["type"] == "ReplayDoneMessage":
                    return {label: (uuid, values[uuid]) for label, uuid in labels.items()}

    def update(uuid: str) -> bytes:
        return msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": False}})

    async with (
        asyncio.timeout(PATIENCE_S),
        viewing(guarded.url, f"/viser?token={tokens['view']}") as viewer,
        viewing(guarded.url, f"/viser?token={tokens['control']}") as controller,
    ):
        before = await boxes(viewer)
        assert all(value for _, value in before.values())
        await viewer.send(update(before["Follow"][0]))
        await controller.send(update(before["Reference frame"][0]))
        checked = {uuid for uuid, _ in before.values()}  # the scene itself changes others: its list of devices
        subjects: set[str] = set()
        while not subjects:  # the others are notified of a change
            updates = [one for one in messages(await viewer.recv()) if one["type"] == "GuiUpdateMessage"]
            subjects = {one["uuid"] for one in updates if one["uuid"] in checked}
        assert subjects == {before["Reference frame"][0]}
        async with viewing(guarded.url, f"/viser?token={tokens['view']}") as late:
            after = await boxes(late)
        assert {label for label, (_, value) in after.items() if not value} == {"Reference frame"}
