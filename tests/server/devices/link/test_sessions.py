"""Requests about one device that come at once."""

import asyncio
import threading
from typing import Any

import pytest

from imuscope.server.devices.link.session import Session
from imuscope.server.devices.link.sessions import Sessions
from imuscope.server.wire import DeviceInfo
from tests.support.in_process_server import InProcessServer
from tests.support.timeouts import PATIENCE_S


def test_of_two_requests_to_remove_a_device_the_second_does_not_find_it(
    running: InProcessServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was answered as an internal error."""
    both, find = threading.Barrier(2), Sessions.get

    def get(sessions: Sessions, device: str) -> Session:
        session = find(sessions, device)
        both.wait(PATIENCE_S)
        return session

    monkeypatch.setattr(Sessions, "get", get)
    answers: list[Any] = []
    threads = [
        threading.Thread(target=lambda: answers.append(running.client.delete("/api/devices/1"))) for _ in range(2)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(one.status_code for one in answers) == [204, 404]


def test_devices_are_listed_while_one_is_removed(running: InProcessServer, monkeypatch: pytest.MonkeyPatch) -> None:
    """The list is read in the thread of a request, which failed when it changed meanwhile."""
    own, sessions, removed = Session.infos, running.services.sessions, list[Session]()
    assert isinstance(own, property)

    def infos(session: Session) -> list[DeviceInfo]:
        if session.info.id == "1" and "2" in sessions._sessions:
            removed.append(running.call(sessions._sessions.pop, "2"))
        listed: list[DeviceInfo] = own.__get__(session)
        return listed

    monkeypatch.setattr(Session, "infos", property(infos))
    assert running.client.post("/api/devices/1/retry").status_code == 200
    assert removed
    assert running.loop is not None
    asyncio.run_coroutine_threadsafe(removed[0].close(), running.loop).result(PATIENCE_S)
