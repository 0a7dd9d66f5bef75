"""A pipe as a source: device bytes are not delayed; a capture written at once is played at its own pace."""

import asyncio
import os
import threading
from pathlib import Path

import pytest

from imuscope.recordings.mcap.records import MAGIC
from imuscope.server.links.base import LinkError
from imuscope.server.links.pipe import PipeLink
from imuscope.server.links.source_url import open_link
from tests.server.links.link_fixtures import frame, gather, joined, settings


@pytest.fixture
def pipe(tmp_path: Path) -> Path:
    os.mkfifo(tmp_path / "pipe")
    return tmp_path / "pipe"


async def test_a_pipe_is_served(pipe: Path) -> None:
    """A capture of 0.5 s that is written at once is played in the time given by the device's clock, and then ends."""
    data = b"".join(frame(i, i * 100) for i in range(51))

    link = open_link(str(pipe), settings(protocol="xbus"))
    assert isinstance(link, PipeLink)
    await link.open()
    writer = threading.Thread(target=pipe.write_bytes, args=(data,))
    writer.start()
    chunks = await gather(link, len(data))
    assert joined(chunks) == data
    assert chunks[-1].arrival_ns - chunks[0].arrival_ns > 300_000_000
    with pytest.raises(LinkError) as ended:
        await link.read()
    assert ended.value.kind == "ended"
    writer.join()
    await link.close()


async def test_device_output_through_a_pipe_is_not_delayed(pipe: Path) -> None:
    """By its clock the frames are 10 s apart; each is there before the next is written."""
    link = open_link(str(pipe), settings(protocol="xbus"))
    await link.open()
    end = await asyncio.to_thread(os.open, pipe, os.O_WRONLY)
    try:
        for i in range(6):
            one = frame(i, i * 100_000)
            os.write(end, one)
            assert joined(await gather(link, len(one))) == one
    finally:
        os.close(end)
        await link.close()


async def test_a_pipe_without_a_writer_is_closed_at_once(pipe: Path) -> None:
    link = open_link(str(pipe), settings())
    await link.open()
    await link.close()


async def test_a_recording_through_a_pipe_is_refused_with_a_hint(pipe: Path) -> None:
    link = open_link(str(pipe), settings())
    await link.open()
    writer = threading.Thread(target=pipe.write_bytes, args=(MAGIC + bytes(100),))
    writer.start()
    with pytest.raises(LinkError, match="Write it to a file"):
        await link.read()
    writer.join()
    await link.close()
