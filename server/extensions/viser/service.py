"""Lifecycle of the viser process: started by the first viewer, stopped some time after the last, restarted on a crash.

    /viser/          a scene of all devices, side by side        key ""
    /viser/ID/       a scene of one device                       key: the device's id
    /viser/replay-…/ a scene of a recording that a page plays    key: given by `begin`, gone with `end`

viser runs in a subprocess (server/extensions/viser/worker.py), fed by server/integrations/viewer_process.py, and is
reached through server/integrations/proxy.py. Its page opens a WebSocket at its own address without the last slash.

    not started ──a page or a WebSocket──> starting ──port reported──> running ──no viewers for idle_s──> stopped
                                              ^                           │ crash: reported as an event
                                              └──────next WebSocket───────┘ (viser's page reconnects by itself)

A viser that crashes repeatedly is not started more than `MAX_STARTS` times in `STARTS_WITHIN_S`.
"""

import asyncio
import secrets
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from imuscope.server.errors import DomainError
from imuscope.server.extensions.viser.playout_buffer import MESSAGES_PER_S
from imuscope.server.extensions.viser.replay_sync import ReplayFollower
from imuscope.server.integrations.shared_secret import SecretEndpoint, new_secret
from imuscope.server.integrations.viewer_process import ViewerProcess, ViewError
from imuscope.server.services.parts import ServicePart
from imuscope.server.services.services import Services
from imuscope.server.streaming.telemetry import Telemetry

MODULE = "imuscope.server.extensions.viser.worker"
START_S = 60.0
MAX_STARTS, STARTS_WITHIN_S = 5, 60.0
MAX_SCENES = 16


@dataclass(slots=True)
class SceneState:
    """One scene: its port and the number of its viewers."""

    port: asyncio.Future[int] = field(default_factory=lambda: asyncio.get_running_loop().create_future())
    viewers: int = 0
    idle: asyncio.TimerHandle | None = None


