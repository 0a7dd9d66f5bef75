"""What the Recordings page and the server say to each other: the shapes of the HTTP API under /api/recordings.

    GET    /api/recordings?q=                     list[RecordingInfo], newest first
    POST   /api/recordings/start   Start          RecorderState: record these devices
    POST   /api/recordings/stop    {}             RecorderState
    POST   /api/recordings/mark    Mark           drops a marker or a note into what is being recorded
    PUT    /api/recordings/upload?name=…          application/octet-stream, whatever can be imported: RecordingInfo
    GET    /api/recordings/{id}?partial=0|1       RecordingDetail; opens it: until then 202 with an OpeningState,
                                                  with partial=1 as soon as something is decoded a RecordingDetail of it
    GET    /api/recordings/{id}/fared?device&t0&t1  Fared (recordings/health_history.py): how a device fared, by seconds
    GET    /api/recordings/{id}/settings?device    RecordedSettings: what a device was set to, in words
    PATCH  /api/recordings/{id}    Edit           title, tags, notes, pinned, file: RecordingInfo, of another id then
    DELETE /api/recordings/{id}                   into the bin: RecordingInfo
    POST   /api/recordings/{id}/undelete {}       and back, within 7 days
    POST   /api/recordings/{id}/markers  Mark     a marker or note put in later
    GET    /api/recordings/{id}/window?t0&t1&width&base&channels&partial
                                                  application/octet-stream: sample frames of the wire (server/wire.py);
                                                  where rows are summarised a bucket is two rows: least, then greatest
                                                  (of flags: of any, of all), and the answer says X-Exact: 0
    GET    /api/recordings/{id}/query?channel&t0&t1&width&columns&base&format=arrow|json
    GET    /api/devices/{id}/query?…              the same of a live device
    GET    /api/recordings/{id}/download          the file with everything in it (application/x-mcap)
    GET    /api/recordings/{id}/original?device   the bytes as they came, one device
    POST   /api/recordings/{id}/exports  Export   ExportJob, run in the background
    POST   /api/recordings/{id}/export-sizes  ExportPart   ExportSizes, found by writing samples
    GET    /api/recordings/exports                list[ExportJob]
    GET    /api/recordings/exports/{job}/file     what it made (a zip where it is several files)
    DELETE /api/recordings/exports/{job}          cancels it, or forgets it
    POST   /api/recordings/{id}/play     Play     a replay as a source: DeviceInfo of each device that appears

Times are unix seconds. The ops `recorder`, `library` and `exports` of the WebSocket tell of changes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from server.wire import ChannelInfo, DeviceInfo, EventInfo

ExportFormat = Literal["csv", "csv-aligned", "parquet", "mcap", "rrd", "mtb", "raw", "bytes"]


@dataclass(slots=True)
class RecordedDevice:
    """One device in a recording, as the list tells it."""

    id: str
    name: str
    protocol: str
    product: str
    serial_number: str
    messages: int | None  # frames; 0 where it sent nothing, null until they have been counted
    lost: int
    rejects: int


@dataclass(slots=True)
class RecordingInfo:
    """One recording, as the list tells it."""

    id: str  # the file's name without suffix
    title: str
    file: str  # name of the file
    format: str  # "mcap", "mtb", "raw", "dat", "bin", "csv"
    size: int  # bytes
    started: float | None
    duration: float | None  # s; null while it is not known
    devices: list[RecordedDevice]
    tags: list[str] = field(default_factory=list)
    notes: str = ""
    pinned: bool = False
    recording: bool = False  # it is being recorded now
    opened: bool = False  # its columns are there: it opens at once
    damaged: str = ""  # one sentence; "" when it is whole
    markers: int = 0
    thumbnail: list[list[float]] = field(default_factory=list)  # least and greatest of |rate of turn| or such, 0..1
    losses: list[float] = field(default_factory=list)  # where samples were lost, 0..1 of the duration
    deleted: float | None = None  # when, while it is in the bin


@dataclass(slots=True)
class Marker:
    time: float
    kind: Literal["marker", "note"]
    text: str
    device: str = ""
    id: int = 0


@dataclass(slots=True)
class OpeningState:
    """A recording that is being decoded for the first time."""

    id: str
    progress: float  # 0..1
    message: str


@dataclass(slots=True)
class RecordingDetail:
    """Everything about an opened recording but its samples."""

    info: RecordingInfo
    t0: float
    t1: float
    devices: list[DeviceInfo]
    channels: list[ChannelInfo]
    events: list[EventInfo]
    markers: list[Marker]
    snapshots: dict[str, dict[str, Any]] = field(default_factory=dict)  # device → configuration
    longest_s: dict[str, float] = field(default_factory=dict)  # channel id → usual time between samples
    progress: float = 1.0  # less while it is decoded for the first time: as much of it is there


@dataclass(slots=True)
class SettingRow:
    title: str  # of the field; "" where a setting has but one
    words: str  # "400 Hz", "ENU"


@dataclass(slots=True)
class RecordedSetting:
    """What one setting of a device was when it was recorded."""

    name: str
    title: str
    group: str
    rows: list[SettingRow]


@dataclass(slots=True)
class RecordedSettings:
    settings: list[RecordedSetting]  # in the order of Configure
    missing: dict[str, str] = field(default_factory=dict)  # title → why it could not be read


@dataclass(slots=True)
class Start:
    devices: list[str] | None = None  # null: all
    title: str = ""


@dataclass(slots=True)
class Mark:
    text: str = ""
    kind: Literal["marker", "note"] = "marker"
    time: float | None = None  # null: now
    device: str = ""


@dataclass(slots=True)
class Edit:
    """What is null stays."""

    title: str | None = None
    tags: list[str] | None = None
    notes: str | None = None
    pinned: bool | None = None
    file: str | None = None  # another name for its file, and so another id; the suffix stays


@dataclass(slots=True, kw_only=True)
class ExportPart:
    """Which part of a recording is exported, or measured."""

    t0: float | None = None  # null: from the beginning
    t1: float | None = None
    channels: list[int] | None = None  # null: all
    base: Literal["device", "arrival"] = "device"


@dataclass(slots=True)
class Export(ExportPart):
    format: ExportFormat
    device: str = ""  # for formats that hold one device


@dataclass(slots=True)
class ExportSizes:
    """About how large exports would be, bytes; what could not be measured is left out."""

    sizes: dict[str, int] = field(default_factory=dict)  # format → size
    devices: dict[str, int] = field(default_factory=dict)  # device → its bytes as they came


@dataclass(slots=True)
class Play:
    speed: float = 1.0
    loop: bool = False
    t0: float | None = None
    t1: float | None = None
