"""Computed signals of live devices, as channels on the bus.

    bus.samples ─> rows of the channels that an expression uses ─> LiveExpression ─> bus.publish, as any other channel

So rings, browsers, viewers and alarms have them without knowing of expressions. A definition waits until its device
sends the signals that it uses, and begins with what memory holds of them, up to `MAX_PAST` samples. Signals may use
others of their device, but never themselves: what a signal publishes reaches those that use it as any other samples.
"""

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from imuscope.server.errors import DomainError, unknown_device
from imuscope.server.extensions.analysis.expressions.channel_rates import ChannelRates, have_changed
from imuscope.server.extensions.analysis.expressions.expression_syntax import ExpressionError, parse
from imuscope.server.extensions.analysis.expressions.expressions import names_in
from imuscope.server.extensions.analysis.expressions.live_expression import LiveExpression
from imuscope.server.extensions.analysis.expressions.live_streams import Piece
from imuscope.server.extensions.analysis.signals.quantities import Quantity
from imuscope.server.library.signal_definitions import SignalDefinition, SignalDefinitions
from imuscope.server.services.parts import ServicePart
from imuscope.server.streaming.bus import TelemetryBus
from imuscope.server.streaming.channel_rows import ChannelRows
from imuscope.server.streaming.channel_store import ChannelStore
from imuscope.server.wire import ChannelInfo, ColumnInfo, DeviceInfo

if TYPE_CHECKING:
    from imuscope.server.services.services import Services


log = logging.getLogger("imuscope.signals")

MESSAGE = "expression"  # ChannelInfo.message of a computed signal
MAX_PAST = 60_000  # samples of a channel that a new signal begins with
STEP_SAMPLES = 1000  # samples of a channel in one step: browsers could not take all of the past at once
SWEEP_S = 1.0
_AXES = {"x": "x", "y": "y", "z": "z", "roll": "x", "pitch": "y", "yaw": "z"}

Rows = list[NDArray[Any]]


@dataclass(slots=True)
class _Running:
    """A signal that is being computed."""

    definition: SignalDefinition
    live: LiveExpression
    channel: int
    next: dict[int, int]  # channel → sequence number of the next row
    rates: Mapping[int, float]
    clock: int  # channel that says when samples arrived
    is_behind: bool = False  # memory holds more than was computed
    recent: Rows = field(default_factory=lambda: [np.empty(0), np.empty(0)])  # its arrival and time