class Viser:
    """The scenes of a server. To be used in its event loop.

    Args:
        idle_s: how long a scene without viewers is kept.
    """

    def __init__(self, telemetry: Telemetry, idle_s: float) -> None:
        self._bus, self._clients = telemetry.bus, telemetry.clients
        self._idle_s = idle_s
        self._process: ViewerProcess | None = None
        self._secret = new_secret()
        self._scenes: dict[str, SceneState] = {}
        self._replays: dict[str, ReplayFollower] = {}
        self._starts: deque[float] = deque(maxlen=MAX_STARTS)
        self._starting = asyncio.Lock()
        self._tasks: set[asyncio.Task[None]] = set()

    @property
    def pid(self) -> int | None:
        """Process ID of viser; None while it is not running."""
        return None if self._process is None else self._process.pid

    async def endpoint(self, key: str) -> SecretEndpoint:
        """Address of the scene of this key; starts it if necessary.

        Raises:
            DomainError: unknown device.
            ViewError: viser does not start, or too many scenes are open.
        """
        if key and key not in self._bus.devices.latest and key not in self._replays:
            raise DomainError("not-found", f"Device {key:.40} not found.", "Open /viser/ to show all devices.")
        async with self._starting:
            if self._process is None:
                await self._start()
            scene = self._scenes.get(key)
            if scene is None:
                if len(self._scenes) >= MAX_SCENES:
                    raise ViewError(f"The maximum of {MAX_SCENES} scenes is open.", "Close one of their pages.")
                scene = self._scenes[key] = SceneState()
                assert self._process is not None
                self._process.send(op="open", key=key, secret=self._secret, **self._about(key))
                self._leave_later(key, START_S + self._idle_s)  # shorter once its port is known
        try:
            async with asyncio.timeout(START_S):
                return SecretEndpoint(await asyncio.shield(scene.port), self._secret)
        except TimeoutError:
            raise ViewError(f"viser did not start within {START_S:g} s.", "See the server's log.") from None

    def add_viewer(self, key: str) -> Callable[[], None]:
        """Count a new viewer of a scene; call the result when it disconnects."""
        scene = self._scenes.get(key)
        if scene is None:
            return lambda: None
        scene.viewers += 1
        if scene.idle is not None:
            scene.idle.cancel()
            scene.idle = None
        return lambda: self._remove_viewer(key, scene)

    def _remove_viewer(self, key: str, scene: SceneState) -> None:
        """Remove a viewer of a scene. After a crash there may be a new scene of this key, with viewers of its own."""
        if self._scenes.get(key) is scene and scene.viewers:
            scene.viewers -= 1
            if scene.viewers == 0:
                self._leave_later(key, self._idle_s)

    def begin(self, replayed: ReplayFollower) -> str:
        """Register a scene of a recording; returns its key. To be ended with `end`."""
        key = f"replay-{secrets.token_hex(8)}"
        self._replays[key] = replayed
        return key

    def show(self, key: str) -> None:
        """Move the scene of a recording to the playhead, at most 60 times a second."""
        scene, replayed = self._scenes.get(key), self._replays[key]
        if self._process is not None and scene is not None and scene.viewers:
            changes = replayed.changes()
            if changes is not None:
                self._process.send(op="rows", key=key, **changes)

    async def end(self, key: str) -> None:
        """Remove the scene of a recording."""
        self._replays.pop(key, None)
        scene = self._scenes.get(key)
        if scene is not None:
            if scene.idle is not None:
                scene.idle.cancel()
            scene.viewers = 0
            await self._stop_idle(key, scene)

    async def close(self) -> None:
        """Stop viser if it is running."""
        async with self._starting:
            await self._stop("The server is closing.")
        for task in self._tasks:
            task.cancel()

    def _about(self, key: str) -> dict[str, Any]:
        """Initial state of a scene."""
        replayed = self._replays.get(key)
        if replayed is not None:
            replayed.restart()
            return {"title": "Recording", "devices": replayed.devices, "channels": replayed.channels}
        device = self._bus.devices.latest.get(key)
        return {"title": device.name if device else "imuscope"}

    async def _start(self) -> None:
        now = time.monotonic()
        if len(self._starts) == MAX_STARTS and now - self._starts[0] < STARTS_WITHIN_S:
            raise ViewError("viser crashed several times.", "Try again in a minute; see the events for the reason.")
        self._starts.append(now)
        self._process = ViewerProcess(self._clients, MODULE, self._on_report, self._crashed, MESSAGES_PER_S)
        try:
            await self._process.start()
        except OSError as error:
            self._process = None
            raise ViewError(
                f"The 3D scene cannot be started: {error.strerror or error}.", "Try again in a moment."
            ) from None

    async def _stop(self, why: str) -> None:
        self._forget(why)
        process, self._process = self._process, None
        if process is not None:
            await process.stop()

    def _forget(self, why: str) -> None:
        scenes, self._scenes = self._scenes, {}
        for scene in scenes.values():
            if scene.idle is not None:
                scene.idle.cancel()
            if not scene.port.done():
                scene.port.set_exception(ViewError(why, "Reload in a moment."))
                scene.port.exception()  # marks it as retrieved, in case there is no waiter

    def _on_report(self, words: Mapping[str, Any]) -> None:
        scene = self._scenes.get(str(words.get("key")))
        if words["op"] == "scene" and scene is not None and not scene.port.done():
            scene.port.set_result(int(words["port"]))
            if not scene.viewers:
                self._leave_later(str(words["key"]), self._idle_s)

    def _crashed(self, words: str) -> None:
        text = "The 3D scene (viser) crashed; it restarts when it is opened."
        self._bus.event("", "device", "warning", text, data={"said": words[-500:]})
        self._run(self._after_crash(self._process))

    async def _after_crash(self, process: ViewerProcess | None) -> None:
        async with self._starting:
            if process is not None and self._process is process:
                await self._stop("viser crashed.")

    def _leave_later(self, key: str, idle_s: float) -> None:
        loop = asyncio.get_running_loop()
        scene = self._scenes[key]
        if scene.idle is not None:
            scene.idle.cancel()
        scene.idle = loop.call_later(idle_s, lambda: self._run(self._stop_idle(key, scene)))

    async def _stop_idle(self, key: str, scene: SceneState) -> None:
        async with self._starting:
            if self._scenes.get(key) is not scene or scene.viewers or self._process is None:
                return
            if len(self._scenes) == 1:
                await self._stop("The scene has no viewers.")
                return
            del self._scenes[key]
            self._process.send(op="close", key=key)

    def _run(self, work: Any) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


def parts(services: Services) -> Iterator[ServicePart]:
    service = Viser(services.telemetry, services.timings.scene_idle_s)
    yield ServicePart("viser", service, service.close)
