"""Files from outside: all that reads one runs in a process of its own, never in the server's.

    await files.call("imuscope.recordings.library.probe:probe_files", paths, returns=list[RecordingProbe | None])

    a route, the library ──> FairQueue ──> file_worker.py (a fork per call) ──> JSON, or bytes piece by piece

A file can be made to take all memory, to keep a library in one call for ever, or to end the interpreter. The process of
a call has a limit of memory and of processor time, which the system enforces; a call that does not end in time, or
whose client leaves, is killed. A function is named, not imported: what reads files is not in the server's process at
all (tests/server/library/test_foreign_files.py).

The process that forks starts when the library is looked at, and ends after IDLE_S without a call. An answer is JSON and
is checked against its type: it may hold what others wrote.
"""

import asyncio
import math
from collections.abc import AsyncGenerator, AsyncIterator, Coroutine, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.library.recording_probe import RecordingProbe
from imuscope.recordings.system.resource_limits import CPU_S, CPU_S_PER_MB
from imuscope.server.concurrency.fair_queue import FairQueue, QueueFullError
from imuscope.server.configuration.snapshots import Snapshot, SnapshotError
from imuscope.server.errors import DomainError
from imuscope.server.system.fork_server import ForkServer, JobLostError

MODULE = "imuscope.server.library.file_worker"
IDLE_S = 60.0
QUICK_S = 4  # of a processor, for a file without size: an intact one takes a tenth
PROBE_S = 0.1  # more for each further file
WAIT_SHARE, WAIT_S = 4, 10  # a call may take so many times its processor time, and so much more
MAX_RUNNING, RUNNING_EACH, WAITING_EACH = 3, 2, 32
MAX_DOWNLOADS = 8  # at once: most of their time they wait for their clients
PROBED_AT_ONCE = 64  # files
MAX_ANSWER = 1 << 20  # bytes that the server takes apart: some 10 ms
MAX_PASSED = 16 << 20  # bytes that it passes on
MALICIOUS = "The file may be damaged or malicious."
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class FileCall:
    """A call in a process of its own.

    Args:
        function: "module:name".
        cpu_s: processor time.
        writes: whether it writes bytes to a file, its last argument, and returns nothing.
        name: of the file, for a refusal.
    """

    function: str
    arguments: Sequence[object]
    cpu_s: int
    writes: bool = False
    name: str = ""


