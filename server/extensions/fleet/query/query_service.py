"""Questions about a store over HTTP: each in a process of its own, a few at once, in turns.

    question ──> FairQueue ──> query_worker.py (subprocess) ──> bytes of the answer

A question ends with its client: closing the answer, or cancelling the wait for it, ends the process. One
that does not end by itself in its time is killed.
"""

import asyncio
import contextlib
import itertools
import json
import os
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from imuscope.server.concurrency.fair_queue import FairQueue, QueueFullError, Turn
from imuscope.server.errors import DomainError
from imuscope.server.extensions.fleet.model.settings import FleetTables, StoreSettings
from imuscope.server.services.parts import ServicePart
from imuscope.server.services.services import Services
from imuscope.server.system.workers import Worker

RUNNING_EACH = 1  # questions of one user that run at once
WAITING_EACH = 8
GRACE_S = 20.0  # for a process to start, and to report its own time-out
WORDS_S = 60.0  # for which tables and signals are taken as they were
FETCH_S = 3600.0
PIECE_BYTES = 1 << 18


@dataclass(frozen=True, slots=True)
class QuestionRequest:
    """A question.

    Args:
        sql: one statement that reads.
        format: json, arrow, csv or parquet.
        rows: most rows of an answer as JSON.
        id: name of the client for it.
    """

    sql: str
    format: str
    rows: int
    memory_mb: int
    timeout_s: float
    id: str = ""


@dataclass(slots=True)
class RunningQuery:
    """A question that waits or runs."""

    id: str
    turn: Turn


class QueryService:
    """The questions of all users.

    Attributes:
        fetches: held while a recording is fetched.
    """

    def __init__(self, settings: StoreSettings) -> None:
        self.settings = settings
        self.queue = FairQueue(max(2, (os.cpu_count() or 2) // 2), RUNNING_EACH, WAITING_EACH)
        self._running: dict[int, RunningQuery] = {}
        self._numbers = itertools.count()
        self._words: tuple[float, dict[str, Any]] | None = None
        self._reads_words = asyncio.Lock()
        self.fetches = asyncio.Lock()

    def running_of(self, user: str) -> list[RunningQuery]:
        """Questions of a user, those that wait too."""
        return [one for one in self._running.values() if one.turn.user == user]

    @asynccontextmanager
    async def answer(self, user: str, question: QuestionRequest) -> AsyncIterator[AsyncIterator[bytes]]:
        """The bytes of an answer, to be read within the `with`; waits for its turn.

        Raises:
            DomainError: "no-store", "full", "bad-query" or "store".
        """
        self._check_store()
        with self._full():
            async with self.queue.turn(user) as turn:
                number = next(self._numbers)
                self._running[number] = RunningQuery(question.id, turn)
                try:
                    await turn.granted()
                    request = {key: value for key, value in asdict(question).items() if key != "id"}
                    async with self._worker(request) as pieces:
                        yield pieces
                finally:
                    del self._running[number]

    async def words(self) -> dict[str, Any]:
        """Tables, columns, signals and functions.

        Raises:
            DomainError: "no-store" or "store".
        """
        self._check_store()
        async with self._reads_words:
            now = time.monotonic()
            if self._words is None or now >= self._words[0] + WORDS_S:
                request = {"words": True, "memory_mb": self.settings.query_mb, "timeout_s": self.settings.query_s}
                async with self._worker(request) as pieces:
                    report = json.loads(b"".join([piece async for piece in pieces]))
                self._words = now, report
            return self._words[1]

    async def fetch(self, recording: str, path: Path) -> None:
        """Write a recording of the store to a file, while `fetches` is held.

        Raises:
            DomainError: "no-store", "not-found" or "store".
        """
        self._check_store()
        request = {"fetch": recording, "path": str(path), "memory_mb": self.settings.query_mb, "timeout_s": FETCH_S}
        async with self._worker(request) as pieces:
            async for _ in pieces:
                pass

    def _check_store(self) -> None:
        if not self.settings.url:
            hint = "Start it with --store URL, or with url in the table [store] of its configuration file."
            raise DomainError("no-store", "This server has no store of recordings.", hint)

    @contextlib.contextmanager
    def _full(self) -> Iterator[None]:
        try:
            yield
        except QueueFullError:
            hint = "Wait for one to end, or cancel one."
            raise DomainError("full", f"{WAITING_EACH} of your questions are waiting.", hint) from None

    @asynccontextmanager
    async def _worker(self, request: dict[str, Any]) -> AsyncIterator[AsyncIterator[bytes]]:
        worker = await Worker.start("imuscope.server.extensions.fleet.query.query_worker")
        end = asyncio.create_task(_end_after(worker, request["timeout_s"] + GRACE_S))
        try:
            worker.request({"store": self.settings.url, **request})
            line = await worker.output.readline()
            if not line.endswith(b"\n"):
                hint = "Ask for less at once; the log of the server may say more."
                raise DomainError("bad-query", "The question took too much memory or time, and was ended.", hint)
            words = json.loads(line)
            if words:
                if words["kind"] == "store":
                    raise DomainError("store", words["message"], words["hint"])
                if words["kind"] == "not-found":
                    raise DomainError("not-found", words["message"], words["hint"])
                raise DomainError("bad-query", words["message"], words["hint"])
            yield _pieces(worker)
        finally:
            end.cancel()
            await worker.end()


async def _end_after(worker: Worker, seconds: float) -> None:
    await asyncio.sleep(seconds)
    await worker.end()


async def _pieces(worker: Worker) -> AsyncIterator[bytes]:
    """The answer; an OSError if it is cut off."""
    while piece := await worker.output.read(PIECE_BYTES):
        yield piece
    if await worker.wait() != 0:
        raise OSError("the answer is cut off")


def parts(services: Services) -> Iterator[ServicePart]:
    """Objects that only requests use, for a server with these services."""
    yield ServicePart("questions", QueryService(services.config.of(FleetTables).store))
