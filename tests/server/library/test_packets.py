"""The packet view: which frame made a sample, what each of its bytes means, and what lies around it."""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.protocols.family.info import ProtocolInfo
from imuscope.protocols.idtp.json_codec import frame_to_json as idtp_values
from imuscope.protocols.isb.json_codec import frame_to_json as isb_values
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.xbus.frames import build
from imuscope.protocols.xbus.json_codec import frame_to_json as xbus_values
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.devices.link.byte_memory import LinkMemory
from imuscope.server.library.packets import SampleArrival, live_bytes, packets_around
from imuscope.server.links.base import Chunk
from imuscope.server.settings.config import Config
from tests.support.each_row import each_row
from tests.support.fakes import FakeLinks
from tests.support.in_process_server import InProcessServer
from tests.support.problems import assert_problem
from tests.support.source_files import ROOT
from tests.support.waiting import block_until

MS = 1_000_000
VALUES: dict[str, Callable[[bytes], Any]] = {
    "xbus": xbus_values,
    "isb": lambda frame: isb_values(frame, None),
    "idtp": lambda frame: idtp_values(frame, {}),
}


def accepted(family: ProtocolInfo, data: bytes) -> list[bytes]:
    listing = family.frames.listing()
    listing.feed(data)
    lines = [line for line in listing.drain(stalled=True) if "reject" not in line and line["protocol"] == family.name]
    return [data[line["offset"] : line["offset"] + line["size"]] for line in lines]


def golden(name: str) -> list[bytes]:
    """Every frame in the golden vectors of a family, once."""
    results: dict[bytes, None] = {}
    for path in sorted((ROOT / "tests" / "golden" / name).glob("*.json")):
        for text in re.findall(r'"\w*hex": ?"((?:[0-9a-fA-F]{2})+)"', path.read_text()):
            results |= dict.fromkeys(accepted(PROTOCOLS[name], bytes.fromhex(text)))
    return list(results)


GOLDEN = {name: golden(name) for name in VALUES}


# ── the meaning of bytes ─────────────────────────────────────────────────────────────────────────────────────────────


@each_row("name", VALUES)
def test_the_parts_of_every_golden_frame_cover_it_in_order(name: str) -> None:
    driver = PROTOCOLS[name].configuration.driver
    assert driver is not None
    assert len(GOLDEN[name]) > 50
    for frame in GOLDEN[name]:
        at = 0
        for part in driver.annotate(frame):
            assert part.offset == at, frame.hex()
            at += part.size
        assert at == len(frame), frame.hex()


@each_row("name", VALUES)
@given(data=st.data())
def test_a_byte_of_a_field_changes_that_field_and_no_other(name: str, data: st.DataObject) -> None:
    driver = PROTOCOLS[name].configuration.driver
    assert driver is not None
    frame = data.draw(st.sampled_from(GOLDEN[name]))
    parts = [part for part in driver.annotate(frame) if part.path]
    if not parts:
        return
    part = data.draw(st.sampled_from(parts))
    before = VALUES[name](frame)
    root = next((field for field in before["fields"] if part.path == field or part.path.startswith(f"{field}.")), "")
    if before["fields"].keys() & LENGTHS or part.path in SELECTORS:
        return
    changed = bytearray(frame)
    changed[part.offset + data.draw(st.integers(0, part.size - 1))] ^= data.draw(st.integers(1, 255))
    after = VALUES[name](bytes(changed))
    assert {field for field in before["fields"] if after["fields"].get(field) != before["fields"][field]} <= {root}
    assert root, f"{part.path} is a field that is listed"


SELECTORS = {"mode", "version", "type"}  # what follows them has another form
LENGTHS = {"data"}  # a payload without a form


# ── the frame of a sample ────────────────────────────────────────────────────────────────────────────────────────────


def sample(count: int) -> bytes:
    """An MTData2 frame: packet counter, device time, acceleration."""
    clock = struct.pack(">HBH", 0x1020, 2, count) + struct.pack(">HBI", 0x1060, 4, count * 20)
    return build(0x36, clock + struct.pack(">HB3f", 0x4020, 12, count, 0.5, -1.5))


def near(memory: LinkMemory, moment: SampleArrival, **options: Any) -> Any:
    view = packets_around("1", PROTOCOLS["xbus"], {}, live_bytes(memory, b""), moment, **options)
    assert view is not None
    return view


