"""How does a function that writes to a file answer a request? In a thread, into a queue that waits for the network.

The thread holds a few pieces at most, so a slow client costs no memory; one that goes away ends it at its next write.
"""

from __future__ import annotations

import asyncio
import io
import queue
import threading
from collections.abc import AsyncGenerator, AsyncIterator, Callable
from typing import BinaryIO, cast

PIECE = 1 << 18
HELD = 8  # pieces


class GoneError(OSError):
    """Nobody takes what is written."""


class QueueWriter(io.RawIOBase):
    """What is written comes out of a queue."""

    def __init__(self) -> None:
        self.queue: queue.Queue[bytes | BaseException | None] = queue.Queue(HELD)
        self.gone = threading.Event()
        self._held = bytearray()

    def writable(self) -> bool:
        return True

    def write(self, data: object) -> int:
        view = memoryview(data)  # type: ignore[arg-type]
        self._held += view
        if len(self._held) >= PIECE:
            self.push()
        return view.nbytes

    def push(self) -> None:
        if self._held:
            self.put(bytes(self._held))
            self._held.clear()

    def put(self, item: bytes | BaseException | None) -> None:
        while True:
            if self.gone.is_set():
                raise GoneError("nobody takes it")
            try:
                self.queue.put(item, timeout=0.2)
                return
            except queue.Full:
                continue


async def streamed(write: Callable[[BinaryIO], None]) -> AsyncIterator[bytes]:
    """The bytes that `write` writes, as they come.

    Raises:
        whatever `write` raises, where it stands in the stream.
    """
    pipe = QueueWriter()

    def run() -> None:
        try:
            write(cast(BinaryIO, pipe))
            pipe.push()
            pipe.put(None)
        except GoneError:
            return
        except BaseException as error:  # told to whoever reads
            try:
                pipe.put(error)
            except GoneError:
                return

    thread = threading.Thread(target=run, name="download", daemon=True)
    thread.start()
    try:
        while True:
            item = await asyncio.to_thread(pipe.queue.get)
            if item is None:
                return
            if isinstance(item, BaseException):
                raise item
            yield item
    finally:
        pipe.gone.set()


async def with_first_chunk(pieces: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
    """The same pieces, when the first is there: what cannot even begin can still be answered in words.

    Raises:
        whatever making the first piece raises.
    """
    first = await anext(pieces, b"")

    async def all_of_them() -> AsyncIterator[bytes]:
        try:
            yield first
            async for piece in pieces:
                yield piece
        finally:
            if isinstance(pieces, AsyncGenerator):
                await pieces.aclose()

    return all_of_them()
