"""Damaged recordings, each read in a fork of one process, as a server reads them (server/library/foreign_files.py).

    FileSearch.check ──> Reading.check ──> `python -m tests.fuzz.reading` ── fork ──> files.KINDS[kind].read

A reader that ends its process, keeps a library in one call, or takes the memory of the machine breaks its own case.
"""

import asyncio
import os
import threading
from pathlib import Path

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.system.resource_limits import bounded, memory_in_use
from imuscope.server.library import file_worker
from imuscope.server.library.foreign_files import ForeignFiles
from tests.fuzz import files
from tests.fuzz.cases import BrokenError


class Reading:
    """The process that forks; it ends with this one."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._files = ForeignFiles(__name__)
        os.environ[file_worker.POOL] = "system"  # before this module imports in the process what uses it
        self._thread = threading.Thread(target=self._loop.run_forever, name="reading", daemon=True)
        self._thread.start()
        asyncio.run_coroutine_threadsafe(self._files.prepare(), self._loop).result()

    def check(self, path: Path, kind: str, *, cut: bool) -> None:
        """Hand a file to the reader of its kind. BrokenError: what should not have happened."""
        call = self._files.call(f"{__name__}:broken", path, kind, cut, returns=list[str])
        try:
            results: list[str] = asyncio.run_coroutine_threadsafe(call, self._loop).result()
        except RecordingError as error:
            raise BrokenError("process", f"a {kind}: {error.message}") from None
        if results:
            raise BrokenError(results[0], results[1])

    def close(self) -> None:
        asyncio.run_coroutine_threadsafe(self._files.close(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


def broken(path: Path, kind: str, cut: bool) -> list[str]:
    """What is wrong with the reading of a file: in one word, and in more; [] for nothing."""
    bounded(memory_in_use() + files.MAX_BYTES, round(files.PATIENCE_S / 2))
    try:
        files.attempt(files.KINDS[kind], path, kind, cut=cut)
    except BrokenError as error:
        return [error.kind, str(error)]
    return []


if __name__ == "__main__":
    file_worker.main()
