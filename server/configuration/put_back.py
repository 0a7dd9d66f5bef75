"""Frames that put devices back into the state in which they were found, stored while a transaction is under way.

    <data>/put-back/<source>.json      written before a transaction changes the state of a device, removed when it ends

A transaction may end without having put the device back: its link broke, the device did not answer any more, or the
server was killed and finds the file when it starts again. Then the frames are sent as soon as the device is there: an
MTi measures again, the streams of an IMX run again. They are sent at the rate at which the device was left: the link
may have none of its own, and a silent device shows none (baud_scan.py). It is back when it has confirmed every frame
(DeviceDriver.confirms), and is reported only then. A device that measures by itself, after it was without power, is
sent nothing; one that another program or a user takes over is left to them. Settings that were being written are rolled
back by server/configuration/rollback.py.
"""

import asyncio
import hashlib
import json
import logging
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from imuscope.protocols.commands.transactions import AT_REST, Send, Transaction, WaitFor
from imuscope.protocols.events import Batch, Event, Reply
from imuscope.recordings.system import atomic_write
from imuscope.recordings.system.regular_file import read_regular
from imuscope.server.concurrency.backoff import Backoff
from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.configuration.timings import ConfigurationTimings
from imuscope.server.links.base import LinkError, OwedFrames
from imuscope.server.wire import Level

if TYPE_CHECKING:
    from imuscope.server.configuration.device_controller import DeviceController

log = logging.getLogger("imuscope.put_back")

PUT_BACK = "put-back"  # folder in the data folder
LONGEST_S = 10.0  # between two attempts at an open link
MOST_TRIES = 5  # at a device that answers, but not to these frames
WAITING = "A read or a write was interrupted: the device is put back into its state as soon as it answers."
UNCONFIRMED = "The device answers, but has not confirmed that it was put back after a read or a write was interrupted."
UNCONFIRMED_HINT = "Check that it sends what it should; “Measure” or its streams under Configure start it."
IS_BACK = "The device is back in the state in which it was before a read or a write was interrupted."


@dataclass(frozen=True, slots=True)
class Interrupted:
    """A transaction that did not end.

    Args:
        device: name of the device on its link; "" for the first.
        frames: as hex.
        baud: rate of the link; None if it has none, or is not known.
    """

    source: str
    device: str
    frames: tuple[str, ...]
    baud: int | None = None