class DerivedChannels:
    """The computed signals of all devices.

    Attributes:
        definitions: as stored.
    """

    def __init__(self, bus: TelemetryBus, store: ChannelStore, definitions: SignalDefinitions) -> None:
        self.definitions = definitions
        self._bus, self._store = bus, store
        self._running: dict[tuple[str, str], _Running] = {}  # device, name
        self._problems: dict[tuple[str, str], DomainError] = {}
        self._next_sweep = 0.0
        bus.samples.subscribe(self._on_samples)
        bus.removed.subscribe(self._on_removed)

    def problem(self, device: str, name: str) -> DomainError | None:
        """The reason that a signal is not being computed; None if it is."""
        return self._problems.get((device, name))

    def unit(self, device: str, name: str) -> str:
        """Unit of a signal that is being computed."""
        running = self._running.get((device, name))
        return running.live.unit if running is not None else ""

    def device(self, number: str) -> DeviceInfo:
        """A device by its id.

        Raises:
            DomainError: "not-found".
        """
        info = self._bus.devices.latest.get(number)
        if info is None:
            raise unknown_device(number)
        return info

    def put(self, device: DeviceInfo, definition: SignalDefinition) -> None:
        """Store a definition, and compute it from now on.

        Raises:
            DomainError: the name is taken, the expression does not fit or would use the signal itself, or it cannot be
                stored.
        """
        if any(info.name == definition.name for info in self._plain(device.id)):
            hint = "Choose another name."
            raise DomainError("name", f"{device.name} sends a channel {definition.name:.60}.", hint)
        if cycle := cycle_of(definition, self.definitions.of(device)):
            way = " uses ".join(f"“{name}”" for name in cycle)
            message = f"A signal cannot use itself: {way}."
            raise DomainError("bad-expression", message, f"Leave “{cycle[1]}” out of the expression.")
        running = self._start(device.id, definition)
        self.definitions.put(device, definition)
        self._begin(device.id, running)

    def remove(self, device: DeviceInfo, name: str) -> None:
        """Remove a definition with its channel.

        Raises:
            DomainError: "not-found", "disk", or "busy": others use it.
        """
        others = self.definitions.of(device)
        users = [f"“{one.name}”" for one in others if one.name != name and used_by(one, [name])]
        if users:
            verb = "uses" if len(users) == 1 else "use"
            message = f"The signal {name:.60} cannot be removed: {', '.join(users)} {verb} it."
            raise DomainError("busy", message, "Remove or edit what uses it first.")
        self.definitions.remove(device, name)
        self._problems.pop((device.id, name), None)
        running = self._running.pop((device.id, name), None)
        if running is not None:
            self._store.remove_channel(running.channel)

    def _plain(self, device: str) -> list[ChannelInfo]:
        return [info for info in self._store.of_device(device).values() if info.message != MESSAGE]

    def _start(self, device: str, definition: SignalDefinition) -> _Running:
        own = [info for info in self._store.of_device(device).values() if info.name != definition.name]
        others = [one.info for one in self._store.all if one.info.device != device and one.info.message != MESSAGE]
        rates = ChannelRates(self._store)
        live = LiveExpression(own, definition.expression, rates, others)
        clock = live.source if live.source is not None else max(live.channels, key=lambda number: rates[number])
        begin = {number: max(0, self._store.of(number).ring.total - MAX_PAST) for number in live.channels}
        return _Running(definition, live, 0, begin, {number: rates[number] for number in live.channels}, clock)

    def _begin(self, device: str, running: _Running) -> None:
        """Compute what memory holds, and follow from there on; in place of a signal of that name."""
        name = running.definition.name
        before = self._running.get((device, name))
        described = channel_of(device, running.definition, running.live.probe)
        known = self._store.get(before.channel) if before is not None else None
        is_same = before is not None and before.definition == running.definition
        if before is not None and known is not None and is_same and before.live.channels == running.live.channels:
            running.channel, running.next = before.channel, before.next  # only the rate changed
        else:
            if before is not None:
                self._store.remove_channel(before.channel)
            running.channel = self._bus.advertise(described)
        self._running[device, name] = running
        self._problems.pop((device, name), None)
        self._follow(device, running)
        if before is not None and before.channel != running.channel:
            self._begin_users(device, before.channel)

    def _begin_users(self, device: str, channel: int) -> None:
        """Restart the signals that use a channel which was replaced or removed."""
        for key, running in list(self._running.items()):
            if channel not in running.live.channels:
                continue
            try:
                self._begin(device, self._start(device, running.definition))
            except DomainError as error:
                del self._running[key]
                self._problems[key] = error
                self._store.remove_channel(running.channel)
                self._begin_users(device, running.channel)

    def _on_samples(self, channels: Iterable[int]) -> None:
        touched = set(channels)
        from_here = touched <= {running.channel for running in self._running.values()}
        for key, running in list(self._running.items()):
            if self._running.get(key) is not running:
                continue  # restarted in the meantime
            if (running.is_behind and not from_here) or not touched.isdisjoint(running.live.channels):
                self._follow(key[0], running)
        if from_here:
            return
        now = self._bus.now()
        if now >= self._next_sweep:
            self._next_sweep = now + SWEEP_S
            self._sweep()

    def _on_removed(self, device: str) -> None:
        used = set(self._store.of_device(device))
        for key, running in list(self._running.items()):
            if key[0] == device or not used.isdisjoint(running.live.channels):
                del self._running[key]
        self._problems = {key: problem for key, problem in self._problems.items() if key[0] != device}

    def _follow(self, device: str, running: _Running) -> None:
        rows = self._new_rows(running)
        if not rows:
            return
        try:
            piece = running.live.feed(rows)
        except Exception as error:  # one signal must not stop the others
            log.exception("a computed signal failed and was stopped")
            del self._running[device, running.definition.name]
            problem = DomainError("bad-expression", f"The signal stopped: {error}.", "Edit it to start it again.")
            self._problems[device, running.definition.name] = problem
            return
        if len(piece):
            self._bus.publish(
                [ChannelRows(running.channel, [_arrivals(running, rows, piece), piece.time, *piece.parts])]
            )
        elif running.clock in rows:
            _arrivals(running, rows, piece)

    def _new_rows(self, running: _Running) -> dict[int, Rows]:
        """The next rows of the channels, up to one moment, so that none runs ahead of the others."""
        by_channel: dict[int, Rows] = {}
        until = np.inf
        for number, start in running.next.items():
            stored = self._store.get(number)
            if stored is None or stored.ring.total <= start:
                continue
            running.next[number] = max(start, stored.ring.first)
            by_channel[number] = stored.ring.read(start)
            arrival = by_channel[number][0]
            if len(arrival) > STEP_SAMPLES:
                until = min(until, float(arrival[STEP_SAMPLES - 1]))
        running.is_behind = until < np.inf
        for number, columns in by_channel.items():
            count = int(np.searchsorted(columns[0], until, "right"))
            by_channel[number] = [column[:count] for column in columns]
            running.next[number] += count
        return {number: columns for number, columns in by_channel.items() if len(columns[0])}

    def _sweep(self) -> None:
        """Start the signals whose channels have come, and restart those whose rate has changed."""
        for device in self._bus.devices.latest.values():
            for definition in self.definitions.of(device):
                running = self._running.get((device.id, definition.name))
                if (
                    running is not None
                    and running.definition == definition
                    and not have_changed(self._store, running.rates)
                ):
                    continue
                try:
                    self._begin(device.id, self._start(device.id, definition))
                except DomainError as error:
                    self._problems[device.id, definition.name] = error


