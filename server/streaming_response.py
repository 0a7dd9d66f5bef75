"""Streaming response from a function that writes to a file. It runs in a thread and writes to a bounded queue.

The queue holds a few pieces at most, so a slow client costs no memory; after a disconnect the next write raises.
"""

from __future__ import annotations

import asyncio
import contextlib
import io
import queue
import threading
from collections.abc import AsyncGenerator, AsyncIterator, Callable
from typing import BinaryIO, cast

PIECE = 1 << 18
QUEUE_LENGTH = 8  # pieces


class ClientGoneError(OSError):
    """The client disconnected."""


class QueueWriter(io.RawIOBase):
    """File object whose output is read from a queue."""

    def __init__(self) -> None:
        self.queue: queue.Queue[bytes | BaseException | None] = queue.Queue(QUEUE_LENGTH)
        self.client_gone = threading.Event()
        self._buffer = bytearray()

    def writable(self) -> bool:
        return True

    def write(self, data: object) -> int:
        view = memoryview(data)  # type: ignore[arg-type]
        self._buffer += view
        if len(self._buffer) >= PIECE:
            self.push()
        return view.nbytes

    def push(self) -> None:
        if self._buffer:
            self.put(bytes(self._buffer))
            self._buffer.clear()

    def put(self, item: bytes | BaseException | None) -> None:
        while True:
            if self.client_gone.is_set():
                raise ClientGoneError("client disconnected")
            try:
                self.queue.put(item, timeout=0.2)
                return
            except queue.Full:
                continue


async def streamed(write: Callable[[BinaryIO], None]) -> AsyncIterator[bytes]:
    """The bytes that `write` writes, as they are produced.

    Raises:
        every exception of `write`, after the bytes written before it.
    """
    pipe = QueueWriter()

    def run() -> None:
        try:
            write(cast(BinaryIO, pipe))
            pipe.push()
            pipe.put(None)
        except ClientGoneError:
            return
        except BaseException as error:  # raised in the reader
            try:
                pipe.put(error)
            except ClientGoneError:
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
        pipe.client_gone.set()
        with contextlib.suppress(queue.Full):
            pipe.queue.put_nowait(None)  # a thread that waits for the next piece would wait for ever


async def with_first_chunk(pieces: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
    """The same pieces, after the first has been produced, so that an early failure can become an error response.

    Raises:
        every exception that occurs before the first piece.
    """
    first = await anext(pieces, b"")

    async def chunks() -> AsyncIterator[bytes]:
        try:
            yield first
            async for piece in pieces:
                yield piece
        finally:
            if isinstance(pieces, AsyncGenerator):
                await pieces.aclose()

    return chunks()
