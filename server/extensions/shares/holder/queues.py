"""Bytes on their way to one client. A client that does not keep up loses whole frames, oldest first.

    sent | rest of a frame | frame | frame | frame …
           kept              dropped when more than MOST_HELD wait, until half of it is left

Frames are found by their headers (`FrameSizes`), which costs nothing while a client keeps up. As long as the protocol
is unknown, whole reads of the port are dropped instead.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

MOST_HELD = 1 << 16

FrameSize = Callable[[bytes, int], int]
"""Size of the frame that begins at a position; 0: its header is incomplete; −1: none begins there."""


class ClientQueue:
    """Bytes waiting for one client.

    Attributes:
        size: bytes that wait.
        dropped_bytes, dropped_frames: lost so far because the client did not keep up; of frames only those counted
            while the protocol was known.
    """

    def __init__(self, most: int = MOST_HELD) -> None:
        self._most = most
        self._chunks: deque[bytes] = deque()
        self.size = 0
        self._is_cut = False  # the first chunk was sent in part
        self.dropped_bytes = 0
        self.dropped_frames = 0

    def put(self, data: bytes, frame_size: FrameSize | None) -> None:
        """Append bytes; beyond `most`, drop the oldest frames."""
        self._chunks.append(data)
        self.size += len(data)
        if self.size > self._most:
            if frame_size is None:
                self._drop_chunks()
            else:
                self._drop_frames(frame_size)

    def send(self, write: Callable[[bytes], int]) -> int:
        """Send what the client takes.

        Args:
            write: as os.write; BlockingIOError when nothing is taken.

        Returns:
            number of bytes sent.
        """
        sent = 0
        while self._chunks:
            chunk = self._chunks[0]
            try:
                n = write(chunk)
            except BlockingIOError:
                break
            sent += n
            self.size -= n
            if n < len(chunk):
                self._chunks[0] = chunk[n:]
                self._is_cut = True
                break
            self._chunks.popleft()
            self._is_cut = False
        return sent

    def clear(self) -> None:
        """Forget what waits."""
        self._chunks.clear()
        self.size, self._is_cut = 0, False

    def _drop_chunks(self) -> None:
        chunks = [self._chunks.popleft()] if self._is_cut else []
        while len(self._chunks) > 1 and self.size > self._most // 2:
            size = len(self._chunks.popleft())
            self.size -= size
            self.dropped_bytes += size
        self._chunks.extendleft(chunks)

    def _drop_frames(self, frame_size: FrameSize) -> None:
        data = b"".join(self._chunks)
        bounds = frame_bounds(data, frame_size)
        if len(bounds) < 2:
            self._drop_chunks()
            return
        first = bounds[0]  # before it is the rest of a frame that was begun
        excess = self.size - self._most // 2
        last = next((i for i, bound in enumerate(bounds) if bound - first >= excess), len(bounds) - 1)
        gone = bounds[last] - first
        self._chunks = deque(part for part in (data[:first], data[bounds[last] :]) if part)
        self.size -= gone
        self.dropped_bytes += gone
        self.dropped_frames += last


def frame_bounds(data: bytes, frame_size: FrameSize) -> list[int]:
    """Beginnings of frames that follow each other, and the end of the last complete one.

    A position counts as the first one only if another frame begins where it ends, so that bytes within a frame that
    look like a header are not taken for one.
    """
    at = 0
    while at < len(data):
        size = frame_size(data, at)
        if size > 0 and at + size < len(data) and frame_size(data, at + size) >= 0:
            break
        at += 1
    bounds = []
    while at < len(data):
        size = frame_size(data, at)
        if size < 0:  # other bytes between frames: skip them with the frame before
            at += 1
            continue
        bounds.append(at)
        if size == 0 or at + size > len(data):
            return bounds
        at += size
    bounds.append(at)
    return bounds
