"""JSON text as phones, web pages and scripts write samples, and text in UTF-16."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.readers.formats import json_table
from imuscope.server.devices.decode import protocol_set
from imuscope.server.library.decode import decode
from tests.recordings.readers.formats.opening import damage_of, rows_of, survives_damage
from tests.support.each_row import each_row

N = 60
START = 1_500_000_000
TIMES = [f"2017-07-14T02:40:{n / 50:09.6f}" for n in range(N)]
SAMPLES = [{"timestamp": TIMES[n], "acc_x": n % 7, "acc_y": 0.5, "acc_z": 9.8} for n in range(N)]


def opened(path: Path) -> ColumnStore:
    return decode(open_file(path), path.with_suffix(".columns"), protocol_set.all_protocols())


def in_lines(values: list[Any]) -> str:
    return "".join(f"{json.dumps(one)}\n" for one in values)


def of_each(**of_sample: Callable[[int], Any]) -> list[dict[str, Any]]:
    """Samples with a time."""
    return [{"time": START + n / 50, **{name: value(n) for name, value in of_sample.items()}} for n in range(N)]


SECONDS = [START + n / 50 for n in range(N)]
COLUMNS = {"times": SECONDS, "ax": [n % 7 for n in range(N)], "ay": [0] * N, "az": [9] * N}
OF_PANDAS = {name: dict(enumerate(column)) for name, column in COLUMNS.items()}
PHONE = [[int(one * 1000), [n % 7, 0, 9]] for n, one in enumerate(SECONDS)]
OF_ROWS = {"desc": ["ax", "ay", "az"], "unit": "m/s²", "data": PHONE}
STREAM = {"SIUN": "m/s2", "ACCL": [{"value": [n % 7, 0, 9], "date": one} for n, one in enumerate(TIMES)]}
SENSORS = [{"name": f"acc{axis}", "units": "m/s2"} for axis in "XYZ"]
EDGE = {"payload": {"interval_ms": 20, "sensors": SENSORS, "values": [[n % 7, 0, 9] for n in range(N)]}}


@each_row(
    ("text", "name", "unit"),
    [
        (json.dumps(SAMPLES), "acc", ""),
        (json.dumps(SAMPLES, indent=2), "acc", ""),
        (json.dumps({"device": "a", "data": SAMPLES}), "acc", ""),
        (json.dumps({"left": SAMPLES, "right": SAMPLES}), "acc", ""),
        (in_lines(SAMPLES), "acc", ""),
        (in_lines([{"timestamp": None, "acc_x": None}, *SAMPLES]), "acc", ""),
        (in_lines(of_each(gyro=lambda n: [n % 7, 0, 9])), "gyro", ""),
        (in_lines(of_each(gyro=lambda n: {"x": n % 7, "y": 0, "z": 9})), "gyro", ""),
        (in_lines(of_each(gyro=lambda n: f"[{n % 7} 0. 9.]")), "gyro", ""),
        (in_lines(of_each(value=lambda n: {"x": str(n % 7), "y": "0", "z": "9"}, unit=lambda n: "g")), "value", "g"),
        (in_lines(of_each(sensor=lambda n: {"type": "gyr", "values": [n % 7, 0, 9]})), "sensor.values", ""),
        (json.dumps(COLUMNS), "a", ""),
        (json.dumps({"car": COLUMNS, "rate": 50}), "a", ""),
        (json.dumps(OF_PANDAS), "a", ""),
        (json.dumps(OF_ROWS), "a", "m/s²"),
        (json.dumps(EDGE), "acc", "m/s²"),
        (json.dumps({"1": {"DEVC": [{"name": "a", "STRM": [STREAM, {"GYRO": STREAM["ACCL"]}]}]}}), "value", "m/s²"),
    ],
)
def test_samples_in_json_are_a_table(text: str, name: str, unit: str, tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text(text, encoding="utf-8")
    store = opened(path)
    info = next(one for one in store.manifest["channels"] if one["name"] == name)
    assert [column["axis"] for column in info["columns"]] == ["x", "y", "z"]
    assert info["kind"] == "vector"
    assert info["unit"] == unit
    rows = rows_of(store, name)
    np.testing.assert_array_equal(rows.columns[0], np.arange(N) % 7)
    np.testing.assert_allclose(np.diff(rows.time), 0.02, atol=1e-6)
    assert rows.time[0] == START or "interval_ms" in text
    assert not store.manifest["damage"]


def test_a_text_beside_samples_has_the_order_of_their_axes(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"DEVC": [{"STRM": [STREAM | {"STNM": "Accelerometer (z,x,y)"}]}]}))
    rows = rows_of(opened(path), "value")
    assert [column[0] for column in rows.columns] == [0, 9, 0]
    np.testing.assert_array_equal(rows.columns[2], np.arange(N) % 7)


def test_batches_of_samples_have_the_time_of_their_batch(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    batches = [
        {
            "Timestamp": 5000 + 80 * n,
            "Acc": [{"x": n, "y": i, "z": 9} for i in range(8)],
            "Gyro": [{"x": i} for i in range(8)],
        }
        for n in range(N)
    ]
    path.write_text(json.dumps({"Meas": {"IMU9": batches}}))
    store = opened(path)
    assert "Timestamp in ms" in " ".join(store.manifest["time"]["sentences"])
    np.testing.assert_array_equal(rows_of(store, "Acc").columns[1], list(range(8)) * N)


def test_samples_that_name_their_sensor_are_tables_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "a.jsonl"
    kinds = ("accelerometer", "gyroscope")
    path.write_text(
        in_lines([{"sensor": kinds[n % 2], "time": START + n / 50, "x": n, "y": 0, "z": 9} for n in range(N)])
    )
    store = opened(path)
    assert {info["message"] for info in store.manifest["channels"]} == {*kinds}
    np.testing.assert_array_equal(rows_of(store, "xyz", "gyroscope").columns[0], np.arange(1, N, 2))


@each_row(
    "write", [lambda: json.dumps(SAMPLES), lambda: json.dumps({"data": SAMPLES}, indent=1), lambda: in_lines(SAMPLES)]
)
def test_a_text_that_ends_too_soon_is_read_up_to_there(write: Callable[[], str], tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    text = write()
    path.write_text(text[: len(text) * 2 // 3 + 9])
    store = opened(path)
    rows = rows_of(store, "acc")
    assert N // 2 < len(rows.time) < N
    np.testing.assert_array_equal(rows.columns[0], np.arange(len(rows.time)) % 7)
    assert re.search("ends too soon|not JSON", damage_of(store))


@each_row(
    ("text", "words"),
    [
        ('{"name": "settings", "rate": 100}', "without a list of samples"),
        ('{"a": ' * 200 + "1" + "}" * 200, "brackets in brackets"),
        ("[" * 100_000, "brackets in brackets"),
        ('{"a": nothing}', "not JSON"),
        ("[[1, 2], [3, 4]]", "no column of times"),
        (json.dumps([{"x": n, "y": 1} for n in range(N)]), "no column of times"),
    ],
)
def test_json_that_holds_none_is_refused(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(RecordingError, match=words):
        opened(path)


def test_one_value_has_a_largest_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(json_table, "MAX_VALUE_BYTES", 1000)
    path = tmp_path / "a.json"
    path.write_text(json.dumps(SAMPLES))
    with pytest.raises(RecordingError, match="JSON value of more than"):
        opened(path)
    path.write_text(in_lines(SAMPLES))
    assert len(rows_of(opened(path), "acc").time) == N


@each_row("write", [lambda: json.dumps({"a": SAMPLES, "b": SAMPLES}), lambda: in_lines(SAMPLES)])
def test_damaged_json_does_no_harm(write: Callable[[], str], tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text(write())
    opens, refused = survives_damage(path, tmp_path)
    assert opens
    assert opens + refused


@each_row("encoding", ["utf-16-le", "utf-16-be"])
@each_row(
    "text",
    [
        "time (s),a_x,a_y,a_z\r\n" + "".join(f"{n / 50:.2f},{n % 7},0,9\r\n" for n in range(N)),
        json.dumps([{"time": n / 50, "a_x": n % 7, "a_y": 0, "a_z": 9} for n in range(N)]),
    ],
)
def test_text_in_utf_16_is_read(encoding: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(f"\ufeff{text}".encode(encoding))
    rows = rows_of(opened(path), "a")
    np.testing.assert_array_equal(rows.columns[0], np.arange(N) % 7)
    np.testing.assert_allclose(np.diff(rows.time), 0.02, atol=1e-6)


@each_row("form", ["split", "index", "columns"])
@each_row("index", ["ms", "dates"])
def test_the_index_of_pandas_is_a_column(form: str, index: str, tmp_path: Path) -> None:
    """Times in the names of members were lost, so that there was no column of times."""
    names = [str(1000 * START + 20 * n) if index == "ms" else TIMES[n] for n in range(N)]
    rows = [{"acc_x": n % 7, "acc_y": 0.5} for n in range(N)]
    value: Any = dict(zip(names, rows, strict=True))
    if form == "columns":
        value = {key: {name: row[key] for name, row in zip(names, rows, strict=True)} for key in rows[0]}
    elif form == "split":
        cells: list[Any] = [int(name) for name in names] if index == "ms" else names
        value = {"columns": [*rows[0]], "index": cells, "data": [[*row.values()] for row in rows]}
    path = tmp_path / "a.json"
    path.write_text(json.dumps(value))
    acceleration = rows_of(opened(path), "acc")
    np.testing.assert_allclose(acceleration.time, START + np.arange(N) / 50, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(acceleration.columns[0], np.arange(N) % 7)


@each_row("form", ["split", "columns"])
def test_an_index_that_only_counts_is_no_column(form: str, tmp_path: Path) -> None:
    value: Any = {key: {str(n): n / 50 for n in range(N)} for key in ("time", "gx")}
    if form == "split":
        value = {"columns": ["time", "gx"], "index": [*range(N)], "data": [[n / 50, n / 50] for n in range(N)]}
    path = tmp_path / "a.json"
    path.write_text(json.dumps(value))
    store = opened(path)
    assert [one["name"] for one in store.manifest["channels"]] == ["gx"]
