"""Exponential backoff: each pause between attempts is twice as long as the previous one, up to a maximum."""

LOCAL_S = 0.2, 2.0
"""First and longest pause before a local port is opened again that is there, and in use or not permitted. One that is
not there is opened as soon as it is (`terminals.standing_at`); pauses that grow are for others' networks."""


class Backoff:
    """The pauses between attempts of one operation, s."""

    def __init__(self, first_s: float, longest_s: float) -> None:
        self._first_s, self._longest_s = first_s, longest_s
        self._next_s = first_s

    def next(self) -> float:
        """The pause before the next attempt, s."""
        pause, self._next_s = self._next_s, min(2 * self._next_s, self._longest_s)
        return pause

    def reset(self) -> None:
        """Start with the first pause again, after a success."""
        self._next_s = self._first_s
