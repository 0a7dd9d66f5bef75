"""Forked workers of a server: their end is seen, whoever looks first."""

import asyncio
import os
import select
import signal
from typing import Any

import pytest

from imuscope.server.system.workers import Worker
from tests.support.forking import fork_server
from tests.support.timeouts import PATIENCE_S

pytestmark = pytest.mark.skipif(not fork_server.IS_THERE, reason="servers are forked on Linux only")


async def test_a_worker_that_was_killed_before_it_is_ended_has_ended() -> None:
    """To signal it took the news of its end from who waited for it, and a killed question had no answer."""
    worker = await Worker.start("imuscope.server.extensions.fleet.query.query_worker")
    worker.dismiss()
    process: Any = worker._process
    os.kill(worker.pid, signal.SIGKILL)
    select.select([process._child.fileno()], [], [])  # told, but the loop has not looked
    async with asyncio.timeout(PATIENCE_S):
        await worker.end()
        await worker.wait()
        assert await worker.output.read() == b""  # or it would be left open
