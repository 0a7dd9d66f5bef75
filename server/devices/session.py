"""One link and one decoder: what is the life of a device?

            open fails                    bytes                     silent, or the link died
    connecting ───────> (try again) ──> live ────────────────────────────> lost ──> (try again) ──> live …
        │ no permission ──> denied            │ a file is over ──> ended
        │ bytes, but nothing known in them: stays connecting and says what they look like

Retries wait 0.5 s, then twice as long each time up to 10 s, and say when the next one is; a person may ask for one now.
Whatever the link does, the page knows within a second: a link that dies says so itself, a link that stays open but
silent is called lost after a second without bytes (or three usual intervals of a slow device). Nothing else in the
server waits for a session.

The protocol is named by the user or guessed from the first bytes; until then chunks are kept, so nothing is lost by
guessing. Each connection has a fresh decoder and a fresh clock mapping; channels and counts go on.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Sequence
from dataclasses import replace

from protocols.events import Doubt, Doubts, Event
from server import wire
from server.devices.audience import Audience
from server.devices.decode_options import DecodeOptions
from server.devices.decode_watchdog import DecodeWatchdog, undecodable_text
from server.devices.device_demux import LinkDevices, StreamDecoder
from server.devices.device_state import DeviceState, short_source
from server.devices.greeting import Greeting
from server.devices.ingest import LinkTiming
from server.devices.left_out import LeftOut
from server.devices.outage import Outage
from server.devices.protocol_detection import ProtocolDetector, ProtocolSet, unknown_hint
from server.devices.restarts import Restarts
from server.devices.sequence_store import SequenceStore
from server.devices.silence_watchdog import LINK_SILENT_HINT, SILENT_S, SilenceWatchdog
from server.devices.stream_diagnostics import StreamDiagnostics
from server.links.base import CHUNK_COST, Chunk, Link, LinkError
from server.streaming.hub import Hub
from server.streaming.slices import Slices

log = logging.getLogger("imuscope.session")

FIRST_RETRY_S = 0.5
LAST_RETRY_S = 10.0
IDLE_LOOK_S = 0.05
STALL_S = 0.25  # without a byte for so long, an incomplete frame is given up; a frame at 9600 Bd takes 0.1 s
STALL_LOOKS = 3  # ticks that found nothing new, too: a silence that was this process's own gives nothing up


class Session(Audience):
    """One device.

    Args:
        device: DeviceInfo.id, unique in this run.
        link: closed; it is opened again after each loss.
        reading: how to read it; its protocol is guessed where it says none.
        sequences: where the last numbers of Secure devices are kept; None: with this process.
    """

    def __init__(
        self,
        device: str,
        link: Link,
        hub: Hub,
        speech: ProtocolSet,
        reading: DecodeOptions = DecodeOptions(),  # noqa: B008 - frozen
        sequences: SequenceStore | None = None,
    ) -> None:
        super().__init__(link.flow)
        info = wire.DeviceInfo(
            id=device,
            name=short_source(link.source),
            source=link.source,
            link=link.kind,
            status="connecting",
            protocol=reading.protocol,
            message=f"Opening {link.source}.",
        )
        self._portrait = DeviceState(hub, info, speech.title)
        self._set = self._portrait.set
        self._link = link
        self._hub, self._speech, self._reading = hub, speech, reading
        self._greeting = Greeting(self.send, link.source)
        self.senders = LinkDevices(hub, self._portrait, speech.title)
        self._figures = self.senders.own.figures
        self.latency = self._figures.latency  # s, from the arrival of bytes until their samples are handed on
        self._incidents = self.senders.own.incidents
        self._advice = StreamDiagnostics(self._incidents, speech.messages_in, speech.title)
        self._intake: StreamDecoder | None = None
        self._decoder: object = None
        self.restarts = Restarts(link.kind, sequences)
        self._unknown = ProtocolDetector(speech.guess)
        self._opened_at: float | None = None
        self._outage = Outage()
        self._patience, self._deafness = SilenceWatchdog(), DecodeWatchdog()
        self._slices = Slices()
        link.flow.at_once = self._slices.size
        self._left_out = LeftOut(self._incidents, self._figures, link.source)
        self._stalled = self._dirty = False
        self._looks = 0  # since bytes came last
        self._retry_s = FIRST_RETRY_S
        self._retry_now = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._off_flush = hub.on_flush(self._drain)
        self._sending = asyncio.Lock()

    @property
    def info(self) -> wire.DeviceInfo:
        """The device as the page knows it; where several are on its link, the first that was heard."""
        return self._portrait.info

    @property
    def reading(self) -> DecodeOptions:
        """How its bytes are read."""
        return self._reading

    @property
    def infos(self) -> list[wire.DeviceInfo]:
        """Every device on the link, as the page knows them."""
        return self.senders.infos

    # ── life ─────────────────────────────────────────────────────────────────────────────────────────────────────────

    def start(self) -> None:
        """Begin; returns at once."""
        self._start()

    def _start(self, *, opened: bool = False) -> None:
        task = self._run(opened=opened)
        self._task = asyncio.get_running_loop().create_task(task, name=f"session {self.info.source}")

    async def close(self) -> None:
        """Stop, close the link, leave the hub."""
        await self._tell_closing()
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
            self._task = None
        await self._greeting.close()
        self.restarts.keep()
        await self._link.close()
        self._off_flush()
        self.senders.leave()

    def retry(self) -> None:
        """Try now instead of at `next_try`; play an ended file again."""
        self._retry_s = FIRST_RETRY_S
        self._retry_now.set()

    async def read_as(self, reading: DecodeOptions) -> None:
        """Read what comes from now on in another way: with a key, as another protocol. Id, channels and history stay.

        A twin has the key that its source has, so it is powered anew; any other link stays open.
        """
        rekeyed = self._task is not None and self._link.kind == "twin" and reading.key != self._reading.key
        if rekeyed and self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
            await self._link.close()
            self._link.settings = replace(self._link.settings, key=reading.key)
        self._drain(final=True)
        self._reading = reading
        self.senders.read_anew()
        self._advice = StreamDiagnostics(self._incidents, self._speech.messages_in, self._speech.title)
        self._intake, self._unknown = None, ProtocolDetector(self._speech.guess)
        self._set(wants="", rearm=[])
        if protocol := reading.protocol or self.info.protocol:
            self._begin(protocol)
        self._set(message="", hint="", notices=self._notices)
        if rekeyed:
            self.start()

    async def _run(self, *, opened: bool = False) -> None:
        while True:
            self._retry_now.clear()
            try:
                if not opened:
                    self._set(next_try=None)  # what went wrong before stays readable while it is tried again
                    await self._link.open(self._portrait.tried)
                self._connected(same=opened)
                opened = False
                while True:
                    self._take(await self._link.read())
                    await self._slices.room()
            except LinkError as error:
                await self._link.close()
                wait = self._explain(error)
            except Exception:  # the top of this task: one device's fault must not become silence
                log.exception("session %s failed", self.info.source)
                await self._link.close()
                wait = self._explain(LinkError("gone", "A fault in imuscope ended this link.", "The log has details."))
            await self._pause(wait)

    def _connected(self, *, same: bool) -> None:
        """Begin anew. The same devices are read as before: what they speak would not be told from others' noise."""
        self._opened_at = self._hub.now()
        self._unknown = ProtocolDetector(self._speech.guess)
        self._link.flow.whole = True  # until it is known whether ends of datagrams matter
        self._intake = None
        self._greeting.anew()
        if protocol := self._reading.protocol or (self.info.protocol if same and self.senders.others else ""):
            self._begin(protocol)
        message = f"{self._link.source} is open, no byte yet."
        self._set(is_open=True, message=message, hint="", baud=self._link.baud, notices=self._notices)

    def _explain(self, error: LinkError) -> float | None:
        """Show why the link is not there; how long to wait before the next try, None for as long as nobody asks."""
        self._drain(final=True)
        was_live = self.info.status == "live"
        self._opened_at = None
        if self.info.status in ("live", "lost"):
            self._outage.begin(self._decoder, self.senders.own)
        if error.kind in ("ended", "bad-source"):
            status: wire.DeviceStatus = "ended" if error.kind == "ended" else "idle"
            self._set(is_open=False, status=status, message=error.message, hint=error.hint, next_try=None)
            self._incidents.say("link", "info", error.message, data={"kind": error.kind})
            return None
        wait, self._retry_s = self._retry_s, min(2 * self._retry_s, LAST_RETRY_S)
        status = "denied" if error.kind == "denied" else "lost"
        if self.info.status == "connecting" and status == "lost" and self._figures.last_arrival is None:
            status = "connecting"  # it never was there: "lost" would be wrong
        changed = was_live or status != self.info.status or error.message != self.info.message
        if changed:
            level: wire.Level = "caution" if status == "connecting" else "fault"
            self._incidents.say("link", level, error.message, data={"kind": error.kind, "hint": error.hint})
        if [one.outcome for one in self.info.tries[-1:]] != [error.message]:  # most links have told it of the place
            self._portrait.tried(wire.Try(self._link.source, error.message, self._hub.now()))
        next_try = self._hub.now() + wait
        self._set(is_open=False, status=status, message=error.message, hint=error.hint, next_try=next_try)
        return wait

    async def _pause(self, seconds: float | None) -> None:
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._retry_now.wait(), seconds)

    # ── for others in the server ─────────────────────────────────────────────────────────────────────────────────────

    async def send(self, data: bytes) -> None:
        """Write to the device, one caller after another, and tell who listens what was sent.

        Raises:
            LinkError: it could not be sent whole, or the link has no way back (a file).
        """
        async with self._sending:
            began_ns = self._link.settings.now_ns()  # before: an answer must not seem older than its question
            self._link.expect()
            await self._link.write(data)
            self._sent.tell(data, began_ns)

    async def relink(self, baud: int | None = None) -> None:
        """Close the link and open it again, at another rate where one is given; what arrives then is decoded anew.

        Raises:
            LinkError: it could not be opened; it goes on being tried, as after any loss.
        """
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        self._drain(final=True)
        self._opened_at = None
        message = f"Opening {self._link.source}{f' at {baud} Bd' if baud else ''}."
        self._set(is_open=False, status="connecting", message=message, hint="", next_try=None)
        try:
            await self._link.relink(baud)
        except BaseException:
            self._start()
            raise
        self._start(opened=True)
        await asyncio.sleep(0)  # it has begun to read when this returns

    async def check_rate(self, baud: int) -> None:
        """Can this end of the link do that rate? As Link.check_rate."""
        await self._link.check_rate(baud)

    @property
    def capacity(self) -> float | None:
        """Bytes/s that the link carries, None where that is not known."""
        return self._link.capacity

    @property
    def baud(self) -> int | None:
        """The rate of the link now."""
        return self._link.baud

    def hush(self, on: bool, device: str = "") -> None:
        """Silence is meant (a device that is being configured does not measure): it is not called lost for it."""
        self._patience.hush(on, self._hub.now())
        self.senders.hush(device, on)

    async def idle(self) -> None:
        """Wait until nobody configures the device: what is sent then cannot come between a request and its answer."""
        while self._patience.hushed:
            await asyncio.sleep(IDLE_LOOK_S)

    def decode(self) -> None:
        """Decode what has come now instead of with the next flush."""
        self._drain()

    def bytes_at(self, offset: int, size: int) -> bytes:
        """Bytes of this connection from an offset that the decoder told; b"" where they are gone."""
        return self._intake.bytes_at(offset, size) if self._intake is not None else b""

    def _heard(self, events: Sequence[Event]) -> None:
        self.restarts.hear(events)
        self._tell_events(events, self.senders.own.name)

    # ── data ─────────────────────────────────────────────────────────────────────────────────────────────────────────

    def _take(self, chunks: list[Chunk]) -> None:
        """Bytes came: cheap, as this happens thousands of times a second."""
        self._keep(chunks)
        self._hub.request_flush()
        if self._patience.hushed and self._intake is not None:
            self._drain()  # somebody waits for an answer, and there are few bytes beside it

    def _keep(self, chunks: list[Chunk]) -> None:
        figures = self._figures
        for chunk in chunks:
            arrival = chunk.arrival_ns / 1e9
            self._patience.heard(arrival, figures.last_arrival)
            figures.heard(len(chunk.data), arrival)
            self._advice.hear(chunk.data)
            self._slices.take(len(chunk.data) + CHUNK_COST)
            if self._intake is None:
                self._unknown.add(chunk)
            else:
                self._feed(chunk)
        self._left_out.look(self._link.flow.left_out, self._hub.now())
        self._stalled, self._looks, self._dirty = False, 0, True

    def _begin(self, protocol: str) -> None:
        """The protocol is known: from here on bytes are decoded, those kept so far first."""
        decoder = self._decoder = self._speech.decoder(protocol, self._reading, self._link.kind)
        about = self._speech.about(protocol)
        self.restarts.begin(decoder, self._reading)
        self._link.flow.whole = about.datagrams
        line = LinkTiming.of(self._link)
        self._intake = StreamDecoder(self._hub, self.senders, decoder, line=line, about=about, on_events=self._heard)
        read = {"time_unit": self._reading.time_unit, "rotation": self._reading.rotation}
        self._set(protocol=protocol, name=self._portrait.name(self.info.product, protocol), **read)
        for chunk in self._unknown.taken():
            self._feed(chunk)

    def _feed(self, chunk: Chunk) -> None:
        """Have a chunk decoded; where a file is played again with it, by a decoder that knows nothing of the last turn:
        it would take the jump back for a reset, a jump or a loss of the device."""
        if chunk.anew:
            self._decode(final=True)
            self._begin(self.info.protocol)
            self._incidents.again(f"{short_source(self.info.source)} starts again.", chunk.arrival_ns / 1e9)
        assert self._intake is not None
        self._intake.feed(chunk)

    def _drain(self, *, final: bool = False) -> bool:
        """Decode a slice of received bytes (server/streaming/slices.py) before each flush. True: more is waiting."""
        self._slices.begin()
        if self._opened_at is not None and not self._slices.full and (chunks := self._link.read_now()):
            self._keep(chunks)
        if self._dirty or final:
            self._dirty = False
            self._decode(final=final)
            self._slices.end()
            self._link.flow.at_once = self._slices.size
        return self._link.held > 0

    def _decode(self, *, final: bool) -> None:
        """What has been taken. A fault here is this device's alone."""
        try:
            if self._intake is None:
                self._recognise(final=final)
            if self._intake is not None:
                self._intake.drain(stalled=final)
                if self._intake.samples and self.info.status != "live" and not final:
                    self._came_alive()
                self._advise(at_once=final)
        except Exception:
            log.exception("decoding %s failed", self.info.source)
            text = "A fault in imuscope stopped the decoder of this device; it was started afresh. The log has details."
            self._incidents.say("device", "fault", text)
            self._intake = None
            if self._reading.protocol:
                self._begin(self._reading.protocol)

    def _recognise(self, *, final: bool) -> None:
        """Guess the protocol from what has been kept."""
        if not self._unknown:
            return
        now = self._hub.now()
        if not self._unknown.is_due(now, final=final):
            self._dirty = True  # look again when the time is over
            return
        guess, why = self._unknown.look(now)
        if guess is not None:
            self._incidents.say("device", "info", f"{self.info.source}: {why}")
            self._begin(guess.protocol)
            return
        self._set(message=self._unknown.words(self.info.source, why), hint=unknown_hint(self._link.kind))

    def _came_alive(self) -> None:
        back = self.info.status == "lost"
        self._retry_s = FIRST_RETRY_S
        hint, last = self._advice.hint, self._figures.last_arrival
        self._set(status="live", message="", hint=hint, wants="", next_try=None, last_arrival=last)
        if self._intake is not None and not self._intake.identity.product and self._link.kind != "file":
            self._greeting.ask(self._speech.about(self.info.protocol).greeting)
        text = f"{self.info.source} is back." if back else f"{self.info.name} is sending."
        self._incidents.say("link", "info", text, data={"kind": "back" if back else "live"})
        self._outage.over(self._decoder, self.senders.own, last if back else None)

    def _advise(self, *, at_once: bool = False) -> None:
        """Say what is to be done about a stream of which something is refused, or not read."""
        assert self._intake is not None
        live = self.info.status == "live"
        samples = self._intake.samples
        new = self._advice.refused(self._figures.rejects_by, live=live)
        new |= self._advice.look(self._hub.now(), self.info.protocol, samples=samples, at_once=at_once)
        new |= self._advice.restarted(self.restarts.waiting) | self._advice.exposed(self._link.kind, self.infos)
        if new:
            self._set(notices=self._notices, hint=self._advice.hint, rearm=list(self.restarts.waiting))
            if self.info.status == "connecting" and self._advice.message:
                self._set(message=self._advice.message, wants=self._advice.wants)
        if isinstance(self._decoder, Doubts) and self._decoder.contradiction is not None and self._link.speed == 1:
            self._doubt(self._decoder.contradiction)

    def _doubt(self, doubt: Doubt) -> None:
        """Arrival speaks for another unit of the timestamps: it is taken where nobody has named one."""
        if self._advice.doubted(doubt, given=bool(self._reading.time_unit)) and not self._reading.time_unit:
            self._reading = replace(self._reading, time_unit=doubt.unit)
            self._begin(self.info.protocol)
        self._set(notices=self._notices)

    @property
    def _notices(self) -> list[str]:
        return [*self._link.notices, *self._left_out.notices(self._hub.now()), *self._advice.notices]

    def rearm(self, device: str = "") -> None:
        """Accept whatever sequence number comes next, of one device of the stream or ("") of all.

        Raises:
            ValueError, OSError: see Restarts.rearm.
        """
        self.restarts.rearm(self._decoder, device)
        self._advice.restarted(self.restarts.waiting)
        text = f"Re-armed: the next sequence number of {f'device {device}' if device else 'every device'} is accepted."
        self._incidents.say("device", "info", text)
        self._set(notices=self._notices, hint=self._advice.hint, rearm=list(self.restarts.waiting), wants="")

    def tick(self, now: float) -> None:
        """Ten times a second: stalls, silence, sums of what happened."""
        last = self._figures.last_arrival
        self._left_out.tick(now)
        if self._opened_at is not None:
            if self._notices != self.info.notices:  # who is connected, what was lost: a link may learn it later
                self._set(notices=self._notices)
            self._looks, looked = self._looks + 1, self._looks + 1 >= STALL_LOOKS
            quiet = self._patience.quiet(now, max(last or 0.0, self._opened_at))
            if self._intake is None and self._unknown:
                self._dirty = True
                self._hub.request_flush()
            if quiet > STALL_S and looked and not self._stalled and self._intake is not None and self._intake.buffered:
                self._stalled = True
                self._dirty = True
                self._drain(final=True)
            if self.info.status == "live" and looked and quiet > self._patience.limit:
                hint = self.senders.own.silence_hint or LINK_SILENT_HINT
                self._fell_silent(f"No byte from {self.info.source} for {quiet:.1f} s; the link is still open.", hint)
            elif self.info.status == "live" and self._deafness.look(now, self.senders.figures, self._patience.hushed):
                self._fell_silent(*(self._advice.refusal(self._figures) or undecodable_text(self._link)))
            elif self.info.status == "connecting" and quiet > SILENT_S and last is None:
                hint = "Is the device powered, connected and set to send?"
                self._set(message=f"{self.info.source} is open, 0 B so far.", hint=hint)
        self.senders.tick(now, None if self._opened_at is not None else self.info)

    def _fell_silent(self, text: str, hint: str) -> None:
        self._incidents.say("link", "fault", text, data={"kind": "silent"})
        wants = self._advice.wants if self.restarts.waiting else ""
        self._set(status="lost", message=text, hint=hint, wants=wants, last_arrival=self._figures.last_arrival)
        if self._intake is not None:
            self._intake.samples = 0  # the next sample makes it live again

    def health(self, now: float) -> wire.DeviceHealth:
        """The figures for the page."""
        return self.healths(now)[0]

    def healths(self, now: float) -> list[wire.DeviceHealth]:
        """The same of every device on the link."""
        return self.senders.healths(now, self._link.capacity)

    def raws(self, now: float) -> list[wire.RawPayload]:
        """The payloads that nobody has described."""
        return self.senders.raws(now)