@given(
    together=st.lists(st.integers(1, 4), min_size=20, max_size=40),
    expected=st.integers(0, 19),
    cut=st.integers(1, 20),
)
def test_the_frame_of_each_sample_is_found_however_its_bytes_arrived(
    together: list[int], expected: int, cut: int
) -> None:
    memory, count, moments = LinkMemory(lambda: None, 1e9), 0, []
    rest = b""
    for number, frames in enumerate(together):
        data = rest + b"".join(sample(count + n) for n in range(frames))
        rest = data[-cut:]  # the last frame of a chunk ends in the next one
        ends = [count - 1] * bool(number) + list(range(count, count + frames - 1))
        moments += [(n, SampleArrival(number * MS, rank)) for rank, n in enumerate(ends)]
        memory.append([Chunk(data[:-cut], number * MS)], "rx")
        count += frames
    n, moment = moments[min(expected, len(moments) - 1)]
    view = near(memory, moment, names=("Acceleration",))
    result = view.packets[view.at]
    assert result.fields["PacketCounter"] == n
    assert bytes.fromhex(result.hex) == sample(n)
    before = [packet.fields["PacketCounter"] for packet in view.packets[: view.at]]
    assert before == list(range(n - len(before), n))


def test_rejects_foreign_bytes_and_sent_ones_are_between_the_frames() -> None:
    memory = LinkMemory(lambda: None, 1e9)
    damaged = bytearray(sample(3))
    damaged[10] ^= 1
    for at, data in enumerate((sample(1), sample(2), bytes(damaged), sample(4), b"\1\2\3", sample(5), sample(6))):
        memory.append([Chunk(data, at * 10 * MS)], "rx")
    memory.append([Chunk(build(0x30), 25 * MS)], "tx")
    view = near(memory, SampleArrival(30 * MS))
    kinds = [packet.kind for packet in view.packets]
    assert kinds[:4] == ["frame", "frame", "reject", "sent"]
    assert kinds[view.at] == "frame"
    reject, sent = view.packets[2:4]
    assert (reject.reason, bytes.fromhex(reject.hex)) == ("bad_checksum", bytes(damaged))
    assert reject.verdict == "Rejected: the checksum does not match."
    assert sent.name == "GoToConfig"
    assert sent.gap_ms == pytest.approx(5)
    others = [packet for packet in view.packets if packet.kind in ("foreign", "reject")]
    assert "010203" in "".join(packet.hex for packet in others)
    assert near(memory, SampleArrival(60 * MS), kind="reject").packets[-1].kind == "frame"
    at_reject = near(memory, SampleArrival(0), kind="reject", beside=0)
    assert [packet.kind for packet in at_reject.packets] == ["reject"]


def test_the_newest_frame_is_found_without_reading_all_of_memory() -> None:
    memory = LinkMemory(lambda: None, 1e9)
    for number in range(400):
        memory.append([Chunk(sample(number), number * 10 * MS)], "rx")
    newest_ns, request = 3990 * MS, []
    read = live_bytes(memory, b"")

    def counted(since_ns: int, until_ns: int) -> Any:
        request.append(until_ns - since_ns)
        return read(since_ns, until_ns)

    view = packets_around("1", PROTOCOLS["xbus"], {}, counted, SampleArrival(newest_ns), beside=24, newest_ns=newest_ns)
    assert view is not None
    assert [packet.fields["PacketCounter"] for packet in view.packets] == list(range(375, 400))
    assert (view.at, request) == (24, [1000 * MS])


def test_a_family_without_a_driver_has_its_frame_as_a_whole() -> None:
    from dataclasses import replace

    memory = LinkMemory(lambda: None, 1e9)
    memory.append([Chunk(sample(1) + sample(2) + sample(3), 0)], "rx")
    xbus = PROTOCOLS["xbus"]
    family = replace(
        xbus,
        configuration=replace(xbus.configuration, driver=None),
        frames=replace(xbus.frames, composer=None, rows=lambda: ()),
    )
    view = packets_around("1", family, {}, live_bytes(memory, b""), SampleArrival(0, 1))
    assert view is not None
    (whole,) = view.packets[view.at].spans
    assert (whole.offset, whole.size, whole.label) == (0, len(sample(2)), "MTData2, as a whole")


