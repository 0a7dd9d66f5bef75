"""State of the recorder and of exports."""

from dataclasses import dataclass, field
from typing import Literal


@dataclass(slots=True)
class RecorderState:
    """Whether a recording runs, its file, size and problem."""

    running: bool
    id: str = ""  # RecordingInfo.id of the file being written
    title: str = ""
    devices: list[str] = field(default_factory=list)
    started: float | None = None  # unix seconds
    bytes: int = 0  # size of this recording, all parts
    behind_s: float = 0.0  # age of the oldest byte not yet passed to the disk
    free: int | None = None  # free bytes on the disk
    seconds_left: float | None = None  # until the disk is full, at the present rate
    message: str = ""  # why it stopped unexpectedly; "" otherwise
    hint: str = ""
    headless: list[str] = field(default_factory=list)  # names of MTi whose configuration is not in it, for an .mtb
    op: Literal["recorder"] = "recorder"


@dataclass(slots=True)
class ExportJob:
    """State, progress and result of an export."""

    id: int
    recording: str
    format: str
    title: str  # description: "CSV, 12.5 s, 3 channels"
    state: Literal["waiting", "running", "done", "failed", "cancelled"]
    progress: float = 0.0  # 0..1
    size: int = 0
    file: str = ""
    message: str = ""
    hint: str = ""
