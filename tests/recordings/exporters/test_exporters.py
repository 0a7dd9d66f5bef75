"""Exports read back equal with other readers, cover exactly the requested range and use little memory."""

import csv
import io
import json
import math
import tracemalloc
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from numpy.typing import NDArray

from imuscope.protocols.clocks.unix_time import NO_TIME
from imuscope.protocols.messages.own_schema import letters
from imuscope.protocols.xbus.frames import build
from imuscope.recordings.columns.rows import ExactRows
from imuscope.recordings.columns.store import ChannelLayout, ColumnStore, ColumnStoreWriter
from imuscope.recordings.exporters import FORMATS, ExportError, ExportRequest, by_suffix, csv_tables, export
from imuscope.recordings.exporters.message_table import join, tables, windows
from imuscope.recordings.mcap.reader import McapReader
from imuscope.recordings.mcap.writer import McapWriter
from tests.recordings.store_fixtures import ACCELERATION, START, store
from tests.support.each_row import each_row

Array = NDArray[Any]
BYTES = {"mtb", "raw", "bytes"}
OF_COLUMNS = sorted(name for name, one in FORMATS.items() if one.suffix in (".csv", ".mcap", ".parquet"))


def rows_of(path: Path) -> tuple[list[str], list[list[str]]]:
    with path.open(encoding="utf-8", newline="") as file:
        head, *rest = csv.reader(line for line in file if not line.startswith("#"))
    return head, rest


def numbers(rows: list[list[str]], at: int) -> Array:
    return np.array([math.nan if row[at] == "" else float(row[at]) for row in rows])


def ns(times: Array) -> list[int]:
    """Nanoseconds of unix seconds, exactly."""
    return [round(Fraction(time) * 10**9) for time in times.tolist()]


def test_csv_has_every_number_in_full(tmp_path: Path) -> None:
    columns = store(tmp_path / "store")
    made = export("csv", ExportRequest(columns), tmp_path / "run.csv")
    assert [path.name for path in made] == [
        "run_MTi-630_MTData2.csv",
        "run_MTi-630_MTData2.GnssSatInfo.csv",
        "run_IMX-5_DID_INS_1.csv",
    ]
    head, rows = rows_of(made[0])
    names = ["Acceleration.x (m/s²)", "Acceleration.y (m/s²)", "Acceleration.z (m/s²)", "PacketCounter"]
    assert head == ["time (s)", "arrival (s)", *names, "Temperature (°C)"]
    expected = columns.exact(1, 0, 1000)
    for at, clock in enumerate((expected.time_ns, expected.arrival_ns)):
        assert [int(row[at].replace(".", "")) for row in rows] == clock.tolist()
    for at, column in enumerate(expected.columns, start=2):
        np.testing.assert_array_equal(numbers(rows, at).astype(np.float32), column)
    assert rows[5][3] == "inf"
    assert rows[0][2] == "nan"  # measured, and no number; a cell where nothing was measured is empty
    assert [row[6] for row in rows[1:10]] == [""] * 9
    np.testing.assert_array_equal(numbers(rows[::10], 6), columns.exact(3, 0, 100).columns[0])
    head, rows = rows_of(made[2])
    assert [row[0] for row in rows] == [""] * 500  # a message without a clock
    assert [int(row[3]) for row in rows] == (np.arange(500) - 2**60).tolist()


def test_no_heading_of_csv_is_a_formula_to_a_spreadsheet() -> None:
    file = io.BytesIO()
    csv_tables.heading(
        file, ["time (s)", '=HYPERLINK("http://elsewhere")', "@SUM(A1)", "+1", "-1", "Acceleration.x (m/s²)"]
    )
    names = next(csv.reader(io.StringIO(file.getvalue().decode())))
    assert [name[0] for name in names] == ["t", "'", "'", "'", "'", "A"]


