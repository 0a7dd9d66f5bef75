"""HTTP API of the Recordings page: the shapes of the HTTP API under /api/recordings (…).

docs/http-api.md lists the routes, with their bodies and answers.

Times are unix seconds. The ops `recorder`, `library` and `exports` of the WebSocket report changes.
"""

from dataclasses import dataclass, field
from typing import Any, Literal

from imuscope.recordings.library.recording_probe import RecordedDevice
from imuscope.recordings.sidecar import MarkerInfo
from imuscope.server.wire import ChannelInfo, DeviceInfo, EventInfo


@dataclass(slots=True)
class RecordingInfo:
    """Row of the library: file, size, times, devices and notes."""

    id: str  # the file's name without suffix
    title: str
    file: str  # name of the file
    format: str  # "mcap", "mtb", "raw", "dat", "bin", "csv"
    size: int  # bytes
    started: float | None
    duration: float | None  # s; null if unknown
    devices: list[RecordedDevice]
    tags: list[str] = field(default_factory=list)
    notes: str = ""
    pinned: bool = False
    recording: bool = False  # still being recorded
    opened: bool = False  # already decoded, so it opens at once
    damaged: str = ""  # one sentence; "" if undamaged
    remark: str = ""  # sentences: what of it is left out, and how it was read
    markers: int = 0
    read: bool = False  # its contents are known: motion, losses, counts
    motion: str = ""  # what the thumbnail shows: "|a|", "attitude", "|rate of turn|" or the title of a quantity
    thumbnail: list[list[float]] = field(default_factory=list)  # min and max of each part, 0..1; [] without samples
    losses: list[float] = field(default_factory=list)  # positions of lost samples, 0..1 of the duration
    marks: list[float] = field(default_factory=list)  # those of markers
    deleted: float | None = None  # time of deletion, while it is in the bin


@dataclass(slots=True)
class LibraryStorage:
    """Disk space of the library, bytes."""

    used: int  # by recordings, also those in the bin
    free: int  # on its disk
    quota: int = 0  # above which the oldest unpinned recordings are deleted; 0 for none


@dataclass(slots=True)
class OpeningState:
    """A recording that is being decoded for the first time."""

    id: str
    progress: float  # 0..1
    message: str


@dataclass(slots=True)
class RecordingDetail:
    """Details of an opened recording, without its samples."""

    info: RecordingInfo
    t0: float
    t1: float
    devices: list[DeviceInfo]
    channels: list[ChannelInfo]
    events: list[EventInfo]
    markers: list[MarkerInfo]
    snapshots: dict[str, dict[str, Any]] = field(default_factory=dict)  # device → configuration
    longest_s: dict[str, float] = field(default_factory=dict)  # channel id → usual time between samples
    progress: float = 1.0  # below 1 while it is decoded for the first time: the decoded share
    begins: dict[str, float] = field(default_factory=dict)  # device → time of its first sample


@dataclass(slots=True)
class SettingRow:
    title: str  # of the field; "" if the setting has only one
    words: str  # "400 Hz", "ENU"


@dataclass(slots=True)
class RecordedSetting:
    """A setting of a device at the time of recording."""

    name: str
    title: str
    group: str
    rows: list[SettingRow]


@dataclass(slots=True)
class RecordedSettings:
    settings: list[RecordedSetting]  # in the order of Configure
    missing: dict[str, str] = field(default_factory=dict)  # title → why it could not be read


@dataclass(slots=True)
class StartRequest:
    devices: list[str] | None = None  # null: all
    title: str = ""
    before_s: float = 0.0  # begin with the bytes of the last seconds, as far as they are in memory
    with_head: bool | None = None  # request the Configuration of an MTi, which pauses it for about 90 ms; null: as
    # `record_head` of the configuration says


@dataclass(slots=True)
class SaveMemoryRequest:
    devices: list[str] | None = None  # null: all
    seconds: float | None = None  # the last ones only; null: everything in memory
    t0: float | None = None  # instead of `seconds`: only bytes that arrived from t0 on …
    t1: float | None = None  # … and before t1
    title: str = ""


@dataclass(slots=True)
class SavedMemory:
    """A recording made of the bytes in memory."""

    id: str
    devices: list[str]
    t0: float  # time of its first bytes
    t1: float  # time of its last bytes
    bytes: int  # received and sent


@dataclass(slots=True)
class HeldBytes:
    """Bytes of a link that are in memory."""

    device: str
    t0: float
    t1: float
    size: int  # of memory


@dataclass(slots=True)
class MarkerRequest:
    text: str = ""
    kind: Literal["marker", "note"] = "marker"
    time: float | None = None  # null: now
    device: str = ""


@dataclass(slots=True)
class EditRequest:
    """Changes to a recording; null leaves a value unchanged."""

    title: str | None = None
    tags: list[str] | None = None
    notes: str | None = None
    notes_before: str | None = None  # notes that were read: refused with 412 if they are others by now; null: replaced
    pinned: bool | None = None
    file: str | None = None  # new name of the file, which changes the id; the suffix stays


@dataclass(slots=True, kw_only=True)
class ExportSelection:
    """Part of a recording to export or measure."""

    t0: float | None = None  # null: from the beginning
    t1: float | None = None
    channels: list[int] | None = None  # null: all
    base: Literal["device", "arrival"] = "device"


@dataclass(slots=True)
class ExportJobRequest(ExportSelection):
    format: str  # a name of ExportCapability
    device: str = ""  # for formats of one device
    units: Literal["shown", "SI", "device"] = "shown"  # of the values, if the format takes them


@dataclass(slots=True)
class KeepRequest:
    """A range of a recording that becomes a recording of its own."""

    t0: float
    t1: float
    base: Literal["device", "arrival"] = "device"
    title: str = ""


@dataclass(slots=True)
class ExportSizes:
    """Estimated sizes of exports, bytes, without those that could not be measured."""

    sizes: dict[str, int] = field(default_factory=dict)  # format → size
    devices: dict[str, int] = field(default_factory=dict)  # device → its received bytes


@dataclass(slots=True)
class PlayRequest:
    speed: float = 1.0
    loop: bool = False
    t0: float | None = None
    t1: float | None = None
