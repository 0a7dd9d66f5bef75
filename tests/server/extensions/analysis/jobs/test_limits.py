"""Limits of analyses: memory, time, turns, and the end with their client. Each runs in a process of its own."""

from __future__ import annotations

import asyncio
import collections
import itertools
import os
import signal
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from imuscope.server.errors import DomainError
from imuscope.server.extensions.analysis.jobs.jobs import AnalysisJob, Content
from imuscope.server.extensions.analysis.jobs.limits import AnalysisLimits
from imuscope.server.extensions.analysis.jobs.service import AnalysisService
from imuscope.server.system.fork_server import ForkServer, JobLostError
from tests.support.each_row import each_row
from tests.support.forking.forked_workers import started_afresh
from tests.support.processes import is_running
from tests.support.waiting import until

TEXT = "text/plain"


@dataclass(frozen=True)
class Progress:
    """Gives a text."""

    text: str

    def content(self) -> Content:
        return Content(TEXT, self.text.encode())


@dataclass(frozen=True)
class NeverEnds:
    """Leaves its process in a file, and holds the interpreter for ever, in C: no thread gets a turn, nor a handler."""

    file: Path

    def content(self) -> Content:
        self.file.write_text(str(os.getpid()))
        collections.deque(itertools.repeat(None), maxlen=0)
        raise AssertionError


@dataclass(frozen=True)
class TakesMemory:
    """Allocates."""

    megabytes: int

    def content(self) -> Content:
        return Content(TEXT, str(len(np.ones(self.megabytes << 17))).encode())


class IsKilled:
    """Is killed by the system."""

    def content(self) -> Content:
        os.kill(os.getpid(), signal.SIGKILL)
        raise AssertionError


@dataclass(frozen=True)
class SendsBack:
    """Gives the sum of its samples."""

    samples: np.ndarray

    def content(self) -> Content:
        return Content(TEXT, str(int(self.samples.sum())).encode())


def ready(job: AnalysisJob) -> Callable[[], Awaitable[AnalysisJob]]:
    async def get() -> AnalysisJob:
        return job

    return get


@asynccontextmanager
async def analyses(**limits: float) -> AsyncIterator[AnalysisService]:
    """A service with these limits, closed with the block."""
    service = AnalysisService(AnalysisLimits(**limits))
    try:
        yield service
    finally:
        await service.close()


async def _process_in(file: Path) -> int:
    await until(lambda: file.exists() and file.read_text(), "the job to begin")
    return int(file.read_text())


async def test_samples_arrive_whole() -> None:
    async with analyses() as service:
        samples = np.arange(3_000_000.0)
        result = await service.content("a", ready(SendsBack(samples)))
        assert result == (TEXT, str(int(samples.sum())).encode())


async def test_an_analysis_beyond_its_memory_is_refused_and_the_next_one_answered() -> None:
    async with analyses(memory_mb=64) as service:
        with pytest.raises(DomainError, match="more memory than 64 MB") as refused:
            await service.content("a", ready(TakesMemory(2000)))
        assert refused.value.kind == "too-many"
        assert (await service.content("a", ready(Progress("on")))).body == b"on"


async def test_an_analysis_beyond_its_time_is_killed(tmp_path: Path) -> None:
    async with analyses(time_s=0.2) as service:
        with pytest.raises(DomainError, match=r"longer than 0\.2 s"):
            await service.content("a", ready(NeverEnds(tmp_path / "process")))
        pid = int((tmp_path / "process").read_text() or 0) if (tmp_path / "process").exists() else 0
        await until(lambda: not pid or not is_running(pid), "the process to end")


async def test_an_analysis_ends_with_its_client_though_it_holds_the_interpreter(tmp_path: Path) -> None:
    async with analyses() as service:
        request = asyncio.create_task(service.content("a", ready(NeverEnds(tmp_path / "process"))))
        pid = await _process_in(tmp_path / "process")
        request.cancel()
        await until(lambda: not is_running(pid), "the process to end")
        assert service.queue.running == 0


