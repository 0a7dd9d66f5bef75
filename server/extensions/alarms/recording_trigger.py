"""Recordings that alarms start: from n seconds before the limit was crossed to m seconds after the condition has ended.

    AlarmInstance.raises ─> add ─┐
                                 ├─ turn, five times a second ─> Recorder.start(before_s=…), mark, stop
    AlarmInstance.holds ─────────┘

There is one recording at a time. An alarm that is raised while another recording runs adds a marker to it, and never
ends it; one that is raised while a recording of an alarm runs prolongs it. A recording that a user stops is over.
"""

import asyncio
import contextlib
import logging
import math
from collections import deque
from dataclasses import dataclass, field

from imuscope.recordings.errors import RecordingError
from imuscope.server.errors import DomainError
from imuscope.server.extensions.alarms.definitions import RecordingAction
from imuscope.server.extensions.alarms.instance import AlarmInstance
from imuscope.server.library.api_models import MarkerRequest
from imuscope.server.library.recorder import Recorder
from imuscope.server.library.recording_session import RecordingSession

log = logging.getLogger("imuscope.alarms")

TURN_S = 0.2
HOUR_S = 3600.0
MARK_EVERY_S = 10.0  # of one alarm of one device, in a recording that is running
LATE_S = 60.0  # a sample may be this much older than its arrival


@dataclass(slots=True)
class TriggeredRecording:
    """The recording that is running, and the alarms that it is for.

    Attributes:
        held: when a condition of its alarms held last, unix s.
    """

    session: RecordingSession
    by: AlarmInstance
    action: RecordingAction
    began: float
    held: float
    alarms: list[AlarmInstance]


@dataclass(slots=True)
class TriggerHistory:
    """Recordings and markers that one alarm has made.

    Attributes:
        starts: times of the recordings of the last hour.
        is_refused: the last one was one too many, which was reported.
        marked: time of the last marker of each device.
    """

    starts: deque[float] = field(default_factory=deque)
    is_refused: bool = False
    marked: dict[str, float] = field(default_factory=dict)


class RecordingTrigger:
    """Starts and ends the recordings of alarms."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self._raised: dict[tuple[str, str], tuple[AlarmInstance, float]] = {}
        self._histories: dict[str, TriggerHistory] = {}
        self._running: TriggeredRecording | None = None
        self._task: asyncio.Task[None] | None = None
        self._closing = asyncio.Event()
        self._has_work = asyncio.Event()  # also set at the end

    def start(self) -> None:
        """Act from now on."""
        self._task = asyncio.get_running_loop().create_task(self._run(), name="recordings of alarms")

    async def close(self) -> None:
        """Start nothing more; a start under way is completed, so that the recorder can end it."""
        self._closing.set()
        self._has_work.set()
        if self._task is not None:
            await self._task

    def forget(self, alarm: str) -> None:
        """Forget what a deleted alarm has started."""
        self._histories.pop(alarm, None)

    def add(self, instance: AlarmInstance) -> None:
        """Take from an alarm that it was raised; the next turn acts on the first time since the last one."""
        self._raised.setdefault((instance.stored.id, instance.device), (instance, instance.raises[0]))
        instance.raises.clear()
        self._has_work.set()

    async def _run(self) -> None:
        while not self._closing.is_set():
            if not self._raised and self._running is None:
                self._has_work.clear()
                await self._has_work.wait()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(TURN_S):
                    await self._closing.wait()
                    return
            try:
                await self._turn()
            except Exception:  # an error of one turn must not end all triggers
                log.exception("a recording of an alarm failed")

    async def _turn(self) -> None:
        raised, self._raised = list(self._raised.values()), {}
        for instance, time in raised:
            action = instance.definition.recording
            if action is not None:
                await self._act(instance, action, time - instance.definition.raise_s)
        await self._end_if_due()

    async def _act(self, instance: AlarmInstance, action: RecordingAction, crossed: float) -> None:
        running, now = self._recorder.current, self._recorder.now()
        if running is None:
            await self._begin(instance, action, crossed)
            return
        if self._running is not None and self._running.session is running:
            self._running.held = now
            if instance not in self._running.alarms:
                self._running.alarms.append(instance)
        history = self._history(instance)
        marked = history.marked = {one: at for one, at in history.marked.items() if now - at < MARK_EVERY_S}
        if now - marked.get(instance.device, -math.inf) < MARK_EVERY_S:
            return
        marked[instance.device] = now
        self._mark(instance, crossed)
        inside = running.every or instance.device.partition(".")[0] in running.devices
        which = "has a marker now" if inside else "has a marker now, but not this device"
        instance.note(
            "info" if inside else "warning",
            f"started no recording: one is running, which {which}.",
            recording=running.writer.path.stem,
        )

    async def _begin(self, instance: AlarmInstance, action: RecordingAction, crossed: float) -> None:
        now, history = self._recorder.now(), self._history(instance)
        while history.starts and history.starts[0] <= now - HOUR_S:
            history.starts.popleft()
        if len(history.starts) >= action.per_hour:
            if not history.is_refused:
                text = f"started no recording: it has started {len(history.starts)} within an hour, which is its limit."
                instance.note("warning", text)
            history.is_refused = True
            return
        late = min(max(now - crossed, 0.0), instance.definition.raise_s + LATE_S)
        devices = None if action.every_device else [instance.device]
        title = f"Alarm {instance.definition.name}"
        try:
            state = await self._recorder.start(devices, title, before_s=action.before_s + late, with_head=False)
        except (DomainError, RecordingError) as error:
            if self._recorder.current is not None:  # another client was faster
                await self._act(instance, action, crossed)
                return
            instance.note("error", f"started no recording: {error.message}", hint=error.hint)
            return
        session = self._recorder.current
        assert session is not None
        history.starts.append(now)
        history.is_refused = False
        history.marked[instance.device] = now
        self._running = TriggeredRecording(session, instance, action, now, self._recorder.now(), [instance])
        self._mark(instance, crossed)
        instance.note("info", f"started the recording {state.id}.", recording=state.id)

    def _mark(self, instance: AlarmInstance, crossed: float) -> None:
        text = f"Alarm “{instance.definition.name}”"
        self._recorder.mark(MarkerRequest(kind="marker", text=text, time=crossed, device=instance.device))

    async def _end_if_due(self) -> None:
        running, now = self._running, self._recorder.now()
        if running is None:
            return
        if self._recorder.current is not running.session:  # a user or an error has ended it
            self._running = None
            return
        if holds := any(one.holds for one in running.alarms):
            running.held = now
        actions = [action for one in running.alarms if (action := one.definition.recording) is not None]
        is_over = not holds and now - running.held >= max(action.after_s for action in actions)
        is_longest = now - running.began >= running.action.longest_s
        if not is_over and not is_longest:
            return
        self._running = None
        state = await self._recorder.stop(running.session)
        why = "." if is_over else f": it has lasted {running.action.longest_s:g} s, the longest that is set."
        running.by.note("info", f"ended the recording {state.id}{why}", recording=state.id)

    def _history(self, instance: AlarmInstance) -> TriggerHistory:
        return self._histories.setdefault(instance.stored.id, TriggerHistory())
