"""Callback list; an exception in one callback does not affect the others or the caller."""

import logging
from collections.abc import Callable
from typing import Generic, ParamSpec

log = logging.getLogger("imuscope.listeners")
Arguments = ParamSpec("Arguments")


class CallbackList(Generic[Arguments]):
    """Callbacks for one kind of event, called in the order in which they were added.

    A callback that raises is logged and called again the next time: one odd message must not end a recording or an
    alarm for good. One that goes on failing is logged at the 1st, 2nd, 4th, 8th … failure.
    """

    def __init__(self) -> None:
        self._callbacks: list[Callable[Arguments, None]] = []
        self._failures: dict[Callable[Arguments, None], int] = {}

    def add(self, callback: Callable[Arguments, None]) -> Callable[[], None]:
        """Add a callback; returns a function that removes it, which may be called more than once."""
        self._callbacks.append(callback)
        return lambda: self._remove(callback)

    def __bool__(self) -> bool:
        return bool(self._callbacks)

    def call(self, *args: Arguments.args, **kwargs: Arguments.kwargs) -> None:
        """Call all callbacks; a callback may remove itself during the call."""
        for callback in tuple(self._callbacks):
            try:
                callback(*args, **kwargs)
            except Exception:
                count = self._failures[callback] = self._failures.get(callback, 0) + 1
                if count & (count - 1) == 0:
                    log.exception("a callback failed (%d so far)", count, extra={"failures": count})

    def _remove(self, callback: Callable[Arguments, None]) -> None:
        if callback in self._callbacks:
            self._callbacks.remove(callback)
        self._failures.pop(callback, None)
