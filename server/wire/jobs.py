"""Configuration of a device: its jobs, a pending rollback, the frames of its transactions."""

from dataclasses import dataclass, field
from typing import Any, Literal

from imuscope.server.wire.events import Level


@dataclass(slots=True)
class TrafficEntry:
    """One frame of a transaction, or a note between frames."""

    seq: int
    time: float
    device: str
    direction: Literal["tx", "rx", "note"]
    name: str  # of the frame: "SetOutputConfiguration"; "" for a note
    hex: str = ""
    text: str = ""  # decoded content or result: "12 of 12 entries as requested"
    ms: float | None = None  # for an answer: time since the request
    level: Level = "info"


@dataclass(slots=True)
class FieldOutcome:
    """A field whose requested value the device did not accept."""

    setting: str
    path: str
    title: str
    requested: str
    actual: str  # "" if it was rejected
    reason: str = ""  # if there is no answer or it was rejected


@dataclass(slots=True)
class Job:
    """One task of a device, queued, running or finished."""

    id: int
    device: str
    title: str  # "Write Output configuration"
    state: Literal["waiting", "running", "done", "failed", "stopped"]
    step: str = ""  # current step: "GoToConfig, second try"
    message: str = ""  # result of a finished job, one sentence
    hint: str = ""
    snapshot: str = ""  # name of the snapshot taken before or by the job
    values: dict[str, Any] = field(default_factory=dict)  # the answer of a command
    outcomes: list[FieldOutcome] = field(default_factory=list)
    started: float | None = None
    ended: float | None = None


@dataclass(slots=True)
class PendingRollback:
    """Settings that are rolled back unless the user confirms them."""

    device: str
    state: Literal["applying", "pending", "rolling-back", "confirmed", "rolled-back", "unreachable"]
    changes: list[str]  # as text: "Baud rate 115 200 → 921 600"
    words: str  # "The device answers at 921 600 Bd. Unless confirmed, it goes back to 115 200 Bd."
    deadline: float | None = None  # unix seconds, while pending
    seconds: float = 20.0


@dataclass(slots=True)
class DeviceJobs:
    """Queue and state of one device."""

    device: str
    state: str  # "Measurement", "Config", "" if the protocol has no states
    running: Job | None = None
    queue: list[Job] = field(default_factory=list)
    done: list[Job] = field(default_factory=list)  # the last five, newest first
    pending_rollback: PendingRollback | None = None
    unfinished: str = ""  # unfinished work of a command, lost on a change of state: a reset that is not stored
