"""Session of one link and its decoder: a device, from its first connection to its last.

The states and transitions of the link are in server/devices/link/connection_state.py; the actions on each transition
are here. Retries over a network wait 0.5 s, then twice as long each time up to 10 s, and publish the time of the next
one; the user can request one at once. A local port is looked for at each tick, and opened as soon as it is back.
Changes of the link are published within a second: a link that fails reports an error, a link that is open but silent
counts as lost after a second without bytes (or three usual intervals of a slow device). Nothing else in the server
waits for a session.

The protocol is named by the user or detected from the first bytes (server/devices/decode/decode_pipeline.py). Bytes are
decoded in turns with other sessions (server/devices/decode/decode_scheduler.py); while the device is being configured,
at once. What configuration and port sharing do with the link is in server/devices/link/link_access.py.
"""

import asyncio
import contextlib
import logging
from collections.abc import Sequence
from dataclasses import replace

from imuscope.protocols.events import Doubt, Event
from imuscope.server import wire
from imuscope.server.concurrency.backoff import LOCAL_S, Backoff
from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.decode.decode_pipeline import DecodePipeline
from imuscope.server.devices.decode.decode_scheduler import DecodeScheduler
from imuscope.server.devices.decode.decode_watchdog import DecodeWatchdog, undecodable_text
from imuscope.server.devices.decode.dropped_bytes import DroppedBytes
from imuscope.server.devices.decode.protocol_detection import ProtocolSet
from imuscope.server.devices.decode.sequence_restarts import Restarts
from imuscope.server.devices.decode.sequence_store import SequenceStore
from imuscope.server.devices.device.device_demux import NOT_QUIET, LinkDevices
from imuscope.server.devices.device.device_names import DeviceNames
from imuscope.server.devices.device.device_state import DeviceState, short_source
from imuscope.server.devices.device.silence_watchdog import LINK_SILENT_HINT, SILENT_S
from imuscope.server.devices.device.stream_diagnostics import StreamDiagnostics
from imuscope.server.devices.link.connection_state import Connection, ConnectionEvent, ConnectionState
from imuscope.server.devices.link.identify import IdentifyRequest
from imuscope.server.devices.link.link_access import LinkAccess
from imuscope.server.devices.link.other_readers import OtherReaders
from imuscope.server.devices.link.outage import Outage
from imuscope.server.devices.link.session_listeners import SessionListeners
from imuscope.server.links.base import SESSION_DEADLINE, Chunk, Link, LinkError
from imuscope.server.streaming.sink import TelemetrySink
from imuscope.server.system.terminals import standing_at

log = logging.getLogger("imuscope.session")

FIRST_RETRY_S = 0.5
LAST_RETRY_S = 10.0
STALL_S = 0.25  # without bytes, after which incomplete frames are examined; a frame at 9600 Bd takes 0.1 s
GIVE_UP_S = 10.0  # without bytes, after which it is given up: no link needs so long for the rest of a frame
JUDGE_S = 0.1  # between two updates of the diagnostics of a device without new rejects
STALL_TICKS = 3  # ticks without new bytes, also required, in case this process itself was delayed


