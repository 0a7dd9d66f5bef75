"""Samples are appended to a ring as they were on the wire: the same as by their columns, for every message."""

from collections.abc import Callable, Iterator, Mapping

import numpy as np
import pytest

from imuscope.protocols.clocks.unix_time import nanoseconds
from imuscope.protocols.events import Batch
from imuscope.protocols.native.kernels import plain
from imuscope.server.devices.decode.decode_options import checked_options
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.streaming import ring_buffer
from imuscope.server.streaming.channel_rows import ChannelRows, WireRows
from imuscope.server.streaming.channels import ChannelRegistry
from imuscope.server.streaming.ring_buffer import FIRST_BLOCK, RingBuffer
from imuscope.server.wire import ChannelInfo
from tests.recordings import every_message
from tests.support.each_row import each_row

REPEATS = 3
LEAST = {"xbus": 60, "isb": 150}  # channels that are stored so; fixed point and scaled numbers are not


CASES: Mapping[str, Callable[[], Iterator[every_message.Case]]] = {
    "xbus": every_message.xbus,
    "isb": every_message.isb,
}


def pieces(family: str) -> Iterator[tuple[ChannelInfo, ChannelRows | WireRows]]:
    """The rows of each message, a batch of several frames each."""
    infos: list[ChannelInfo] = []

    def advertise(info: ChannelInfo) -> int:
        infos.append(info)
        return len(infos)

    registry = ChannelRegistry("1", advertise)
    decoder = all_protocols().decoder(family, checked_options(family, {}), "serial")
    for _, frame in CASES[family]():
        decoder.feed(frame * REPEATS, 0)
        for batch in (event for event in decoder.drain() if isinstance(event, Batch) and len(event)):
            time = np.linspace(1.7e9, 1.7e9 + 1, len(batch))
            for rows in registry.split([(batch, time, nanoseconds(time))]):
                yield infos[rows.channel - 1], rows


@pytest.fixture(params=["compiled", "plain"])
def each_kernel(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param == "plain":
        monkeypatch.setattr(ring_buffer, "append_rows", plain(ring_buffer.append_rows))


@each_row("family", list(CASES))
def test_rows_on_the_wire_are_stored_as_their_columns_are(family: str, each_kernel: None) -> None:
    direct: set[str] = set()
    every: set[str] = set()
    for info, rows in pieces(family):
        every.add(info.name)
        if not isinstance(rows, WireRows):
            continue
        direct.add(info.name)
        dtypes = [column.dtype for column in info.columns]
        by_column, by_row = RingBuffer(dtypes), RingBuffer(dtypes)
        for _ in range(1 + FIRST_BLOCK // len(rows)):  # into the second block
            by_column.append(rows.columns)
            by_row.append_wire(rows)
        assert by_row.total == by_column.total > FIRST_BLOCK
        assert by_row.newest == by_column.newest
        for mine, theirs in zip(by_row.read(), by_column.read(), strict=True):
            assert mine.dtype == theirs.dtype
            assert mine.tobytes() == theirs.tobytes(), info.name
    assert len(direct) >= LEAST[family], sorted(every - direct)


def test_pieces_of_one_channel_are_merged_in_stream_order() -> None:
    """Two batches that share a channel cannot be stored one after the other."""
    kinds = {type(rows) for _, rows in pieces("xbus")}
    assert kinds == {WireRows, ChannelRows}
