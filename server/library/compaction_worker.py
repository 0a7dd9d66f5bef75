"""Compaction of finished recordings (recordings/mcap/compaction.py) in a low-priority subprocess.

Recordings are compacted one after the other. A thread would compete with the event loop; a subprocess does not. One
process handles all that are waiting, since it takes a second to start. Recordings that a previous run left uncompacted
are found at the start.
"""

import asyncio
import logging
from collections import deque
from collections.abc import Callable
from itertools import islice
from pathlib import Path

from imuscope.recordings.file_names import SUFFIX
from imuscope.recordings.mcap.own_recordings import TEMPORARY_SUFFIX, is_uncompacted
from imuscope.recordings.system import file_lock
from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.system.workers import Worker

log = logging.getLogger("imuscope.packer")
RECORDINGS_PER_PROCESS = 32  # recordings for one process


class CompactionWorker:
    """Queue of recordings to compact.

    Args:
        packed: called with each path that has been rewritten.
    """

    def __init__(self, packed: Callable[[Path], None]) -> None:
        self._packed = packed
        self._waiting: deque[Path] = deque()
        self._task: asyncio.Task[None] | None = None
        self._closed = False

    def add(self, path: Path) -> None:
        """Add a recording to the queue."""
        if self._closed or path in self._waiting:
            return
        self._waiting.append(path)
        if self._task is None or self._task.done():
            self._task = asyncio.get_running_loop().create_task(self._work(), name="packing recordings")

    async def resume(self, folder: Path, spare: Path | None = None) -> None:
        """Queue the uncompacted recordings of a folder.

        Args:
            spare: the file of the running recording, which is skipped even on a file system without locks.
        """
        for path in await asyncio.to_thread(uncompacted, folder):
            if path != spare:
                self.add(path)

    @property
    def is_busy(self) -> bool:
        """Whether any recording waits for compaction."""
        return self._task is not None and not self._task.done()

    async def close(self) -> None:
        """Stop; the remaining recordings are compacted after the next start."""
        self._closed = True
        self._waiting.clear()
        await end_tasks(self._task)

    async def _work(self) -> None:
        while self._waiting:
            before = len(self._waiting)
            try:
                await self._pack(list(islice(self._waiting, RECORDINGS_PER_PROCESS)))
            except OSError as error:
                log.warning("Recordings could not be compacted: %s", error)
            if self._waiting and len(self._waiting) >= before:  # the process crashed on the first one
                log.warning("%s could not be compacted.", self._waiting.popleft().name)

    async def _pack(self, paths: list[Path]) -> None:
        """Compact recordings; each leaves the queue when it is reported, as the process may end early."""
        worker = await Worker.start("imuscope.recordings.mcap.compaction", *map(str, paths))
        try:
            async for result in worker:
                path = Path(result["path"])
                self._waiting.remove(path)
                if result["message"]:
                    log.warning("%s could not be compacted: %s", path.name, result["message"])
                elif result["packed"]:
                    self._packed(path)
            await worker.wait()
        finally:
            await worker.end()


def uncompacted(folder: Path) -> list[Path]:
    """Recordings that are not compacted; files of an interrupted compaction are removed.

    Files that another process writes or compacts are left alone.
    """
    for temporary in folder.glob(f".*{TEMPORARY_SUFFIX}"):
        if not file_lock.is_in_use(temporary):
            temporary.unlink(missing_ok=True)
    return [path for path in sorted(folder.glob(f"*{SUFFIX}")) if is_uncompacted(path)]