def _arrivals(running: _Running, rows: Mapping[int, Rows], piece: Piece) -> NDArray[np.float64]:
    """Arrival of samples: that of the sample from which they have their time."""
    arrival, time = running.recent
    if running.clock in rows:
        more, when = rows[running.clock][:2]
        when = np.where(np.isnan(when), more, when)
        arrival, time = np.concatenate((arrival, more)), np.maximum.accumulate(np.concatenate((time, when)))
    arrivals: NDArray[np.float64] = np.interp(piece.time, time, arrival) if len(time) else piece.time
    end = float(piece.time[-1]) if len(piece) else -np.inf
    keep = max(0, int(np.searchsorted(time, end, "left")) - 1)
    running.recent = [arrival[keep:], time[keep:]]
    return np.maximum.accumulate(arrivals)


def channel_of(device: str, definition: SignalDefinition, value: Quantity) -> ChannelInfo:
    """Description of the channel of a signal, given what its expression gives."""
    names, unit = value.names, str(value.unit)
    columns = [
        ColumnInfo(
            name=name or "value",
            dtype="f8",
            unit=unit,
            label="" if name else definition.name,
            axis=_AXES.get(name, ""),  # type: ignore[arg-type]
            period=value.period,
        )
        for name in names
    ]
    return ChannelInfo(
        id=0,
        device=device,
        message=MESSAGE,
        name=definition.name,
        title=definition.name,
        kind="scalar" if len(columns) == 1 else "vector",
        unit=unit,
        frame="",
        columns=columns,
        doc=f"Computed: {definition.expression}",
        group="Computed",
    )


def signals_part(services: "Services") -> ServicePart:
    """The computed signals of a server."""
    definitions, telemetry = services.recorder.signals, services.telemetry
    assert definitions is not None  # that of a server has them
    return ServicePart("computed signals", DerivedChannels(telemetry.bus, telemetry.store, definitions))


def used_by(definition: SignalDefinition, names: Sequence[str]) -> list[str]:
    """Those of the names of computed signals that an expression uses; none if it has a mistake."""
    try:
        named = {one.name.partition(".")[0] for one in names_in(parse(definition.expression))}
    except ExpressionError:
        return []
    return [name for name in names if name in named]


def in_order(definitions: Sequence[SignalDefinition]) -> list[SignalDefinition]:
    """The definitions, each after those that it uses; those of a cycle come last, as given."""
    names = [one.name for one in definitions]
    waiting = {one.name: (one, {*used_by(one, names)}) for one in definitions}
    ordered: list[SignalDefinition] = []
    while ready := [name for name, (_, uses) in waiting.items() if uses.isdisjoint(waiting)]:
        ordered += [waiting.pop(name)[0] for name in ready]
    return ordered + [one for one, _ in waiting.values()]


def cycle_of(definition: SignalDefinition, others: Sequence[SignalDefinition]) -> list[str]:
    """Names from a definition back to itself, along what each uses; empty if there is no such way."""
    known = {one.name: one for one in others} | {definition.name: definition}
    ways = [[definition.name]]
    visited: set[str] = set()
    for way in ways:  # grows while it is walked: the shortest way comes first
        for name in used_by(known[way[-1]], list(known)):
            if name == definition.name:
                return [*way, name]
            if name not in visited:
                visited.add(name)
                ways.append([*way, name])
    return []
