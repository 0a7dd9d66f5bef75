"""What does a scene show of a recording, in step with a page's player?

The page says where it reads and how fast it plays, a few times a second; in between the head moves on here by itself,
so that the scene is smooth:

    head(now) = t + (now − heard) · rate            rate 0: paused

Each row that is shown is the newest one at the head. A track is made anew when the head has jumped.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from recordings.column_store import ColumnStore
from server.integrations.poses import TRACK_S, looks_of

JUMP_S = 2.0  # further than that between two looks, in what is played: a jump, unless it plays that fast
TRACK_ROWS = 2000

SceneRows = dict[str, list[list[float]]]


class ReplayFollower:
    """One recording, read at a head that a page moves.

    Args:
        now: monotonic, s.
    """

    def __init__(self, store: ColumnStore, now: Callable[[], float] = time.monotonic) -> None:
        self._store = store
        self._now = now
        self.devices: list[Mapping[str, Any]] = store.manifest["devices"]
        self.channels: list[Mapping[str, Any]] = store.manifest["channels"]
        looks = looks_of(self.devices, self.channels)
        self._used = [number for look in looks for number in look.channels]
        self._places = [look.position.channel for look in looks if look.position]
        first, last = store.span() or (0.0, 0.0)
        self._first, self._last = first, last
        self._t, self._rate, self._heard = first, 0.0, now()
        self._shown: float | None = None

    def move(self, t: float, rate: float) -> None:
        """The page reads there, and goes on at that rate (recorded seconds in a second)."""
        self._t, self._rate, self._heard = t, min(max(rate, 0.0), 1000.0), self._now()

    @property
    def head(self) -> float:
        """Where it is read now, unix s."""
        t = self._t + (self._now() - self._heard) * self._rate
        return min(max(t, self._first), self._last)

    def begin_again(self) -> None:
        """Whoever was shown something has forgotten it."""
        self._shown = None

    def news(self) -> dict[str, SceneRows] | None:
        """What is to be shown that was not, None when nothing is.

        Returns:
            "rows": by channel, arrival, time and the channel's columns, newest row only; "past": the same with many
            rows, where a track begins anew.
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
