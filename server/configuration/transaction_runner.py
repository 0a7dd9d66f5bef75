"""Runner of transactions (protocols/commands/transactions.py) on a live session.

    transaction ──Send───────> port.send               write bytes, one writer at a time
                ──WaitFor────> events of the session   the first that `match` accepts, or None at the time-out
                ──Sleep──────> sleep
                ──ReopenLink─> port.reopen             close the link and open it again
                ──Note───────> watcher.add_note        a sentence for the traffic log
                ──PutBack────> put_back                frames that are owed to the device until they are sent

Events are collected from the first act on, so that an answer that arrives before it is waited for is not lost. A new
request (a Send after a wait) discards older events, so that a late answer to the previous attempt is not taken for its
answer. The session decodes at intervals (server/devices/decode/decode_scheduler.py); at the time-out it decodes once
more before giving up.

At the log level debug each act (`<<`) and each answer (`>>`) is logged with the position of the transaction.

A cancelled runner performs the final steps of the transaction (GoToMeasurement) before it ends.
"""

import asyncio
import logging
from collections import deque
from collections.abc import Awaitable, Callable, Sequence
from types import GeneratorType
from typing import Any, Protocol, TypeVar

from imuscope.protocols.commands.transactions import (
    Act,
    Note,
    PutBack,
    ReopenLink,
    Send,
    Sleep,
    Transaction,
    WaitFor,
    cancel,
)
from imuscope.protocols.events import Batch, Event
from imuscope.server.links.base import LinkError

log = logging.getLogger("imuscope.runner")
T = TypeVar("T")

MAX_EVENTS = 4096  # events stored for the next WaitFor
FINAL_STEPS_S = 2.0  # for the final steps of a stopped transaction
CONFIRM_S = 0.5  # for the answer to them
IN_FLIGHT_NS = 100_000_000  # until then samples may arrive that the device sent before them


class TransactionPort(Protocol):
    """Session interface that a runner uses."""

    async def send(self, data: bytes) -> int | None: ...

    async def reopen(self, baud: int | None) -> None: ...

    def listen(self, callback: Callable[[Event], None]) -> Callable[[], None]: ...

    def decode(self) -> None: ...


class TrafficListener(Protocol):
    """Listener of the traffic with a device: the traffic log."""

    def sent(self, frame: bytes, what: str, written_ns: int | None) -> None: ...

    def matched(self, event: Event, *, may_refuse: bool = False) -> None: ...

    def add_note(self, text: str, *, error: bool = False) -> None: ...


