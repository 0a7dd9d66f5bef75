"""Rewriting of finished recordings (recordings/compaction.py) by a process of low priority.

One recording after the other. A thread would take turns with the event loop; a process of its own does not. One process
takes what is waiting, since it takes a second to start. What the server before this one left behind, closed or killed,
is found at the start.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable
from itertools import islice
from pathlib import Path

from recordings import compaction, file_lock
from recordings.mcap_writer import SUFFIX
from server.library.worker import Worker

log = logging.getLogger("imuscope.packer")
BATCH = 32  # recordings for one process


class CompactionWorker:
    """Packs what it is given.

    Args:
        packed: called with each path that has been rewritten.
    """

    def __init__(self, packed: Callable[[Path], None]) -> None:
        self._packed = packed
        self._waiting: deque[Path] = deque()
        self._task: asyncio.Task[None] | None = None
        self._closed = False

    def add(self, path: Path) -> None:
        """Pack this one when it is its turn."""
        if self._closed or path in self._waiting:
            return
        self._waiting.append(path)
        if self._task is None or self._task.done():
            self._task = asyncio.get_running_loop().create_task(self._work(), name="packing recordings")

    async def resume(self, folder: Path, spare: Path | None = None) -> None:
        """Find what was left unpacked in a folder.

        Args:
            spare: the file that is being recorded now, on a file system without locks too.
        """
        for path in await asyncio.to_thread(left_behind, folder):
            if path != spare:
                self.add(path)

    @property
    def busy(self) -> bool:
        """Is there something that has not been packed yet?"""
        return self._task is not None and not self._task.done()

    async def close(self) -> None:
        """Stop; what is not packed is so at the next start."""
        self._closed = True
        self._waiting.clear()
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)

    async def _work(self) -> None:
        while self._waiting:
            before = len(self._waiting)
            try:
                await self._pack(list(islice(self._waiting, BATCH)))
            except OSError as error:
                log.warning("Recordings could not be packed: %s", error)
            if self._waiting and len(self._waiting) >= before:  # the process fell over the first one, and said nothing
                log.warning("%s could not be packed.", self._waiting.popleft().name)

    async def _pack(self, paths: list[Path]) -> None:
        """Have these packed, each leaving the queue when it is told of; the process may end before it has done all."""
        worker = await Worker.start("recordings.compaction", *map(str, paths))
        try:
            async for told in worker:
                path = Path(told["path"])
                self._waiting.remove(path)
                if told["message"]:
                    log.warning("%s could not be packed: %s", path.name, told["message"])
                elif told["packed"]:
                    self._packed(path)
            await worker.wait()
        finally:
            await worker.end()


def left_behind(folder: Path) -> list[Path]:
    """Recordings of ours that are not packed; what an interrupted packing left is taken away.

    What another process writes or packs at this moment is left alone.
    """
    for aside in folder.glob(f".*{compaction.ASIDE}"):
        if not file_lock.is_in_use(aside):
            aside.unlink(missing_ok=True)
    return [path for path in sorted(folder.glob(f"*{SUFFIX}")) if compaction.is_uncompacted(path)]
