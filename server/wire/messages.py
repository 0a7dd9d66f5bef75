"""Messages: text frames in both directions, distinguished by `op`."""

from dataclasses import dataclass, field
from typing import Literal

from imuscope.server.wire.capabilities import Capabilities
from imuscope.server.wire.channels import ChannelInfo
from imuscope.server.wire.devices import DeviceHealth, DeviceInfo, UnknownPayload
from imuscope.server.wire.events import EventInfo
from imuscope.server.wire.jobs import DeviceJobs, TrafficEntry
from imuscope.server.wire.recordings import ExportJob, RecorderState


@dataclass(slots=True)
class Hello:
    version: str
    server_time: float
    host: str
    run: str  # changes when the server restarts; the page then discards its channels
    history: float  # seconds kept in memory
    capabilities: Capabilities = field(default_factory=Capabilities)
    role: Literal["view", "control"] = "control"  # what the token of this client allows
    op: Literal["hello"] = "hello"


@dataclass(slots=True)
class Devices:
    devices: list[DeviceInfo]
    op: Literal["devices"] = "devices"


@dataclass(slots=True)
class Channels:
    channels: list[ChannelInfo]
    op: Literal["channels"] = "channels"


@dataclass(slots=True)
class HealthReport:
    devices: list[DeviceHealth]
    op: Literal["health"] = "health"


@dataclass(slots=True)
class UnknownPayloads:
    payloads: list[UnknownPayload]
    op: Literal["unknown_payloads"] = "unknown_payloads"


@dataclass(slots=True)
class Events:
    events: list[EventInfo]
    op: Literal["events"] = "events"


@dataclass(slots=True)
class LibraryChanged:
    op: Literal["library"] = "library"


@dataclass(slots=True)
class Exports:
    jobs: list[ExportJob]
    op: Literal["exports"] = "exports"


@dataclass(slots=True)
class JobsReport:
    devices: list[DeviceJobs]
    op: Literal["jobs"] = "jobs"


@dataclass(slots=True)
class Traffic:
    entries: list[TrafficEntry]
    op: Literal["traffic"] = "traffic"


@dataclass(slots=True)
class HistoryEnd:
    op: Literal["history_end"] = "history_end"


@dataclass(slots=True)
class Pong:
    t: float
    server_time: float
    op: Literal["pong"] = "pong"


@dataclass(slots=True)
class Problem:
    """The shape of every error, here and in HTTP responses."""

    kind: str
    message: str
    hint: str = ""
    op: Literal["error"] = "error"


@dataclass(slots=True)
class Subscribe:
    """The page discards its samples, appends live frames and prepends history frames (newest block first, each
    ending where the previous one began; flags bit 0).
    """

    history: float  # seconds of history wanted, before the newest sample of each device
    channels: list[int] | None = None  # None: all, also future ones
    units: Literal["shown", "device"] = "shown"  # of the samples: those of the page, or `sent_unit` of their columns
    op: Literal["subscribe"] = "subscribe"


@dataclass(slots=True)
class Interval:
    """Drawing interval of the page: a longer one reduces the load of server, network and page."""

    s: float  # minimum time between sample frames; 0: as often as the server sends
    op: Literal["interval"] = "interval"


@dataclass(slots=True)
class Ping:
    t: float
    op: Literal["ping"] = "ping"


ServerText = (
    Hello
    | Devices
    | Channels
    | HealthReport
    | UnknownPayloads
    | Events
    | JobsReport
    | Traffic
    | RecorderState
    | LibraryChanged
    | Exports
    | HistoryEnd
    | Pong
    | Problem
)
BrowserText = Subscribe | Interval | Ping
