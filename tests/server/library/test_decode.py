"""A decoded recording has the rows and events of the live page, in little memory."""

from pathlib import Path

import numpy as np
import pytest

from imuscope.protocols import events
from imuscope.protocols.clocks.unix_time import NO_TIME
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.recordings.columns.health_history import health_history
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.mcap.compaction import compact
from imuscope.recordings.mcap.source import McapSource
from imuscope.recordings.mcap.writer import McapWriter
from imuscope.server.devices.decode import protocol_set
from imuscope.server.library.decode import decode
from imuscope.server.streaming.channels import ChannelRegistry
from imuscope.server.wire import ChannelInfo
from tests.recordings.recorded_drive import START, drive
from tests.support.truth_frames import even_ticks, xbus


def test_a_recording_has_the_rows_that_its_bytes_hold(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    stored = drive(path)
    compact(path)
    shares: list[float] = []
    store = decode(McapSource(path), tmp_path / "store", protocol_set.all_protocols(), progress=shares.append)
    decoder = PROTOCOLS["xbus"].decoding.decoder()
    decoder.feed(stored, 0)
    names: list[str] = []

    def advertise(info: ChannelInfo) -> int:
        names.append(info.name)
        return len(names)

    batches = events.batches(decoder.drain(stalled=True))
    untimed = [(batch, np.full(len(batch), np.nan), np.full(len(batch), NO_TIME)) for batch in batches]
    pieces = ChannelRegistry("1", advertise).split(untimed)
    results = {info["name"]: info["id"] for info in store.manifest["channels"]}
    assert results.keys() == {*names, "EulerAngles"}  # and the channels derived from them
    for piece in pieces:
        number = results[names[piece.channel - 1]]
        rows = store.in_units("device").exact(number, 0, store.rows(number))
        assert len(rows) == len(piece.columns[0])
        for got, expected in zip(rows.columns, piece.columns[2:], strict=True):
            np.testing.assert_array_equal(got, expected)
    assert shares
    assert shares == sorted(shares)


def test_derived_events_are_recomputed_and_user_events_kept(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    drive(path)
    manifest = decode(McapSource(path), tmp_path / "store", protocol_set.all_protocols()).manifest
    texts = [event["text"] for event in manifest["events"]]
    assert "told live" not in texts
    assert "Opened." in texts
    gaps = [event for event in manifest["events"] if event["kind"] == "gap"]
    assert sum(event["samples"] for event in gaps) == manifest["figures"]["1"]["lost"] > 0
    assert [marker["text"] for marker in manifest["markers"]] == ["bump"]
    assert manifest["devices"][0]["baud"] == 921600
    assert manifest["started"] == pytest.approx(START / 1e9, abs=1e-6)


def test_times_are_mapped_as_they_were_live(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    drive(path)
    store = decode(McapSource(path), tmp_path / "store", protocol_set.all_protocols())
    number = next(info["id"] for info in store.manifest["channels"] if info["name"] == "Acceleration")
    rows = store.exact(number, 0, store.rows(number))
    steps = np.diff(rows.time)
    usual = np.median(steps)
    assert (np.abs(rows.arrival - rows.time) < 0.02).all()
    assert np.sum(steps > 5 * usual) == 1  # the hole; bursts of 10 ms make no comb
    assert np.abs(steps[steps < 5 * usual] - usual).max() < 0.3 * usual


def test_a_recording_that_names_no_protocol_is_recognised(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    drive(path, seconds=1.0, named=False)
    store = decode(McapSource(path), tmp_path / "store", protocol_set.all_protocols())
    assert store.manifest["devices"][0]["protocol"] == "xbus"
    assert store.manifest["channels"]


def test_a_clock_that_learns_the_date_within_one_drain_has_no_samples_in_1970(tmp_path: Path) -> None:
    """An IMX recorded from power-on counts from zero until its receiver knows the week."""
    from imuscope.protocols.isb.simulator.device import IsbSimulator

    path = tmp_path / "a.mcap"
    device = IsbSimulator(start_ns=0)
    writer = McapWriter(path, {})
    writer.device("1", {"protocol": "isb"})
    for n in range(1, 4000):
        data = device.advance(n * 10_000_000)
        if data:
            writer.chunk("1", "rx", data, START + n * 10_000_000)
    writer.close()
    store = decode(McapSource(path), tmp_path / "store", protocol_set.all_protocols())
    report = store.span()
    assert report is not None
    assert report[0] > START / 1e9 - 1.0
    assert report[1] < START / 1e9 + 41.0
    kinds = {event["data"].get("kind") for event in store.manifest["events"] if event["kind"] == "clock"}
    assert "sync" in kinds  # or this would prove nothing


def test_each_loss_of_a_recording_is_an_event_of_its_own(tmp_path: Path) -> None:
    """If losses were summed up as in the live log, a range without losses would be hatched."""
    path = tmp_path / "a.mcap"
    device = XbusSimulator(start_ns=0)
    writer = McapWriter(path, {})
    writer.device("1", {"protocol": "xbus"})
    for n in range(1, 1000):
        data = device.advance(n * 10_000_000)
        if n % 20:
            writer.chunk("1", "rx", data, START + n * 10_000_000)
    writer.close()
    manifest = decode(McapSource(path), tmp_path / "store", protocol_set.all_protocols()).manifest
    gaps = [event for event in manifest["events"] if event["kind"] == "gap"]
    assert len(gaps) == manifest["figures"]["1"]["gaps"] > 40
    assert max(event["t1"] - event["t0"] for event in gaps) < 0.1


def test_it_is_shown_while_it_is_decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from imuscope.server.library import decode as opening
    from imuscope.server.library.recording_detail import channels_of

    monkeypatch.setattr(opening, "FIRST_SHOWN_S", 0.0)
    monkeypatch.setattr(opening, "LAST_SHOWN_S", 0.0)
    monkeypatch.setattr(opening, "DRAIN_BYTES", 4096)
    path = tmp_path / "a.mcap"
    drive(path)
    compact(path)
    records: list[tuple[float, int, float]] = []

    def shown(folder: Path) -> None:
        store = ColumnStore(folder)
        number = next(info.id for info in channels_of(store).values() if info.name == "Acceleration")
        report = store.manifest
        records.append((report["progress"], store.rows(number), report["ended"]))

    store = decode(McapSource(path), tmp_path / "store", protocol_set.all_protocols(), shown=shown)
    number = next(info["id"] for info in store.manifest["channels"] if info["name"] == "Acceleration")
    assert records
    assert records == sorted(records)
    assert 0 < records[0][1] <= store.rows(number)
    assert all(ended == pytest.approx(store.manifest["ended"], abs=0.02) for _, _, ended in records)  # known before
    assert "progress" not in store.manifest


def test_a_table_of_others_is_shown_while_it_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A long CSV was a progress bar to its last row."""
    from imuscope.recordings.tables import number_blocks as tabular
    from imuscope.server.library import decode as opening

    monkeypatch.setattr(opening, "FIRST_SHOWN_S", 0.0)
    monkeypatch.setattr(opening, "LAST_SHOWN_S", 0.0)
    monkeypatch.setattr(tabular, "BLOCK_BYTES", 4096)
    path = tmp_path / "bench.csv"
    path.write_text("time (s),acc_x (m/s²)\n" + "".join(f"{1.76e9 + n / 100:.2f},{n % 7}\n" for n in range(2000)))
    records: list[tuple[float, int, float]] = []

    def shown(folder: Path) -> None:
        store = ColumnStore(folder)
        records.append((store.manifest["progress"], store.rows(1), store.manifest["ended"]))

    store = decode(open_file(path), tmp_path / "store", protocol_set.all_protocols(), shown=shown)
    assert len(records) > 2
    assert records == sorted(records)
    assert 0 < records[0][1] < store.rows(1) == 2000
    assert {ended for _, _, ended in records} == {store.manifest["ended"]}  # known before: the axis stays as it is
    assert "progress" not in store.manifest


def test_an_outage_without_a_counter_is_taken_from_the_live_event(tmp_path: Path) -> None:
    """A recording of a device without a counter had no hatch where its link had been down."""
    path = tmp_path / "a.mcap"
    drive(path)
    again = tmp_path / "b.mcap"
    source = McapSource(path)
    writer = McapWriter(again, {"title": "A drive"})
    writer.device("1", dict(source.devices["1"].identity))
    for part in source.parts():
        if part.direction == "rx":
            start = 0
            for end, at in zip(part.ends.tolist(), part.times.tolist(), strict=True):
                writer.chunk("1", "rx", bytes(part.data[start:end]), at)
                start = end
    first = START / 1e9
    outage = {"kind": "gap", "level": "error", "device": "1", "samples": 0, "data": {"counter": "", "by": "link"}}
    writer.event({**outage, "text": "counted too", "t0": first + 1.9, "t1": first + 2.2}, START)
    writer.event({**outage, "text": "down", "t0": first + 3.0, "t1": first + 3.1, "time": first + 3.1}, START)
    writer.event({**outage, "text": "no time", "t0": None, "t1": float("nan")}, START)
    writer.close()
    store = decode(McapSource(again), tmp_path / "store", protocol_set.all_protocols())
    gaps = [event for event in store.manifest["events"] if event["kind"] == "gap"]
    assert [event["text"] for event in gaps if event["samples"] == 0] == ["down"]
    assert gaps[-1]["t0"] == pytest.approx(first + 3.0)
    assert sum(event["samples"] for event in gaps) > 0


def test_health_is_recorded_for_every_second(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    stored = drive(path)
    store = decode(McapSource(path), tmp_path / "store", protocol_set.all_protocols())
    second = START // 1_000_000_000
    report = health_history(store.folder, store.manifest["health"], "1", "1", second - 1, second + 4)
    assert report.bytes[0] == 0
    assert sum(report.bytes) == len(stored)
    (message,) = report.messages
    counts = report.messages[message]
    total = next(iter(store.manifest["figures"]["1"]["messages"].values()))
    assert sum(counts) == total
    assert counts[2] == pytest.approx(counts[4], abs=2)
    assert counts[3] == pytest.approx(0.95 * counts[2], abs=2)  # a hole of 50 ms
    late = report.jitter_ms[2]
    assert late is not None
    assert 0 < late <= 12  # chunks of 10 ms
    assert report.uncertainty_ms[5] is not None
    tail = health_history(store.folder, store.manifest["health"], "1", "1", second + 2, second + 2)
    assert tail.before == sum(report.bytes[:3])
    assert tail.counted[message] == sum(counts[:3])
    assert health_history(store.folder, {}, "1", "1", second, second).bytes == [0]  # a table has no such file


@pytest.mark.parametrize(("baud", "known"), [(921_600, True), (57_600, False)])
def test_times_of_a_full_line_have_no_uncertainty_in_a_recording_either(tmp_path: Path, baud: int, known: bool) -> None:
    path, rate = tmp_path / "a.mcap", 180.0  # 32 B each: as many as 57 600 Bd carries
    writer = McapWriter(path, {})
    writer.device("1", {"source": "/dev/ttyUSB0", "link": "serial", "protocol": "xbus", "baud": baud})
    for number, tick in enumerate(even_ticks(4800, rate)):
        writer.chunk("1", "rx", xbus(number, int(tick)), START + round(number / rate * 1e9))
    writer.close()
    store = decode(McapSource(path), tmp_path / "store", protocol_set.all_protocols())
    second = START // 1_000_000_000
    report = health_history(store.folder, store.manifest["health"], "1", "1", second, second + int(4800 / rate))
    assert (report.uncertainty_ms[-1] is not None) == known
    assert (report.drift_ppm[-1] is not None) == known
