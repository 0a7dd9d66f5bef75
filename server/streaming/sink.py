"""Destination of decoded data: a live bus, or the store of a recording.

    Ingest, EventReporter, DeviceState ──> TelemetrySink ──> TelemetryBus     live: rings, browsers, a recording
                                                         └─> RecordingSink    a file: columns on disk

Decoding code uses this interface only, so recordings and live devices are decoded by the same code. Data needed by
exports but by no live view (the device's own clock readings, all payloads without a description) goes to the sink's
`archive`, if it has one.
"""

from collections.abc import Iterable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Ints
from imuscope.protocols.events import Batch
from imuscope.server import wire
from imuscope.server.streaming.channel_rows import ChannelRows, WireRows
from imuscope.server.streaming.unknown_payloads import Payloads

Dated = tuple[Batch, Ints, NDArray[np.float64] | None]
"""Samples, their device time on this host's clock, and their UTC if the device sends it (unix s)."""


class SampleArchive(Protocol):
    """Storage of data that only exports need."""

    def keep_clocks(self, device: str, dated: Sequence[Dated]) -> None:
        """Store device clock readings of the samples of one drain, and their UTC."""

    def keep_payloads(self, parts: Sequence[Payloads]) -> None:
        """Store payloads of one kind without a description."""


class EventSink(Protocol):
    """Receiver of events."""

    def now(self) -> float:
        """Unix seconds that never step; for a recording, the arrival of the bytes being decoded."""

    def add_event(self, event: wire.EventInfo) -> wire.EventInfo:
        """Give an event its number, and log it."""

    def event(
        self,
        device: str,
        kind: wire.EventKind,
        level: wire.Level,
        text: str,
        *,
        time: float | None = None,
        span: tuple[float, float] | None = None,
        samples: int = 0,
        data: dict[str, Any] | None = None,
    ) -> wire.EventInfo:
        """Report an event, at `time` (unix s; None: now) or over `span`."""
        t0, t1 = span or (None, None)
        when = self.now() if time is None else time
        return self.add_event(wire.EventInfo(0, when, device, kind, level, text, t0, t1, samples, data or {}))


class TelemetrySink(EventSink, Protocol):
    """Receiver of channels, samples, events and states of devices."""

    @property
    def archive(self) -> SampleArchive | None:
        """Storage of clock readings and payloads; None if they are not stored."""

    @property
    def reports_every_gap(self) -> bool:
        """False: many gaps in a short time are summarised (server/devices/device/event_reporter.py)."""

    def advertise(self, info: wire.ChannelInfo) -> int:
        """Open a channel described by `info` (id 0); returns its id, which is never used again."""

    def publish(self, pieces: Iterable[ChannelRows | WireRows]) -> None:
        """Publish samples of advertised channels."""

    def set_device(self, info: wire.DeviceInfo) -> None:
        """Set the complete state of a device."""

    def remove_device(self, device: str) -> None:
        """Remove a device with its channels and figures."""
