"""Downloads whose client goes away before the next piece is ready."""

from __future__ import annotations

import asyncio
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import BinaryIO

from imuscope.server.streaming_response import streamed
from tests.timeouts import PATIENCE_S
from tests.waiting import until


async def test_a_download_that_is_aborted_keeps_no_thread() -> None:
    """Each kept one of the few threads of the server: after some, no request that needs one was answered."""
    pool = ThreadPoolExecutor(1)
    asyncio.get_running_loop().set_default_executor(pool)
    begun, may_end, ended = threading.Event(), threading.Event(), threading.Event()

    def write(file: BinaryIO) -> None:
        begun.set()
        may_end.wait(PATIENCE_S)
        try:
            file.write(bytes(1 << 20))
        finally:
            ended.set()

    async def download() -> None:
        async for _ in streamed(write):
            pass

    downloading = asyncio.create_task(download())
    await until(begun.is_set, "it is being made")
    downloading.cancel()
    await asyncio.gather(downloading, return_exceptions=True)
    may_end.set()
    await until(ended.is_set, "its maker has noticed")
    answered = asyncio.create_task(asyncio.to_thread(lambda: True))
    try:
        await until(answered.done, "another request is answered")
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
