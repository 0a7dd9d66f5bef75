"""How is a dialogue (protocols/transactions.py) carried out on a live session?

    dialogue ──Send──> session.send            bytes on their way, one writer at a time
             ──Expect─> events of the session   the first of which `match` makes something, or None when time is up
             ──Pause──> sleep
             ──Relink─> session.relink          the link closed, opened again
             ──Note──>  watcher.note            a sentence for who watches

Events are collected from the first act on, so that an answer that comes before anybody waits for it is not lost; a new
request (a Send that follows a wait) forgets what is older, so that a late answer to the last try is not taken for one
to this. The session decodes in stretches (server/streaming/hub.py); when time is up it decodes once more before that
counts.

A runner that is cancelled writes what the dialogue must not leave undone (GoToMeasurement) before it ends.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable
from typing import Any, Protocol, TypeVar

from protocols.events import Event
from protocols.transactions import Act, Note, ReopenLink, Send, Sleep, Transaction, WaitFor, cancel
from server.links.base import LinkError

log = logging.getLogger("imuscope.runner")
T = TypeVar("T")

KEPT = 4096  # events that wait for an WaitFor
LAST_WORDS_S = 2.0  # for what a stopped dialogue still has to write


class TransactionPort(Protocol):
    """What a runner needs of a session."""

    async def send(self, data: bytes) -> None: ...

    async def relink(self, baud: int | None) -> None: ...

    def listen(self, callback: Callable[[Event], None]) -> Callable[[], None]: ...

    def decode(self) -> None: ...


class TrafficListener(Protocol):
    """Who is told what goes to and fro: the log of the exchange."""

    def sent(self, frame: bytes, what: str) -> None: ...

    def matched(self, event: Event) -> None: ...

    def note(self, text: str, *, fault: bool = False) -> None: ...


class Runner:
    """Carries out dialogues on one session, one after another.

    Args:
        watcher: told of every frame that was sent and of every event that answered.
    """

    def __init__(self, channel: TransactionPort, watcher: TrafficListener) -> None:
        self._channel = channel
        self._watcher = watcher
        self._heard: deque[Event] = deque(maxlen=KEPT)
        self._wanted: tuple[WaitFor, asyncio.Future[Any]] | None = None

    async def run(self, dialogue: Transaction[T]) -> T:
        """The dialogue's result.

        Raises:
            RefusedError, SilentError: as the dialogue says.
            LinkError: something could not be sent.
        """
        self._heard.clear()
        off = self._channel.listen(self._hear)
        try:
            return await self._play(dialogue)
        except (asyncio.CancelledError, LinkError):
            await asyncio.shield(asyncio.ensure_future(self._last_words(dialogue)))
            raise
        finally:
            off()

    async def _play(self, dialogue: Transaction[T]) -> T:
        answer: Any = None
        asked = False
        while True:
            try:
                act = dialogue.send(answer)
            except StopIteration as end:
                result: T = end.value
                return result
            if isinstance(act, Send) and not asked:
                self._heard.clear()
            asked = isinstance(act, Send)
            answer = await self._do(act)

    async def _do(self, act: Act) -> Any:
        match act:
            case Send(frame=frame, what=what):
                self._watcher.sent(frame, what)
                await self._channel.send(frame)
                return None
            case WaitFor():
                return await self._expect(act)
            case Sleep(seconds=seconds):
                await asyncio.sleep(seconds)
                return None
            case ReopenLink(baud=baud):
                return await self.relink(baud)
            case Note(words=words):
                self._watcher.note(words, fault=True)
                return None

    async def relink(self, baud: int | None) -> bool:
        """Close the link and open it again; False, with a note, when it cannot be."""
        at = f" at {group(baud)} Bd" if baud else ""
        try:
            await self._channel.relink(baud)
        except LinkError as error:
            self._watcher.note(f"The link could not be opened{at}: {error.message}", fault=True)
            return False
        self._heard.clear()
        self._watcher.note(f"Link closed, opened again{at}.")
        return True

    async def _expect(self, act: WaitFor) -> Any:
        while self._heard:
            found = self._try(act, self._heard.popleft())
            if found is not None:
                return found
        answered: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        self._wanted = (act, answered)
        try:
            done, _ = await asyncio.wait((answered,), timeout=act.timeout_s)
            if not done:
                self._channel.decode()
            return answered.result() if answered.done() else None
        finally:
            self._wanted = None

    def _try(self, act: WaitFor, event: Event) -> Any:
        found = act.match(event)
        if found is not None:
            self._watcher.matched(event)
        return found

    def _hear(self, event: Event) -> None:
        """An event of the decoder: the answer that is waited for, or kept for who asks next."""
        if self._wanted is None:
            self._heard.append(event)
            return
        act, answered = self._wanted
        if answered.done():
            self._heard.append(event)
            return
        try:
            found = self._try(act, event)
        except Exception as error:  # a fault of the dialogue: it ends the job, not the session
            answered.set_exception(error)
            return
        if found is not None:
            answered.set_result(found)

    async def _last_words(self, dialogue: Transaction[Any]) -> None:
        """What must not be left undone, as far as the link still takes it."""
        for act in cancel(dialogue):
            try:
                self._watcher.sent(act.frame, act.what)
                await asyncio.wait_for(self._channel.send(act.frame), LAST_WORDS_S)
            except (LinkError, TimeoutError) as error:
                log.warning("a stopped dialogue could not end: %s", error)
                return


def group(number: int) -> str:
    """115 200."""
    return f"{number:,}".replace(",", " ")
