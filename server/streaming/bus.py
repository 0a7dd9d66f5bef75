"""Telemetry bus: data and events of devices as typed topics.

    sessions ──advertise, publish, event, …──> TelemetryBus ─> samples, channels      rows are in the ChannelStore
    jobs, recorder ──<topic>.publish(…)──────>       │      ─> events                 also in the EventLog
                                                     │      ─> devices, jobs, health, recorder, exports, …
                                                 subscribe
                                                     └──> fan-out to clients, recording, journal, metrics

It is the live TelemetrySink (server/streaming/sink.py). A topic carries either messages, each of which counts, or a
state, of which the latest is stored for later subscribers. An error of a subscriber does not affect the others or the
publisher (server/concurrency/listeners.py).
"""

import uuid
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Generic, TypeVar

from imuscope.server import wire
from imuscope.server.concurrency.listeners import CallbackList
from imuscope.server.streaming.channel_rows import ChannelRows, WireRows
from imuscope.server.streaming.channel_store import ChannelStore
from imuscope.server.streaming.event_log import EventLog
from imuscope.server.streaming.sink import EventSink, SampleArchive

T = TypeVar("T")


class Topic(Generic[T]):
    """Messages of one type."""

    def __init__(self) -> None:
        self._subscribers: CallbackList[[T]] = CallbackList()

    def subscribe(self, callback: Callable[[T], None]) -> Callable[[], None]:
        """Call `callback` with everything published from now on; returns a function that ends the subscription."""
        return self._subscribers.add(callback)

    def publish(self, value: T) -> None:
        """Pass a message to every subscriber."""
        self._subscribers.call(value)


class StateTopic(Topic[T]):
    """A state; only the latest one is stored.

    Attributes:
        latest: None before the first one.
    """

    def __init__(self) -> None:
        super().__init__()
        self.latest: T | None = None

    def publish(self, value: T) -> None:
        """Store the state and pass it to every subscriber."""
        self.latest = value
        super().publish(value)


class DeviceTopic(Topic[T]):
    """A state of each device; only the latest one of each is stored.

    Args:
        device_of: returns the device of a state.
    """

    def __init__(self, device_of: Callable[[T], str]) -> None:
        super().__init__()
        self._device_of = device_of
        self._latest: dict[str, T] = {}

    @property
    def latest(self) -> Mapping[str, T]:
        """Latest state by device, in order of appearance."""
        return MappingProxyType(self._latest)

    def publish(self, value: T) -> None:
        """Store the state and pass it to every subscriber."""
        self._latest[self._device_of(value)] = value
        super().publish(value)

    def forget(self, device: str) -> bool:
        """Delete the state of a device; returns whether there was one."""
        return self._latest.pop(device, None) is not None


class TelemetryBus(EventSink):
    """Topics of a server, and the sink of its live devices.

    Args:
        now: unix seconds that never step (server/links/base.py `steady_clock`).
        store, log: stores of samples and events.

    Attributes:
        run: identifies this run of the server.
        samples: ids of channels with new rows.
        channels: each advertised channel, with its id.
        removed: ids of devices that are about to be removed.
    """

    archive: SampleArchive | None = None  # live views need neither clock readings nor all payloads
    reports_every_gap = False

    def __init__(self, now: Callable[[], float], store: ChannelStore, log: EventLog) -> None:
        self._now = now
        self.run = uuid.uuid4().hex
        self.samples: Topic[list[int]] = Topic()
        self.channels: Topic[wire.ChannelInfo] = Topic()
        self.events: Topic[wire.EventInfo] = Topic()
        self.devices: DeviceTopic[wire.DeviceInfo] = DeviceTopic(lambda info: info.id)
        self.removed: Topic[str] = Topic()
        self.jobs: DeviceTopic[wire.DeviceJobs] = DeviceTopic(lambda state: state.device)
        self.traffic: Topic[wire.TrafficEntry] = Topic()
        self.health: StateTopic[Mapping[str, wire.DeviceHealth]] = StateTopic()
        self.unknown_payloads: StateTopic[list[wire.UnknownPayload]] = StateTopic()
        self.recorder: StateTopic[wire.RecorderState] = StateTopic()
        self.exports: StateTopic[wire.Exports] = StateTopic()
        self.library: Topic[wire.LibraryChanged] = Topic()
        self._store = store
        self._log = log
        self._next_event = 0
        self._next_traffic = 0

    # ── the sink of live devices ─────────────────────────────────────────────────────────────────────────────────────

    def advertise(self, info: wire.ChannelInfo) -> int:
        """Open a channel; returns its id, which is never used again in this run."""
        info = self._store.advertise(info)
        self.channels.publish(info)
        return info.id

    def publish(self, pieces: Iterable[ChannelRows | WireRows]) -> None:
        """Publish samples; those of removed devices are ignored."""
        touched = self._store.append(pieces)
        if touched:
            self.samples.publish(touched)

    def now(self) -> float:
        """Unix seconds that never step."""
        return self._now()

    def add_event(self, event: wire.EventInfo) -> wire.EventInfo:
        """Log an event and pass it to every subscriber."""
        event = replace(event, seq=self._next_event)
        self._next_event += 1
        self._log.append(event)
        self._log.trim(self._store.newest(), self.now())
        self.events.publish(event)
        return event

    def events_since(self, time: float) -> list[wire.EventInfo]:
        """Stored events from a time on, unix s, in order of publication."""
        return [event for event in self._log if event.time >= time]

    def set_device(self, info: wire.DeviceInfo) -> None:
        """Publish the changed state of a device."""
        self.devices.publish(info)

    def remove_device(self, device: str) -> None:
        """Remove a device with its channels and figures."""
        self.removed.publish(device)
        self._store.remove_device(device)
        self._log.forget(device)
        self.devices.forget(device)
        self.jobs.forget(device)
        if self.health.latest:
            self.health.latest = {name: one for name, one in self.health.latest.items() if name != device}

    # ── other topics ─────────────────────────────────────────────────────────────────────────────────────────────────

    def next_traffic_number(self) -> int:
        """The number of the next entry of a traffic log, counted over all devices."""
        self._next_traffic += 1
        return self._next_traffic - 1

    def health_of(self, device: str) -> wire.DeviceHealth | None:
        """The latest figures of a device; None before the first."""
        return (self.health.latest or {}).get(device)

    def report_unknown_payloads(self, payloads: list[wire.UnknownPayload]) -> None:
        """Publish the unknown payloads of all devices; an empty list only once."""
        if payloads or self.unknown_payloads.latest:
            self.unknown_payloads.publish(payloads)

    def library_changed(self) -> None:
        """Publish a change of the recordings, so that clients request the list again."""
        self.library.publish(wire.LibraryChanged())
