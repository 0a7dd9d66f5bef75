"""Running calibrations of live devices: one for each device, the same for all who look.

    start ─> CalibrationSession ── each look reads the new rows of the rings ─> samples, at most MAX_SAMPLES a sensor
                                        └─> report (at most REPORTS_HZ a second, however many look)
    finish, or progress 1 ─> the report stays until it is discarded or replaced

Nothing runs without viewers: the rings of the channel store hold the samples, as long as their memory
reaches back. Above MAX_SAMPLES every second sample is dropped, and from then on every second one is left out.
"""

import asyncio
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from imuscope.server.errors import DomainError, unknown_device
from imuscope.server.extensions.analysis.signals.triads import Samples, Triad, finite
from imuscope.server.extensions.calibration.kinds import (
    CalibrationInputs,
    CalibrationMethod,
    CalibrationOptions,
    evaluated,
    method_for,
)
from imuscope.server.extensions.calibration.report import CalibrationReport
from imuscope.server.services.parts import ServicePart
from imuscope.server.services.services import Services
from imuscope.server.streaming.bus import TelemetryBus
from imuscope.server.streaming.channel_store import ChannelStore

MAX_SAMPLES = 120_000  # of one sensor: 4 MB
MAX_S = 1800.0
REPORTS_HZ = 3.0
MAX_SESSIONS = 8


class SampleCollector:
    """Samples of one sensor from its channel's ring, with bounded memory."""

    def __init__(self, triad: Triad, store: ChannelStore) -> None:
        self.triad = triad
        self._store = store
        known = store.get(triad.info.id)
        self._next = known.ring.total if known else 0
        self._stride = 1
        self._skip = 0  # rows to leave out before the next one
        self._pieces: list[Samples] = []
        self._count = 0
        self.lost = 0  # rows that the ring no longer had

    def catch_up(self) -> None:
        """Read the new rows; call it in the event loop."""
        known = self._store.get(self.triad.info.id)
        if known is None or known.ring.total <= self._next:
            return
        self.lost += max(0, known.ring.first - self._next)
        columns = known.ring.read(self._next)
        self._next = known.ring.total
        arrival, time = columns[0], columns[1]
        rows = len(arrival)
        indices = np.arange(self._skip, rows, self._stride)
        self._skip = (self._skip - rows) % self._stride
        values = np.stack([columns[2 + at][indices] for at in self.triad.at], axis=1).astype(np.float64)
        times = np.where(np.isnan(time), arrival, time)[indices]
        piece = finite(times, values * self.triad.factor)
        if len(piece):
            self._pieces.append(piece)
            self._count += len(piece)
        if self._count > MAX_SAMPLES:
            whole = self.samples.at(slice(None, None, 2))
            self._pieces, self._count = [whole], len(whole)
            self._stride *= 2

    @property
    def samples(self) -> Samples:
        """All that were read; the pieces become one."""
        if len(self._pieces) != 1:
            time = np.concatenate([piece.time for piece in self._pieces]) if self._pieces else np.empty(0)
            values = np.concatenate([piece.values for piece in self._pieces]) if self._pieces else np.empty((0, 3))
            self._pieces = [Samples(np.maximum.accumulate(time), values)]
        return self._pieces[0]


@dataclass(frozen=True, slots=True)
class SessionState:
    """A calibration and how it stands."""

    report: CalibrationReport
    is_running: bool


class CalibrationSession:
    """A calibration of a live device.

    Args:
        now: unix seconds.
    """

    def __init__(
        self,
        method: CalibrationMethod,
        inputs: CalibrationInputs,
        options: CalibrationOptions,
        store: ChannelStore,
        now: Callable[[], float],
    ) -> None:
        self.method, self.options = method, options
        self.started = now()
        self.is_running = True
        self._triads = method.triads(inputs)
        self._collectors = {name: SampleCollector(triad, store) for name, triad in self._triads.items()}
        self._now = now
        self._report: CalibrationReport | None = None
        self._reported = -np.inf
        self._lock = asyncio.Lock()

    async def state(self) -> SessionState:
        """The report as of now; of one that has ended, its last."""
        async with self._lock:
            now = self._now()
            if self._report is None or (self.is_running and now - self._reported >= 1 / REPORTS_HZ):
                self._report = await self._evaluate()
                self._reported = now
                is_complete = self._report.progress >= 1 and self._report.correction is not None
                if is_complete or now - self.started > MAX_S:
                    self.is_running = False
            return SessionState(self._report, self.is_running)

    async def finish(self) -> SessionState:
        """End it with the samples until now.

        Raises:
            DomainError: "no-result": they do not determine a result; it goes on.
        """
        async with self._lock:
            if self.is_running or self._report is None:
                self._report = await self._evaluate()
            if self._report.refusal is not None:
                refusal = self._report.refusal
                raise DomainError("no-result", refusal.message, refusal.hint)
            self.is_running = False
            return SessionState(self._report, False)

    async def _evaluate(self) -> CalibrationReport:
        for collector in self._collectors.values():
            collector.catch_up()
        samples = {name: collector.samples for name, collector in self._collectors.items()}
        report = await asyncio.to_thread(evaluated, self.method, self._triads, samples, self.options)
        lost = self._collectors[self.method.sensor].lost
        if lost:
            report.notes.append(f"{lost} samples are missing: they were older than the memory when they were read.")
        if report.t0 == 0:
            report.t0 = self.started
        return report


class CalibrationSessions:
    """The calibrations of all live devices.

    Args:
        store: rows of the channels.
    """

    def __init__(self, bus: TelemetryBus, store: ChannelStore) -> None:
        self._bus, self._store = bus, store
        self._sessions: dict[str, CalibrationSession] = {}
        bus.removed.subscribe(self.discard)

    def inputs(self, device: str) -> CalibrationInputs:
        """The sensors of a device.

        Raises:
            DomainError: "not-found": unknown device.
        """
        if device not in self._bus.devices.latest:
            raise unknown_device(device)
        return CalibrationInputs.of(self._store.of_device(device).values())

    def start(self, device: str, kind: str, options: CalibrationOptions) -> CalibrationSession:
        """Begin a calibration, in place of the one that there may be.

        Raises:
            DomainError: "not-found", "not-now".
        """
        inputs = self.inputs(device)
        method = method_for(kind, inputs, self._bus.devices.latest[device].name)
        session = CalibrationSession(method, inputs, options, self._store, self._bus.now)
        self._sessions.pop(device, None)
        while len(self._sessions) >= MAX_SESSIONS:
            self._sessions.pop(min(self._sessions, key=lambda one: self._sessions[one].started))
        self._sessions[device] = session
        return session

    def get(self, device: str) -> CalibrationSession | None:
        return self._sessions.get(device)

    def of(self, device: str) -> CalibrationSession:
        """The calibration of a device.

        Raises:
            DomainError: "not-found": there is none.
        """
        session = self._sessions.get(device)
        if session is None:
            hint = "Start one; one that was running ended with the server."
            raise DomainError("not-found", f"Device {device:.40} has no calibration.", hint)
        return session

    def discard(self, device: str) -> None:
        """Forget the calibration of a device."""
        self._sessions.pop(device, None)


async def _close() -> None:
    """Sessions hold nothing that must be freed."""


def parts(services: Services) -> Iterator[ServicePart]:
    yield ServicePart("calibrations", CalibrationSessions(services.telemetry.bus, services.telemetry.store), _close)