async def test_one_user_runs_one_analysis_while_another_gets_an_answer(tmp_path: Path) -> None:
    async with analyses() as service:
        long = [asyncio.create_task(service.content("a", ready(NeverEnds(tmp_path / name)))) for name in "12"]
        await _process_in(tmp_path / "1")
        assert (await service.content("b", ready(Progress("soon")))).body == b"soon"
        assert not (tmp_path / "2").exists()
        for one in long:
            one.cancel()
        await asyncio.gather(*long, return_exceptions=True)


async def test_an_analysis_that_the_system_kills_is_an_error_in_words() -> None:
    async with analyses() as service:
        with pytest.raises(DomainError, match="system ended the analysis"):
            await service.content("a", ready(IsKilled()))


async def test_the_fork_server_is_started_again_after_it_was_killed() -> None:
    async with analyses() as service:
        await service.content("a", ready(Progress("1")))
        pid = service.forks.pid
        assert pid is not None
        os.kill(pid, signal.SIGKILL)
        await until(lambda: not is_running(pid), "its end")
        assert (await service.content("a", ready(Progress("2")))).body == b"2"
        assert service.forks.pid != pid


async def test_the_fork_server_ends_when_nothing_is_requested_for_a_while() -> None:
    forks = ForkServer("imuscope.server.extensions.analysis.jobs.worker", *AnalysisLimits().words, idle_s=0.0)
    assert (await forks.run(Progress("1")))[1] == b"1"
    await until(lambda: forks.pid is None, "the end of the fork server")
    assert (await forks.run(Progress("2")))[1] == b"2"
    await forks.close()


async def test_a_fork_server_that_ends_while_it_starts_is_an_error_in_words() -> None:
    forks = ForkServer("imuscope.server.extensions.analysis.jobs.worker", "no number", "60")
    with pytest.raises(OSError, match="it ended while it started"):
        await forks.run(Progress("1"))
    assert forks.pid is None
    await forks.close()


async def test_what_runs_analyses_is_there_before_the_first_one_while_a_page_is_open(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Regression: the first analysis of a server waited 0.7 s for the libraries, however long the page was open."""
    monkeypatch.setattr("imuscope.server.extensions.analysis.jobs.service._processors", lambda: 2)
    views, loads = [True], [9.0, 3.0, 0.5]

    service = AnalysisService(is_viewed=lambda: views[0], load=lambda: loads.pop(0))
    service.viewed(0.0)
    await until(lambda: service.forks.pid, "the process to start")
    assert loads == [], "it waits until the machine is idle"
    assert service.forks.is_kept(), "it stays while somebody looks"
    views[0] = False
    assert not service.forks.is_kept()
    await service.close()


@each_row(("is_viewed", "processors", "memory"), [(False, 2, 4), (True, 1, 4), (True, 2, 1)])
async def test_nothing_is_started_where_no_page_is_open_or_on_a_small_machine(
    is_viewed: bool, processors: int, memory: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("imuscope.server.extensions.analysis.jobs.service._processors", lambda: processors)
    monkeypatch.setattr("imuscope.server.extensions.analysis.jobs.service.memory_of_one", lambda: memory << 30)
    loads = [0.0]

    service = AnalysisService(is_viewed=lambda: is_viewed, load=loads.pop)
    service.viewed(0.0)
    assert not service.forks.is_kept()
    await service.close()
    assert loads == [0.0], "nothing was even planned"


async def test_closing_does_not_wait_for_the_start() -> None:
    with started_afresh():
        forks = ForkServer("json.tool")  # it reads for ever, and never says that it is ready
        starting = asyncio.create_task(forks.prepare())
        await until(lambda: forks.pid, "the process to be there")
        await forks.close()
        with pytest.raises(OSError, match="it ended while it started"):
            await starting


async def test_closing_ends_the_jobs_under_way(tmp_path: Path) -> None:
    forks = ForkServer("imuscope.server.extensions.analysis.jobs.worker", *AnalysisLimits().words)
    job = asyncio.create_task(forks.run(NeverEnds(tmp_path / "process")))
    pid = await _process_in(tmp_path / "process")
    await forks.close()
    with pytest.raises(JobLostError):
        await job
    await until(lambda: not is_running(pid), "the process to end")
