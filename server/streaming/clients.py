"""Fan-out of telemetry to clients: browsers, and processes that feed third-party viewers.

    TelemetryBus ──topics──> ClientFanout ──flush──> one packet, one text ──offer──> SendQueue of each client
    ChannelStore ──rows────>      │
                                  └─ subscribe ─> HistoryStream: contents of the rings, up to the first live sample

New data is encoded once per flush, and every client gets the same bytes, once more for those that want the units in
which it was sent. A flush happens when there is new data, at
most every 12 ms for up to four clients and every 16 ms beyond (once per frame of a 60 Hz screen; on a small computer
each flush costs more than the samples in it), less often if every client needs less (`SendQueue.interval_s`).
"""

import asyncio
import platform
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from imuscope.server import wire
from imuscope.server.concurrency.heartbeat import UNWATCHED_S
from imuscope.server.streaming.bus import TelemetryBus
from imuscope.server.streaming.channel_store import ChannelStore
from imuscope.server.streaming.event_log import EventLog
from imuscope.server.streaming.send_queue import Frame, HistoryStream, Packet, SendQueue
from imuscope.server.streaming.shedding import Shedding
from imuscope.server.version import VERSION
from imuscope.server.wire import codec as wire_codec
from imuscope.server.wire.capabilities import Capabilities

FEW_CLIENTS = 4
FLUSH_S = 0.012
FLUSH_MANY_S = 0.016
SLACK_S = 0.002  # a flush may be earlier by this: decoding has the same interval, but not to the ms


@dataclass(frozen=True, slots=True)
class ClientStatistics:
    """Figures of all clients since the server started.

    Args:
        browsers: connected now, without third-party viewers.
        connected: total number of browsers.
        dropped: samples, including those of disconnected clients.
        sent_bytes: including those to disconnected clients.
        queues: of the connected clients, in order of connection.
    """

    browsers: int
    connected: int
    dropped: int
    sent_bytes: int
    queues: tuple[SendQueue, ...]


