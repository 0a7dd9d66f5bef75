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
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol as Shape

from protocols.events import Decoder
from server import wire
from server.advice import Advice
from server.channels import Channels
from server.health import Figures
from server.hub import Hub
from server.incidents import Incidents
from server.intake import About, Identity, Intake
from server.links.base import Chunk, Link, LinkError
from server.reading import Reading

log = logging.getLogger("imuscope.session")

FIRST_RETRY_S = 0.5
LAST_RETRY_S = 10.0
SILENT_S = 0.8  # and the tick and the flush after it: the page knows within a second
SLOW_FACTOR = 3.0  # a device that speaks every 2 s is silent after 6 s
FEW_CHUNKS = 3  # with fewer than these its usual interval is not known, and it has this long:
FEW_CHUNKS_S = 3.0
SLOWEST_S = 10.0
STALL_S = 0.25  # without a byte for so long, an incomplete frame is given up; a frame at 9600 Bd takes 0.1 s
GUESS_BYTES = 1024
GUESS_S = 0.4  # with fewer bytes than that, after so long
GUESS_SCORE = 0.5
UNKNOWN_BYTES = 16 * 1024  # kept while the protocol is unknown
TRIES_KEPT = 12
_MODEL = re.compile(r"[A-Za-z]+(?:-[A-Z])?-\d+[A-Z]?")


class Guess(Shape):
    """What `protocols.registry.guess` gives, best first."""

    @property
    def protocol(self) -> str: ...
    @property
    def score(self) -> float: ...
    @property
    def why(self) -> str: ...


@dataclass(frozen=True, slots=True)
class Speech:
    """The protocols a session can speak: usually those of protocols/registry.py."""

    decoder: Callable[[str, Reading, str], Decoder]  # protocol, what was said about the source, kind of its link
    guess: Callable[[bytes], Sequence[Guess]]
    title: Callable[[str], str]
    about: Callable[[str], About] = lambda protocol: About()
    messages_in: Callable[[bytes], Mapping[str, int]] = lambda data: {}


