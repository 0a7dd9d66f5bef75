"""Memory of the bytes of live links: what is kept, what gives way, and what is made of it."""

import random
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from imuscope.recordings.mcap.reader import McapReader
from imuscope.recordings.mcap.source import McapSource
from imuscope.server.devices.link import byte_memory
from imuscope.server.devices.link.byte_memory import ByteMemory, Direction, LinkMemory
from imuscope.server.links.base import CHUNK_COST, Chunk
from imuscope.server.settings.config import Config
from imuscope.server.streaming.channel_store import ChannelStore
from tests.recordings.mcap_files import json_messages
from tests.support.fakes import FakeLinks, sample
from tests.support.in_process_server import InProcessServer
from tests.support.recorder_harness import chunks, recorded, send, settled
from tests.support.waiting import block_until

S = 1_000_000_000
Got = list[tuple[bytes, int, Direction]]


def filled(memory: LinkMemory, seconds: range, size: int = 1000) -> None:
    for second in seconds:
        memory.append([Chunk(bytes([second % 256]) * size, second * S)], "rx")


# ── one link ─────────────────────────────────────────────────────────────────────────────────────────────────────────


@given(
    sizes=st.lists(st.lists(st.integers(1, 40), min_size=1, max_size=6), min_size=1, max_size=40),
    block=st.integers(1, 4000),
    since=st.integers(0, 200),
    until=st.integers(0, 250),
)
def test_a_range_of_time_is_what_arrived_then_however_it_was_packed(
    sizes: list[list[int]], block: int, since: int, until: int
) -> None:
    all_chunks: list[Chunk] = []
    memory = LinkMemory(lambda: None, 1e9)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(byte_memory, "BLOCK_BYTES", block)
        for batch in sizes:
            made = [
                Chunk(bytes([(len(all_chunks) + n) % 256]) * size, len(all_chunks) + n) for n, size in enumerate(batch)
            ]
            all_chunks += made
            memory.append(made, "rx")
    expected = [(chunk.data, chunk.arrival_ns) for chunk in all_chunks if since <= chunk.arrival_ns < until]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(byte_memory, "RUN_CHUNKS", 3)
        results = [chunk for run in memory.runs(since, until) for piece in run.pieces() for chunk in piece]
    assert results == expected
    assert memory.span == (0, len(all_chunks) - 1)


@settings(deadline=None, max_examples=25)
@given(data=st.data())
def test_a_follower_gets_every_byte_once_whenever_it_joins(data: st.DataObject) -> None:
    """A thread receives while another joins at any moment, writes the past as slowly as it likes, and begins."""
    batches = data.draw(st.lists(st.integers(1, 5), min_size=20, max_size=120))
    join_at = data.draw(st.integers(0, len(batches) - 1))
    begin_at = data.draw(st.integers(join_at, len(batches) - 1))
    since = data.draw(st.integers(0, 300))
    memory = LinkMemory(lambda: None, 1e9)
    every: Got = []
    reached, go_on = [threading.Event() for _ in batches], [threading.Event() for _ in batches]
    for number, event in enumerate(go_on):
        if number not in (join_at, begin_at):
            event.set()

    def receive() -> None:
        for number, count in enumerate(batches):
            reached[number].set()
            go_on[number].wait()
            made = [Chunk(bytes([len(every) % 256]), len(every))]
            for _ in range(count - 1):
                made.append(Chunk(bytes([(len(every) + len(made)) % 256]), len(every) + len(made)))
            way: Direction = "tx" if number % 7 == 3 else "rx"
            every.extend((chunk.data, chunk.arrival_ns, way) for chunk in made)
            memory.append(made, way)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(byte_memory, "BLOCK_BYTES", 1000)
        thread = threading.Thread(target=receive)
        thread.start()
        got: Got = []
        reached[join_at].wait()
        go_on[join_at].set()  # it receives while this joins
        follower = memory.follow(lambda some, way: got.extend((one, at, way) for one, at in some), since)
        got += [(one, at, run.direction) for run in follower.past for piece in run.pieces() for one, at in piece]
        reached[begin_at].wait()
        go_on[begin_at].set()
        follower.begin()
        thread.join()
    for way in ("rx", "tx"):
        joined = [one for one in got if one[2] == way]
        expected = [one for one in every if one[2] == way]
        assert joined == expected[len(expected) - len(joined) :], "in order, none twice, none missing"
        assert all(one in joined for one in expected if one[1] >= since)


