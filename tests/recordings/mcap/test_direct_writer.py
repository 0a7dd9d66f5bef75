"""The direct writer: all reads of followed links, in order and with their times, compiled and in plain Python."""

import resource
import tempfile
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from imuscope.protocols.native.kernels import plain
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.mcap import write_kernel as record_kernel
from imuscope.recordings.mcap.direct_writer import DirectWriter
from imuscope.recordings.mcap.live_writer import Limits, RecordingWriter
from imuscope.recordings.mcap.read_memory import MAX_READS, READ_COUNT, ReadFollower, ReadMemory
from imuscope.recordings.mcap.records import MESSAGE_HEAD
from imuscope.recordings.mcap.writer import McapWriter
from tests.recordings.mcap_files import read, theirs
from tests.support.waiting import block_until

OFFSET_NS = 1_700_000_000_000_000_000
ABOUT = {"title": "drive", "version": "1"}
FAR_NS = 1 << 40


class Source:
    """A reading loop that reads what it is told."""

    def __init__(self) -> None:
        self.memory = ReadMemory(OFFSET_NS)
        self.follower = ReadFollower(self.memory, 0, lambda follower: follower.oldest_ns is None)
        self.read_count = 0
        self.expected: list[tuple[int, bytes]] = []

    def read(self, data: bytes) -> None:
        memory, at = self.memory, int(self.memory.state[READ_COUNT])
        begin = int(memory.ends[at - 1]) if at else 0
        if at == MAX_READS or begin + len(data) > len(memory.buffer):
            self.memory = ReadMemory(OFFSET_NS)
            self.follower.extend(at, self.memory)
            self.read(data)
            return
        memory.view[begin : begin + len(data)] = data
        memory.ends[at], memory.arrivals[at] = begin + len(data), 1000 * self.read_count
        memory.state[READ_COUNT] = at + 1
        self.expected.append((OFFSET_NS + 1000 * self.read_count, data))
        self.read_count += 1

    def end(self) -> None:
        self.follower.extend(int(self.memory.state[READ_COUNT]), None)


@pytest.fixture(params=["compiled", "plain"])
def each_kernel(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param == "plain":
        monkeypatch.setattr(record_kernel, "write_reads", plain(record_kernel.write_reads))


def chunks(path: Path, device: str) -> list[tuple[int, bytes]]:
    return [(time_ns, data) for topic, time_ns, data in read(path) if topic == f"rx/{device}"]


def write_once(direct: DirectWriter, writer: McapWriter, shift_ns: int = 0) -> bool:
    return direct.write(writer, shift_ns, 1000, 0, FAR_NS)


@given(data=st.data())
@settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_each_read_is_written_once_with_its_time(each_kernel: None, data: st.DataObject) -> None:
    """Whatever arrives between two turns: nothing, more than the memory holds, another link, an end."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "drive.mcap"
        writer, direct = McapWriter(path, {}), DirectWriter()
        sources = {"1": Source(), "2": Source()}
        for device, source in sources.items():
            direct.add(device, source.follower)
        for _ in range(data.draw(st.integers(1, 5))):
            for source in sources.values():
                sizes = data.draw(st.lists(st.sampled_from([1, 66, 4096, 60_000]), max_size=5))
                for size in sizes + [7] * data.draw(st.sampled_from([0, 0, 1500])):
                    source.read(bytes([source.read_count & 255]) * size)
            write_once(direct, writer)
        for source in sources.values():
            source.end()
        while direct:
            write_once(direct, writer)
        writer.close()
        assert theirs(path) == read(path)
        for device, source in sources.items():
            assert chunks(path, device) == source.expected


def test_the_head_of_a_record_is_that_of_a_message() -> None:
    assert MESSAGE_HEAD.size == record_kernel.HEAD_BYTES


def test_a_shift_is_added_to_the_times(tmp_path: Path, each_kernel: None) -> None:
    writer, direct, source = McapWriter(tmp_path / "drive.mcap", {}), DirectWriter(), Source()
    direct.add("1", source.follower)
    source.read(b"early")
    write_once(direct, writer)
    source.read(b"late")
    write_once(direct, writer, 5_000_000_000)
    writer.close()
    assert [time_ns - OFFSET_NS for time_ns, _ in chunks(tmp_path / "drive.mcap", "1")] == [0, 5_000_001_000]


def test_the_loop_ends_when_it_is_stopped_or_nothing_comes(tmp_path: Path, each_kernel: None) -> None:
    writer, direct, source = McapWriter(tmp_path / "drive.mcap", {}), DirectWriter(), Source()
    direct.add("1", source.follower)
    assert not direct.write(writer, 0, 1000, 60_000_000_000, FAR_NS), "nothing came"
    assert direct.sleep()
    source.read(b"one")
    assert not direct.sleep()
    direct.stop_flag[0] = 1
    assert direct.write(writer, 0, 1000, 60_000_000_000, FAR_NS)
    direct.stop_flag[0] = 0
    source.read(b"two")
    assert direct.write(writer, 0, 1000, 60_000_000_000, 1), "as many bytes as were allowed"
    writer.close()


def test_a_full_disk_keeps_whole_records_and_is_reported(tmp_path: Path, each_kernel: None) -> None:
    writer, direct, source = McapWriter(tmp_path / "drive.mcap", {}), DirectWriter(), Source()
    direct.add("1", source.follower)
    source.read(b"small")
    write_once(direct, writer)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (writer.size + 250, before[1]))
    try:
        for _ in range(5):
            source.read(b"x" * 100)
        with pytest.raises(RecordingError, match="largest size"):
            write_once(direct, writer)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert chunks(tmp_path / "drive.mcap", "1") == source.expected[:2], "what fitted, and no part of another"
    assert (tmp_path / "drive.mcap").stat().st_size == writer.size


def test_parts_of_a_recording_have_every_read_once(tmp_path: Path) -> None:
    """A writer with its threads: reads come while it writes, events between them, and parts end."""
    tape = RecordingWriter(lambda part: tmp_path / f"{part}.mcap", {}, time.time_ns, Limits(split_bytes=30_000))
    source = Source()
    tape.follow = lambda: [("1", source.follower)]
    tape.device("1", {})
    for n in range(3000):
        source.read(n.to_bytes(4, "big") * 16)
        if n % 500 == 0:
            tape.event({"kind": "link", "text": "a word"}, n)
            size = tape.bytes
            block_until(lambda size=size: tape.bytes > size, "it is written")  # type: ignore[misc]
    block_until(lambda: source.follower.oldest_ns is None, "all is written")
    source.end()
    tape.stop()
    assert tape.error is None
    parts = sorted(tmp_path.iterdir(), key=lambda path: int(path.stem))
    assert len(parts) > 3
    assert [one for path in parts for one in chunks(path, "1")] == source.expected