def test_parquet_has_types_units_and_nulls(tmp_path: Path) -> None:
    columns = store(tmp_path / "store", devices=1)
    made = export("parquet", ExportRequest(columns, title="A drive"), tmp_path / "run.parquet")
    assert [path.name for path in made] == ["run_MTData2.parquet", "run_MTData2.GnssSatInfo.parquet"]
    table = pq.read_table(made[0])
    assert table.schema.field("Acceleration.x").metadata[b"unit"].decode() == "m/s²"
    assert table.schema.metadata[b"recording"] == b"A drive"
    assert str(table.schema.field("Acceleration.x").type) == "float"
    assert table.column("Temperature").null_count == 900
    expected = columns.exact(1, 0, 1000)
    np.testing.assert_array_equal(table.column("Acceleration.x").to_numpy(), expected.columns[0])
    np.testing.assert_array_equal(table.column("time").to_numpy(), expected.time_ns.view("datetime64[ns]"))
    assert table.column("Acceleration.x").null_count == 0
    assert pq.read_table(made[1]).num_rows == 30


def test_mcap_is_plain_objects_with_a_schema(tmp_path: Path) -> None:
    columns = store(tmp_path / "store")
    (made,) = export("mcap", ExportRequest(columns), tmp_path / "run.mcap")
    results: dict[str, list[tuple[int, dict[str, Any]]]] = {}
    with made.open("rb") as file:
        reader = make_reader(file)
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            body = json.loads(message.data)
            results.setdefault(channel.topic, []).append((message.log_time, body))
            assert message.publish_time <= message.log_time  # others take it amiss: it cannot come before it is sent
        summary = reader.get_summary()
    assert summary is not None
    assert {index.compression for index in summary.chunk_indexes} == {"zstd"}
    names = ("Acceleration", "PacketCounter", "Temperature", "GnssSatInfo")
    arrivals = {f"/{name}/arrival" for name in ("MTi-630/MTData2", "IMX-5/DID_INS_1")}
    assert results.keys() == {*(f"/MTi-630/{name}" for name in names), "/IMX-5/DID_INS_1", *arrivals}
    expected = columns.exact(1, 0, 1000)
    assert len(results["/MTi-630/Acceleration"]) == 1000
    for row, (time, body) in enumerate(results["/MTi-630/Acceleration"]):
        assert time == ns(expected.time[row : row + 1])[0]
        for axis, column in zip("xyz", expected.columns, strict=True):
            if np.isfinite(column[row]):
                assert np.float32(body[f"{axis}_m_s2"]) == column[row]
            else:
                assert f"{axis}_m_s2" not in body
    assert [body["value"] for _, body in results["/MTi-630/PacketCounter"]] == list(range(1000))
    assert [body["arrival_s"] for _, body in results["/MTi-630/MTData2/arrival"]] == expected.arrival.tolist()
    assert len(results["/MTi-630/Temperature"]) == 100
    sats = [[row["svid"] for row in body["rows"]] for _, body in results["/MTi-630/GnssSatInfo"]]
    assert sats == np.arange(30).reshape(-1, 3).tolist()
    assert [body["big"] for _, body in results["/IMX-5/DID_INS_1"]] == (np.arange(500) - 2**60).tolist()
    times = columns.exact(5, 0, 500).arrival
    assert [time for time, _ in results["/IMX-5/DID_INS_1"]] == ns(times)
    schema = next(one for one in summary.schemas.values() if one.name == "Acceleration")
    details = {"description": "[m/s²] About x.", "unit": "m/s²", "frame": "body"}
    assert json.loads(schema.data)["properties"]["x_m_s2"] == {"type": "number", **details}