def test_a_follower_that_fails_is_removed_and_memory_goes_on() -> None:
    memory = LinkMemory(lambda: None, 1e9)

    def fail(chunks: Sequence[tuple[bytes, int]], way: Direction) -> None:
        raise OSError("full")

    memory.follow(fail, 0).begin()
    memory.append([Chunk(b"a", 1)], "rx")
    memory.append([Chunk(b"b", 2)], "rx")
    assert b"".join(run.data for run in memory.runs()) == b"ab"


# ── all links ────────────────────────────────────────────────────────────────────────────────────────────────────────


class FakeSession:
    """A session of which only the chunks matter."""

    def __init__(self, device: str) -> None:
        self.info = self.listeners = self
        self.id = device
        self.take: Any = None
        self.last: Any = None

    def chunks(self, take: Any) -> Any:
        self.take = take
        return lambda: setattr(self, "take", None)

    def before_close(self, last: Any) -> None:
        self.last = last


def test_a_flood_shortens_its_own_memory_only() -> None:
    memory = ByteMemory(1_000_000, 1e6)
    slow, fast, noise = FakeSession("1"), FakeSession("2"), random.Random(1)
    for session in (slow, fast):
        memory.watch(session)  # type: ignore[arg-type]
    for second in range(3000):
        slow.take([Chunk(bytes([second % 256]) * 40, second * S)], "rx")
        fast.take([Chunk(noise.randbytes(4000), second * S)], "rx")
    of_slow, of_fast = memory.of("1"), memory.of("2.102")
    assert of_slow is not None
    assert of_fast is not None
    assert memory.nbytes <= 1_000_000 + byte_memory.BLOCK_BYTES
    assert of_slow.span == (0, 2999 * S)
    assert of_fast.span is not None
    assert of_fast.span[0] > 2000 * S


def test_bytes_older_than_the_history_are_dropped_but_a_silent_link_keeps_its_last() -> None:
    memory = LinkMemory(lambda: None, 60.0)
    filled(memory, range(1000), 2000)
    assert memory.span is not None
    assert 60 <= (memory.span[1] - memory.span[0]) / S < 60 + byte_memory.BLOCK_BYTES / 2000 + 1


def test_what_it_uses_is_counted_exactly() -> None:
    memory = LinkMemory(lambda: None, 1e9)
    filled(memory, range(2000))
    while memory.drop_oldest():
        pass
    assert 0 <= memory.nbytes < byte_memory.BLOCK_BYTES
    assert memory.nbytes == sum(len(run.data) + CHUNK_COST * len(run.ends) for run in memory.runs())


def test_it_takes_its_memory_from_that_of_samples() -> None:
    used = 0
    store = ChannelStore(lambda: 0.0, 600, 1000, lambda: used)
    assert store.nbytes == 0
    assert Config(memory_mb=256).bytes_limit_mb == 64
    assert Config(memory_mb=64).bytes_limit_mb == 16, "at most a quarter"
    assert Config(bytes_mb=0).bytes_limit_mb == 0


# ── recordings of it ─────────────────────────────────────────────────────────────────────────────────────────────────


def metadata(path: Path, device: str) -> dict[str, Any]:
    source = McapSource(path)
    for _ in source.parts():  # what was learned later is further on in the file
        pass
    return dict(source.devices[device].identity)


