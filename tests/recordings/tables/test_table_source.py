"""Tables of other programs: CSV with any kind of times, MCAP with JSON; invalid numbers are reported."""

import json
import os
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap.writer import Writer as McapWriter

import imuscope
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.exporters import ExportRequest, export
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.library.index import summarize
from imuscope.server.devices.decode import protocol_set
from imuscope.server.library.decode import decode
from tests.recordings.store_fixtures import START, store
from tests.support.each_row import each_row


def opened(path: Path) -> ColumnStore:
    return decode(open_file(path), path.with_suffix(".columns"), protocol_set.all_protocols())


def table(path: Path, text: str) -> ColumnStore:
    path.write_text(text, encoding="utf-8")
    return opened(path)


def named(columns: ColumnStore) -> dict[str, int]:
    return {info["title"]: info["id"] for info in columns.manifest["channels"]}


@each_row(
    ("head", "times"),
    [
        ("time (s)", ["1760000000.5", "1760000001.5"]),
        ("Time [ms]", ["1760000000500", "1760000001500"]),
        ("timestamp_us", ["1760000000500000", "1760000001500000"]),
        ("t (ns)", ["1760000000500000000", "1760000001500000000"]),
        ("timestamp", ["1760000000500", "1760000001500"]),
        ("timestamp", ["1760000000500000000", "1760000001500000000"]),
        ("date", ["2025-10-09T08:53:20.5Z", "2025-10-09 10:53:21.5+02:00"]),
        ("utc", ["2025-10-09T08:53:20.5", "2025-10-09T08:53:21.5"]),
    ],
)
def test_times_of_every_kind(head: str, times: list[str], tmp_path: Path) -> None:
    columns = table(tmp_path / "a.csv", f"{head},x\n{times[0]},1\n{times[1]},2\n")
    np.testing.assert_allclose(columns.exact(1, 0, 2).time, [START + 0.5, START + 1.5], rtol=0, atol=1e-6)


