"""viser behind the server's port: lifetime, forwarding, access control. The real viser, in its own process."""

import asyncio
import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from websockets.exceptions import ConnectionClosedError, InvalidStatus

from imuscope.server.extensions.viser.service import MODULE, Viser
from imuscope.server.services.services import ViewerTimings
from imuscope.server.settings.config import Config
from tests.server.extensions.viser.viser_client import subprotocol, turns, viewing
from tests.support.fakes import FakeLink
from tests.support.forking.forked_workers import workers_of
from tests.support.in_process_server import InProcessServer
from tests.support.server_process import ROOT, ServerProcess
from tests.support.timeouts import PATIENCE_S, connecting, get, http_client
from tests.support.waiting import block_until


@pytest.fixture(scope="module")
def shown(server: ServerProcess) -> Iterator[httpx.Client]:
    with http_client(base_url=server.url, timeout=PATIENCE_S) as client:
        yield client


async def turned(url: str, *, expected: int) -> list[list[float]]:
    """So many orientations of the body, as a viewer gets them."""
    results: list[list[float]] = []
    async with asyncio.timeout(PATIENCE_S), viewing(url) as socket:
        while len(results) < expected:
            results += turns(await socket.recv())
    return results


def test_its_page_comes_through_with_a_policy_of_its_own(shown: httpx.Client) -> None:
    answer = shown.get("/viser/")
    assert answer.status_code == 200
    assert "<title>Viser</title>" in answer.text
    policy = dict(part.split(" ", 1) for part in answer.headers["content-security-policy"].split("; "))
    assert policy["connect-src"] == "'self' data: blob:"
    assert "'unsafe-eval'" not in policy["script-src"]
    assert "wasm-unsafe-eval" not in shown.get("/").headers["content-security-policy"]
    assert "unsafe-inline" not in shown.get("/").headers["content-security-policy"]
    assert shown.get("/viser", follow_redirects=False).headers["location"] == "viser/"


def test_a_scene_is_begun_by_name_and_an_unknown_one_refused(shown: httpx.Client) -> None:
    [device] = shown.get("/api/devices").json()
    assert shown.get("/api/views/scene", params={"device": device["id"]}).json() == {
        "address": f"/viser/{device['id']}/"
    }
    for refused in (shown.get("/viser/nobody/"), shown.get("/api/views/scene", params={"device": "nobody"})):
        assert (refused.status_code, refused.json()["kind"]) == (404, "not-found")
        assert "nobody" in refused.json()["message"]
        assert refused.json()["hint"]


def test_the_body_turns_as_the_device_does(shown: httpx.Client, server: ServerProcess) -> None:
    results = asyncio.run(turned(server.url, expected=30))
    for q in results:
        assert sum(part * part for part in q) == pytest.approx(1, abs=1e-3)
    assert results[0] != results[-1]


def test_a_foreign_page_and_a_foreign_name_are_refused(shown: httpx.Client, server: ServerProcess) -> None:
    async def attempt(headers: dict[str, str]) -> int:
        try:
            address = server.url.replace("http", "ws") + "/viser"
            async with connecting(address, subprotocols=[subprotocol()], additional_headers=headers):
                return 101
        except InvalidStatus as error:
            return error.response.status_code

    assert asyncio.run(attempt({"Origin": "https://elsewhere.example"})) == 403
    assert asyncio.run(attempt({"Origin": server.url})) == 101
    assert shown.get("/viser/", headers={"Host": "rebound.example"}).status_code == 403
    assert shown.get("/viser/", headers={"X-Forwarded-For": "1.2.3.4"}).status_code == 401


def test_foreign_messages_do_not_reach_it(server: ServerProcess) -> None:
    """Regression: viser ended the connection, which was reported as the end of viser."""

    async def turns_after(*message: str | bytes) -> int:
        async with asyncio.timeout(PATIENCE_S), viewing(server.url) as socket:
            for one in message:
                await socket.send(one)
            while not turns(await socket.recv()):
                pass
            for _ in range(20):
                await socket.recv()
            return 20

    assert asyncio.run(turns_after("7", b"\x07", b"\xa9\x1fR5", b"\xff" * 40)) == 20