def test_what_is_in_memory_becomes_the_recording_that_was_not_made(
    running: InProcessServer, links: FakeLinks, tmp_path: Path
) -> None:
    began = running.client.post("/api/recordings/start", json={"title": "Ordinary"}).json()
    for n in range(200):
        send(running, links, "/dev/one", sample(n))
    send(running, links, "/dev/two", b"other")
    session = running.services.sessions.get("1")
    running.call(lambda: session.listeners.sent.call(b"request", links["/dev/one"].settings.now_ns()))
    running.client.post("/api/recordings/mark", json={"text": "bump", "device": "1"})
    settled(running)
    block_until(lambda: running.client.get("/api/devices").json()[0]["protocol"], "its protocol is known")
    held = {one["device"]: one for one in running.client.get("/api/recorder/memory").json()}
    answer = running.client.post("/api/recordings/save-memory", json={"title": "From memory"})
    assert answer.status_code == 200, answer.text
    saved = answer.json()
    ended = running.client.post("/api/recordings/stop", json={}).json()
    ordinary, path = (tmp_path / "recordings" / f"{one['id']}.mcap" for one in (began, saved))
    assert ended["message"] == ""
    for topic in ("rx/1", "tx/1", "rx/2"):
        assert chunks(path, topic) == chunks(ordinary, topic)
    assert chunks(path, "tx/1") == b"request"
    assert metadata(path, "1") == metadata(ordinary, "1")
    with McapReader(path) as recording:
        assert [body["text"] for _, body in json_messages(recording, "notes")] == ["bump"]
    assert saved["devices"] == ["1", "2"]
    assert saved["bytes"] == 200 * len(sample(0)) + len(b"other") + len(b"request")
    assert held["1"]["t0"] == pytest.approx(saved["t0"], abs=1e-3)
    listed = [one["id"] for one in running.client.get("/api/recordings").json()]
    assert saved["id"] in listed


def test_the_last_seconds_of_chosen_devices(
    running: InProcessServer, links: FakeLinks, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    send(running, links, "/dev/one", sample(1))
    before = time.time()
    block_until(lambda: time.time() > before + 1.0, "time passes")
    send(running, links, "/dev/one", sample(2))
    send(running, links, "/dev/two", sample(3))
    monkeypatch.setattr(running.services.recorder, "now", lambda: before + 10.1)  # however long the request takes
    last = {"devices": ["1"], "seconds": 10.0}  # begins in the pause
    saved = running.client.post("/api/recordings/save-memory", json=last).json()
    path = tmp_path / "recordings" / f"{saved['id']}.mcap"
    assert saved["devices"] == ["1"]
    assert chunks(path, "rx/1") == sample(2)
    assert chunks(path, "rx/2") == b""
    range_ = {"devices": ["1"], "t0": before - 5, "t1": before + 0.2}
    earlier = running.client.post("/api/recordings/save-memory", json=range_).json()
    assert chunks(tmp_path / "recordings" / f"{earlier['id']}.mcap", "rx/1") == sample(1)


def test_nothing_in_memory_is_reported(running: InProcessServer) -> None:
    answer = running.client.post("/api/recordings/save-memory", json={})
    assert answer.status_code == 404
    assert "No bytes" in answer.json()["message"]
    answer = running.client.post("/api/recordings/save-memory", json={"seconds": -1})
    assert (answer.status_code, answer.json()["message"]) == (422, "seconds is -1 s; allowed: 0 … 86400 s.")


@settings(deadline=None, max_examples=6)
@given(pauses=st.lists(st.sampled_from([0.0, 0.0005, 0.002, 0.01]), min_size=30, max_size=60))
def test_a_recording_with_a_past_goes_on_without_a_lost_or_doubled_byte(
    tmp_path_factory: pytest.TempPathFactory, pauses: list[float]
) -> None:
    """Bytes arrive in a thread, at random times, while the recording starts."""
    folder, links = tmp_path_factory.mktemp("past"), FakeLinks()
    with InProcessServer(Config(sources=("/dev/one",), data=folder), links.open) as running:
        link, at_start, at_random = links["/dev/one"], threading.Event(), threading.Event()
        sent: list[bytes] = []

        def receive() -> None:
            for number, pause in enumerate(pauses):
                data = b"".join(sample((number * 8 + n) % 256, number) for n in range(8))
                sent.append(data)
                link.flow.arrivals.call([Chunk(data, link.settings.now_ns())])
                if number == len(pauses) // 3:
                    at_start.set()
                at_random.wait(pause)

        thread = threading.Thread(target=receive)
        thread.start()
        at_start.wait()
        state = running.client.post("/api/recordings/start", json={"before_s": 60}).json()
        thread.join()
        settled(running)
        running.client.post("/api/recordings/stop", json={})
        assert state["running"]
        assert chunks(recorded(folder), "rx/1") == b"".join(sent)
