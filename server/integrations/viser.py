"""When does viser run? From the first look until a while after the last; again after it has fallen over.

    /viser/          a scene of all devices, side by side        key ""
    /viser/ID/       a scene of one device                       key: the device's id
    /viser/replay-…/ a scene of a recording that a page plays    key: given by `begin`, gone with `end`

viser runs in a process of its own (server/integrations/viser_worker.py), fed as server/integrations/viewer_process.py
says, and is reached through server/integrations/proxy.py. Its page opens a WebSocket at its own address without the
last slash.

    nobody looked yet ──a page or a WebSocket──> starting ──port told──> running ──nobody for IDLE_S──> stopped
                                                     ^                      │ it ended by itself: told as an event
                                                     └──next WebSocket──────┘ (viser's page tries again by itself)

A viser that falls over again and again is not started more than `MOST_STARTS` times in `STARTS_WITHIN_S`.
"""

from __future__ import annotations

import asyncio
import secrets
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from server.integrations.playout_buffer import MESSAGES_PER_S
from server.integrations.proxy import ViewError
from server.integrations.replay_sync import ReplayFollower
from server.integrations.shared_secret import SecretEndpoint, new_secret
from server.integrations.viewer_process import ViewerProcess
from server.streaming.hub import Hub

MODULE = "server.integrations.viser_worker"
IDLE_S = 15.0
START_S = 60.0
MOST_STARTS, STARTS_WITHIN_S = 5, 60.0
MOST_SCENES = 16


@dataclass(slots=True)
class SceneState:
    """One scene: where it is served, and who looks."""

    port: asyncio.Future[int] = field(default_factory=lambda: asyncio.get_running_loop().create_future())
    viewers: int = 0
    idle: asyncio.TimerHandle | None = None


