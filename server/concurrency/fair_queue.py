"""Slots that users take turns at: a user who asks a hundred questions does not make another wait for all of them.

`at_once` slots in all, `each` for one user. A free slot goes to the user who was served longest ago among those who
wait; the requests of one user are served in their order.
"""

import asyncio
from collections import Counter, OrderedDict
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

MOST_USERS = 1024  # whose last turn is known


class QueueFullError(Exception):
    """A user has as many requests waiting as are allowed."""


class Turn:
    """A request for a slot, running or waiting."""

    __slots__ = ("_granted", "user")

    def __init__(self, user: str) -> None:
        self.user = user
        self._granted = asyncio.Event()

    @property
    def is_running(self) -> bool:
        return self._granted.is_set()

    def grant(self) -> None:
        """Give it the slot."""
        self._granted.set()

    async def granted(self) -> None:
        """Wait for the slot."""
        await self._granted.wait()


class FairQueue:
    """Slots for requests of several users.

    Args:
        at_once: slots in all.
        each: slots of one user at most.
        waiting_each: requests of one user that may wait.
    """

    def __init__(self, at_once: int, each: int, waiting_each: int) -> None:
        self.at_once, self._each, self._waiting_each = at_once, each, waiting_each
        self._running: Counter[str] = Counter()
        self._waiting: dict[str, list[Turn]] = {}
        self._served: OrderedDict[str, int] = OrderedDict()  # when a user last got a slot, as a number that grows
        self._number = 0

    @property
    def running(self) -> int:
        return self._running.total()

    @property
    def waiting(self) -> int:
        return sum(map(len, self._waiting.values()))

    @asynccontextmanager
    async def turn(self, user: str) -> AsyncIterator[Turn]:
        """Stand in the queue within the `with`; `turn.granted()` waits for the slot, which is held until its end.

        Raises:
            QueueFullError: too many requests of this user wait.
        """
        if len(self._waiting.get(user, ())) >= self._waiting_each:
            raise QueueFullError
        turn = Turn(user)
        self._waiting.setdefault(user, []).append(turn)
        self._serve()
        try:
            yield turn
        finally:
            if turn.is_running:
                self._running[user] -= 1
                self._running += Counter()  # without the users who have none
            else:
                self._leave(turn)
            self._serve()

    def before(self, turn: Turn) -> int:
        """Number of waiting requests that come before this one, as things are now; 0 if it runs."""
        if turn.is_running:
            return 0
        own = self._waiting[turn.user].index(turn)
        users = self._users()
        at = users.index(turn.user)
        others = (min(len(self._waiting[user]), own + (place < at)) for place, user in enumerate(users) if place != at)
        return own + sum(others)

    def _serve(self) -> None:
        while self.running < self.at_once:
            user = next((one for one in self._users() if self._running[one] < self._each), None)
            if user is None:
                return
            turn = self._waiting[user][0]
            self._leave(turn)
            self._running[user] += 1
            self._number += 1
            self._served[user] = self._number
            self._served.move_to_end(user)
            if len(self._served) > MOST_USERS:
                self._served.popitem(last=False)
            turn.grant()

    def _users(self) -> list[str]:
        """Users who wait, the one who was served longest ago first."""
        return sorted(self._waiting, key=lambda user: self._served.get(user, 0))

    def _leave(self, turn: Turn) -> None:
        turns = self._waiting[turn.user]
        turns.remove(turn)
        if not turns:
            del self._waiting[turn.user]
