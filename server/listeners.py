"""Who else wants to hear of something? Callbacks that come and go; none can harm the others, or who calls them."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Generic, ParamSpec

log = logging.getLogger("imuscope.listeners")
Heard = ParamSpec("Heard")


class CallbackList(Generic[Heard]):
    """Callbacks for one sort of news, called in the order in which they came.

    A callback that raises is logged and hears no more: whoever brings the news must not fail by who listens.
    """

    def __init__(self) -> None:
        self._callbacks: list[Callable[Heard, None]] = []

    def add(self, callback: Callable[Heard, None]) -> Callable[[], None]:
        """Call `callback` from now on; returns what takes it off again (more than once does no harm)."""
        self._callbacks.append(callback)
        return lambda: self._take_off(callback)

    def __bool__(self) -> bool:
        return bool(self._callbacks)

    def tell(self, *args: Heard.args, **kwargs: Heard.kwargs) -> None:
        """Call them all; one that takes itself off meanwhile does not disturb the others."""
        for callback in tuple(self._callbacks):
            try:
                callback(*args, **kwargs)
            except Exception:
                log.exception("a listener failed and hears no more")
                self._take_off(callback)

    def _take_off(self, callback: Callable[Heard, None]) -> None:
        if callback in self._callbacks:
            self._callbacks.remove(callback)
