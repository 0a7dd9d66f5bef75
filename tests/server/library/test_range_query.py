"""One query for live and recorded data: the same rows and buckets, as frames and tables."""

import asyncio
import io
import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from imuscope.recordings.columns.rows import ExactRows, MinMaxBuckets
from imuscope.recordings.columns.store import ChannelLayout, ColumnStore, ColumnStoreWriter
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.mcap.source import McapSource
from imuscope.server import wire
from imuscope.server.devices.decode import protocol_set
from imuscope.server.library.api_models import RecordingInfo
from imuscope.server.library.column_cache import ColumnCache, DecodeJob
from imuscope.server.library.decode import decode
from imuscope.server.library.range_query import (
    arrow_of,
    frame_of,
    json_of,
    query_columns,
    recorded,
    statistics_in,
    stored_values,
)
from imuscope.server.library.recording_detail import channels_of, detail
from imuscope.server.streaming.channel_rows import ChannelRows
from imuscope.server.streaming.telemetry import Telemetry
from imuscope.server.wire import codec as wire_codec
from tests.recordings.recorded_drive import drive
from tests.support.each_row import each_row


@pytest.fixture
def store(tmp_path: Path) -> ColumnStore:
    drive(tmp_path / "a.mcap", seconds=6.0)
    return decode(McapSource(tmp_path / "a.mcap"), tmp_path / "store", protocol_set.all_protocols())


def hub_with(store: ColumnStore) -> tuple[Telemetry, dict[int, int]]:
    """Telemetry that was given live what the store holds; id of each channel there."""
    telemetry = Telemetry.create(lambda: 0.0, history_s=1e12)
    ids: dict[int, int] = {}
    for number, info in channels_of(store).items():
        ids[number] = telemetry.bus.advertise(info)
        rows = store.in_units("device").exact(number, 0, store.rows(number))
        telemetry.bus.publish([ChannelRows(ids[number], [rows.arrival, rows.time, *rows.columns])])
    return telemetry, ids


@each_row("base", ["device", "arrival"])
@each_row("width", [0, 40, 100_000])
def test_live_and_recorded_queries_agree(store: ColumnStore, width: int, base: str) -> None:
    telemetry, ids = hub_with(store)
    whole = store.span()
    assert whole is not None
    t0, t1 = whole[0] + 1.0, whole[1] - 1.5
    for number, info in channels_of(store).items():
        one = recorded(store, info, t0, t1, width, base=base)  # type: ignore[arg-type]
        live = stored_values(telemetry.store.of(ids[number]), t0, base)  # type: ignore[arg-type]
        other = query_columns(info, live, t0, t1, width, base=base)  # type: ignore[arg-type]
        assert type(one.rows) is type(other.rows)
        if isinstance(one.rows, ExactRows) and isinstance(other.rows, ExactRows):
            np.testing.assert_array_equal(one.rows.arrival, other.rows.arrival)
            for a, b in zip(one.rows.columns, other.rows.columns, strict=True):
                np.testing.assert_array_equal(a, b)
        if isinstance(one.rows, MinMaxBuckets) and isinstance(other.rows, MinMaxBuckets):
            assert len(one.rows) <= width
            for a, b in zip(one.rows.low, other.rows.low, strict=True):
                assert np.nanmin(a) == pytest.approx(np.nanmin(b)) or info.kind == "status"


def test_a_frame_of_buckets_has_two_rows_each_and_is_read_by_the_pages_codec(store: ColumnStore) -> None:
    whole = store.span()
    assert whole is not None
    infos = channels_of(store)
    acceleration = next(info for info in infos.values() if info.name == "Acceleration")
    answer = recorded(store, acceleration, *whole, 50)
    assert isinstance(answer.rows, MinMaxBuckets)
    dtypes = {acceleration.id: [column.dtype for column in acceleration.columns]}
    (samples,) = wire_codec.decode_samples(frame_of(answer), dtypes)
    assert samples.n == 2 * len(answer.rows)
    np.testing.assert_array_equal(samples.columns[2][0::2], answer.rows.low[0])
    np.testing.assert_array_equal(samples.columns[2][1::2], answer.rows.high[0])
    assert frame_of(recorded(store, acceleration, 0.0, 1.0, 50)) == b""


def test_an_attitude_is_thinned_never_summarised(store: ColumnStore) -> None:
    whole = store.span()
    assert whole is not None
    quaternion = next(info for info in channels_of(store).values() if info.kind == "quaternion")
    answer = recorded(store, quaternion, *whole, 20)
    assert isinstance(answer.rows, ExactRows)
    assert len(answer.rows) <= 40
    assert np.linalg.norm(np.column_stack(answer.rows.columns), axis=1) == pytest.approx(1.0, abs=1e-5)