class Runner:
    """Runs transactions on one session, one after another.

    Args:
        watcher: receives every sent frame and every event that answered.
        put_back: stores the frames that put the device back if the transaction does not; none: it is back.
        confirms: whether an event shows that the device has carried out such a frame.
        patience: factor of the time that the answer to a request has. A simulator on a busy machine answers late.
    """

    def __init__(
        self,
        channel: TransactionPort,
        watcher: TrafficListener,
        patience: float = 1.0,
        put_back: Callable[[Sequence[bytes]], Awaitable[None]] | None = None,
        confirms: Callable[[bytes, Event], bool] = lambda frame, event: False,
    ) -> None:
        self._channel = channel
        self._put_back, self._confirms = put_back, confirms
        self._owed: tuple[bytes, ...] = ()  # frames that put the device back
        self._patience = patience
        self._watcher = watcher
        self._received: deque[Event] = deque(maxlen=MAX_EVENTS)
        self._awaited: tuple[WaitFor, asyncio.Future[Any]] | None = None
        self._running: Transaction[Any] | None = None
        self._act: Act | None = None

    def __repr__(self) -> str:
        """The running transaction, each generator with its line, and its present act."""
        return (
            f"<Runner: {position_of(self._running)}, {text_of(self._act)}>"
            if self._running is not None
            else "<Runner: idle>"
        )

    async def run(self, transaction: Transaction[T]) -> T:
        """Run a transaction and return its result.

        Raises:
            DeviceRejectedError, NoReplyError: raised by the transaction.
            LinkError: sending failed.
        """
        self._received.clear()
        self._owed = ()
        stop_listening = self._channel.listen(self._on_event)
        self._running = transaction
        try:
            return await self._play(transaction)
        except (asyncio.CancelledError, LinkError):
            await asyncio.shield(asyncio.ensure_future(self._final_steps(transaction)))
            raise
        finally:
            stop_listening()
            self._running = self._act = None

    async def _play(self, transaction: Transaction[T]) -> T:
        answer: Any = None
        just_sent = False
        while True:
            try:
                act = transaction.send(answer)
            except StopIteration as end:
                result: T = end.value
                return result
            if isinstance(act, Send) and not just_sent:
                self._received.clear()
            just_sent = isinstance(act, Send)
            self._act = act
            log.debug("%s << %s", TransactionPosition(transaction), text_of(act))
            answer = await self._do(act)
            if isinstance(act, WaitFor):
                log.debug("%s >> %s", TransactionPosition(transaction), type(answer).__name__)

    async def _do(self, act: Act) -> Any:
        match act:
            case Send(frame=frame, what=what):
                await self._send(frame, what)
                return None
            case WaitFor():
                return await self._wait_for(act)
            case Sleep(seconds=seconds):
                await asyncio.sleep(seconds)
                return None
            case ReopenLink(baud=baud):
                return await self.reopen(baud)
            case Note(words=words):
                self._watcher.add_note(words, error=True)
                return None
            case PutBack(frames=frames):
                self._owed = frames
                if self._put_back is not None:
                    await self._put_back(frames)
                return None

    async def _send(self, frame: bytes, what: str) -> int:
        """Send a frame, and return when it was written. It is logged then: on a shared port it may wait for others, or
        be refused.
        """
        try:
            written_ns = await self._channel.send(frame)
        except LinkError as error:
            self._watcher.add_note(f"{what or 'A request'} was not sent: {error.message}", error=True)
            raise
        except asyncio.CancelledError:
            self._watcher.add_note(f"{what or 'A request'} was cancelled while it waited; it may still be sent.")
            raise
        self._watcher.sent(frame, what, written_ns)
        return written_ns or 0

    async def reopen(self, baud: int | None) -> bool:
        """Close the link and open it again; False, with a note, if that fails."""
        at = f" at {group(baud)} Bd" if baud else ""
        try:
            await self._channel.reopen(baud)
        except LinkError as error:
            self._watcher.add_note(f"The link could not be opened{at}: {error.message}", error=True)
            return False
        self._received.clear()
        self._watcher.add_note(f"Link closed, opened again{at}.")
        return True

    async def _wait_for(self, act: WaitFor) -> Any:
        while self._received:
            result = self._try(act, self._received.popleft())
            if result is not None:
                return result
        answered: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        self._awaited = (act, answered)
        try:
            timeout_s = act.timeout_s * (self._patience if act.is_answer else 1.0)
            done, _ = await asyncio.wait((answered,), timeout=timeout_s)
            if not done:
                self._channel.decode()
            return answered.result() if answered.done() else None
        finally:
            self._awaited = None

    def _try(self, act: WaitFor, event: Event) -> Any:
        result = act.match(event)
        if result is not None:
            self._watcher.matched(event, may_refuse=act.may_refuse)
        return result

    def _on_event(self, event: Event) -> None:
        """Handle an event of the decoder: the awaited answer, or stored for the next wait."""
        if self._awaited is None:
            self._received.append(event)
            return
        act, answered = self._awaited
        if answered.done():
            self._received.append(event)
            return
        try:
            result = self._try(act, event)
        except Exception as error:  # an error of the transaction ends the job, not the session
            answered.set_exception(error)
            return
        if result is not None:
            answered.set_result(result)

    async def _final_steps(self, transaction: Transaction[Any]) -> None:
        """Run the final steps of a transaction, as far as the link still accepts them. One that is stopped while it
        puts the device back has none: its frames are sent. It is back when it has confirmed them.
        """
        self._received.clear()
        sent_ns = 0
        for act in cancel(transaction) or [Send(frame) for frame in self._owed]:
            try:
                async with asyncio.timeout(FINAL_STEPS_S):
                    sent_ns = await self._send(act.frame, act.what)
            except (LinkError, TimeoutError) as error:
                log.warning("the final steps of a stopped transaction failed: %s", error)
                return
        left = set(self._owed)

        def match(event: Event) -> bool | None:
            if not isinstance(event, Batch) or event.arrival_ns[-1] > sent_ns + IN_FLIGHT_NS:
                left.difference_update({frame for frame in left if self._confirms(frame, event)})
            return None if left else True

        if left and await self._wait_for(WaitFor(match, CONFIRM_S, "the device back", is_answer=True, may_refuse=True)):
            await self._do(PutBack())  # else they stay owed


class TransactionPosition:
    """Position of a transaction, found only when it is printed."""

    def __init__(self, transaction: Transaction[Any]) -> None:
        self._transaction = transaction

    def __str__(self) -> str:
        return position_of(self._transaction)


def text_of(act: Act | None) -> str:
    """An act in the log, without bytes, which may be a key."""
    match act:
        case Send(frame=frame, what=what):
            return f"Send {what or f'{len(frame)} B'}"
        case WaitFor(timeout_s=timeout_s, what=what):
            return f"WaitFor {what or 'an event'}, {timeout_s:g} s"
        case PutBack(frames=frames):
            return f"PutBack {len(frames)} frames"
        case _:
            return repr(act)


def position_of(transaction: Transaction[Any]) -> str:
    """The generators of a transaction, the acting one last, each with its line: "apply:88 › read:31"."""
    steps: list[str] = []
    generator: Any = transaction
    while isinstance(generator, GeneratorType) and generator.gi_frame is not None:
        steps.append(f"{generator.gi_code.co_name}:{generator.gi_frame.f_lineno}")
        generator = generator.gi_yieldfrom
    return " › ".join(steps) or "ended"


def group(number: int) -> str:
    """A number with its digits grouped: 115 200."""
    return f"{number:,}".replace(",", " ")
