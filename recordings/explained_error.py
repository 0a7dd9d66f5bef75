"""Errors that a user can do something about."""

from __future__ import annotations


class ExplainedError(Exception):
    """A failure: one sentence, and what to do."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message, self.hint = message, hint

    @property
    def text(self) -> str:
        """The sentence and what to do, for a line of text."""
        return f"{self.message} {self.hint}".strip()
