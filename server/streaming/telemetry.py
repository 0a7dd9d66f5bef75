"""Assembly of the streaming part of a server: store, event log, bus, clients."""

from collections.abc import Callable
from dataclasses import dataclass

from imuscope.server.streaming.bus import TelemetryBus
from imuscope.server.streaming.channel_store import BUDGET_BYTES, HISTORY_S, ChannelStore
from imuscope.server.streaming.clients import ClientFanout
from imuscope.server.streaming.event_log import EventLog
from imuscope.server.streaming.shedding import Shedding
from imuscope.server.wire.capabilities import Capabilities


@dataclass(frozen=True, slots=True)
class Telemetry:
    """Streaming part of a server. Publishers and subscribers need only the bus, senders to clients only `clients`."""

    store: ChannelStore
    log: EventLog
    bus: TelemetryBus
    clients: ClientFanout
    shedding: Shedding

    @classmethod
    def create(
        cls,
        now: Callable[[], float],
        *,
        history_s: float = HISTORY_S,
        budget: int = BUDGET_BYTES,
        reserved: Callable[[], int] = lambda: 0,
        capabilities: Capabilities | None = None,
    ) -> "Telemetry":
        """Create all parts, empty.

        Args:
            now: unix seconds that never step (server/links/base.py `steady_clock`).
            history_s, budget, reserved: see ChannelStore.
            capabilities: capabilities of this server, sent to clients.
        """
        store = ChannelStore(now, history_s, budget, reserved)
        log = EventLog(history_s)
        bus = TelemetryBus(now, store, log)
        shedding = Shedding()
        clients = ClientFanout(bus, store, log, capabilities or Capabilities(), shedding)
        return cls(store, log, bus, clients, shedding)