class ClientFanout:
    """All clients of a server.

    Args:
        bus: source of the topics sent to them.
        store, log: samples and events for clients that connect later.
        shedding: the work left out while decoding is behind.

    Attributes:
        capabilities: of this server, sent to clients.
        history_lock: held while history is sent to a browser, so that several pages are served one after the other.
    """

    def __init__(
        self,
        bus: TelemetryBus,
        store: ChannelStore,
        log: EventLog,
        capabilities: Capabilities,
        shedding: Shedding | None = None,
    ) -> None:
        self.shedding = shedding or Shedding()
        self._bus, self._store, self._log, self.capabilities = bus, store, log, capabilities
        self.now = bus.now
        self.history_lock = asyncio.Lock()
        self._queues: set[SendQueue] = set()
        self._browser_count = 0
        self._attached = 0  # including third-party viewers
        self._disconnected_dropped = self._disconnected_bytes = 0  # of disconnected clients
        self._offered: dict[int, int] = {}  # channel → sequence number up to which clients were offered samples
        self._touched: dict[int, None] = {}  # channels with samples that were not offered yet
        self._new_channels: list[wire.ChannelInfo] = []
        self._new_events: list[wire.EventInfo] = []
        self._new_traffic: list[wire.TrafficEntry] = []
        self._devices_changed = self._jobs_changed = False
        self._timer: asyncio.Handle | None = None
        self._next_flush = 0.0  # due time at even intervals, by the loop's clock
        bus.samples.subscribe(self._on_samples)
        bus.channels.subscribe(self._on_channel)
        bus.events.subscribe(self._on_event)
        bus.traffic.subscribe(self._on_traffic)
        bus.devices.subscribe(self._on_device)
        bus.jobs.subscribe(self._on_jobs)
        bus.removed.subscribe(self._on_removed)
        bus.health.subscribe(self._send_health)
        bus.unknown_payloads.subscribe(
            lambda payloads: self._send_latest("unknown_payloads", wire.UnknownPayloads(payloads))
        )
        bus.recorder.subscribe(lambda state: self._send_latest("recorder", state))
        bus.exports.subscribe(lambda state: self._send_latest("exports", state))
        bus.library.subscribe(lambda changed: self._send_latest("library", changed))

    # ── in: from the bus ─────────────────────────────────────────────────────────────────────────────────────────────

    def _on_samples(self, channels: Iterable[int]) -> None:
        if self._queues:
            self._touched.update(dict.fromkeys(channels))
            self.request_flush()

    def _on_channel(self, info: wire.ChannelInfo) -> None:
        if self._queues:
            self._new_channels.append(info)

    def _on_event(self, event: wire.EventInfo) -> None:
        if self._queues:
            self._new_events.append(event)
            self.request_flush()

    def _on_traffic(self, entry: wire.TrafficEntry) -> None:
        if self._queues:
            self._new_traffic.append(entry)
            self.request_flush()

    def _on_device(self, _: wire.DeviceInfo) -> None:
        self._devices_changed = True
        self.request_flush()

    def _on_jobs(self, _: wire.DeviceJobs) -> None:
        self._jobs_changed = True
        self.request_flush()

    def _on_removed(self, device: str) -> None:
        self._new_channels = [info for info in self._new_channels if info.device != device]
        numbers = self._store.of_device(device)
        for number in numbers:
            self._offered.pop(number, None)
            self._touched.pop(number, None)
        for queue in self._queues:
            queue.forget(numbers)
        self._devices_changed = True
        self._jobs_changed |= device in self._bus.jobs.latest
        self.request_flush()

    def _send_health(self, report: Mapping[str, wire.DeviceHealth]) -> None:
        """Send the figures of all devices, with each client's own `dropped`."""
        shared = wire_codec.encode_text(wire.HealthReport(list(report.values())))
        for queue in self._queues:
            own = self._health_for(queue, report) if queue.dropped_of else None
            queue.put_latest("health", shared if own is None else wire_codec.encode_text(own))

    def _health_for(self, queue: SendQueue, report: Mapping[str, wire.DeviceHealth]) -> wire.HealthReport:
        dropped: dict[str, int] = {}
        for number, count in queue.dropped_of.items():
            if (channel := self._store.get(number)) is not None:
                dropped[channel.info.device] = dropped.get(channel.info.device, 0) + count
        return wire.HealthReport([replace(one, dropped=dropped.get(one.device, 0)) for one in report.values()])

    # ── flush ────────────────────────────────────────────────────────────────────────────────────────────────────────

    @property
    def sample_interval(self) -> float:
        """Interval between samples, s, of the most demanding client, regardless of the number of clients."""
        interval = min((queue.interval_s for queue in self._queues), default=UNWATCHED_S)
        return max(FLUSH_S, interval, self.shedding.page_interval)

    @property
    def flush_interval(self) -> float:
        """Minimum mean time between two flushes, s."""
        return max(self.sample_interval, FLUSH_S if len(self._queues) <= FEW_CLIENTS else FLUSH_MANY_S)

    def request_flush(self) -> None:
        """Flush as soon as the interval allows. To be called in the event loop; without one, call `flush` yourself."""
        if self._timer is not None or not self._queues:
            return
        try:
            loop = asyncio.get_running_loop()
        except RuntimeError:
            return
        due = self._next_flush - SLACK_S
        if due <= loop.time():  # after the present publisher has finished
            self._timer = loop.call_soon(self._flush_now, loop)
        else:
            self._timer = loop.call_at(due, self._flush_now, loop)

    def _flush_now(self, loop: asyncio.AbstractEventLoop) -> None:
        self._timer = None
        self._next_flush = max(self._next_flush, loop.time()) + self.flush_interval
        self.flush()

    def flush(self) -> None:
        """Encode new data once, and offer it to every client."""
        self._flush_text()
        now = self._bus.now()
        touched, self._touched = self._touched, {}
        rings = {number: channel.ring for number in touched if (channel := self._store.get(number)) is not None}
        for as_sent in {queue.as_sent for queue in self._queues} if rings else ():
            with np.errstate(over="ignore"):  # the largest float32 in rad/s is infinite in °/s
                packet = Packet.of(
                    (
                        Frame(number, *frame)
                        for number, ring in rings.items()
                        for frame in ring.frames(number, self._offered.get(number, 0), ring.total, now, as_sent=as_sent)
                    ),
                    now,
                )
            for queue in self._queues:
                if queue.as_sent is as_sent:
                    queue.offer(packet)
        self._offered |= {number: ring.total for number, ring in rings.items()}

    def _flush_text(self) -> None:
        if self._devices_changed:
            self._devices_changed = False
            self._send_latest("devices", wire.Devices(list(self._bus.devices.latest.values())))
        if self._new_channels:
            channels, self._new_channels = self._new_channels, []
            self._send(wire.Channels(channels))
        if self._new_events:
            events, self._new_events = self._new_events, []
            self._send(wire.Events(events))
        if self._jobs_changed:
            self._jobs_changed = False
            self._send_latest("jobs", wire.JobsReport(list(self._bus.jobs.latest.values())))
        if self._new_traffic:
            entries, self._new_traffic = self._new_traffic, []
            self._send(wire.Traffic(entries))

    def _send(self, message: wire.ServerText) -> None:
        if self._queues:
            text = wire_codec.encode_text(message)
            for queue in self._queues:
                queue.put_message(text)

    def _send_latest(self, kind: str, message: wire.ServerText) -> None:
        if self._queues:
            text = wire_codec.encode_text(message)
            for queue in self._queues:
                queue.put_latest(kind, text)

    # ── clients ──────────────────────────────────────────────────────────────────────────────────────────────────────

    def attach(self, queue: SendQueue, role: Literal["view", "control"] = "control") -> None:
        """Add a client and send it the present state. Samples begin with its `subscribe`."""
        if self._queues:
            self._flush_text()  # so that the present state is not sent twice
        else:  # changes without clients are part of the history
            self._devices_changed = self._jobs_changed = False
            self._offered = {channel.info.id: channel.ring.total for channel in self._store.all}
        self._log.trim(self._store.newest(), self._bus.now())
        self._attached += 1
        queue.number = self._attached
        self._browser_count += queue.is_browser
        self._queues.add(queue)
        bus = self._bus
        for message in (
            wire.Hello(VERSION, bus.now(), platform.node(), bus.run, self._store.history_s, self.capabilities, role),
            wire.Devices(list(bus.devices.latest.values())),
            wire.Channels([channel.info for channel in self._store.all]),
            *map(wire.Events, self._log.for_late()),
            wire.HealthReport(list((bus.health.latest or {}).values())),
            *([wire.JobsReport(list(bus.jobs.latest.values()))] if bus.jobs.latest else []),
            *(state for state in (bus.recorder.latest, bus.exports.latest) if state is not None),
        ):
            queue.put_message(wire_codec.encode_text(message))

    def detach(self, queue: SendQueue) -> None:
        """Remove a disconnected client."""
        if queue in self._queues:
            self._queues.discard(queue)
            self._disconnected_dropped += queue.dropped
            self._disconnected_bytes += queue.sent_bytes
        if not self._queues:
            self._touched, self._new_channels, self._new_events, self._new_traffic = {}, [], [], []

    def subscribe(self, queue: SendQueue, request: wire.Subscribe, past: Iterable[int] | None = None) -> None:
        """Send live samples from the next flush on, and history exactly up to there.

        Args:
            past: channels with history; None: all requested channels.
        """
        past_s, newest = min(request.history, self._store.history_s), self._store.newest()
        channels = None if request.channels is None else set(request.channels)
        spans = {}
        for channel in self._store.all:
            number = channel.info.id
            if (channels is None or number in channels) and (past is None or number in past):
                offered = self._offered.get(number, 0)
                since = newest.get(channel.info.device, 0.0) - past_s
                spans[number] = (channel.ring, min(channel.ring.sequence_at(since), offered), offered)
        queue.as_sent = request.units == "device"
        history = HistoryStream(spans, as_sent=queue.as_sent)
        queue.subscribe(request.channels, history, wire_codec.encode_text(wire.HistoryEnd()))

    @property
    def browsers(self) -> int:
        """Number of connected browsers."""
        return sum(queue.is_browser for queue in self._queues)

    @property
    def statistics(self) -> ClientStatistics:
        """Figures for /metrics."""
        queues = tuple(sorted(self._queues, key=lambda queue: queue.number))
        return ClientStatistics(
            self.browsers,
            self._browser_count,
            self._disconnected_dropped + sum(queue.dropped for queue in queues),
            self._disconnected_bytes + sum(queue.sent_bytes for queue in queues),
            queues,
        )
