"""Time limits of a server towards its viewers. Tests pass shorter ones."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ViewerTimings:
    """Time limits, s.

    Args:
        stuck_s: a browser that accepts no byte for this long is disconnected.
        scene_idle_s: a scene in viser without viewers is kept for this long; the process ends with its last scene.
    """

    stuck_s: float = 5.0
    scene_idle_s: float = 15.0