def test_a_table_has_units_and_leads_back_from_arrow_and_json(store: ColumnStore) -> None:
    whole = store.span()
    assert whole is not None
    info = next(info for info in channels_of(store).values() if info.name == "Acceleration")
    answer = recorded(store, info, *whole, 0, columns=[0, 2])
    table = pa.ipc.open_stream(io.BytesIO(b"".join(arrow_of(answer)))).read_all()
    assert table.column_names == ["time", "arrival", "x", "z"]
    assert table.schema.field("x").metadata == {b"unit": b"m/s\xc2\xb2"}
    assert isinstance(answer.rows, ExactRows)
    np.testing.assert_array_equal(table["z"].to_numpy(), answer.rows.columns[1])
    body = json.loads(b"".join(json_of(answer)))
    assert body["columns"]["z"] == pytest.approx(answer.rows.columns[1].tolist())
    assert body["units"]["z"] == "m/s²"
    buckets = json.loads(b"".join(json_of(recorded(store, info, *whole, 10, columns=[0]))))
    assert list(buckets["columns"]) == ["t", "n", "x_min", "x_max"]
    assert not buckets["exact"]


def test_flags_are_summarised_as_any_and_all(store: ColumnStore) -> None:
    whole = store.span()
    assert whole is not None
    info = next(info for info in channels_of(store).values() if info.kind == "status")
    buckets = json.loads(b"".join(json_of(recorded(store, info, *whole, 10))))
    assert [name.rpartition("_")[2] for name in list(buckets["columns"])[2:]] == ["any", "all"]


def test_a_detail_holds_what_the_page_needs(store: ColumnStore) -> None:
    info = RecordingInfo("a", "A drive", "a.mcap", "mcap", 1, None, None, [])
    report = wire_codec.to_json_safe(detail(info, store))
    json.dumps(report, allow_nan=False)
    assert report["t1"] > report["t0"]
    assert {channel["name"] for channel in report["channels"]} >= {"Acceleration", "EulerAngles"}
    assert report["markers"][0]["text"] == "bump"
    acceleration = next(channel["id"] for channel in report["channels"] if channel["name"] == "Acceleration")
    assert 0 < report["longest_s"][str(acceleration)] < 0.05
    device = next(channel["device"] for channel in report["channels"] if channel["id"] == acceleration)
    span = store.span(acceleration)
    assert span is not None
    assert report["t0"] <= report["begins"][device] <= span[0]


# -- the shelf ---------------------------------------------------------------------------------------------------------


def shelf_in(folder: Path) -> ColumnCache:
    def path_of(name: str) -> Path:
        path = folder / f"{name}.mcap"
        if not path.exists():
            raise KeyError(name)
        return path

    return ColumnCache(folder / "data", path_of)


async def test_a_recording_is_decoded_once_aside_and_again_when_it_changed(tmp_path: Path) -> None:
    drive(tmp_path / "a.mcap", seconds=2.0)

    shelf = shelf_in(tmp_path)
    assert isinstance(shelf.open("a"), DecodeJob)
    first = await shelf.opened("a")
    assert shelf.open("a") is first
    assert shelf_in(tmp_path).cached("a") is not None  # it outlives the server
    (tmp_path / "a.mcap").unlink()
    drive(tmp_path / "a.mcap", seconds=1.0)
    await shelf.prepare()  # the library is viewed: a process waits for the next recording
    opening = shelf.open("a")
    assert isinstance(opening, DecodeJob)
    opening.partial = first
    assert await shelf.partial_or_wait("a") is first  # available while the rest is decoded
    again = await shelf.opened("a")
    assert again is not first
    assert await shelf.partial_or_wait("a") is again
    await shelf.prepare()  # and a waiting process ends with the server
    assert sum(again.rows(number) for number in again.shapes) < sum(first.rows(number) for number in first.shapes)
    with pytest.raises(KeyError):
        shelf.open("b")
    await shelf.close()


async def test_concurrent_openings_share_one_decoding(tmp_path: Path) -> None:
    drive(tmp_path / "a.mcap", seconds=1.0)

    shelf = shelf_in(tmp_path)
    one, other = await asyncio.gather(shelf.opened("a"), shelf.opened("a"))
    assert one is other
    assert len(list((tmp_path / "data" / "cache" / "columns").iterdir())) == 1
    await shelf.close()


async def test_unopenable_recordings_are_reported(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"\x55" * 3000)

    shelf = shelf_in(tmp_path)
    with pytest.raises(RecordingError, match=r"a\.mcap"):
        await shelf.opened("a")
    await shelf.close()


def test_channel_descriptions_survive_the_manifest(store: ColumnStore) -> None:
    for info in channels_of(store).values():
        assert isinstance(info, wire.ChannelInfo)
        assert all(isinstance(bit, wire.BitsInfo) for column in info.columns for bit in column.bits)


def test_the_mean_of_a_recorded_heading_is_circular(tmp_path: Path) -> None:
    """Half of its samples stand at 175°, half at −175°: the mean is 180°, not 0°."""
    writer = ColumnStoreWriter(tmp_path / "store")
    writer.channel(1, ChannelLayout(("f8", "f8"), (False, False)))
    times = np.arange(100.0)
    yaw = np.where(times % 2, 175.0, -175.0)
    writer.append(1, [times, times, yaw, yaw])
    columns = [wire.ColumnInfo("yaw", "f8", "°", period=360.0), wire.ColumnInfo("offset", "f8", "°")]
    info = wire.ChannelInfo(1, "1", "M", "Heading", "Heading", "euler", "°", "", columns)
    around, along = statistics_in(writer.finish({}), info, 0.0, 100.0)
    assert abs(around.mean or 0.0) == pytest.approx(180.0)
    assert around.sigma == pytest.approx(5.0, rel=0.01)
    assert along.mean == pytest.approx(0.0)