class Session:
    """One device.

    Args:
        device: DeviceInfo.id, unique in this run.
        link: closed; it is opened again after each loss.
        reading: how to read it; its protocol is guessed where it says none.
    """

    def __init__(
        self,
        device: str,
        link: Link,
        hub: Hub,
        speech: Speech,
        reading: Reading = Reading(),  # noqa: B008 - frozen
    ) -> None:
        self.info = wire.DeviceInfo(
            id=device,
            name=_short(link.source),
            source=link.source,
            link=link.kind,
            status="connecting",
            protocol=reading.protocol,
            message=f"Opening {link.source}.",
        )
        self._link = link
        self._hub = hub
        self._speech = speech
        self._reading = reading
        self._greeted = False
        self._greeting: asyncio.Task[None] | None = None
        self._figures = Figures()
        self._channels = Channels(device, hub.advertise)
        self._incidents = Incidents(hub, device)
        self._advice = Advice(self._incidents, speech.messages_in, speech.title)
        self._intake: Intake | None = None
        self._unknown: list[Chunk] = []
        self._unknown_since = 0.0
        self._opened_at: float | None = None
        self._died_at: float | None = None  # last arrival before the link went while it was live
        self._interval = 0.0  # the usual time between chunks of this device, s
        self._chunks = 0
        self._stalled = False
        self._dirty = False
        self._retry_s = FIRST_RETRY_S
        self._retry_now = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._off_flush = hub.on_flush(self._drain)
        hub.set_device(self.info)

    # ── life ─────────────────────────────────────────────────────────────────────────────────────────────────────────

    def start(self) -> None:
        """Begin; returns at once."""
        self._task = asyncio.get_running_loop().create_task(self._run(), name=f"session {self.info.source}")

    async def close(self) -> None:
        """Stop, close the link, leave the hub."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
            self._task = None
        if self._greeting is not None:
            self._greeting.cancel()
            await asyncio.gather(self._greeting, return_exceptions=True)
        await self._link.close()
        self._off_flush()
        self._hub.remove_device(self.info.id)

    def retry(self) -> None:
        """Try now instead of at `next_try`; play an ended file again."""
        self._retry_s = FIRST_RETRY_S
        self._retry_now.set()

    async def _run(self) -> None:
        while True:
            self._retry_now.clear()
            try:
                await self._connect()
                while True:
                    self._take(await self._link.read())
            except LinkError as error:
                await self._link.close()
                wait = self._explain(error)
            except Exception:  # the top of this task: one device's fault must not become silence
                log.exception("session %s failed", self.info.source)
                await self._link.close()
                wait = self._explain(LinkError("gone", "A fault in imuscope ended this link.", "The log has details."))
            await self._pause(wait)

    async def _connect(self) -> None:
        self._set(next_try=None)  # what went wrong before stays readable while it is tried again
        await self._link.open(self._tried)
        self._opened_at = self._hub.now()
        self._unknown, self._unknown_since = [], 0.0
        self._intake = None
        self._greeted = False
        if self._reading.protocol:
            self._begin(self._reading.protocol)
        self._set(
            message=f"{self._link.source} is open, no byte yet.",
            hint="",
            baud=self._link.baud,
            notices=self._notices,
        )

    def _tried(self, attempt: wire.Try) -> None:
        """Keep the last tries; one that repeats takes the place of its predecessor."""
        tries = self.info.tries
        if tries and (tries[-1].what, tries[-1].outcome) == (attempt.what, attempt.outcome):
            tries = tries[:-1]
        self._set(tries=[*tries, attempt][-TRIES_KEPT:])

    def _explain(self, error: LinkError) -> float | None:
        """Show why the link is not there; how long to wait before the next try, None for as long as nobody asks."""
        self._drain(final=True)
        was_live = self.info.status == "live"
        self._opened_at = None
        if self.info.status in ("live", "lost") and self._died_at is None:
            self._died_at = self._figures.last_arrival
        if error.kind in ("ended", "bad-source"):
            status: wire.DeviceStatus = "ended" if error.kind == "ended" else "idle"
            self._set(status=status, message=error.message, hint=error.hint, next_try=None)
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
        self._tried(wire.Try(self._link.source, error.message, self._hub.now()))
        self._set(status=status, message=error.message, hint=error.hint, next_try=self._hub.now() + wait)
        return wait

    async def _pause(self, seconds: float | None) -> None:
        try:
            await asyncio.wait_for(self._retry_now.wait(), seconds)
        except TimeoutError:
            return

    # ── data ─────────────────────────────────────────────────────────────────────────────────────────────────────────

    def _take(self, chunks: list[Chunk]) -> None:
        """Bytes came: cheap, as this happens thousands of times a second."""
        figures = self._figures
        for chunk in chunks:
            arrival = chunk.arrival_ns / 1e9
            if figures.last_arrival is not None:
                gap = arrival - figures.last_arrival
                self._interval = max(gap if gap < SLOWEST_S else 0.0, 0.9 * self._interval)
            self._chunks += 1
            figures.heard(len(chunk.data), arrival)
            self._advice.hear(chunk.data)
            if self._intake is None:
                self._unknown.append(chunk)
            else:
                self._intake.feed(chunk)
        self._stalled = False
        self._dirty = True
        self._hub.request_flush()

    def _begin(self, protocol: str) -> None:
        """The protocol is known: from here on bytes are decoded, those kept so far first."""
        baud = self._link.baud
        self._intake = Intake(
            self._hub,
            self.info.id,
            self._speech.decoder(protocol, self._reading, self._link.kind),
            figures=self._figures,
            channels=self._channels,
            incidents=self._incidents,
            identify=self._identified,
            byte_time_ns=10e9 / baud if baud else 0,
            link_kind=self._link.kind,
            capacity=self._link.capacity,
            about=self._speech.about(protocol),
        )
        self._set(protocol=protocol, name=self._name(self.info.product, protocol))
        for chunk in self._unknown:
            self._intake.feed(chunk)
        self._unknown = []

    def _drain(self, *, final: bool = False) -> None:
        """Decode what has come. Called by the hub before each flush; a fault here is this device's alone."""
        if not (self._dirty or final):
            return
        self._dirty = False
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
        self._unknown_since = self._unknown_since or now
        size = sum(len(chunk.data) for chunk in self._unknown)
        if size < GUESS_BYTES and now - self._unknown_since < GUESS_S and not final:
            self._dirty = True  # look again when the time is over
            return
        guesses = self._speech.guess(b"".join(chunk.data for chunk in self._unknown))
        if guesses and guesses[0].score >= GUESS_SCORE:
            self._incidents.say("device", "info", f"{self.info.source}: {guesses[0].why}")
            self._begin(guesses[0].protocol)
            return
        words = f", at best: {guesses[0].why}" if guesses and guesses[0].score > 0 else ""
        self._set(
            message=f"{size} B from {self.info.source} look like no known protocol{words}.",
            hint="Is the baud rate right? Give the protocol if you know it.",
        )
        while size > UNKNOWN_BYTES:
            size -= len(self._unknown.pop(0).data)

    def _came_alive(self) -> None:
        back = self.info.status == "lost"
        self._retry_s = FIRST_RETRY_S
        hint = self._advice.hint
        self._set(status="live", message="", hint=hint, next_try=None, last_arrival=self._figures.last_arrival)
        self._greet()
        text = f"{self.info.source} is back." if back else f"{self.info.name} is sending."
        self._incidents.say("link", "info", text, data={"kind": "back" if back else "live"})
        if self._died_at is not None and back and self._figures.last_arrival is not None:
            # A new connection has a new decoder, which cannot know what its predecessor missed.
            span = (self._died_at, self._figures.last_arrival)
            text = f"Nothing came for {span[1] - span[0]:.1f} s: the link was down. How many samples is not known."
            self._incidents.say("gap", "fault", text, span=span, data={"counter": "", "by": "link"})
        self._died_at = None

    def _advise(self, *, at_once: bool = False) -> None:
        """Say what is to be done about a stream of which something is refused, or not read."""
        assert self._intake is not None
        live = self.info.status == "live"
        samples = self._intake.samples
        new = self._advice.refused(self._figures.rejects_by, live=live)
        new |= self._advice.look(self._hub.now(), self.info.protocol, samples=samples, at_once=at_once)
        if new:
            self._set(notices=self._notices, hint=self._advice.hint)
            if self.info.status == "connecting" and self._advice.message:
                self._set(message=self._advice.message)

    @property
    def _notices(self) -> list[str]:
        return [*self._link.notices, *self._advice.notices]

    def _greet(self) -> None:
        """Ask a device that has been heard who it is, once for each connection, unless it has said so."""
        intake, link = self._intake, self._link
        if self._greeted or intake is None or intake.identity.product or link.kind == "file":
            return
        self._greeted = True
        greeting = self._speech.about(self.info.protocol).greeting

        async def ask() -> None:
            with contextlib.suppress(LinkError):  # no way back, or nobody there any more: reading finds that out
                await link.write(greeting)

        if greeting:
            self._greeting = asyncio.get_running_loop().create_task(ask(), name=f"greeting {self.info.source}")

    def tick(self, now: float) -> None:
        """Ten times a second: stalls, silence, sums of what happened."""
        last = self._figures.last_arrival
        if self._opened_at is not None:
            if self._notices != self.info.notices:  # who is connected, what was lost: a link may learn it later
                self._set(notices=self._notices)
            quiet = now - max(last or 0.0, self._opened_at)
            if self._intake is None and self._unknown:
                self._dirty = True
                self._hub.request_flush()
            if quiet > STALL_S and not self._stalled and self._intake is not None and self._intake.buffered:
                self._stalled = True
                self._dirty = True
                self._drain(final=True)
            if self.info.status == "live" and quiet > self._patience:
                self._fell_silent(quiet)
            elif self.info.status == "connecting" and quiet > SILENT_S and last is None:
                hint = "Is the device powered, connected and set to send?"
                self._set(message=f"{self.info.source} is open, 0 B so far.", hint=hint)
        self._incidents.tick(now)

    @property
    def _patience(self) -> float:
        """How long this device may be silent, s."""
        if self._chunks < FEW_CHUNKS:
            return FEW_CHUNKS_S
        return max(SILENT_S, min(SLOW_FACTOR * self._interval, SLOWEST_S))

    def _fell_silent(self, quiet: float) -> None:
        text = f"No byte from {self.info.source} for {quiet:.1f} s; the link is still open."
        hint = "Is the device powered and in measurement state? It is shown again as soon as it speaks."
        self._incidents.say("link", "fault", text, data={"kind": "silent"})
        self._set(status="lost", message=text, hint=hint, last_arrival=self._figures.last_arrival)
        if self._intake is not None:
            self._intake.samples = 0  # the next sample makes it live again

    def health(self, now: float) -> wire.DeviceHealth:
        """The figures for the page."""
        figures = self._figures
        messages = figures.report(now)
        clock = self._intake.clock if self._intake is not None else None
        known = clock is not None and clock.uncertainty_ns < float("inf")
        return wire.DeviceHealth(
            device=self.info.id,
            time=now,
            rate=max((message.rate for message in messages), default=0.0),
            messages=messages,
            gaps=figures.gaps,
            lost=figures.lost,
            rejects=figures.rejects,
            rejects_by=dict(figures.rejects_by),
            verified=figures.verified,
            unverified=figures.unverified,
            bytes=figures.bytes.total,
            bytes_per_s=figures.bytes.rate(now),
            capacity=self._link.capacity,
            jitter_ms=clock.jitter_ns() / 1e6 if clock is not None and known else None,
            last_arrival=figures.last_arrival,
            drift_ppm=clock.drift_ppm if clock is not None and known else None,
            uncertainty_ms=clock.uncertainty_ns / 1e6 if clock is not None and known else None,
        )

    # ── state ────────────────────────────────────────────────────────────────────────────────────────────────────────

    def _identified(self, identity: Identity) -> None:
        self._set(
            product=identity.product or self.info.product,
            serial_number=identity.serial_number or self.info.serial_number,
            firmware=identity.firmware or self.info.firmware,
            protection=identity.protection or self.info.protection,
            name=identity.name or self._name(identity.product, self.info.protocol),
        )

    def _name(self, product: str, protocol: str) -> str:
        """What people call it: the model in its product code (MTi-630 of MTi-630-8A1G6), else protocol or link."""
        product = product or self.info.product
        model = _MODEL.match(product)
        if product:
            return model.group() if model else product
        return self._speech.title(protocol) if protocol else _short(self.info.source)

    def _set(self, **changes: object) -> None:
        new = replace(self.info, **changes)  # type: ignore[arg-type]
        if new != self.info:
            self.info = new
            self._hub.set_device(new)


def _short(source: str) -> str:
    """/dev/ttyUSB0 → ttyUSB0; /dev/pts/4 → pts/4; tcp://host:1 → host:1; a file by its name."""
    bare = source.partition("?")[0].rstrip("/")
    device = re.search("(?:^|//)/dev/(.+)", bare)
    return (device[1] if device else bare.rsplit("/", 1)[-1]) or source
