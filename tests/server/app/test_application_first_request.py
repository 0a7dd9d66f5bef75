"""The routes are imported at the first request: a robot without viewers has neither them nor what they need."""

from __future__ import annotations

import asyncio
from pathlib import Path

import httpx
import pytest
from fastapi import FastAPI

from imuscope.server.access.auth import Access
from imuscope.server.api import framework
from imuscope.server.app.application import Application
from imuscope.server.app.build import create_app
from imuscope.server.reference.pages import ReferencePages
from imuscope.server.services.extension import extensions
from imuscope.server.services.services import Services
from imuscope.server.settings.config import Config
from tests.support.asgi_client import send_request
from tests.support.fakes import FakeLink
from tests.support.in_process_server import InProcessServer
from tests.support.problems import assert_problem
from tests.support.server_process import ServerProcess
from tests.support.timeouts import http_client

OF_ROUTES = "_pydantic_core"  # library of the framework's models


def test_a_robot_without_viewers_has_no_routes(tmp_path: Path) -> None:
    with ServerProcess("sim:xbus?rate=10", data=tmp_path, fresh=True) as server, http_client() as client:
        maps = Path(f"/proc/{server.process.pid}/maps")
        for _ in range(2):
            assert client.get(f"{server.url}/healthz").json()["status"] == "ok"
            assert "\nimuscope_clients 0\n" in client.get(f"{server.url}/metrics").text
        assert OF_ROUTES not in maps.read_text()
        assert client.get(f"{server.url}/").status_code == 200
        assert OF_ROUTES in maps.read_text()


def test_pages_for_monitoring_are_the_same_with_and_without_routes() -> None:
    with InProcessServer(Config(sources=("/dev/one",)), FakeLink) as running:

        def answers() -> list[object]:
            health, metrics = (running.client.get(path) for path in ("/healthz", "/metrics"))
            families = [line for line in metrics.text.splitlines() if line.startswith("# ")]
            return [health.json(), health.headers["content-type"], metrics.headers["content-type"], families]

        before = answers()
        assert running.client.get("/api/capabilities").status_code == 200
        alarms = {line for line in answers()[-1] if "alarm" in line}  # type: ignore[attr-defined]
        after = answers()
        after[-1] = [line for line in after[-1] if line not in alarms]  # type: ignore[attr-defined]
        assert before == after


def test_a_watcher_is_answered_before_there_are_routes() -> None:
    """The first answer took seconds on a slow machine, though the socket accepted: a watcher called the server dead."""
    config = Config(sources=("/dev/one", "sim:idtp"))
    with InProcessServer(config, FakeLink) as running:
        before = running.client.get("/api/devices")
        assert running._app.app._routes is None
        assert running.client.get("/api/capabilities").status_code == 200
        after = running.client.get("/api/devices")
        assert running._app.app._routes is not None
        assert [one.keys() for one in before.json()] == [one.keys() for one in after.json()]
        assert [one["source"] for one in after.json()] == ["/dev/one", "sim:idtp"]
        assert before.headers["content-type"] == after.headers["content-type"]


def test_requests_at_once_build_the_routes_once(monkeypatch: pytest.MonkeyPatch) -> None:
    built = []

    def build(services: Services) -> FastAPI:
        built.append(services)
        return original(services)

    original = framework.build_framework
    monkeypatch.setattr(framework, "build_framework", build)
    with InProcessServer(Config(sources=("/dev/one",)), FakeLink) as running:

        async def all_at_once() -> list[int]:
            async with httpx.AsyncClient(base_url=running.url) as client:
                return [one.status_code for one in await asyncio.gather(*(client.get("/api/build") for _ in range(8)))]

        assert asyncio.run(all_at_once()) == [200] * 8
    assert len(built) == 1


def test_routes_that_cannot_be_built_leave_the_devices_alone(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def build(services: Services) -> FastAPI:
        raise ImportError("no such module")

    monkeypatch.setattr(framework, "build_framework", build)
    with InProcessServer(Config(sources=("/dev/one",)), FakeLink) as running:
        for _ in range(2):
            assert_problem(running.client.get("/api/capabilities"), 500, "fault")
        assert running.client.get("/healthz").json()["devices"] == 1
        assert len(running.services.sessions.all) == 1
    assert sum(one.exc_info is not None for one in caplog.records) == 1


def test_a_failing_route_is_logged_once(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    """Regression: the same traceback came from us and from uvicorn."""
    with InProcessServer(Config(sources=("/dev/one",)), FakeLink) as running:
        monkeypatch.setattr(ReferencePages, "html", lambda *_: 1 / 0)
        assert_problem(running.client.get("/docs/websocket"), 500, "fault")
    assert [one.getMessage() for one in caplog.records if one.exc_info] == ["GET /docs/websocket failed"]


def test_objects_for_requests_are_made_at_the_first(tmp_path: Path) -> None:
    guarded = create_app(Config(data=tmp_path), Access(Config()))
    application = guarded.app  # type: ignore[attr-defined]
    assert isinstance(application, Application)
    before = {part.name for part in application.services.parts}
    assert send_request(guarded, "GET", "/api/build", client="127.0.0.1").status == 200
    made = {part.name for part in application.services.parts} - before
    assert made or not any(one.page_parts for one in extensions())
