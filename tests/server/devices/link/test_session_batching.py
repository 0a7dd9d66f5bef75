"""Chunks that are read together: the same samples, times, figures and recording as one chunk at a time."""

from __future__ import annotations

import asyncio
import itertools
import tempfile
import time
from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from imuscope.recordings.mcap.live_writer import RecordingWriter
from imuscope.recordings.mcap.reader import McapReader
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.devices.link.session import Session
from imuscope.server.links.base import Chunk, LinkSettings
from imuscope.server.streaming.telemetry import Telemetry
from tests.bench.support.serial_device import frame
from tests.recordings.mcap_files import messages
from tests.support.fakes import FakeClock, FakeLink

RATE = 2000
PERIOD_NS = 10**9 // RATE


class GatheredLink(FakeLink):
    """A link whose chunks are taken together."""

    def __init__(self, settings: LinkSettings) -> None:
        super().__init__("/dev/ttyFAKE", settings)
        self.waiting: list[Chunk] = []

    def read_now(self, again_ns: int) -> list[Chunk]:
        chunks, self.waiting = self.waiting, []
        return chunks


async def result(chunks: list[Chunk], groups: list[int]) -> dict[str, Any]:
    """Everything that a session makes of chunks that arrive in groups; it decodes after the last one."""
    clock = FakeClock()
    telemetry = Telemetry.create(clock)
    link = GatheredLink(LinkSettings(now_ns=clock.now_ns))
    received: list[tuple[bytes, int, str]] = []
    session = Session("1", link, telemetry.bus, all_protocols(), DecodeOptions("xbus"))
    session.listeners.chunks(lambda came, way: received.extend((one.data, one.arrival_ns, way) for one in came))
    session.start()
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    clock.move(chunks[-1].arrival_ns / 1e9 - clock())
    rest = iter(chunks)
    for count in [*groups, len(chunks)]:
        if part := list(itertools.islice(rest, count)):
            link.flow.arrivals.call(part)
            session._on_chunks(part)
    session.access.decode()
    stats, now = session._stats, clock()
    results = {
        "rows": {one.info.name: [column.tolist() for column in one.ring.read()] for one in telemetry.store.all},
        "bytes": (stats.bytes.total, stats.bytes.rate(now), stats.last_arrival),
        "messages": stats.report(now),
        "losses": (stats.gaps, stats.lost, stats.rejects_by),
        "latency": (stats.latency.counts, stats.latency.sum),
        "silence": (session._silence.limit, session._silence._chunks, session._silence._interval),
        "diagnostics": list(session._diagnostics._recent),
        "tail": session.access.bytes_at(0, 1 << 20),
        "backlog": session._pipeline.slices._used,
        "heard": received,
    }
    await session.close()
    return results


@st.composite
def arrivals(draw: st.DrawFn) -> list[Chunk]:
    """Frames of a device, some lost or damaged, cut anywhere, with uneven times."""
    frames = [frame(number, RATE) for number in range(draw(st.integers(3, 60)))]
    damage = draw(st.sets(st.integers(0, len(frames) - 1), max_size=3))
    stream = b"".join(bytes([one[0]]) + b"\0" + one[2:] if at in damage else one for at, one in enumerate(frames))
    whole = [len(frames[0]) * number for number in range(1, len(frames))]
    cuts = draw(st.one_of(st.just(whole), st.lists(st.integers(1, len(stream) - 1), max_size=80)))
    ends = [*sorted(set(cuts)), len(stream)]
    begin_ns = 1_700_000_000_000_000_000
    times = [begin_ns + PERIOD_NS * end // len(frames[0]) + draw(st.integers(0, 400_000)) for end in ends]
    times = list(itertools.accumulate(times, max))
    return [Chunk(stream[a:b], at) for a, b, at in zip([0, *ends], ends, times, strict=False)]


@given(arrivals(), st.lists(st.integers(1, 40), max_size=40))
def test_gathered_chunks_give_what_single_ones_give(chunks: list[Chunk], groups: list[int]) -> None:
    one_by_one = asyncio.run(result(chunks, [1] * len(chunks)))
    assert sum(map(len, one_by_one["rows"].values())), "there are samples"
    assert asyncio.run(result(chunks, groups)) == one_by_one


@given(arrivals(), st.lists(st.integers(1, 40), max_size=40), st.integers(0, 5))
def test_gathered_chunks_are_recorded_as_single_ones(chunks: list[Chunk], groups: list[int], shift_ns: int) -> None:
    def recorded(groups: list[int], folder: str) -> list[tuple[str, int, bytes]]:
        path = Path(folder) / f"{len(groups)}-{sum(groups)}.mcap"
        writer = RecordingWriter(lambda part: path, {}, time.time_ns, shift_ns=shift_ns)
        rest = iter(chunks)
        for count in [*groups, len(chunks)]:
            if part := [(chunk.data, chunk.arrival_ns) for chunk in itertools.islice(rest, count)]:
                writer.chunks("1", "rx", part)
        writer.stop()
        with McapReader(path) as recording:
            return messages(recording)

    with tempfile.TemporaryDirectory() as folder:
        outcome = recorded(groups, folder)
    assert outcome == [("rx/1", chunk.arrival_ns + shift_ns, chunk.data) for chunk in chunks]
