"""Per-device job queue: serialises commands and reports progress. Each device has a queue, one running job and a log.

    user A ──apply──>   ┌ queue ┐      ┌ job ┐ ──transaction──> Runner ──bytes──> session ──> device
    user B ──run────>   │ 2, 3 … │ ──> │  1  │ <──result──────        <─events───
                        └────────┘     └─────┘
                             │            └─ step, outcomes, errors as text ──> every browser, at once (op `jobs`)
                             └─ visible, jobs can be removed                frames ──> TrafficLog (op `traffic`)

Commands never overlap on a device, whichever client sends them; devices on separate links work at the same time, those
that share a link take turns. A job belongs to the server, not to the browser that requested it: closing the browser
does not affect it. A stopped job, or a stopping server, leaves the device measuring
(server/configuration/transaction_runner.py runs the final steps of a transaction).

Rules for editing: the work of jobs is in server/configuration/jobs.py and rollback.py; this file only queues and runs
them.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Awaitable, Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

from imuscope.protocols.commands.transactions import (
    AT_REST,
    DeviceContext,
    DeviceDriver,
    DeviceRejectedError,
    NoReplyError,
    Transaction,
    Values,
)
from imuscope.protocols.events import Batch, Reply
from imuscope.protocols.messages.family import NAME as MESSAGES
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.schema.fields import Setting
from imuscope.protocols.schema.layouts import EncodeError
from imuscope.recordings.errors import ExplainedError
from imuscope.server.configuration.preview import DevicePresentState, SerialLine, load_of
from imuscope.server.configuration.put_back import PutBackStore, PutBackTask
from imuscope.server.configuration.timings import ConfigurationTimings
from imuscope.server.configuration.traffic_log import TrafficLog
from imuscope.server.configuration.transaction_runner import Runner
from imuscope.server.devices.device.device_demux import QuietReason
from imuscope.server.devices.link.link_member import LinkMember
from imuscope.server.errors import DomainError
from imuscope.server.links.base import LinkError
from imuscope.server.streaming.bus import TelemetryBus
from imuscope.server.wire import DeviceJobs, Job, PendingRollback

log = logging.getLogger("imuscope.configuration")
T = TypeVar("T")

MAX_WAITING = 16
LOG_HEADER = "Configuration"  # the setting that is stale when the header is
MAX_DONE = 5
RESTART_S = 0.2  # without samples: the restart, not those on their way
PAUSE_ENDS_S = 3.0  # after a job; its device sends by then
REST = "{who} put it into the {state} state, in which it sends no data."
ANOTHER_PROGRAM = "Another program"
REST_HINT = "Send {command} to resume measuring."
UNANSWERED_HINT = "Check its power, its cable and the baud rate, then read its settings again."


class JobError(ExplainedError):
    """The reason why a job failed, and what to do."""


class ControlError(DomainError):
    """A request that does not become a job: `kind` is "full", "no-driver", "not-found" or "not-now"."""


@dataclass(slots=True)
class RunningJob:
    """One job of a device, from the queue to its end.

    Args:
        work: performs the job; sets message, outcomes and values of `job`.
        stoppable: False while stopping could leave the line cut.
    """

    controller: DeviceController
    job: Job
    work: Callable[[RunningJob], Awaitable[None]]
    stoppable: bool = True
    finished: asyncio.Event = field(default_factory=asyncio.Event)

    def step(self, text: str) -> None:
        """Set the current step."""
        self.job.step = text
        self.controller.notify()


def _is_named(protocol: str) -> bool:
    """True if the stream names the sending device, and commands are addressed by that name."""
    return protocol in PROTOCOLS and bool(PROTOCOLS[protocol].device.sender)


class DeviceController:
    """Queue and state of one device.

    Args:
        member: the device on its link.
        driver_of: the driver of a protocol, None if it has none.
        decode: decodes the first frame of some bytes of a protocol to plain values.
        siblings: the controllers of the other devices on its link.
        timings: how long a device is waited for.
        put_back: store of the frames that put devices back.
    """

    def __init__(
        self,
        member: LinkMember,
        bus: TelemetryBus,
        driver_of: Callable[[str], DeviceDriver | None],
        decode: Callable[[str, bytes, LinkMember], Mapping[str, Any] | None],
        siblings: Callable[[str], Sequence[DeviceController]] = lambda device: (),
        *,
        timings: ConfigurationTimings,
        put_back: PutBackStore,
    ) -> None:
        self.member = member
        self.siblings = siblings
        self.bus = bus
        self._driver_of = driver_of
        self.log = TrafficLog(
            bus,
            member.info.id,
            lambda frame: decode(self.member.info.protocol, frame, member),
            lambda frame: self._name_of(frame),
            member.access.bytes_at,
        )
        is_stored = member.info.link not in ("simulator", "file")
        self.put_back = PutBackTask(self, put_back, timings, device=member.name, is_stored=is_stored)
        self.runner = Runner(member, self.log, timings.patience, self.put_back.keep, self.put_back.confirms)
        self.values: dict[str, Values] = {}  # the device's settings, as last read
        self.missing: dict[str, str] = {}  # settings that could not be read then, and why
        self.read_at = 0.0  # unix s
        self._restarted = "", 0.0, 0.0  # title of the job that restarted it, its last sample before, and when
        self.header: dict[str, str] = {}  # frames of the header of its log, as last received: name → hex
        self.product = ""  # of the last reading, which may know more than the stream reports
        self.serial_number = ""
        self.firmware = ""
        self.state = ""
        self.at_rest = False  # the user set it to the state in which settings are read: jobs leave it there
        self.unfinished: dict[str, str] = {}  # command → text on unfinished work that a change of state discards
        self.pending_rollback: PendingRollback | None = None
        self.cut_off: Mapping[str, Values] = {}  # values being written when the device was cut off, until it is read
        self.answer: asyncio.Event = asyncio.Event()  # set when the pending rollback is answered
        self.is_change_confirmed = False
        self._queue: deque[RunningJob] = deque()
        self._done: deque[Job] = deque(maxlen=MAX_DONE)
        self._running: RunningJob | None = None
        self._queue_task: asyncio.Task[None] | None = None
        self._stopping: asyncio.Task[None] | None = None
        self._is_closed = False
        self._next_job = 1
        self._off = member.listen_to_news(self._on_news)
        self._off_replaced = member.state.replaced.add(lambda before: self._forget())
        member.listeners.before_close(self.close)

    # ── state ────────────────────────────────────────────────────────────────────────────────────────────────────────

    @property
    def device(self) -> str:
        return self.member.info.id

    @property
    def driver(self) -> DeviceDriver:
        """The driver of the device; ControlError if it cannot be configured."""
        protocol = self.member.info.protocol
        driver = self._driver_of(protocol) if protocol else None
        if driver is None:
            what = "Its protocol is not known yet." if not protocol else "Devices of this protocol have no settings."
            if protocol == MESSAGES:
                what = "It is known by its messages only: configure it with the program that publishes them."
            raise ControlError("no-driver", f"{self.member.info.name} cannot be configured.", what)
        return driver

    @property
    def context(self) -> DeviceContext:
        """Identity of the device, as far as known."""
        info, address = self.member.info, self.member.address
        return DeviceContext(
            product=info.product or self.product,
            serial_number=info.serial_number or self.serial_number,
            firmware=info.firmware or self.firmware,
            baud=self.member.access.baud,
            device=info.serial_number if _is_named(info.protocol) else "" if address is None else str(address),
            settings=self.member.link_session.decode_options.settings(info.protocol),
            at_rest=self.at_rest,
            sample_s=self.member.stats.batch_interval,
        )

    @property
    def present(self) -> DevicePresentState:
        """Known state of the device, for a preview."""
        health = self.bus.health_of(self.device)
        measured = health.bytes_per_s if health is not None else None
        others = [(one.member.info.name, sent) for one in self.siblings(self.device) if (sent := one.sends)]
        line = SerialLine(self.member.access.baud, self.member.access.capacity, measured, others)
        return DevicePresentState(self.driver, self.context, line, self.values)

    @property
    def sends(self) -> float:
        """Bytes/s of its outputs according to its settings; 0 if they were not read."""
        alone = DevicePresentState(self.driver, self.context, SerialLine(), self.values)
        load = load_of(alone, self.values, None)
        return load.total if load is not None else 0.0

    @property
    def rows(self) -> dict[str, Setting]:
        """The device's settings by name."""
        return {row.name: row for row in self.driver.settings(self.context)}

    def update(self, known: DeviceContext, values: Mapping[str, Values], missing: Mapping[str, str]) -> None:
        """Store values read from the device. A new serial number is another device, so older values are discarded."""
        if known.serial_number != self.serial_number:
            self.values, self.missing = {}, {}
        self.product, self.serial_number, self.firmware = known.product, known.serial_number, known.firmware
        self.values = {**self.values, **values}
        self.missing = {name: why for name, why in {**self.missing, **missing}.items() if name not in values}
        self.read_at = self.bus.now()

    def _forget(self) -> None:
        """Forget the values of a sensor that is gone: another one is in its place."""
        if self.serial_number != self.member.info.serial_number:
            self.values, self.missing, self.cut_off, self.unfinished, self.header = {}, {}, {}, {}, {}
            self.product = self.serial_number = self.firmware = self.state = ""
            self.read_at = 0.0
            self.put_back.forget()
            self.rest(False)
            self.member.expect_samples()
            self.notify()

    def invalidate(self, names: Collection[str], why: str) -> None:
        """Mark the values of these settings as unknown, so that old values are not shown."""
        stale = [name for name in names if name in self.values]
        if LOG_HEADER in names:
            self.header = {}
        self.values = {name: values for name, values in self.values.items() if name not in stale}
        self.missing = {**self.missing, **dict.fromkeys(stale, why)}

    def note_unfinished(self, command: str, text: str | None) -> None:
        """Record what a command left unfinished: "" clears it, None changes nothing."""
        kind = command.partition(".")[0]
        if text is not None and text != self.unfinished.get(kind, ""):
            self.unfinished = {**self.unfinished, kind: text} if text else _without(self.unfinished, kind)
            self.notify()

    # ── queue ────────────────────────────────────────────────────────────────────────────────────────────────────────

    def add(self, title: str, work: Callable[[RunningJob], Awaitable[None]], *, stoppable: bool = True) -> RunningJob:
        """Append a job to the queue; it begins when the jobs before it are done.

        Raises:
            ControlError: the queue is full, or the device is being removed.
        """
        if self._is_closed:
            raise ControlError("not-found", f"{self.member.info.name} was removed.", "Add it again.")
        if len(self._queue) >= MAX_WAITING:
            hint = "Wait, or remove one from the queue."
            raise ControlError("full", f"The queue of this device is full ({MAX_WAITING} jobs).", hint)
        job = Job(id=self._next_job, device=self.device, title=title, state="waiting")
        self._next_job += 1
        task = RunningJob(self, job, work, stoppable)
        self._queue.append(task)
        self.notify()
        self._begin()
        return task

    async def drop(self, number: int) -> None:
        """Remove a job from the queue, or stop it.

        Raises:
            ControlError: unknown number, or the job cannot be stopped now.
        """
        for task in self._queue:
            if task.job.id == number:
                self._queue.remove(task)
                self._finish(task, "stopped", "Removed from the queue.")
                return
        running = self._running
        if running is None or running.job.id != number:
            raise ControlError("not-found", f"Job {number} is not queued or running.", "It may be done by now.")
        if not running.stoppable:
            hint = "It ends by itself within a minute; Roll back now ends a pending change."
            raise ControlError(
                "not-now", f"“{running.job.title}” cannot be stopped now: the line could stay cut.", hint
            )
        await self._stop()

    async def close(self) -> None:
        """Stop the running job and drop the queued ones."""
        self._is_closed = True
        self._queue.clear()
        await self._stop()
        await self.put_back.close()
        self._off()
        self._off_replaced()

    def _begin(self, ended: asyncio.Task[None] | None = None) -> None:
        """Run the queue, unless that is done. One task does, so that the one to stop is that of the running job."""
        if self._queue and not self._is_closed and (self._queue_task is None or self._queue_task.done()):
            loop = asyncio.get_running_loop()
            self._queue_task = loop.create_task(self._run_queue(), name=f"jobs of {self.member.info.source}")
            self._queue_task.add_done_callback(self._begin)

    async def _stop(self) -> None:
        """Cancel the running job, once however often it is stopped: it puts its device back. Returns when it has."""
        queue_task = self._queue_task
        if queue_task is None or queue_task.done():
            return
        if queue_task is not self._stopping:
            self._stopping = queue_task
            queue_task.cancel()
        await asyncio.wait((queue_task,))

    async def _run_queue(self) -> None:
        while self._queue:
            async with self.member.listeners.turn:
                if self._queue:  # the job may have been removed while waiting
                    await self._do(self._queue.popleft())

    async def _do(self, task: RunningJob) -> None:
        self._running = task
        task.job.state, task.job.started = "running", self.bus.now()
        self.member.suppress_timeout(True)
        self.member.explain_pause(task.job.title)
        self.notify()
        try:
            await task.work(task)
            self._finish(task, "done")
        except asyncio.CancelledError:
            self._finish(task, "stopped", "Stopped.")
            raise
        except Exception as error:
            message, hint = error_text(error)
            self.log.add_note(message, error=True)
            self.bus.event(self.device, "device", "warning", f"{task.job.title}: {message}", data={"hint": hint})
            self._finish(task, "failed", message, hint)
        finally:
            self._running = None
            asyncio.get_running_loop().call_later(PAUSE_ENDS_S, self._pause_has_ended)
            self.member.suppress_timeout(False)
            self.put_back.transaction_ended()
            self.notify()

    def _pause_has_ended(self) -> None:
        if self._running is None:
            self.member.explain_pause("")

    def _finish(self, task: RunningJob, state: str, message: str = "", hint: str = "") -> None:
        job = task.job
        job.state = "done" if state == "done" else "failed" if state == "failed" else "stopped"
        job.message, job.hint = message or job.message, hint or job.hint
        job.step, job.ended = "", self.bus.now()
        self._done.appendleft(job)
        task.finished.set()
        self.notify()

    def decide(self, *, keep: bool) -> None:
        """Answer the pending rollback.

        Raises:
            ControlError: no rollback is pending, or it was answered.
        """
        is_pending = self.pending_rollback is not None and self.pending_rollback.state == "pending"
        if not is_pending or self.answer.is_set():
            raise ControlError(
                "not-now", "No change is waiting to be confirmed.", "It may have been rolled back already."
            )
        self.is_change_confirmed = keep
        self.answer.set()

    # ── for jobs ─────────────────────────────────────────────────────────────────────────────────────────────────────

    async def run(self, transaction: Transaction[T]) -> T:
        """Run a transaction; see server/configuration/transaction_runner.py."""
        return await self.runner.run(transaction)

    def rest(self, on: bool, who: str = "") -> None:
        """Note that the user set the device to the state in which settings are read, by what, or that this state has
        ended.
        """
        if on:
            self.put_back.forget()
        if on != self.at_rest:
            self.at_rest = on
            self._explain_rest(on, who)

    def _explain_rest(self, on: bool, who: str) -> None:
        """Explain the silence of the config state, naming the person's action or program that set it."""
        if on:
            command = self.driver.ends_rest
            self.explain_quiet(REST.format(who=who, state=AT_REST.lower()), REST_HINT.format(command=command), command)
        else:
            self.member.explain_silence(None)

    def explain_quiet(self, text: str, hint: str, resume: str = "") -> None:
        """Report why the device sends nothing from now on, and what makes it send again: `resume` is a command."""
        self.member.explain_silence(QuietReason(text, hint, resume, self.bus.now()))

    # ── reports ──────────────────────────────────────────────────────────────────────────────────────────────────────

    @property
    def job_report(self) -> DeviceJobs:
        """The complete state, as sent to browsers."""
        return DeviceJobs(
            device=self.device,
            state=self.state,
            running=replace(self._running.job) if self._running is not None else None,
            queue=[replace(task.job) for task in self._queue],
            done=[replace(job) for job in self._done],
            pending_rollback=replace(self.pending_rollback) if self.pending_rollback is not None else None,
            unfinished=" ".join(self.unfinished.values()),
        )

    def notify(self) -> None:
        """Publish the state after a change."""
        self.bus.jobs.publish(self.job_report)

    def _on_news(self, event: Batch | Reply) -> None:
        if isinstance(event, Reply):
            self.log.on_received(event)
            self._keep_header(event)
        else:
            self._report_restart()
        try:
            driver = self.driver
        except ControlError:
            return
        if event.message.name in driver.begins:
            self.rest(False)
            if self.unfinished:
                self.unfinished = {}
                self.notify()
        state = driver.states.get(event.message.name, self.state)
        if state != self.state:
            self.state = state
            self.rest(self.at_rest and state == AT_REST)
            if not self.at_rest and self._running is None:
                self._explain_rest(state == AT_REST, ANOTHER_PROGRAM)
            self.notify()

    def restarts(self, title: str) -> None:
        """Note that a job restarts the device: the pause is reported at its first sample afterwards."""
        self._restarted = title, self.member.stats.last_batch, self.bus.now()
        self.member.expect_samples()

    def _report_restart(self) -> None:
        title, last, since = self._restarted
        if not title or self.driver.ends_rest:
            return
        now = self.bus.now()
        if min(self.member.stats.batch_interval, now - since) <= RESTART_S:
            self.member.expect_samples()  # these were on their way
        else:
            self._restarted = "", 0.0, 0.0
            text = f"No samples for {now - last:.1f} s: imuscope had restarted the device (“{title}”)."
            self.bus.event(self.device, "device", "info", text, span=(last, now))

    def _keep_header(self, reply: Reply) -> None:
        """Store a reply that belongs to the header of a log, also one that a starting device sends by itself."""
        family = PROTOCOLS.get(self.member.info.protocol)
        header = family.logs.log_header if family is not None else None
        if header is None or reply.message.id not in header.frames:
            return
        if frame := self.member.access.bytes_at(reply.offset, reply.size):
            self.header = {**self.header, header.frames[reply.message.id]: frame.hex()}

    def _name_of(self, frame: bytes) -> str:
        try:
            return self.driver.name_of(frame)
        except ControlError:
            return ""


def _without(texts: Mapping[str, str], key: str) -> dict[str, str]:
    return {name: text for name, text in texts.items() if name != key}


def error_text(error: Exception) -> tuple[str, str]:
    """Message and hint for the error of a job."""
    match error:
        case JobError() | LinkError() | ControlError():
            return error.message, error.hint
        case DeviceRejectedError():
            return f"The device refused {error.what}: {error.why}.", "The previous values are unchanged."
        case NoReplyError():
            return str(error), UNANSWERED_HINT
        case EncodeError():
            return f"{error}.", "Nothing was sent."
    log.error("a job failed", exc_info=error)
    return "An internal error of imuscope ended this job.", "The log has details."