# ── over HTTP ────────────────────────────────────────────────────────────────────────────────────────────────────────


@pytest.fixture(scope="module")
def links() -> FakeLinks:
    return FakeLinks()


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory, links: FakeLinks) -> Iterator[InProcessServer]:
    data: Path = tmp_path_factory.mktemp("data")
    config = Config(sources=("/dev/one",), data=data, protocol="xbus", record_head=False)
    with InProcessServer(config, links.open, all_protocols()) as running:
        for n in range(0, 600, 3):
            running.call(links["/dev/one"].send, sample(n) + sample(n + 1) + sample(n + 2))
        store = running.services.telemetry.store

        def arrived() -> bool:
            return any(one.info.name == "Acceleration" and len(one.ring) == 600 for one in store.all)

        block_until(lambda: running.call(arrived), "all samples are decoded")
        yield running


@each_row("base", ["device", "arrival"])
def test_a_point_of_a_plot_leads_to_its_bytes_live_and_recorded(running: InProcessServer, base: str) -> None:
    store = running.services.telemetry.store
    channel = next(one for one in running.call(lambda: store.all) if one.info.name == "Acceleration")
    arrival, time, x, *_ = running.call(channel.ring.read)
    saved = running.client.post("/api/recordings/save-memory", json={}).json()["id"]
    detail = block_until(lambda: opened(running, saved), "the recording is decoded")
    recorded = next(one["id"] for one in detail["channels"] if one["name"] == "Acceleration")
    for row in (3, 300, 590):
        at = (time if base == "device" else arrival)[row]
        request: dict[str, Any] = {"time": float(at), "base": base, "beside": 3}
        live = running.client.get("/api/devices/1/frames", params={**request, "channel": channel.info.id})
        assert live.status_code == 200, live.text
        result = live.json()["packets"][live.json()["at"]]
        if base == "device":
            assert result["fields"]["Acceleration"][0] == x[row] == row
        else:
            assert abs(result["fields"]["Acceleration"][0] - row) <= 2, "of three that arrived together, one"
        assert result["title"] == "MTData2"
        assert result["source"]
        columns = block_until(lambda: columns_of(running, saved), "its columns can be read")
        clock = columns.clock(recorded, row, row + 1, "key" if base == "device" else "arrival")
        request |= {"time": float(clock[0]), "channel": recorded}  # a whole recording may map the device's clock better
        there = running.client.get(f"/api/recordings/{saved}/frames", params=request)
        assert there.status_code == 200, there.text
        again = there.json()["packets"][there.json()["at"]]
        assert (again["hex"], again["spans"]) == (result["hex"], result["spans"])


def opened(running: InProcessServer, recording: str) -> Any:
    answer = running.client.get(f"/api/recordings/{recording}")
    return answer.json() if answer.status_code == 200 else None


def columns_of(running: InProcessServer, recording: str) -> Any:
    """The columns of a recording; its compaction, meanwhile, makes it be decoded again."""
    return running.services.columns.cached(recording) if opened(running, recording) is not None else None


def test_one_leads_to_the_next(running: InProcessServer) -> None:
    view = running.client.get("/api/devices/1/frames", params={"time": held(running), "beside": 4}).json()
    for step in (1, -1):
        beside = view["packets"][view["at"] + step]
        request = {"time": beside["arrival"], "rank": beside["rank"], "beside": 4}
        moved = running.client.get("/api/devices/1/frames", params=request).json()
        assert moved["packets"][moved["at"]]["hex"] == beside["hex"]


def held(running: InProcessServer) -> float:
    (one,) = running.client.get("/api/recorder/memory").json()
    return float(one["t0"] + one["t1"]) / 2


def test_what_is_not_there_is_reported(running: InProcessServer) -> None:
    long_ago = running.client.get("/api/devices/1/frames", params={"time": held(running) - 5000})
    assert_problem(long_ago, 404, "not-found")
    assert "no longer in memory" in json.loads(long_ago.text)["message"]
    assert_problem(running.client.get("/api/recordings/none/frames", params={"time": 1}), 404, "not-found")
    no_channel = running.client.get("/api/devices/1/frames", params={"time": held(running), "channel": 999})
    assert_problem(no_channel, 404, "not-found")
