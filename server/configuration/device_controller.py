"""What is done to a device, by whom first, and who may watch? One desk per device: a queue, one job at a time, a log.

    person A ──apply──> ┌ queue ┐      ┌ job ┐ ──dialogue──> Runner ──bytes──> session ──> device
    person B ──run────> │ 2, 3 … │ ──> │  1  │ <──result───        <─events───
                        └────────┘     └─────┘
                             │            └─ step, outcomes, errors in words ──> every browser, at once (op `control`)
                             └─ visible, may be taken out                    frames ──> TrafficLog (op `exchange`)

Commands never overlap on a device, whoever sends them; devices on links of their own work at the same time, those that
share one take turns. A job belongs to the
server, not to the browser that asked for it: one that is closed in the middle changes nothing. A job that is stopped,
or a server that ends, leaves the device measuring (server/configuration/transaction_runner.py writes a dialogue's last
words).

Rules for editing: what a job does lies in server/configuration/jobs.py and rollback.py; here is only that there are
some.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Awaitable, Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

from protocols.events import Batch, Event, Reply
from protocols.layouts import EncodeError
from protocols.schema import Setting
from protocols.transactions import (
    AT_REST,
    DeviceContext,
    DeviceDriver,
    DeviceRejectedError,
    NoReplyError,
    Transaction,
    Values,
)
from server.configuration.preview import DevicePresentState, Line, load_of
from server.configuration.traffic_log import TrafficLog
from server.configuration.transaction_runner import Runner
from server.devices.member import AnyDevice, address_of, explain_silence
from server.links.base import LinkError
from server.streaming.hub import Hub
from server.wire import ControlState, Job, Trial

log = logging.getLogger("imuscope.control")
T = TypeVar("T")

MOST_WAITING = 16
DONE_KEPT = 5
REST_HINT = "It was sent to the state {state}, in which it sends no data: send {command} to have it measure again."
UNANSWERED_HINT = "Check its power, its cable and the rate, then read its settings again."


class JobError(Exception):
    """A job cannot be done: one sentence, and what to do."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message, self.hint = message, hint