class Viser:
    """The scenes of a server. To be used in its event loop.

    Args:
        idle_s: how long a scene stays when nobody looks.
    """

    def __init__(self, hub: Hub, idle_s: float = IDLE_S) -> None:
        self._hub = hub
        self._idle_s = idle_s
        self._aside: ViewerProcess | None = None
        self._secret = new_secret()
        self._scenes: dict[str, SceneState] = {}
        self._replays: dict[str, ReplayFollower] = {}
        self._starts: deque[float] = deque(maxlen=MOST_STARTS)
        self._starting = asyncio.Lock()
        self._tasks: set[asyncio.Task[None]] = set()

    @property
    def pid(self) -> int | None:
        """Of viser's process; None while it does not run."""
        return None if self._aside is None else self._aside.pid

    async def door(self, key: str) -> SecretEndpoint:
        """Where the scene of this key is served; begins it when it is not there.

        Raises:
            ViewError: there is no such device (404), viser does not start, or there are too many scenes.
        """
        if key and key not in self._hub.devices and key not in self._replays:
            raise ViewError(f"There is no device {key:.40} to show.", "Open /viser/ for all that there are.", 404)
        async with self._starting:
            if self._aside is None:
                await self._start()
            scene = self._scenes.get(key)
            if scene is None:
                if len(self._scenes) >= MOST_SCENES:
                    raise ViewError(f"There are {MOST_SCENES} scenes already.", "Close one of their pages.")
                scene = self._scenes[key] = SceneState()
                assert self._aside is not None
                self._aside.say(op="open", key=key, secret=self._secret, **self._about(key))
                self._leave_later(key)
        try:
            async with asyncio.timeout(START_S):
                return SecretEndpoint(await asyncio.shield(scene.port), self._secret)
        except TimeoutError:
            raise ViewError(f"viser did not start within {START_S:g} s.", "The server's log may say why.") from None

    def looked_at(self, key: str) -> None:
        """Someone looks at a scene; `left` when they do no more."""
        scene = self._scenes.get(key)
        if scene is not None:
            scene.viewers += 1
            if scene.idle is not None:
                scene.idle.cancel()
                scene.idle = None

    def left(self, key: str) -> None:
        """One looks no more. After a crash the scene may be another, which nobody looked at yet: that does no harm."""
        scene = self._scenes.get(key)
        if scene is not None and scene.viewers:
            scene.viewers -= 1
            if scene.viewers == 0:
                self._leave_later(key)

    def begin(self, replayed: ReplayFollower) -> str:
        """A scene of a recording; returns its key. To be ended with `end`."""
        key = f"replay-{secrets.token_hex(8)}"
        self._replays[key] = replayed
        return key

    def show(self, key: str) -> None:
        """Have a recording's scene show where it is read now; at most 60 times a second."""
        scene, replayed = self._scenes.get(key), self._replays[key]
        if self._aside is not None and scene is not None and scene.viewers:
            news = replayed.news()
            if news is not None:
                self._aside.say(op="rows", key=key, **news)

    async def end(self, key: str) -> None:
        """The recording is no longer played."""
        self._replays.pop(key, None)
        scene = self._scenes.get(key)
        if scene is not None:
            if scene.idle is not None:
                scene.idle.cancel()
            scene.viewers = 0
            await self._leave(key, scene)

    async def close(self) -> None:
        """End viser, if it runs."""
        async with self._starting:
            await self._stop("The server is closing.")
        for task in self._tasks:
            task.cancel()

    def _about(self, key: str) -> dict[str, Any]:
        """What a scene is begun with."""
        replayed = self._replays.get(key)
        if replayed is not None:
            replayed.begin_again()
            return {"title": "Recording", "devices": replayed.devices, "channels": replayed.channels}
        device = self._hub.devices.get(key)
        return {"title": device.name if device else "imuscope"}

    async def _start(self) -> None:
        now = time.monotonic()
        if len(self._starts) == MOST_STARTS and now - self._starts[0] < STARTS_WITHIN_S:
            raise ViewError("viser ended by itself several times.", "Try again in a minute; the events say why.")
        self._starts.append(now)
        self._aside = ViewerProcess(self._hub, MODULE, self._told, self._crashed, MESSAGES_PER_S)
        try:
            await self._aside.start()
        except OSError as error:
            self._aside = None
            raise ViewError(
                f"The 3D scene cannot be started: {error.strerror or error}.", "Try again in a moment."
            ) from None

    async def _stop(self, why: str) -> None:
        self._forget(why)
        aside, self._aside = self._aside, None
        if aside is not None:
            await aside.stop()

    def _forget(self, why: str) -> None:
        scenes, self._scenes = self._scenes, {}
        for scene in scenes.values():
            if scene.idle is not None:
                scene.idle.cancel()
            if not scene.port.done():
                scene.port.set_exception(ViewError(why, "Reload in a moment."))
                scene.port.exception()  # nobody may be waiting any more

    def _told(self, words: Mapping[str, Any]) -> None:
        scene = self._scenes.get(str(words.get("key")))
        if words["op"] == "scene" and scene is not None and not scene.port.done():
            scene.port.set_result(int(words["port"]))

    def _crashed(self, words: str) -> None:
        text = "The 3D scene (viser) ended by itself and starts again when it is looked at."
        self._hub.event("", "device", "caution", text, data={"said": words[-500:]})
        self._run(self._after_crash(self._aside))

    async def _after_crash(self, aside: ViewerProcess | None) -> None:
        async with self._starting:
            if aside is not None and self._aside is aside:
                await self._stop("viser ended by itself.")

    def _leave_later(self, key: str) -> None:
        loop = asyncio.get_running_loop()
        scene = self._scenes[key]
        scene.idle = loop.call_later(self._idle_s, lambda: self._run(self._leave(key, scene)))

    async def _leave(self, key: str, scene: SceneState) -> None:
        async with self._starting:
            if self._scenes.get(key) is not scene or scene.viewers or self._aside is None:
                return
            if len(self._scenes) == 1:
                await self._stop("Nobody looks.")
                return
            del self._scenes[key]
            self._aside.say(op="close", key=key)

    def _run(self, work: Any) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
