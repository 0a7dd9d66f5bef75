"""Events of devices and of the server."""

from dataclasses import dataclass, field
from typing import Any, Literal

EventKind = Literal["gap", "reject", "clock", "link", "reply", "text", "marker", "device", "command", "alarm"]
Level = Literal["info", "warning", "error"]


@dataclass(slots=True)
class EventInfo:
    """An event. `t0`..`t1` (host time) is the time span concerned, for example hatched as a gap."""

    seq: int
    time: float
    device: str  # "" for the server itself
    kind: EventKind
    level: Level
    text: str
    t0: float | None = None
    t1: float | None = None
    samples: int = 0
    data: dict[str, Any] = field(default_factory=dict)