class PutBackStore:
    """The folder. It is used by threads."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def keep(self, source: str, device: str, frames: Sequence[bytes], baud: int | None = None) -> None:
        """Store the frames of a device; none: remove the stored ones. A write error is logged: reading goes on."""
        path = self._path(source, device)
        try:
            if not frames:
                if path.exists():
                    atomic_write.remove(path)
                return
            self._folder.mkdir(parents=True, exist_ok=True)
            body = {"source": source, "device": device, "frames": [frame.hex() for frame in frames], "baud": baud}
            atomic_write.write_atomic(path, json.dumps(body))
        except OSError as error:
            log.warning("%s: %s", path, error.strerror or error)

    def all(self) -> list[Interrupted]:
        """Transactions that the previous run left; a file that cannot be read is logged and removed."""
        records = []
        for path in sorted(self._folder.glob("*.json")) if self._folder.is_dir() else []:
            try:
                body = json.loads(read_regular(path))
                frames = tuple(bytes.fromhex(frame).hex() for frame in body["frames"])
                baud = int(body["baud"]) if body.get("baud") else None
                records.append(Interrupted(str(body["source"]), str(body["device"]), frames, baud))
            except (OSError, KeyError, ValueError, TypeError, RecursionError) as error:
                log.warning("%s cannot be read: %s", path, error)
                atomic_write.remove(path)
        return records

    def _path(self, source: str, device: str) -> Path:
        return self._folder / f"{hashlib.sha256(f'{source}#{device}'.encode()).hexdigest()[:16]}.json"


class PutBackTask:
    """State of one device that has still to be put back, and the task that does it.

    Args:
        source, device: under which it is stored; `device` is its name on the link, "" for the first.
        is_stored: whether it may outlast this process; a simulator does not.
    """

    def __init__(
        self,
        controller: "DeviceController",
        store: PutBackStore,
        timings: ConfigurationTimings,
        *,
        device: str,
        is_stored: bool = True,
    ) -> None:
        self._controller, self._timings = controller, timings
        self._store, self._device, self._is_stored = store, device, is_stored
        self._frames: tuple[bytes, ...] = ()  # stored
        self._left: tuple[bytes, ...] = ()  # those of them that no running transaction will send
        self._baud: int | None = None  # of the link while they were stored
        self._tries = 0  # at a device that answered otherwise
        self._protocol = ""
        self._writing = threading.Lock()  # held by the thread that stores the frames
        self._task: asyncio.Task[None] | None = None

    async def keep(self, frames: Sequence[bytes]) -> None:
        """Store the frames of the running transaction; none: it has put the device back."""
        self._frames = tuple(dict.fromkeys((*self._left, *frames)))
        self._baud = self._controller.member.access.baud or self._baud
        await self._save()

    def transaction_ended(self) -> None:
        """Begin to put the device back if the transaction has not."""
        self.begin(self._frames)

    def begin(self, frames: Iterable[bytes]) -> None:
        """Put the device back as soon as it is there."""
        self._frames = self._left = tuple(frames)
        if not self._left or (self._task is not None and not self._task.done()):
            return
        self._protocol, self._tries = self._controller.member.info.protocol, 0
        self._update_link()
        self._report("warning", WAITING)
        self._task = asyncio.get_running_loop().create_task(self._work(), name="put back")

    async def resume(self, record: Interrupted) -> None:
        """Put back what the previous run left, under whatever address and name it was stored."""
        self._baud = record.baud or self._baud
        self.begin(dict.fromkeys((*self._left, *map(bytes.fromhex, record.frames))))
        await self._save()
        if (record.source, record.device) != (self._controller.member.info.source, self._device):
            await asyncio.to_thread(self._store.keep, record.source, record.device, ())

    def forget(self) -> None:
        """Leave the device as it is."""
        self._frames = self._left = ()
        self._update_link()

    def _update_link(self) -> None:
        """Give the link, which may be another by now, the frames that are owed."""
        link = self._controller.member.access.link
        link.owed = OwedFrames(self._baud, WAITING) if self._left else None

    async def close(self) -> None:
        """Stop; stored frames are for the next start."""
        await end_tasks(self._task)

    async def _work(self) -> None:
        while self._left:  # again, when more was left while the end of the earlier was stored
            await self._until_back()
            if not self._frames:
                await self._save()

    async def _until_back(self) -> None:
        backoff = Backoff(self._timings.port_poll_s, LONGEST_S)
        while self._left:
            self._update_link()
            await asyncio.sleep(backoff.next())
            if not self._controller.member.link_session.info.is_open:
                backoff.reset()
                continue
            async with self._controller.member.listeners.turn:
                if self._left:  # a user may have taken the device over by now
                    await self._attempt()

    async def _attempt(self) -> None:
        protocol = self._controller.member.info.protocol
        if self._protocol and protocol != self._protocol:  # the frames mean nothing to it
            self.forget()
            return
        frames = self._left
        try:
            transaction = _put_back(frames, self._measures, self.confirms, self._timings.sample_s)
            is_back = await self._controller.run(transaction)
        except LinkError as error:
            if error.kind == "busy":
                self._controller.log.add_note(f"{error.message} It is left to that program.")
                self.forget()
            return  # otherwise again when the link is back
        except Exception:  # top of this task
            log.exception("%s could not be put back", self._controller.member.info.source)
            return
        if frames != self._left:
            return
        if is_back and self._controller.state != AT_REST:
            self.forget()
            self._report("info", IS_BACK)
        elif is_back is not None:
            self._tries += 1
            if self._tries >= MOST_TRIES:
                self.forget()
                self._report("warning", UNCONFIRMED, UNCONFIRMED_HINT)

    def _measures(self) -> bool:
        """Whether samples show that the device is back: it sends none in the config state, and has not entered that
        state after the samples, which may have waited in the port.
        """
        return bool(self._controller.driver.ends_rest) and self._controller.state != AT_REST

    def confirms(self, frame: bytes, event: Event) -> bool:
        """Whether an event confirms a frame; any does while the protocol is not known."""
        if not self._controller.member.info.protocol:
            return isinstance(event, Batch | Reply)
        return self._controller.driver.confirms(frame, event)

    def _report(self, level: Level, text: str, hint: str = "") -> None:
        self._controller.log.add_note(text)
        self._controller.bus.event(self._controller.device, "device", level, text, data={"hint": hint} if hint else {})

    async def _save(self) -> None:
        if self._is_stored:
            await asyncio.to_thread(self._write, self._controller.member.info.source)

    def _write(self, source: str) -> None:
        """Store the frames as they are now, in a thread. Threads may overtake each other, and one goes on when its job
        is stopped: whichever comes last stores the last state.
        """
        with self._writing:
            self._store.keep(source, self._device, self._frames, self._baud)


def _put_back(
    frames: Sequence[bytes], measures: Callable[[], bool], confirms: Callable[[bytes, Event], bool], sample_s: float
) -> Transaction[bool | None]:
    """Send the frames if they are needed; whether the device confirmed each, None if it did not answer at all."""
    if (yield WaitFor(lambda event: isinstance(event, Batch) or None, sample_s, "a sample")) and measures():
        return True
    for frame in frames:
        yield Send(frame)
    left, answered = list(frames), False

    def match(event: Event) -> bool | None:
        nonlocal answered
        answered |= isinstance(event, Batch | Reply)
        left[:] = [frame for frame in left if not confirms(frame, event)]
        return None if left else True

    is_back = yield WaitFor(match, sample_s, "an answer", is_answer=True, may_refuse=True)
    return True if is_back else False if answered else None
