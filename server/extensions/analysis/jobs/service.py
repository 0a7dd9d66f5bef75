"""Analyses over HTTP: each in a process of its own, a few at once, in turns.

    request ──> FairQueue ──> worker.py (a fork per job) ──> bytes of the response

The process that forks takes 0.7 s of a processor to start, and 90 MB. It starts with the first analysis; on a machine
with room for it, while a page is open, as soon as the machine is idle, and stays until no page is open.

An analysis ends with its client: when the caller is cancelled, its process is killed. Samples are copied when its turn
has come, so that requests that wait take no memory.
"""

import asyncio
import os
from collections.abc import Awaitable, Callable, Iterator
from typing import TYPE_CHECKING

from imuscope.recordings.system.resource_limits import memory_of_one
from imuscope.server.concurrency.fair_queue import FairQueue, QueueFullError
from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.expressions.derived_channels import DerivedChannels, signals_part
from imuscope.server.extensions.analysis.jobs.jobs import AnalysisJob, Content
from imuscope.server.extensions.analysis.jobs.limits import LESS, AnalysisLimits
from imuscope.server.extensions.analysis.jobs.settings import AnalysisSettings
from imuscope.server.services.parts import ServicePart
from imuscope.server.system.fork_server import ForkServer, JobLostError

if TYPE_CHECKING:
    from imuscope.server.services.services import Services

RUNNING_EACH = 1  # analyses of one user that run at once
WAITING_EACH = 64
MODULE = "imuscope.server.extensions.analysis.jobs.worker"
IDLE_S = 5.0  # after the opening of a page, which needs the processors itself
PROCESS_BYTES = 2 << 30  # bytes for one process, half of the memory of the machine


class AnalysisService:
    """The analyses of all users.

    Args:
        is_viewed: whether a page is open.
        load: mean number of processes that run or wait, as of `os.getloadavg`.
    """

    def __init__(
        self,
        limits: AnalysisLimits = AnalysisLimits(),  # noqa: B008 - frozen
        is_viewed: Callable[[], bool] = lambda: False,
        load: Callable[[], float] = lambda: os.getloadavg()[0],
    ) -> None:
        self.limits = limits
        self._is_viewed, self._load = is_viewed, load
        self.queue = FairQueue(max(2, (os.cpu_count() or 2) // 2), RUNNING_EACH, WAITING_EACH)
        self.forks = ForkServer(MODULE, *limits.words)
        self.forks.is_kept = self._is_wanted
        self._preparing: asyncio.Task[None] | None = None
        self._idle: asyncio.TimerHandle | None = None

    def prepare(self) -> None:
        """Start what runs analyses, in the background: one is requested soon."""
        if self._preparing is None or self._preparing.done():
            self._preparing = asyncio.create_task(self.forks.prepare(), name="analyses")

    def viewed(self, after_s: float = IDLE_S) -> None:
        """Start it when this machine is idle: a page was opened, from which an analysis may be requested."""
        if self._idle is None and self._is_wanted():
            self._idle = asyncio.get_running_loop().call_later(after_s, self._prepare_if_idle, after_s)

    def _prepare_if_idle(self, after_s: float) -> None:
        self._idle = None
        if self._load() >= _processors():
            self.viewed(after_s)
        elif self._is_wanted():
            self.prepare()

    def _is_wanted(self) -> bool:
        return self._is_viewed() and _processors() > 1 and memory_of_one() >= PROCESS_BYTES

    async def content(self, user: str, job: Callable[[], Awaitable[AnalysisJob]]) -> Content:
        """The response to a request; waits for its turn.

        Args:
            job: makes the job, when its turn has come.

        Raises:
            DomainError: "full", "too-many": beyond a limit; or what the job raises.
        """
        try:
            async with self.queue.turn(user) as turn:
                await turn.granted()
                return await self._run(await job())
        except QueueFullError:
            hint = "Wait for one to end, or cancel one."
            raise DomainError("full", f"{WAITING_EACH} of your analyses are waiting.", hint) from None

    async def _run(self, job: AnalysisJob) -> Content:
        try:
            await self.forks.prepare()  # its time does not count
            async with asyncio.timeout(self.limits.time_s):
                facts, body = await self.forks.run(job)
        except TimeoutError:
            raise self.limits.too_long() from None
        except JobLostError:
            message = "The system ended the analysis, as it does when memory runs out."
            raise DomainError("too-many", message, LESS) from None
        except OSError as error:
            words = (error.strerror or str(error)).lower()
            hint = "The machine may have too many processes or too little memory; try again later."
            raise DomainError("fault", f"No process can be started for the analysis: {words}.", hint) from None
        if "kind" in facts:
            raise DomainError(facts["kind"], facts["message"], facts["hint"])
        return Content(facts["media"], body)

    async def close(self) -> None:
        """End all analyses."""
        self._is_viewed = lambda: False
        if self._idle is not None:
            self._idle.cancel()
        await end_tasks(self._preparing)
        await self.forks.close()


def _processors() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def parts(services: "Services") -> Iterator[ServicePart]:
    telemetry = services.telemetry
    settings = services.config.of(AnalysisSettings)
    limits = AnalysisLimits(settings.analysis_mb, settings.analysis_s)
    analyses = AnalysisService(limits, lambda: telemetry.clients.browsers > 0)
    if services.parts.find(DerivedChannels) is None:  # none was stored at the start
        yield signals_part(services)
    yield ServicePart("an analysis", analyses, analyses.close, viewed=analyses.viewed)