class ForeignFiles:
    """The processes that read files from outside.

    Args:
        module: of the process; fuzzing has its own.
    """

    def __init__(self, module: str = MODULE) -> None:
        self._forks = ForkServer(module, idle_s=IDLE_S)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._queue = FairQueue(MAX_RUNNING, RUNNING_EACH, WAITING_EACH)
        self._downloads = FairQueue(MAX_DOWNLOADS, MAX_DOWNLOADS // 2, WAITING_EACH)

    async def call(self, function: str, *arguments: object, returns: type[T] | Any, user: str = "") -> T:
        """Call a function; returns its result.

        Args:
            function: "module:name"; its first argument is a path, or several.
            returns: its type.
            user: who waits for it; of each two run at once.

        Raises:
            RecordingError: what it raises; or it exceeds a limit.
            OSError: what it raises.
            DomainError: what it raises; or "full": too many wait.
        """
        from pydantic import TypeAdapter

        body = await self.json(function, *arguments, user=user, most=MAX_ANSWER)
        value: T = TypeAdapter(returns).validate_json(body)
        return value

    async def json(self, function: str, *arguments: object, user: str = "", most: int = MAX_PASSED) -> bytes:
        call = _call(function, arguments)
        async with self._turn(call, user):
            facts, body = await self._forks.run(call)
        _raise(facts)
        if len(body) > most:
            raise RecordingError(f"{call.name} holds too much to be shown.", "Divide it into several files.")
        return body

    async def pieces(self, function: str, *arguments: object, user: str = "") -> AsyncGenerator[bytes]:
        """Output of a function to a file, its last argument. Raises as `call`, after the pieces before it."""
        call = _call(function, arguments, writes=True)
        async with self._turn(call, user):
            stream = self._forks.stream(call)
            try:
                async for piece in stream:
                    if isinstance(piece, bytes):
                        yield piece
                    else:
                        _raise(piece)
            finally:
                await stream.aclose()

    async def probe(self, paths: Sequence[Path]) -> list[RecordingProbe | None]:
        """Metadata of files: all at once, and one by one where that fails."""
        probes: list[RecordingProbe | None] = []
        for first in range(0, len(paths), PROBED_AT_ONCE):
            some = paths[first : first + PROBED_AT_ONCE]
            try:
                probes += await self._probed(some)
            except (RecordingError, OSError, ValueError):
                probes += [await self._probed_alone(path) for path in some]
        return probes

    async def _probed(self, paths: Sequence[Path]) -> list[RecordingProbe | None]:
        function = "imuscope.recordings.library.probe:probe_files"
        return await self.call(function, list(paths), returns=list[RecordingProbe | None], user="the library")

    async def _probed_alone(self, path: Path) -> RecordingProbe | None:
        try:
            return (await self._probed([path]))[0]
        except RecordingError as error:
            return RecordingProbe(path.suffix[1:].lower(), damaged=f"{error.message} {error.hint}".rstrip())
        except (OSError, ValueError):
            return RecordingProbe(path.suffix[1:].lower(), damaged="It cannot be read.")

    def is_pinned(self, path: Path) -> bool:
        """Whether a recording says itself that it is pinned, or cannot be read. Call it in a thread."""
        try:
            return self._from_thread("imuscope.recordings.library.probe:is_pinned", path, returns=bool)
        except (RecordingError, OSError):
            return True

    def snapshot(self, text: str) -> Snapshot:
        """A snapshot of settings from its text. Call it in a thread.

        Raises:
            SnapshotError: the text is not a valid snapshot.
        """
        try:
            function = "imuscope.server.configuration.snapshot_text:from_text"
            return self._from_thread(function, text, returns=Snapshot)
        except RecordingError as error:
            raise SnapshotError(error.message, error.hint) from None
        except OSError as error:
            raise SnapshotError(f"The snapshot cannot be read: {error.strerror or error}.", "Try again.") from None

    def _from_thread(self, function: str, *arguments: object, returns: type[T]) -> T:
        assert self._loop is not None
        call: Coroutine[Any, Any, T] = self.call(function, *arguments, returns=returns, user="the server")
        return asyncio.run_coroutine_threadsafe(call, self._loop).result()

    def start(self) -> None:
        """Let calls come from threads. Call it on the event loop that runs them."""
        self._loop = asyncio.get_running_loop()

    async def prepare(self) -> None:
        """Start the process that forks in advance."""
        await self._forks.prepare()

    async def close(self) -> None:
        """End all calls."""
        await self._forks.close()

    @asynccontextmanager
    async def _turn(self, call: FileCall, user: str) -> AsyncIterator[None]:
        try:
            queue = self._downloads if call.writes else self._queue
            async with queue.turn(user) as turn:
                await turn.granted()
                await self._forks.prepare()  # its time does not count
                async with asyncio.timeout(None if call.writes else WAIT_SHARE * call.cpu_s + WAIT_S):
                    yield
        except QueueFullError:
            hint = "Wait for one to end."
            raise DomainError("full", f"{WAITING_EACH} of your requests for files are waiting.", hint) from None
        except TimeoutError:
            raise RecordingError(f"Reading {call.name} takes too long.", MALICIOUS) from None
        except JobLostError:
            raise RecordingError(f"Reading {call.name} ended its process.", MALICIOUS) from None


def _call(function: str, arguments: Sequence[object], *, writes: bool = False) -> FileCall:
    """A call, with its processor time by the size of its files."""
    first = arguments[0]
    paths = [one for one in (first if isinstance(first, list) else [first]) if isinstance(one, Path)]
    megabytes = 0.0
    for path in paths:
        try:
            megabytes += path.stat().st_size / (1 << 20)
        except OSError:
            continue
    seconds = QUICK_S + PROBE_S * len(paths) + CPU_S_PER_MB * megabytes
    return FileCall(function, arguments, min(math.ceil(seconds), CPU_S), writes, paths[0].name if paths else "the text")


def _raise(facts: Mapping[str, Any]) -> None:
    """Raise the error that the process reports, if any."""
    match facts.get("error"):
        case "recording":
            raise RecordingError(facts["message"], facts["hint"])
        case "system":
            raise OSError(facts["number"], facts["message"])
        case str(kind):
            raise DomainError(kind, facts["message"], facts["hint"])