def test_lines_with_another_number_of_fields_are_skipped_and_reported(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = "".join(f"{START + n},{n},{n}\n" for n in range(20))
    path.write_text(f"time,x,y\n{rows}{START + 20},1\n{START + 21},1,2,3\n{START + 22},7,8\n")
    source = open_file(path)
    columns = decode(source, tmp_path / "a.columns", protocol_set.all_protocols())
    assert columns.rows(1) == 21
    assert [one.words for one in source.damage] == ["2 lines do not have 3 fields and were skipped."]


def test_what_was_measured_is_before_clocks_and_whole_numbers_have_no_decimals(tmp_path: Path) -> None:
    rows = "".join(f"{n * 10_000},{START + n / 100},{n % 2},{n},{n / 3},9\n" for n in range(60_000))
    columns = table(tmp_path / "a.csv", f"TimeUS,time (s),state,count,acc_x,acc_y\n{rows}".replace(",1,", ",0.5,", 1))
    channels = columns.manifest["channels"]
    decimals = {info["title"]: [one["decimals"] for one in info["columns"]] for info in channels}
    assert list(decimals.items()) == [("state", [-1]), ("count", [0]), ("acc", [-1, -1]), ("time", [-1])]


def test_times_of_no_calendar_are_counted_from_when_the_file_was_written(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t;x\n10.5;1\n11.5;2\n")
    os.utime(path, (START, START))
    assert not open_file(path).timed
    assert opened(path).exact(1, 0, 2).time.tolist() == [START, START + 1]


def test_columns_go_together_and_keep_their_units(tmp_path: Path) -> None:
    head = "# a comment\n\ntime (s),Gyro.x (°/s),Gyro.y (°/s),Gyro.z (°/s),accX,accY,accZ,mag_x,Temperature [°C]\n"
    columns = table(tmp_path / "a.csv", head + "1760000000,1,2,3,4,5,6,7,\n1760000001,1,2,3,4,5,6,nan,21.5\n")
    infos = {info["name"]: info for info in columns.manifest["channels"]}
    assert infos.keys() == {"Gyro", "acc", "mag_x", "Temperature"}
    assert [column["name"] for column in infos["Gyro"]["columns"]] == ["x", "y", "z"]
    assert infos["Gyro"]["unit"] == "°/s"
    assert infos["acc"]["columns"][2]["axis"] == "z"
    temperature = columns.exact(infos["Temperature"]["id"], 0, 2).columns[0]
    assert np.isnan(temperature[0])
    assert temperature[1] == 21.5
    assert columns.manifest["damage"] == []


def test_whole_numbers_that_are_rounded_are_reported(tmp_path: Path) -> None:
    rows = "1760000000,9007199254740993,1e300,9007199254740992\n1760000001,9007199254740995,1e300,9007199254740994\n"
    columns = table(tmp_path / "a.csv", "time (s),id,a,b\n" + rows)
    words = "Whole numbers beyond 2⁵³ are rounded: id (9007199254740993)."
    assert [one["words"] for one in columns.manifest["damage"]] == [words]


def test_quoted_cells_behind_blanks_are_read(tmp_path: Path) -> None:
    head = '"x, y", "Время, мс", "ax"\n'
    columns = table(tmp_path / "a.csv", head + "".join(f'{n}, {1666669005 + 10 * n}, "{n / 4}"\n' for n in range(20)))
    assert [info["name"] for info in columns.manifest["channels"]] == ["x, y", "ax"]
    rows = columns.exact(columns.manifest["channels"][1]["id"], 0, 20)
    np.testing.assert_array_equal(rows.columns[0], np.arange(20) / 4)
    np.testing.assert_allclose(np.diff(rows.time), 0.01, atol=1e-6)


@each_row("first", ["0,1,on,x", "0,,n.a.,", "0,on,off,x", '0,1,"a, b",see below'])
def test_first_rows_with_texts_are_rows(first: str, tmp_path: Path) -> None:
    """Regression: rows before the first one of numbers alone were taken for lines above the table."""
    rows = "".join(f"{n},{n},{n / 2},\n" for n in range(2, 20))
    columns = table(tmp_path / "a.csv", f"time (s),a,b,note\n{first}\n1,1,off,y\n{rows}")
    assert columns.rows(1) == 20


def test_a_line_of_units_is_not_a_row(tmp_path: Path) -> None:
    columns = table(tmp_path / "a.csv", "time,a,b\ns,-,m/s\n" + "".join(f"{n},{n},{n / 2}\n" for n in range(20)))
    assert columns.rows(1) == 20
    assert [info["unit"] for info in columns.manifest["channels"]] == ["-", "m/s"]


def test_a_heading_without_rows_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time (s),gyr_x\n")
    with pytest.raises(RecordingError, match=r"a\.csv has a heading, but no rows") as error:
        open_file(path)
    assert error.value.hint == "Give a table with samples."


def test_cells_that_are_not_numbers_are_reported(tmp_path: Path) -> None:
    text = "time,x\n1760000000,1\n1760000001,many\n1760000002,3,4\nnever,5\n1760000004,6\n"
    columns = table(tmp_path / "a.csv", text)
    rows = columns.exact(1, 0, 10)
    assert rows.time.tolist() == [1760000000, 1760000001, 1760000004]
    words = " ".join(damage["words"] for damage in columns.manifest["damage"])
    assert "1 line does" in words
    assert "2 cells" in words


def test_what_is_left_out_is_reported_and_not_called_damage(tmp_path: Path) -> None:
    """Regression: the library called a table with a column of labels damaged, as it did a bag with pictures."""
    heading = "time,joint.name,joint.position,joint.effort,note\n"
    text = heading + "".join(f"{1760000000 + n},elbow,{n},0,\n" for n in range(9))
    columns = table(tmp_path / "a.csv", text)
    (info,) = columns.manifest["channels"]
    assert (info["name"], [one["name"] for one in info["columns"]]) == ("joint", ["position", "effort"])
    words = "Columns without numbers are left out: note, joint.name ('elbow')."
    (one,) = columns.manifest["damage"]
    assert (one["words"], one["is_remark"]) == (words, True)
    about = summarize(columns)
    assert (about["damaged"], about["remark"]) == ("", words)


@each_row("text", ["hello\n", "a,b\n1,2\n", "time,x\n", "\n\n", "time,x\n,\n", "\ufeff", "time,x\n\x00\x00"])
def test_an_invalid_table_is_reported(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(RecordingError) as failed:
        opened(tmp_path / "a.csv")
    assert failed.value.message.endswith(".")


def test_exported_csv_is_read_again(tmp_path: Path) -> None:
    columns = store(tmp_path / "store", devices=1)
    made = export("csv", ExportRequest(columns), tmp_path / "run.csv")[0]
    again = opened(made)
    numbers = named(again)
    for name, number in (("Acceleration", 1), ("PacketCounter", 2)):
        expected, got = columns.exact(number, 0, 1000), again.exact(numbers[name], 0, 1000)
        np.testing.assert_array_equal(got.time, expected.time)
        np.testing.assert_array_equal(got.arrival, expected.arrival)
        for a, b in zip(got.columns, expected.columns, strict=True):
            np.testing.assert_array_equal(a.astype(b.dtype), b)


def test_messages_in_json_are_tables_and_others_are_named(tmp_path: Path) -> None:
    path = tmp_path / "theirs.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile="ros2", library="theirs")
        pose = writer.register_channel("/pose", "json", 0)
        other = writer.register_channel("/camera", "cdr", 0)
        for n in range(100):
            body = f'{{"position": {{"x": {n}, "y": 2}}, "name": "a", "cov": [1, 2], "ok": true}}'
            writer.add_message(pose, round(START * 1e9) + n * 10**7, body.encode() if n != 50 else b"{", 0)
            writer.add_message(other, round(START * 1e9) + n * 10**7, b"\x00\x01", 0)
        writer.finish()
    columns = opened(path)
    numbers = named(columns)
    assert numbers.keys() == {"position", "cov", "ok"}
    rows = columns.exact(numbers["position"], 0, 100)
    assert rows.columns[0].tolist() == [*range(50), *range(51, 100)]
    assert columns.manifest["figures"]["1"]["rejects"] == 1
    np.testing.assert_allclose(rows.arrival, START + np.delete(np.arange(100), 50) / 100, atol=1e-6)
    assert np.isnan(rows.time).all()  # these messages have no stamp
    (camera,) = (damage for damage in columns.manifest["damage"] if "/camera is cdr" in damage["words"])
    assert camera["is_remark"]


def test_an_export_as_mcap_is_read_again(tmp_path: Path) -> None:
    columns = store(tmp_path / "store", devices=1)
    (made,) = export("mcap", ExportRequest(columns, channels=(2,)), tmp_path / "run.mcap")
    again = opened(made)
    got = again.exact(named(again)["PacketCounter"], 0, 1000)
    assert got.columns[0].tolist() == list(range(1000))


def test_quantities_of_an_export_have_their_axes_and_units_again(tmp_path: Path) -> None:
    columns = store(tmp_path / "store", devices=1)
    (made,) = export("mcap", ExportRequest(columns, channels=(1,)), tmp_path / "run.mcap")
    (info,) = (one for one in opened(made).manifest["channels"] if "Acceleration" in one["name"])
    assert [(column["name"], column["unit"]) for column in info["columns"]] == [(axis, "m/s²") for axis in "xyz"]


def test_an_export_of_a_former_version_opens_as_before(tmp_path: Path) -> None:
    """Regression: one message per instant had all quantities nested, including its times."""
    path = tmp_path / "run.mcap"
    number = {"type": "number", "unit": "m/s²"}
    axes = {"type": "object", "properties": dict.fromkeys("xyz", number)}
    second = {"type": "number", "unit": "s"}
    inside = {"time": second, "arrival": second, "Acceleration": axes}
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = {"title": "MTData2", "type": "object", "properties": inside}
        number = writer.register_schema("imuscope.MTData2", "jsonschema", json.dumps(schema).encode())
        topic = writer.register_channel("/MTi-630/MTData2", "json", number)
        for n in range(20):
            body = {"time": START + n, "arrival": START + n, "Acceleration": {"x": n, "y": 0.5, "z": 9.8}}
            at = round((START + n) * 1e9)
            writer.add_message(topic, at, json.dumps(body).encode(), at)
        writer.finish()  # type: ignore[no-untyped-call]
    again = opened(path)
    assert again.exact(named(again)["Acceleration"], 0, 20).columns[0].tolist() == list(range(20))
    assert {"time", "arrival"} <= named(again).keys()


def test_satellites_of_an_export_are_rows_again(tmp_path: Path) -> None:
    """Regression: in MCAP a table is one message per instant; its rows became columns, and those after the sixteenth
    were lost.
    """
    columns = store(tmp_path / "store")
    (made,) = export("mcap", ExportRequest(columns, channels=(4,)), tmp_path / "run.mcap")
    again = opened(made)
    (info,) = (one for one in again.manifest["channels"] if one["message"] == "/MTi-630/GnssSatInfo")
    rows, expected = again.exact(info["id"], 0, 30), columns.exact(4, 0, 30)
    names = [column["name"] for column in info["columns"]]
    assert (info["title"], info["kind"]) == ("GnssSatInfo", "table")
    np.testing.assert_array_equal(rows.columns[names.index("svid")], expected.columns[0])
    assert info["columns"][names.index("cno")]["unit"] == "dBHz"
    np.testing.assert_allclose(rows.time, expected.time, atol=1e-6)


def test_an_mcap_without_json_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "theirs.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        writer.add_message(writer.register_channel("/camera", "cdr", 0), 1, b"x", 1)
        writer.finish()
    with pytest.raises(RecordingError, match="cdr"):
        open_file(path)


@each_row("form", ["s", "quoted", "ms", "µs of s", "ns", "ISO", "parquet"])
def test_times_are_those_of_the_file_to_the_nanosecond(form: str, tmp_path: Path) -> None:
    """Regression: they went through a float64, which is 0.2 µs apart."""
    ns = 1_760_000_000_123_456_789 + np.cumsum(np.random.default_rng(1).integers(9_000_000, 11_000_000, 400))
    ns = ns // 1000 * 1000 if form == "µs of s" else ns
    arrival, path = ns + 1_234_567, tmp_path / "a.csv"
    digits = {"ms": 6, "ns": 0}.get(form, 9)

    def written(moment: int) -> str:
        if form == "ISO":
            return f"{datetime.fromtimestamp(moment // 10**9, UTC):%Y-%m-%dT%H:%M:%S}.{moment % 10**9:09d}Z"
        text = f"{moment // 10**digits}.{moment % 10**digits:0{digits}d}".rstrip(".")
        return text[:-3] if form == "µs of s" else text if digits else str(moment)

    head = {"ISO": "time,x", "ms": "time (ms),x", "ns": "time (ns),x"}.get(form, "time (s),arrival (s),x")
    rows = zip(ns.tolist(), arrival.tolist(), range(len(ns)), strict=True)
    both = "arrival" in head
    lines = [f"{written(t)},{written(a)},{k}" if both else f"{written(t)},{k}" for t, a, k in rows]
    text = "\n".join([head, *lines]) + "\n"
    path.write_text(text.replace(",5\n", ',"5"\n') if form == "quoted" else text)
    if form == "parquet":
        path = tmp_path / "a.parquet"
        pq.write_table(pa.table({"time": pa.array(ns, pa.timestamp("ns", "UTC")), "x": np.arange(len(ns)) / 2}), path)
    with imuscope.open(path) as recording:
        signal = recording["x"]
        np.testing.assert_array_equal(signal.time_ns, ns)
        came = arrival // 1000 * 1000 if form == "µs of s" else arrival
        np.testing.assert_array_equal(signal.arrival_ns, came if both and form != "parquet" else ns)
