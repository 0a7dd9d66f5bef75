"""Viewers of 3D scenes, counted, with a process that only says that it serves each scene."""

import asyncio
from collections.abc import Callable, Mapping
from typing import Any

import pytest

from imuscope.server.extensions.viser import service
from imuscope.server.extensions.viser.service import Viser
from imuscope.server.streaming.telemetry import Telemetry
from tests.support.waiting import until


class ServingProcess:
    """A process that serves every scene at once, and may crash."""

    def __init__(
        self,
        clients: object,
        module: str,
        on_message: Callable[[Mapping[str, Any]], None],
        on_crash: Callable[[str], None],
        per_s: float,
    ) -> None:
        self._on_message = on_message
        self.crash = on_crash
        self.pid = 1

    async def start(self) -> None: ...

    async def stop(self) -> None: ...

    def send(self, *, op: str, key: str, **words: Any) -> None:
        if op == "open":
            self._on_message({"op": "scene", "key": key, "port": 8080})


async def test_a_viewer_of_a_scene_that_crashed_is_none_of_the_next_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that was late to leave ended the new scene for the one that was back already."""
    made: list[ServingProcess] = []

    def process(*arguments: Any) -> ServingProcess:
        made.append(ServingProcess(*arguments))
        return made[-1]

    monkeypatch.setattr(service, "ViewerProcess", process)
    viser = Viser(Telemetry.create(lambda: 0.0), idle_s=0.0)
    await viser.endpoint("")
    leave = viser.add_viewer("")
    made[0].crash("it crashed")
    await until(lambda: viser.pid is None, "the crash is noticed")
    await viser.endpoint("")
    leave_again = viser.add_viewer("")
    leave()
    for _ in range(10):  # a scene without viewers would end
        await asyncio.sleep(0)
    assert (viser.pid, len(made)) == (1, 2)
    leave_again()
    await until(lambda: viser.pid is None, "it ends with its last viewer")
    await viser.close()
