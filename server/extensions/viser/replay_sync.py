"""Scene of a recording, synchronised with the player of a page.

The page sends its position and speed a few times a second; in between the playhead moves by itself, so that the scene
is smooth:

    head(now) = t + (now − received) · rate         rate 0: paused

The newest row at the playhead is shown. A track restarts when the playhead has jumped.
"""

import time
from collections.abc import Callable, Mapping
from typing import Any

from imuscope.recordings.columns.store import ColumnStore
from imuscope.server.extensions.viser.poses import TRACK_S, device_views

JUMP_S = 2.0  # a larger step of the playhead between two updates is a jump, unless the speed explains it
TRACK_ROWS = 2000

SceneRows = dict[str, list[list[float]]]


class ReplayFollower:
    """One recording at a playhead that a page moves.

    Args:
        now: monotonic, s.
    """

    def __init__(self, store: ColumnStore, now: Callable[[], float] = time.monotonic) -> None:
        self._store = store
        self._now = now
        self.devices: list[Mapping[str, Any]] = store.manifest["devices"]
        self.channels: list[Mapping[str, Any]] = store.manifest["channels"]
        views = device_views(self.devices, self.channels)
        self._used = [number for view in views for number in view.channels]
        self._places = [view.position.channel for view in views if view.position]
        first, last = store.span() or (0.0, 0.0)
        self._first, self._last = first, last
        self._t, self._rate, self._on_state = first, 0.0, now()
        self._shown: float | None = None

    def move(self, t: float, rate: float) -> None:
        """Set position and rate (recorded seconds per second) of the page."""
        self._t, self._rate, self._on_state = t, min(max(rate, 0.0), 1000.0), self._now()

    @property
    def head(self) -> float:
        """Playhead, unix s."""
        t = self._t + (self._now() - self._on_state) * self._rate
        return min(max(t, self._first), self._last)

    def restart(self) -> None:
        """Start over after the viewer lost its state."""
        self._shown = None

    def changes(self) -> dict[str, SceneRows] | None:
        """Changes to show; None if there are none.

        Returns:
            "rows": by channel, arrival, time and the channel's columns, newest row only; "past": the same with many
            rows, if a track restarts.
        """
        head, shown = self.head, self._shown
        if shown == head:
            return None
        self._shown = head
        out = {"rows": {str(number): rows for number in self._used if (rows := self._row(number, head))}}
        if shown is None or not 0 <= head - shown <= max(JUMP_S, self._rate):
            out["past"] = {str(number): self._past(number, head) for number in self._places}
        return out

    def _row(self, number: int, t: float) -> list[list[float]]:
        at = self._store.row_at(number, t)
        return [] if at < 0 else _plain(self._store.exact(number, at, at + 1))

    def _past(self, number: int, t: float) -> list[list[float]]:
        return _plain(self._store.thinned(number, t - TRACK_S, t, TRACK_ROWS))


def _plain(rows: Any) -> list[list[float]]:
    return [[float(value) for value in column] for column in (rows.arrival, rows.time, *rows.columns)]
