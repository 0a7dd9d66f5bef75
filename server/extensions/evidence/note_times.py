"""Times in notes that lead to a moment or a range: `[14:32:18.500]`, `[14:32:18 – 14:32:20]`, `[2026-11-21 14:32:18]`.

As on the page (web/src/extensions/notes/panel.tsx): UTC; without a day the first such time from the beginning of the
recording on.
"""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime

_CLOCK = r"(?:(\d{4}-\d\d-\d\d) )?(\d\d):(\d\d):(\d\d(?:\.\d{1,7})?)"
_TIMES = re.compile(rf"\[{_CLOCK}(?:\s*[–-]\s*{_CLOCK})?\]")
DAY_S = 86_400


def pieces_of(text: str, first: float) -> list[tuple[str, float | None, float | None]]:
    """Pieces of a text, each with its moment, or with both ends of its range; None: plain text.

    Args:
        first: beginning of the recording, unix s.
    """
    pieces: list[tuple[str, float | None, float | None]] = []
    at = 0
    for match in _TIMES.finditer(text):
        words = match.groups()
        t0 = _moment(words[:4], math.floor(first))
        t1 = None if t0 is None or words[5] is None else _moment(words[4:], t0)
        if t0 is None:
            continue
        pieces += [(text[at : match.start()], None, None), (match[0][1:-1], t0, t1)]
        at = match.end()
    return [piece for piece in [*pieces, (text[at:], None, None)] if piece[0]]


def _moment(words: tuple[str | None, ...], begin: float) -> float | None:
    """The moment of a clock; None: there is no such day."""
    day, hours, minutes, seconds = words
    time = 3600 * float(hours or 0) + 60 * float(minutes or 0) + float(seconds or 0)
    if day is not None:
        try:
            return datetime.strptime(day, "%Y-%m-%d").replace(tzinfo=UTC).timestamp() + time
        except ValueError:
            return None
    moment = begin // DAY_S * DAY_S + time
    return moment + DAY_S if moment < begin else moment