class ControlError(Exception):
    """A wish that does not become a job: `kind` is "full", "no-driver", "not-found" or "not-now"."""

    def __init__(self, kind: str, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.kind, self.message, self.hint = kind, message, hint


@dataclass(slots=True)
class QueuedJob:
    """One job and what carries it out.

    Args:
        work: does it; sets message, outcomes, values of `job`.
        stoppable: False while stopping would leave the line in doubt.
    """

    job: Job
    work: Callable[[QueuedJob], Awaitable[None]]
    stoppable: bool = True
    over: asyncio.Event = field(default_factory=asyncio.Event)


class DeviceController:
    """What is done to one device.

    Args:
        session: its link and decoder; of one that shares a link, its part in it.
        driver_of: the driver of a protocol, None where it has none.
        beside: the desks of the other devices of its link.
        listing_of: makes what turns bytes of a protocol into lines of plain values.
    """

    def __init__(
        self,
        session: AnyDevice,
        hub: Hub,
        driver_of: Callable[[str], DeviceDriver | None],
        decode: Callable[[str, bytes, AnyDevice], Mapping[str, Any] | None],
        beside: Callable[[str], Sequence[DeviceController]] = lambda device: (),
    ) -> None:
        self.session = session
        self.beside = beside
        self.hub = hub
        self._driver_of = driver_of
        self.log = TrafficLog(
            hub,
            session.info.id,
            lambda frame: decode(self.session.info.protocol, frame, session),
            lambda frame: self._name_of(frame),
            session.bytes_at,
        )
        self.runner = Runner(session, self.log)
        self.values: dict[str, Values] = {}  # the device's settings, as last read
        self.missing: dict[str, str] = {}  # what could not be read then, and why
        self.read_at = 0.0  # unix s
        self.product = ""  # of the last survey, which may know more than has been heard by the way
        self.serial_number = ""
        self.firmware = ""
        self.state = ""
        self.at_rest = False  # a person sent it to the state in which settings are read: jobs leave it there
        self.unfinished: dict[str, str] = {}  # command → what it left open that a change of state discards, in words
        self.trial: Trial | None = None
        self.cut_off: Mapping[str, Values] = {}  # what was being written when the device went, until it is read again
        self.answer: asyncio.Event = asyncio.Event()  # somebody answered the question of a trial
        self.kept = False
        self._queue: deque[QueuedJob] = deque()
        self._done: deque[Job] = deque(maxlen=DONE_KEPT)
        self._running: QueuedJob | None = None
        self._carrier: asyncio.Task[None] | None = None
        self._next_job = 1
        self._off = session.listen(self._hear)
        session.before_close(self.close)

    # ── what is known ────────────────────────────────────────────────────────────────────────────────────────────────

    @property
    def device(self) -> str:
        return self.session.info.id

    @property
    def driver(self) -> DeviceDriver:
        """ControlError where nobody can configure this device."""
        protocol = self.session.info.protocol
        driver = self._driver_of(protocol) if protocol else None
        if driver is None:
            what = "Its protocol is not known yet." if not protocol else "Devices of this protocol have no settings."
            raise ControlError("no-driver", f"{self.session.info.name} cannot be configured.", what)
        return driver

    @property
    def known(self) -> DeviceContext:
        """Who the device is, as far as it has told."""
        info, address = self.session.info, address_of(self.session)
        return DeviceContext(
            product=info.product or self.product,
            serial_number=info.serial_number or self.serial_number,
            firmware=info.firmware or self.firmware,
            baud=self.session.baud,
            device=info.serial_number if info.protocol == "idtp" else "" if address is None else str(address),
            key=self.session.reading.key,
            at_rest=self.at_rest,
        )

    @property
    def present(self) -> DevicePresentState:
        """What is known when something is looked at before it is sent."""
        health = self.hub.health.get(self.device)
        measured = health.bytes_per_s if health is not None else None
        others = [(one.session.info.name, sent) for one in self.beside(self.device) if (sent := one.sends)]
        line = Line(self.session.baud, self.session.capacity, measured, others)
        return DevicePresentState(self.driver, self.known, line, self.values)

    @property
    def sends(self) -> float:
        """Bytes/s of its outputs by its settings; 0 where they were not read."""
        alone = DevicePresentState(self.driver, self.known, Line(), self.values)
        load = load_of(alone, self.values, None)
        return load.total if load is not None else 0.0

    @property
    def rows(self) -> dict[str, Setting]:
        """The device's settings by name."""
        return {row.name: row for row in self.driver.settings(self.known)}

    def learn(self, known: DeviceContext, values: Mapping[str, Values], missing: Mapping[str, str]) -> None:
        """What a survey found out. Another serial number is another device: what was known is forgotten."""
        if known.serial_number != self.serial_number:
            self.values, self.missing = {}, {}
        self.product, self.serial_number, self.firmware = known.product, known.serial_number, known.firmware
        self.values = {**self.values, **values}
        self.missing = {name: why for name, why in {**self.missing, **missing}.items() if name not in values}
        self.read_at = self.hub.now()

    def doubt(self, names: Collection[str], why: str) -> None:
        """What the device has of these settings is not known any more: nobody is shown what it had before."""
        stale = [name for name in names if name in self.values]
        self.values = {name: values for name, values in self.values.items() if name not in stale}
        self.missing = {**self.missing, **dict.fromkeys(stale, why)}

    def leave(self, command: str, words: str | None) -> None:
        """What a command left unfinished: "" ends it, None says nothing."""
        kind = command.partition(".")[0]
        if words is not None and words != self.unfinished.get(kind, ""):
            self.unfinished = {**self.unfinished, kind: words} if words else _without(self.unfinished, kind)
            self.tell()

    # ── queue ────────────────────────────────────────────────────────────────────────────────────────────────────────

    def add(self, title: str, work: Callable[[QueuedJob], Awaitable[None]], *, stoppable: bool = True) -> QueuedJob:
        """Put a job at the end of the queue; it begins when those before it are done.

        Raises:
            ControlError: the queue is full.
        """
        if len(self._queue) >= MOST_WAITING:
            hint = "Wait, or take one out of the queue."
            raise ControlError("full", f"{MOST_WAITING} jobs wait for this device, and that is the most.", hint)
        job = Job(id=self._next_job, device=self.device, title=title, state="waiting")
        self._next_job += 1
        task = QueuedJob(job, work, stoppable)
        self._queue.append(task)
        self.tell()
        if self._carrier is None or self._carrier.done():
            loop = asyncio.get_running_loop()
            self._carrier = loop.create_task(self._carry(), name=f"jobs of {self.session.info.source}")
        return task

    async def drop(self, number: int) -> None:
        """Take a job out of the queue, or stop it.

        Raises:
            ControlError: there is none of that number, or it cannot be stopped now.
        """
        for task in self._queue:
            if task.job.id == number:
                self._queue.remove(task)
                self._finish(task, "stopped", "Taken out of the queue.")
                return
        running = self._running
        if running is None or running.job.id != number:
            raise ControlError("not-found", f"No job {number} waits or runs.", "It may be done by now.")
        if not running.stoppable:
            hint = "It ends by itself within a minute; Go back now ends a trial."
            raise ControlError(
                "not-now", f"“{running.job.title}” cannot be stopped now: the line could stay cut.", hint
            )
        await self._stop()

    async def close(self) -> None:
        """End: what runs is stopped, what waits is dropped."""
        self._queue.clear()
        await self._stop(for_good=True)
        self._off()

    async def _stop(self, *, for_good: bool = False) -> None:
        carrier, self._carrier = self._carrier, None
        if carrier is not None:
            carrier.cancel()
            await asyncio.gather(carrier, return_exceptions=True)
        if self._queue and not for_good:
            loop = asyncio.get_running_loop()
            self._carrier = loop.create_task(self._carry(), name=f"jobs of {self.session.info.source}")

    async def _carry(self) -> None:
        """Do what is in the queue, then end."""
        while self._queue:
            async with self.session.turn:
                if self._queue:  # it may have been taken out meanwhile
                    await self._do(self._queue.popleft())

    async def _do(self, task: QueuedJob) -> None:
        self._running = task
        task.job.state, task.job.started = "running", self.hub.now()
        self.session.hush(True)
        self.tell()
        try:
            await task.work(task)
            self._finish(task, "done")
        except asyncio.CancelledError:
            self._finish(task, "stopped", "Stopped.")
            raise
        except Exception as error:
            message, hint = error_text(error)
            self.log.note(message, fault=True)
            self.hub.event(self.device, "device", "caution", f"{task.job.title}: {message}", data={"hint": hint})
            self._finish(task, "failed", message, hint)
        finally:
            self._running = None
            self.session.hush(False)
            self.tell()

    def _finish(self, task: QueuedJob, state: str, message: str = "", hint: str = "") -> None:
        job = task.job
        job.state = "done" if state == "done" else "failed" if state == "failed" else "stopped"
        job.message, job.hint = message or job.message, hint or job.hint
        job.step, job.ended = "", self.hub.now()
        self._done.appendleft(job)
        task.over.set()
        self.tell()

    def decide(self, *, keep: bool) -> None:
        """Answer the question of a trial.

        Raises:
            ControlError: nothing is asked.
        """
        asked = self.trial is not None and self.trial.state == "asking"
        if not asked:
            raise ControlError("not-now", "No settings are on trial here.", "They may have gone back already.")
        self.kept = keep
        self.answer.set()

    # ── for jobs ─────────────────────────────────────────────────────────────────────────────────────────────────────

    async def run(self, dialogue: Transaction[T]) -> T:
        """Carry out a dialogue; see server/configuration/transaction_runner.py."""
        return await self.runner.run(dialogue)

    def rest(self, on: bool) -> None:
        """A person sent it to the state in which settings are read, or that is over; its silence is explained by it."""
        if on != self.at_rest:
            self.at_rest = on
            hint = REST_HINT.format(state=AT_REST, command=self.driver.ends_rest) if on else ""
            explain_silence(self.session, hint)

    def step(self, task: QueuedJob, words: str) -> None:
        """What a job is at."""
        task.job.step = words
        self.tell()

    # ── who watches ──────────────────────────────────────────────────────────────────────────────────────────────────

    @property
    def control(self) -> ControlState:
        """The whole, as browsers are told."""
        return ControlState(
            device=self.device,
            state=self.state,
            running=replace(self._running.job) if self._running is not None else None,
            queue=[replace(task.job) for task in self._queue],
            done=[replace(job) for job in self._done],
            trial=replace(self.trial) if self.trial is not None else None,
            unfinished=" ".join(self.unfinished.values()),
        )

    def tell(self) -> None:
        """Something changed."""
        self.hub.set_control(self.control)

    def _hear(self, event: Event) -> None:
        self.log.hear(event)
        if isinstance(event, Batch | Reply):
            try:
                driver = self.driver
            except ControlError:
                return
            states = driver.states
            if event.message.name in driver.begins:
                self.rest(False)
                if self.unfinished:
                    self.unfinished = {}
                    self.tell()
            state = states.get(event.message.name, self.state)
            if state != self.state:
                self.state = state
                self.rest(self.at_rest and state == AT_REST)
                self.tell()

    def _name_of(self, frame: bytes) -> str:
        try:
            return self.driver.name_of(frame)
        except ControlError:
            return ""


def _without(words: Mapping[str, str], key: str) -> dict[str, str]:
    return {name: said for name, said in words.items() if name != key}


def error_text(error: Exception) -> tuple[str, str]:
    """Why a job failed, in words: message and hint."""
    match error:
        case JobError() | LinkError() | ControlError():
            return error.message, error.hint
        case DeviceRejectedError():
            return f"The device refused {error.what}: {error.why}.", "What was there before is unchanged."
        case NoReplyError():
            return str(error), UNANSWERED_HINT
        case EncodeError():
            return f"{error}.", "Nothing was sent."
    log.error("a job failed", exc_info=error)
    return "A fault in imuscope ended this job.", "The log has details."