class Session:
    """One device.

    Args:
        device: DeviceInfo.id, unique in this run.
        link: closed; it is opened again after each loss.
        reading: decode options; without a protocol it is detected.
        sink: receives samples, events and states.
        sequences: store of the last numbers of Secure devices; None: in this process only.
        scheduler: of decoding, shared with other sessions; None: its own.
        names: names given to devices by users; None: there are none.

    Attributes:
        listeners: of decoded events, received chunks and sent bytes.
        access: to the link, for configuration and port sharing.
    """

    def __init__(
        self,
        device: str,
        link: Link,
        sink: TelemetrySink,
        protocol_set: ProtocolSet,
        reading: DecodeOptions = DecodeOptions(),  # noqa: B008 - frozen
        sequences: SequenceStore | None = None,
        scheduler: DecodeScheduler | None = None,
        names: DeviceNames | None = None,
    ) -> None:
        self._sink = sink
        self.listeners = SessionListeners(link.flow)
        info = wire.DeviceInfo(
            id=device,
            name=short_source(link.source),
            source=link.source,
            link=link.kind,
            status="connecting",
            protocol=reading.protocol,
            message=f"Opening {link.source}.",
            simulated=link.is_simulated,
        )
        self._state = DeviceState(sink, info, protocol_set.title, names)
        self._set = self._state.set
        self._protocols = protocol_set
        self.devices = LinkDevices(sink, self._state, protocol_set.title)
        self._stats = self.devices.own.stats
        self.latency = self._stats.latency  # s, from the arrival of bytes until their samples are published
        self._reporter = self.devices.own.events
        self._diagnostics = StreamDiagnostics(self._reporter, protocol_set.count_messages, protocol_set.title)
        self.restarts = Restarts(link.kind, sequences)
        self._pipeline = DecodePipeline(
            link,
            sink,
            self.devices,
            protocol_set,
            reading,
            self.restarts,
            on_events=self._on_events,
            on_restart=lambda: self._decode(final=True),
        )
        self.access = LinkAccess(link, self.listeners, self, self._pipeline, self.devices, sink.now)
        self._silence = self.access.silence
        self._identification = IdentifyRequest(self.access.send, link.source)
        self._connection = Connection()
        self._opened_at = 0.0  # unix s, while it is open
        self._outage = Outage()
        self._other_readers = OtherReaders(link)
        self._decode_watchdog = DecodeWatchdog()
        self._left_out = DroppedBytes(self._reporter, self._stats, link.source)
        self._stalled = False
        self._ticks_since_bytes = 0  # since bytes came last
        self._judged_rejects, self._judge_due = 0, 0.0  # of the last update of the diagnostics, and of the next
        self._backoff = Backoff(*(LOCAL_S if link.local_path else (FIRST_RETRY_S, LAST_RETRY_S)))
        self._path_identity: tuple[int, ...] | None = None  # at the path of a local port, when it failed
        self._retry_now = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self.is_closed = False
        self._scheduler = scheduler or DecodeScheduler()
        self._off_turns = self._scheduler.add(self.drain)

    @property
    def _link(self) -> Link:
        return self.access.link

    @property
    def info(self) -> wire.DeviceInfo:
        """The published state of the device; of several on the link, the first received."""
        return self._state.info

    @property
    def decode_options(self) -> DecodeOptions:
        return self._pipeline.options

    @property
    def infos(self) -> list[wire.DeviceInfo]:
        """The published states of every device on the link."""
        return self.devices.infos

    # ── lifecycle ────────────────────────────────────────────────────────────────────────────────────────────────────

    def start(self) -> None:
        """Start reading in the background; returns at once."""
        if before := self._state.names.moved.pop(self.info.id, ""):
            text = (
                f"{self.info.source} is {self.info.topic} for programs that subscribe to it; before, it was {before}."
            )
            self._reporter.report("device", "warning", text)
        self._connection.apply(ConnectionEvent.START)
        self.start_reading()

    def start_reading(self, *, opened: bool = False) -> None:
        if self.is_closed:
            return
        task = self._run(opened=opened)
        self._task = asyncio.get_running_loop().create_task(task, name=f"session {self.info.source}")

    async def _stop_reading(self) -> None:
        await end_tasks(self._task)

    async def interrupt(self, message: str) -> None:
        """Stop reading and decode the received bytes; the link is opened again next.

        Raises:
            LinkError: the device was removed.
        """
        await self._stop_reading()
        if self.is_closed:
            raise LinkError("not-found", f"{self.info.name} was removed.", "Add it again.")
        self.drain(final=True)
        self._connection.apply(ConnectionEvent.REOPEN)
        self._set(is_open=False, status="connecting", message=message, hint="", next_attempt=None)

    async def close(self) -> None:
        """Stop, close the link, remove its devices."""
        await self.listeners.close()
        self.is_closed = True
        await self._stop_reading()
        self._task = None
        self._connection.apply(ConnectionEvent.CLOSE)
        await self._identification.close()
        self.restarts.save()
        await self._link.close()
        self._off_turns()
        self.devices.remove()

    def retry(self) -> None:
        """Retry now instead of at `next_attempt`; play an ended file again."""
        self._backoff.reset()
        self._retry_now.set()

    async def read_as(self, reading: DecodeOptions) -> None:
        """Change the decode options (key, protocol, …) from now on. Id, channels and history stay.

        A simulator has the key of its source, so it is restarted; any other link stays open.
        """
        rekeyed = (
            self._task is not None and self._link.kind == "simulator" and reading.secrets != self.decode_options.secrets
        )
        if rekeyed:
            await self._stop_reading()
            await self._link.close()
            self._link.settings = replace(self._link.settings, decode_options=reading.values)
        self.drain(final=True)
        self._pipeline.options = reading
        self.devices.reset_decoding()
        self._diagnostics = StreamDiagnostics(self._reporter, self._protocols.count_messages, self._protocols.title)
        self._pipeline.disconnect()
        self._set(required_action="", rearm=[])
        if protocol := reading.protocol or self.info.protocol:
            self._pipeline.begin(protocol)
        self._set(message="", hint="", notices=self._notices)
        if rekeyed:
            self._connection.apply(ConnectionEvent.REOPEN)
            self.start_reading()

    async def _run(self, *, opened: bool = False) -> None:
        while True:
            self._retry_now.clear()
            try:
                if not opened:
                    self._set(next_attempt=None)  # the previous error stays readable during the retry
                    await self._link.open(self._state.tried)
                self._connected(same=opened)
                opened = False
                while True:
                    self._on_chunks(await self._link.read())
                    await self._pipeline.slices.wait_for_room()
            except LinkError as error:
                await self._link.close()
                wait = self._explain(error)
            except Exception:  # top of this task: an internal error must be reported
                log.exception("session %s failed", self.info.source)
                await self._link.close()
                wait = self._explain(
                    LinkError("gone", "An internal error of imuscope ended this link.", "The log has details.")
                )
            await self._pause(wait)
            self._connection.apply(ConnectionEvent.RETRY)

    def _connected(self, *, same: bool) -> None:
        """Start decoding a new connection. Several devices on a line keep their protocol: it could not be detected
        again from their mixed bytes.
        """
        self._connection.apply(ConnectionEvent.OPENED)
        self._opened_at = self._sink.now()
        self._pipeline.disconnect()
        self._link.flow.deadlines[SESSION_DEADLINE] = 0  # the first bytes wake the loop
        self._link.flow.keep_datagrams = True  # until it is known whether ends of datagrams matter
        self._identification.restart()
        if protocol := self._pipeline.known_protocol or (self.info.protocol if same and self.devices.others else ""):
            self._pipeline.begin(protocol)
        owed = self._link.owed
        message = f"{self._link.source} is open, no data yet.{f' {owed.words}' if owed is not None else ''}"
        self._set(is_open=True, message=message, hint="", baud=self._link.baud, notices=self._notices)
        self._set(simulated=self._link.is_simulated)  # of a recording, known once it is open

    def _explain(self, error: LinkError) -> float | None:
        """Publish why the link failed. Returns the time until the next attempt, None to wait for a request."""
        self.drain(final=True)
        was_live = self.info.status == "live"
        if self.info.status in ("live", "lost"):
            self._outage.begin(self._pipeline.decoder, self.devices.own)
        if error.kind in ("ended", "bad-source"):
            self._connection.apply(ConnectionEvent.FINISHED)
            status: wire.DeviceStatus = "ended" if error.kind == "ended" else "idle"
            self._set(is_open=False, status=status, message=error.message, hint=error.hint, next_attempt=None)
            self._reporter.report("link", "info", error.message, data={"kind": error.kind})
            return None
        self._connection.apply(ConnectionEvent.FAILED)
        self._path_identity = standing_at(self._link.local_path)
        wait = self._backoff.next()
        status = "denied" if error.kind == "denied" else "lost"
        if self.info.status == "connecting" and status == "lost" and self._stats.last_arrival is None:
            status = "connecting"  # it was never connected, so not "lost"
        changed = was_live or status != self.info.status or error.message != self.info.message
        if changed:
            level: wire.Level = "warning" if status == "connecting" else "error"
            self._reporter.report("link", level, error.message, data={"kind": error.kind, "hint": error.hint})
        if [one.outcome for one in self.info.attempts[-1:]] != [error.message]:  # most links have reported the attempt
            self._state.tried(wire.Attempt(self._link.source, error.message, self._sink.now()))
        next_attempt = self._sink.now() + wait
        self._set(is_open=False, status=status, message=error.message, hint=error.hint, next_attempt=next_attempt)
        return wait

    async def _pause(self, seconds: float | None) -> None:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await self._retry_now.wait()

    def _on_events(self, events: Sequence[Event]) -> None:
        self.restarts.on_events(events)
        self.listeners.publish(events, self.devices.own.name)

    # ── data ─────────────────────────────────────────────────────────────────────────────────────────────────────────

    def _on_chunks(self, chunks: list[Chunk]) -> None:
        self._receive(chunks)
        self._scheduler.request()
        if self._silence.suppressed and self._pipeline.stream is not None:
            self.drain()  # a job waits for an answer, and there are few other bytes

    def _receive(self, chunks: list[Chunk]) -> None:
        arrivals = [chunk.arrival_ns / 1e9 for chunk in chunks]
        before = self._stats.last_arrival or arrivals[0]
        self._silence.note_chunks(arrivals, self._stats.last_arrival)
        self._stats.count_chunks([len(chunk.data) for chunk in chunks], arrivals)
        self._diagnostics.on_chunks(chunks)
        self._pipeline.put_all(chunks)
        self._left_out.update(self._link.flow.dropped, self._sink.now(), (before, arrivals[-1]))
        self._stalled, self._ticks_since_bytes = False, 0

    def drain(self, *, final: bool = False) -> bool:
        """Decode a slice of received bytes in a turn. True if more is waiting."""
        pipeline = self._pipeline
        pipeline.slices.begin()
        if self._connection.is_open and not pipeline.slices.is_full:
            chunks = self._link.read_now(self._scheduler.interval_ns)
            if chunks:
                self._scheduler.request()
                self._receive(chunks)
        if pipeline.is_due or final:
            self._decode(final=final)
            pipeline.end_slice()
        return self._link.backlog > 0

    def _decode(self, *, final: bool) -> None:
        """Decode the received bytes. An error here affects this device only."""
        pipeline = self._pipeline
        try:
            pipeline.decode(final=final)
            if pipeline.stream is not None:
                if pipeline.samples and not final and self._connection.allows(ConnectionEvent.DECODED):
                    self._on_live()
                self._update_diagnostics(at_once=final)
                decoder = pipeline.doubting
                if decoder is not None and decoder.contradiction is not None and self._link.speed == 1:
                    self._on_contradiction(decoder.doubted, decoder.contradiction)
        except Exception:
            log.exception("decoding %s failed", self.info.source)
            text = "An internal error stopped the decoder of this device; it was restarted. The log has details."
            self._reporter.report("device", "error", text)
            pipeline.stream = None
            if self.decode_options.protocol:
                pipeline.begin(self.decode_options.protocol)

    def _on_live(self) -> None:
        self._connection.apply(ConnectionEvent.DECODED)
        if self.info.status == "live":  # only its key was changed
            return
        back = self.info.status == "lost"
        self._backoff.reset()
        hint, last = self._diagnostics.hint, self._stats.last_arrival
        self.devices.own.quiet_reason = None
        self._set(status="live", last_arrival=last, **{**NOT_QUIET, "hint": hint, "required_action": ""})
        stream = self._pipeline.stream
        if back and self.info.serial_number and stream is not None and not stream.identity.serial_number:
            self._set(unconfirmed_since=self._sink.now())  # another one may have been plugged in
        # else the other program's dialogue may identify it
        is_identified = self._link.kind != "file" and not self._link.other_users
        if stream is not None and not stream.identity.product and is_identified:
            self._identification.request(self._protocols.about(self.info.protocol).device.identify_request)
        text = f"{self.info.source} is back." if back else f"{self.info.name} is sending."
        self._reporter.report("link", "info", text, data={"kind": "back" if back else "live"})
        self._outage.end(self._pipeline.decoder, self.devices.own, last if back else None)

    def _update_diagnostics(self, *, at_once: bool = False) -> None:
        """Update warnings and remedies for data that is rejected or not decoded; at intervals while all is accepted."""
        live = self.info.status == "live"
        now, rejects = self._sink.now(), self._stats.rejects
        if live and not at_once and rejects == self._judged_rejects and now < self._judge_due:
            return
        self._judged_rejects, self._judge_due = rejects, now + JUDGE_S
        samples = self._pipeline.samples
        new = self._diagnostics.refused(self._stats.rejects_by, live=live)
        stream = self._pipeline.stream
        unclaimed = stream.unclaimed if stream is not None else None
        protocol = self.info.protocol
        new |= self._diagnostics.update(now, protocol, samples=samples, unclaimed=unclaimed, at_once=at_once)
        waiting = self.restarts.waiting
        new |= self._diagnostics.restarted(waiting) | self._diagnostics.exposed(self._link.kind, self.infos)
        if new:
            self._set(notices=self._notices, hint=self._diagnostics.hint, rearm=list(waiting))
            if self.info.status == "connecting" and self._diagnostics.message:
                self._set(message=self._diagnostics.message, required_action=self._diagnostics.required_action)

    def _on_contradiction(self, option: str, doubt: Doubt) -> None:
        """Use another value of an option if arrival times indicate it and the user has not set one."""
        is_configured = option in self.decode_options.values
        if self._diagnostics.on_contradiction(option, doubt, is_configured=is_configured) and not is_configured:
            self._pipeline.set_option(option, doubt.value)
        self._set(notices=self._notices)

    @property
    def _notices(self) -> list[str]:
        return [*self._pipeline.notices, *self._left_out.notices(self._sink.now()), *self._diagnostics.notices]

    def rearm(self, device: str = "") -> None:
        """Accept any next sequence number of one device of the stream, or of all ("").

        Raises:
            ValueError, OSError: see Restarts.rearm.
        """
        self.restarts.rearm(self._pipeline.decoder, device)
        self._diagnostics.restarted(self.restarts.waiting)
        text = f"Re-armed: the next sequence number of {f'device {device}' if device else 'every device'} is accepted."
        self._reporter.report("device", "info", text)
        hint, waiting = self._diagnostics.hint, list(self.restarts.waiting)
        self._set(notices=self._notices, hint=hint, rearm=waiting, required_action="")

    def tick(self, now: float) -> None:
        """Check for stalls and silence, and sum up events. Called ten times a second."""
        self._left_out.tick(now)
        if self._connection.is_open:
            self._watch(now)
        elif self._connection.state is ConnectionState.RETRYING and (path := self._link.local_path):
            before, self._path_identity = self._path_identity, standing_at(path)
            if self._path_identity not in (None, before):
                self.retry()
        silence = self.devices.tick(now, None if self._connection.is_open else self.info)
        if silence is not None:
            self._fell_silent(*silence)

    def _watch(self, now: float) -> None:
        """Check an open link for stalls, silence and other programs that read it."""
        last, stream = self._stats.last_arrival, self._pipeline.stream
        if self._notices != self.info.notices:  # a link may learn later who is connected, or which bytes were lost
            self._set(notices=self._notices)
        self._ticks_since_bytes, is_due = self._ticks_since_bytes + 1, self._ticks_since_bytes + 1 >= STALL_TICKS
        quiet = self._silence.silence(now, max(last or 0.0, self._opened_at))
        self._other_readers.tick(now, self._stats, is_silent=self.info.status != "live" and quiet > SILENT_S)
        if stream is None and self._pipeline.detector:
            self._pipeline.mark_dirty()
            self._scheduler.request()
        if is_due and stream is not None and stream.buffered and quiet > STALL_S:
            is_new, self._stalled = not self._stalled, True
            if quiet > GIVE_UP_S or (is_new and self._pipeline.hides_messages()):
                self.drain(final=True)
        if self.info.status == "live" and is_due and quiet > self._silence.limit and not self._link.backlog:
            self._fell_silent(f"No data from {self.info.source}; the link is still open.", LINK_SILENT_HINT)
        elif self.info.status in ("live", "lost") and self._decode_watchdog.update(
            now, self.devices.stats, self._silence.suppressed
        ):
            self._fell_silent(*(self._diagnostics.refusal(self._stats) or undecodable_text(self._link)))
        elif self.info.status == "connecting" and quiet > SILENT_S and last is None:
            hint = "Check that the device is powered, connected and set to send."
            self._set(message=f"{self.info.source} is open, 0 B so far.", hint=hint)

    def _fell_silent(self, text: str, hint: str) -> None:
        self._connection.apply(ConnectionEvent.SILENCE)
        if self.devices.own.came_to_rest():
            return
        self._reporter.report("link", "error", text, data={"kind": "silent"})
        action = self._diagnostics.required_action if self.restarts.waiting else ""
        self._set(status="lost", message=text, hint=hint, required_action=action, last_arrival=self._stats.last_arrival)
        self._identification.restart()
        if self._pipeline.stream is not None:
            self._pipeline.stream.samples = 0  # the next sample makes it live again
            self._pipeline.stream.identity.forget()

    def health(self, now: float) -> wire.DeviceHealth:
        return self.health_of_all(now)[0]

    def health_of_all(self, now: float) -> list[wire.DeviceHealth]:
        """The figures for the page of every device on the link."""
        reports = self.devices.health_of_all(now, self._link.capacity, self._silence.pauses)
        decoding = self.behind(now)
        for one in reports:
            one.behind.decoding = decoding
        return reports

    def behind(self, now: float) -> float:
        """Age of the oldest bytes that have arrived and are not decoded, s; 0 if there are none."""
        waiting_ns = self._link.waiting_since_ns if self._connection.is_open else None
        return 0.0 if waiting_ns is None else max(0.0, now - waiting_ns / 1e9)