def test_a_message_that_is_too_large_ends_the_connection(server: ServerProcess) -> None:
    async def attempt() -> int | None:
        address = server.url.replace("http", "ws") + "/viser"
        async with (
            asyncio.timeout(PATIENCE_S),
            connecting(address, subprotocols=[subprotocol()], max_size=None) as socket,
        ):
            with contextlib.suppress(ConnectionClosedError, ConnectionResetError):
                await socket.send(bytes(2 * 1024 * 1024))
                async for _ in socket:
                    pass
            return socket.close_code

    # 1009 gives the reason; a reset overtakes it if the server closes before reading everything.
    assert asyncio.run(attempt()) in (1009, 1006)
    assert get(f"{server.url}/healthz").status_code == 200


def test_viser_recovers_from_a_crash_and_reports_it(shown: httpx.Client, server: ServerProcess) -> None:
    shown.get("/viser/")
    pid = viser_of(server.process.pid)[0]
    os.kill(pid, signal.SIGKILL)

    def turned_again() -> object:  # viser's page tries again by itself, too
        try:
            return asyncio.run(turned(server.url, expected=3))
        except InvalidStatus as refused:
            if refused.response.status_code != 503:
                raise
            return None

    block_until(turned_again, "it turns again")
    assert viser_of(server.process.pid)[0] != pid
    assert any("crashed" in text for text in asyncio.run(events(server.url)))


def viser_of(server: int) -> list[int]:
    return workers_of(server, MODULE)


async def events(url: str) -> list[str]:
    import json

    async with (
        asyncio.timeout(PATIENCE_S),
        connecting(url.replace("http", "ws") + "/ws", subprotocols=["imuscope.v1"]) as socket,
    ):
        while True:
            message = json.loads(await socket.recv())
            if message["op"] == "events":
                return [event["text"] for event in message["events"]]


def test_it_runs_only_while_a_client_views_it(tmp_path: Path) -> None:
    async def visit(url: str) -> None:
        async with viewing(url):
            pass

    config = Config(sources=("/dev/one",), data=tmp_path)
    with InProcessServer(config, FakeLink, timings=ViewerTimings(scene_idle_s=PATIENCE_S)) as running:
        assert viser_of(os.getpid()) == []
        assert get(running.url + "/viser/").status_code == 200
        [pid] = viser_of(os.getpid())
        running.services.parts.get(Viser)._idle_s = 0.01  # from here on, so that it is still there when it is counted
        asyncio.run(visit(running.url))
        block_until(lambda: not viser_of(os.getpid()), "it has ended")
        running.services.parts.get(Viser)._idle_s = PATIENCE_S
        assert get(running.url + "/viser/").status_code == 200
        [again] = viser_of(os.getpid())
        assert again != pid


def test_viser_ends_with_the_server_however_that_ends(tmp_path: Path) -> None:
    with ServerProcess("sim:xbus?rate=10", data=tmp_path, fresh=True) as server:  # it starts its processes itself
        assert viser_of(server.process.pid) == []
        assert get(server.url + "/viser/", timeout=PATIENCE_S).status_code == 200
        [pid] = viser_of(server.process.pid)
        server.process.kill()
        block_until(lambda: not Path(f"/proc/{pid}").exists(), "it is gone, too")


def test_nothing_heavy_is_imported_before_it_is_used() -> None:
    """The start would take seconds longer: what draws, hands on or reads tables is imported by who does that."""
    code = (
        "import sys; import imuscope.server.cli; import imuscope.server.extensions.fleet.robot.publisher; "
        "from imuscope.server.app.build import create_app; "
        "from imuscope.server.devices.decode.protocol_set import problems; "
        "from imuscope.server.access.auth import Access; from imuscope.server.settings.config import load; "
        "from imuscope.server.services.extension import extension_problems; "
        "config = load(foxglove=0, rerun_connect='rerun+http://127.0.0.1:9/proxy'); "
        "create_app(config, Access(config)); problems(), extension_problems(); print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    modules = set(done.stdout.split())
    imported = modules | {name.partition(".")[0] for name in modules}
    assert "numpy" in imported, done.stderr
    heavy = {"viser", "foxglove", "rerun", "rerun_bindings", "pyarrow", "trimesh", "scipy", "pandas", "PIL"}
    heavy |= {"rosbags", "zenoh", "xxhash"}  # ROS 2, and the bus of a fleet
    heavy |= {"numpy.ma", "numpy.random", "imuscope.recordings.readers.formats.flight_log"}
    heavy |= {"imuscope.server.extensions.analysis.methods.allan"}
    assert not imported & heavy