def test_mcap_of_a_short_recording_is_not_one_chunk(tmp_path: Path) -> None:
    """Cut at three quarters, a file of one chunk was lost whole."""
    (made,) = export("mcap", ExportRequest(store(tmp_path / "store")), tmp_path / "run.mcap")
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(made.read_bytes()[: made.stat().st_size * 3 // 4])
    with McapReader(torn) as recording:
        stored = sum(block.table.shape[1] for block in recording.blocks())
    assert stored > 1000


def test_aligned_rows_hold_the_last_value_while_it_is_not_old(tmp_path: Path) -> None:
    writer = ColumnStoreWriter(tmp_path / "store")
    fast = {**ACCELERATION, "columns": ACCELERATION["columns"][:1]}
    slow = {**fast, "id": 2, "name": "Temperature", "title": "Temperature"}
    for number in (1, 2):
        writer.channel(number, ChannelLayout(("f4",), (False,)))
    t = START + np.arange(100) / 10
    writer.append(1, [t, t, np.arange(100, dtype=np.float32)])
    late = START + np.array([0.05, 1.05, 2.05, 8.05])
    writer.append(2, [late, late, np.array([1, 2, 3, 4], np.float32)])
    details = {"channels": [fast, slow], "devices": [{"id": "1", "name": "MTi"}], "format": "mcap"}
    columns = writer.finish(details)
    (made,) = export("csv-aligned", ExportRequest(columns), tmp_path / "run.csv")
    assert made.read_text().startswith(
        "# A line for each sample of Acceleration. Any other column holds its last value"
    )
    assert "Temperature 2 s" in made.read_text().splitlines()[0]
    head, rows = rows_of(made)
    assert head[2:] == ["Acceleration.x (m/s²)", "Temperature.x (m/s²)"]
    held = [row[3] for row in rows]
    assert held == [""] + ["1"] * 10 + ["2"] * 10 + ["3"] * 20 + [""] * 40 + ["4"] * 19


def test_segments_of_the_clock_are_numbered_where_there_are_several(tmp_path: Path) -> None:
    columns = store(tmp_path / "store", devices=1)
    begin = float(columns.exact(1, 600, 601).time[0])
    columns.manifest["segments"] = {"1": [begin]}
    expected = (columns.exact(1, 0, 1000).time >= begin).astype(int)
    names = [*OF_COLUMNS, "csv-plotjuggler"]
    made = {name: export(name, ExportRequest(columns), tmp_path / f"run.{name}")[0] for name in names}
    for name in ("csv", "csv-plotjuggler"):
        head, rows = rows_of(made[name])
        assert head[2] == "segment"
        some = [row for row in rows if row[5]]
        assert [int(row[2]) for row in some] == expected.tolist()
    np.testing.assert_array_equal(pq.read_table(made["parquet"]).column("segment").to_numpy(), expected)
    assert f"A segment of its clock begins at {begin:.6f} s." in made["csv-aligned"].read_text().splitlines()[0]
    with made["mcap"].open("rb") as file:
        report = make_reader(file).iter_messages(topics=["/MTi-630/MTData2/arrival"])
        assert [json.loads(message.data)["segment"] for _, _, message in report] == expected.tolist()


def test_plotjuggler_finds_one_table_of_numbers_and_its_time(tmp_path: Path) -> None:
    """As its loader reads: the separator is what the first line has most of, and blanks count; times never go back."""
    columns = store(tmp_path / "store")
    (made,) = export("csv-plotjuggler", ExportRequest(columns), tmp_path / "run.plotjuggler.csv")
    first = made.read_text().splitlines()[0]
    assert max("\t;, ", key=first.count) == ","
    assert '"' not in first
    head, rows = rows_of(made)
    assert head[:3] == ["__time", "arrival", "/MTi-630/Acceleration/x_m_s2"]
    assert letters("0.1 ms") == "0_1_ms", "not the same as 1 ms"
    assert len(head) == len(set(head))
    assert all(cell == "" or math.isfinite(float(cell)) for row in rows for cell in row)
    times = numbers(rows, 0)
    assert (np.diff(times) >= 0).all()
    expected = columns.exact(1, 0, 1000)
    of_first = np.array([row[4] != "" for row in rows])
    np.testing.assert_array_equal(times[of_first], expected.time)
    np.testing.assert_array_equal(numbers(rows, 1)[of_first], expected.arrival)
    np.testing.assert_array_equal(numbers(rows, 4)[of_first].astype(np.float32), expected.columns[2])
    big = head.index("/IMX-5/DID_INS_1/big")
    assert [int(row[big]) for row in rows if row[big]] == (np.arange(500) - 2**60).tolist()
    assert not any("svid" in name for name in head)  # a table
    with pytest.raises(ExportError, match="one value at a time"):
        export("csv-plotjuggler", ExportRequest(columns, channels=(4,)), tmp_path / "tables.plotjuggler.csv")


@each_row("export_format", OF_COLUMNS)
def test_the_stretch_is_exact_and_both_ends_belong_to_it(export_format: str, tmp_path: Path) -> None:
    columns = store(tmp_path / "store")
    times = columns.exact(1, 0, 1000).time
    wish = ExportRequest(columns, t0=float(times[100]), t1=float(times[200]), channels=(1,))
    (made,) = export(export_format, wish, tmp_path / f"run{FORMATS[export_format].suffix}")
    if export_format == "parquet":
        result = pq.read_table(made).column("time").cast(pa.int64()).to_numpy()
    elif export_format == "mcap":
        with made.open("rb") as file:
            report = make_reader(file).iter_messages(topics=["/MTi-630/Acceleration"])
            result = np.array([message.log_time for _, _, message in report])
    else:
        result = np.array([int(row[0].replace(".", "")) for row in rows_of(made)[1]])
    np.testing.assert_array_equal(result, np.array(ns(times))[100:201])


@each_row("export_format", OF_COLUMNS)
def test_a_cancelled_export_leaves_nothing(export_format: str, tmp_path: Path) -> None:
    columns = store(tmp_path / "store")
    (tmp_path / "out").mkdir()

    def stop(share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export(export_format, ExportRequest(columns), tmp_path / "out" / f"run{FORMATS[export_format].suffix}", stop)
    assert list((tmp_path / "out").iterdir()) == []


@each_row("export_format", ["csv", "csv-aligned", "csv-plotjuggler", "parquet"])
def test_memory_does_not_grow_with_the_length(export_format: str, tmp_path: Path) -> None:
    def peak(n: int) -> int:
        columns = store(tmp_path / f"store{n}", n=n, rate=1000.0, devices=1)
        tracemalloc.start()
        try:
            export(
                export_format,
                ExportRequest(columns, channels=(1, 2, 3)),
                tmp_path / f"run{n}{FORMATS[export_format].suffix}",
            )
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    assert peak(600_000) < 1.3 * peak(200_000)


def test_quantities_are_joined_by_time_and_arrival() -> None:
    a = ExactRows(np.array([1, 2, 2, 3]), np.array([1, 2, 2, NO_TIME]), [np.array([10, 20, 21, 30])])
    b = ExactRows(np.array([2, 2, 2, 4]), np.array([2, 2, 2, NO_TIME]), [np.array([5, 6, 7, 8])])
    joined = join([a, b], [np.full(4, -1.0), np.full(4, -1.0)])
    (va, ma), (vb, mb) = joined.columns()
    assert ma is not None
    assert mb is not None
    rows = [
        (t, None if x else int(v), None if y else int(w))
        for t, v, x, w, y in zip(joined.arrival, va, ma, vb, mb, strict=True)
    ]
    assert rows == [(1, 10, None), (2, 20, 5), (2, 21, 6), (2, None, 7), (3, 30, None), (4, None, 8)]
    assert join([a, a], [np.arange(4.0)] * 2).at == [None, None]
    in_order = join([a, a], [np.arange(4.0), np.arange(1.0, 5.0)]).at
    assert [one.tolist() for one in in_order if one is not None] == [
        [0, -1, 1, 2, -1, 3, -1],
        [-1, 0, -1, 1, 2, -1, 3],
    ]


def test_windows_split_no_instant_and_lose_no_row(tmp_path: Path) -> None:
    columns = store(tmp_path / "store")
    ranges = {number: (0, columns.rows(number)) for number in (1, 2, 3, 4)}
    ends = dict.fromkeys(ranges, 0)
    for window in windows(columns, ranges, rows=7):
        stops = [columns.clock(n, hi - 1, hi)[0] for n, (lo, hi) in window.items() if hi > lo]
        nexts = [columns.clock(n, hi, hi + 1)[0] for n, (_, hi) in window.items() if hi < ranges[n][1]]
        assert not nexts or max(stops) < min(nexts)
        for number, (lo, hi) in window.items():
            assert lo == ends[number]
            ends[number] = hi
    assert ends == {number: hi for number, (_, hi) in ranges.items()}


def test_unwritable_exports_are_reported(tmp_path: Path) -> None:
    columns = store(tmp_path / "store")
    with pytest.raises(ExportError, match="contains nothing to export"):
        export("csv", ExportRequest(columns, channels=()), tmp_path / "run.csv")
    with pytest.raises(ExportError, match="bytes"):
        export("mtb", ExportRequest(columns), tmp_path / "run.mtb")
    (tmp_path / "run.csv").mkdir()
    with pytest.raises(ExportError, match="is a folder that exists"):
        export("csv", ExportRequest(columns), tmp_path / "run.csv")
    assert by_suffix("Run.CSV") == "csv"
    assert by_suffix("run.plotjuggler.csv") == "csv-plotjuggler"
    assert by_suffix("run.xlsx") is None


def test_columns_with_the_same_name_get_unique_names(tmp_path: Path) -> None:
    columns = store(tmp_path / "store")
    columns.manifest["channels"][1] = {**columns.manifest["channels"][1], "name": "Temperature"}
    table = tables(ExportRequest(columns, device="1"))[0]
    assert table.names[1:] == [["Temperature"], ["Temperature #2"]]


def test_a_table_has_the_message_name_once(tmp_path: Path) -> None:
    """DID_GPS1_SAT.DID_GPS1_SAT.sat was the name of a file."""
    columns = store(tmp_path / "store")
    report = columns.manifest["channels"]
    report[3] = {**report[3], "message": "DID_GPS1_SAT", "name": "DID_GPS1_SAT.sat"}
    made = export("csv", ExportRequest(columns, channels=(4,), device="1"), tmp_path / "run.csv")
    assert [path.name for path in made] == ["run_MTi-630_DID_GPS1_SAT.sat.csv"]
    assert rows_of(made[0])[0] == ["time (s)", "arrival (s)", "sat.svid", "sat.cno (dBHz)"]


# ── bytes ────────────────────────────────────────────────────────────────────────────────────────────────────────────


def recorded(path: Path) -> tuple[ColumnStore, bytes, bytes, list[bytes]]:
    """An MTi with its Configuration in the middle, noise between the frames, and another device; frames by chunk."""
    writer = McapWriter(path, {})
    writer.device("1", {"protocol": "xbus"})
    writer.device("2", {"protocol": "isb"})
    configuration = build(0x0D, bytes(118))
    whole, chunks = b"", []
    for n in range(1, 300):
        data = build(0x36, bytes([0x10, 0x20, 2, n >> 8, n & 255])) * 2
        if n == 150:
            data = configuration + data
        noise = b"\x00\x01" if n % 50 == 0 else b""
        writer.chunk("1", "rx", data + noise, round(START * 1e9) + n * 10_000_000)
        writer.chunk("2", "rx", bytes([n % 256]) * 3, round(START * 1e9) + n * 10_000_000)
        whole += data + noise
        chunks.append(data)
    writer.close()
    about = [{"id": "1", "name": "MTi", "protocol": "xbus"}, {"id": "2", "name": "IMX", "protocol": "isb"}]
    columns = ColumnStoreWriter(path.with_suffix(".store")).finish({"channels": [], "devices": about, "format": "mcap"})
    return columns, whole, configuration, chunks


def test_an_mtb_begins_with_the_configuration_and_holds_frames_alone(tmp_path: Path) -> None:
    columns, _, configuration, chunks = recorded(tmp_path / "a.mcap")
    wish = ExportRequest(columns, tmp_path / "a.mcap")
    (made,) = export("mtb", wish, tmp_path / "run.mtb")
    frames = b"".join(chunks).replace(configuration, b"")
    assert made.read_bytes() == configuration + frames
    part = ExportRequest(columns, tmp_path / "a.mcap", t0=START + 0.1, t1=START + 0.5)
    (made,) = export("mtb", part, tmp_path / "part.mtb")
    assert made.read_bytes() == configuration + b"".join(chunks[9:50])


def test_the_bytes_of_a_device_are_unchanged(tmp_path: Path) -> None:
    columns, whole, _, _ = recorded(tmp_path / "a.mcap")
    wish = ExportRequest(columns, tmp_path / "a.mcap", device="1")
    (made,) = export("bytes", wish, tmp_path / "run.bin")
    assert made.read_bytes() == whole
    (made,) = export("raw", ExportRequest(columns, tmp_path / "a.mcap"), tmp_path / "run.raw")
    assert made.read_bytes() == b"".join(bytes([n % 256]) * 3 for n in range(1, 300))
    with pytest.raises(ExportError, match="one device"):
        export("bytes", ExportRequest(columns, tmp_path / "a.mcap"), tmp_path / "all.bin")
