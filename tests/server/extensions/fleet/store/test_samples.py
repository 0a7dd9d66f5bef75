"""Samples and minutes of a store: the numbers of the recording, in columns that never change their meaning."""

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from imuscope.recordings.importers.open_file import open_file
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.extensions.fleet.query.prepared_queries import QUESTIONS
from imuscope.server.extensions.fleet.store.samples import fields_for, plain_name, sample_rows
from imuscope.server.extensions.fleet.store.tables import SAMPLES, SIGNAL, UNIT
from imuscope.server.library.decode import decode
from tests.recordings.recorded_drive import START, drive
from tests.server.extensions.fleet.store_fixtures import Commands, delta
from tests.support.each_row import each_row


def table(path: Path, columns: dict[str, np.ndarray], rate: float = 50.0, start: float = START / 1e9) -> Path:
    """A CSV file with these columns."""
    length = len(next(iter(columns.values())))
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    lines = (f"{start + n / rate:.6f},{','.join(map(repr, row))}" for n, row in zip(range(length), rows, strict=True))
    path.write_text("\n".join((",".join(["time", *columns]), *lines)) + "\n")
    return path


def test_samples_are_those_of_the_recording(commands: Commands, recording: Path, store: Path, tmp_path: Path) -> None:
    commands.uploaded(recording, store)
    opened = decode(open_file(recording), tmp_path / "columns", all_protocols())
    by_signal: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for one in commands.query(store, "SELECT signal, time, unit, value FROM samples ORDER BY time"):
        by_signal[one.pop("signal")].append(one)
    for name in (next(iter(by_signal)), "RateOfTurn.x"):
        assert (
            commands.query(store, f"SELECT time, unit, value FROM samples('{name}') ORDER BY time") == by_signal[name]
        )
    compared = 0
    for info in opened.manifest["channels"]:
        rows = opened.exact(info["id"], 0, opened.rows(info["id"]))
        for column, values in zip(info["columns"], rows.columns, strict=True):
            results = by_signal[f"{info['name']}.{column['name']}"]
            assert [one["value"] for one in results] == pytest.approx(values.astype(float).tolist(), nan_ok=True)
            assert {one["unit"] for one in results} == {column["unit"]}
            compared += len(results)
    assert compared > 5000
    packets = opened.manifest["figures"]["1"]["messages"]["MTData2"]
    (counted,) = commands.query(
        store, "SELECT count(*) AS n, count(DISTINCT time) AS times, count(BaroPressure_value) AS p FROM samples_wide"
    )
    assert (counted["n"], counted["times"]) == (packets, packets)
    assert 0 < counted["p"] < packets
    (bounds,) = commands.query(store, "SELECT min(time) >= min(started) AS a FROM samples, recordings")
    assert bounds == {"a": True}


@pytest.fixture(scope="session")
def long_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording that is longer than a minute."""
    path = tmp_path_factory.mktemp("long") / "long.mcap"
    drive(path, seconds=75.0)
    return path


def test_minutes_are_figures_of_the_samples(commands: Commands, store: Path, long_recording: Path) -> None:
    commands.uploaded(long_recording, store)
    sql = """SELECT m.minute, m.signal, m.count AS rows, s.n, m.mean, s.mean AS mean_2, m.sigma, s.sigma AS sigma_2,
                    m.min, s.low
             FROM minutes m JOIN (
                 SELECT date_trunc('minute', time) AS minute, signal, count(*) AS n, avg(value) AS mean,
                        stddev_samp(value) AS sigma, min(value) AS low FROM samples GROUP BY ALL
             ) s USING (minute, signal) WHERE m.signal LIKE 'RateOfTurn._' ORDER BY ALL"""
    results = commands.query(store, sql)
    assert len(results) == 2 * 3
    for one in results:
        assert one["rows"] == one["n"]
        assert (one["mean"], one["sigma"], one["min"]) == pytest.approx((one["mean_2"], one["sigma_2"], one["low"]))
    norm = commands.query(store, "SELECT axis, max FROM minutes WHERE signal = 'Acceleration.norm'")
    assert all(one["axis"] == "norm" and one["max"] > 9 for one in norm)


def test_noise_is_that_of_the_samples_whatever_moves(commands: Commands, store: Path, tmp_path: Path) -> None:
    random, n = np.random.default_rng(1), 5000
    slow = 3 * np.sin(np.arange(n) / 200)
    commands.upload(table(tmp_path / "a.csv", {"w": slow + random.normal(0, 0.2, n)}), store)
    rows = commands.query(store, "SELECT noise, rate, count FROM minutes WHERE count > 2000")
    assert rows
    for row in rows:
        assert row["rate"] == pytest.approx(50, rel=0.01)
        assert row["noise"] == pytest.approx(0.2 * np.sqrt(2 / 50), rel=0.1)


def test_a_new_field_is_a_new_column_and_old_files_stay_readable(
    commands: Commands, store: Path, tmp_path: Path
) -> None:
    values = np.arange(10.0)
    commands.upload(table(tmp_path / "a.csv", {"speed (m/s)": values}), store, "old")
    commands.upload(table(tmp_path / "b.csv", {"speed (m/s)": values, "extra": values}), store, "new")
    commands.upload(table(tmp_path / "c.csv", {"speed (km/h)": 3.6 * values}), store, "other")
    results = commands.query(store, "SELECT robot, signal, unit, count(*) AS n FROM samples GROUP BY ALL ORDER BY ALL")
    speeds = {(one["robot"], one["unit"]): one["n"] for one in results if "speed" in one["signal"]}
    assert speeds == {("old", "m/s"): 10, ("new", "m/s"): 10, ("other", "km/h"): 10}
    wide = delta(store, "samples")
    assert wide.num_rows == 30
    columns = [field for field in wide.schema if (field.metadata or {}).get(SIGNAL)]
    assert sorted((field.metadata[UNIT].decode()) for field in columns) == ["", "km/h", "m/s"]
    assert len({field.name.lower() for field in wide.schema}) == len(wide.schema)


def test_names_of_columns_are_plain_and_differ(recording: Path, tmp_path: Path) -> None:
    opened = decode(open_file(recording), tmp_path / "columns", all_protocols())
    groups = sample_rows(opened)
    fields = fields_for(groups, SAMPLES.schema)
    names = [field.name for field in fields.values()]
    assert all(name == plain_name(name) for name in names)
    assert len({name.lower() for name in names}) == len(names)
    again = fields_for(groups, pa.schema([*SAMPLES.schema, *fields.values()]))
    assert {key: field.name for key, field in again.items()} == {key: field.name for key, field in fields.items()}


def test_a_signal_that_is_not_there_has_no_rows(commands: Commands, recording: Path, store: Path) -> None:
    store.mkdir()
    for sql in ("SELECT * FROM samples('None.x')", "SELECT * FROM samples", "SELECT * FROM samples_wide"):
        assert commands.query(store, sql) == []
    commands.uploaded(recording, store)
    assert commands.query(store, "SELECT * FROM samples('it''s')") == []
    one = (
        "SELECT (SELECT count(*) FROM samples('RateOfTurn.x')) + (SELECT count(*) FROM samples( 'RateOfTurn.y' )) AS n"
    )
    (both,) = commands.query(store, one)
    (same,) = commands.query(
        store, "SELECT count(*) AS n FROM samples WHERE signal IN ('RateOfTurn.x', 'RateOfTurn.y')"
    )
    assert both == same
    assert both["n"] > 600


@each_row("name", QUESTIONS)
def test_a_prepared_question_is_answered_by_an_empty_store_too(name: str, commands: Commands, store: Path) -> None:
    store.mkdir(exist_ok=True)
    status, out, err = commands.run("query", "--store", store, "--question", name, "--format", "json")
    assert (status, out, err) == (0, "[]\n", "")
    status, out, _ = commands.run("query", "--store", store, "--question", name, "--show")
    assert (status, out) == (0, QUESTIONS[name].sql + "\n")


def test_the_prepared_questions_find_what_they_are_for(commands: Commands, store: Path, long_recording: Path) -> None:
    commands.uploaded(long_recording, store)

    def request(name: str) -> list[dict[str, object]]:
        status, out, _ = commands.run("query", "--store", store, "--question", name, "--format", "json")
        assert status == 0
        return list(json.loads(out))

    (loss,) = request("loss-by-adapter")
    assert (loss["adapter"], loss["lost"], loss["gaps"]) == ("/dev/ttyUSB0", 5, 1)
    noise = {one["quantity"]: one for one in request("noise-by-batch")}
    assert 0.8 < float(str(noise["rate of turn"]["ratio"])) < 1.25
    assert noise["rate of turn"]["batch"] == "00808"
    biases = request("gyro-bias")
    assert {one["signal"] for one in biases} <= {"RateOfTurn.x", "RateOfTurn.y", "RateOfTurn.z"}
    assert biases
    assert all(one["serial_number"] == "0080800001" and one["temperature_c"] == 25 for one in biases)
    assert all(float(str(one["peak_g"])) > 3 for one in request("shocks"))


def test_a_device_counts_once_in_its_batch_however_often_it_was_recorded(
    commands: Commands, store: Path, long_recording: Path
) -> None:
    answers = []
    commands.uploaded(long_recording, store)
    for robot in ("otter", "b"):
        commands.upload(long_recording, store, robot)
        answers.append(commands.query(store, QUESTIONS["noise-by-batch"].sql))
    assert answers[0] == answers[1]
    assert {one["devices"] for one in answers[1]} == {1}


def test_shocks_are_found(commands: Commands, store: Path, tmp_path: Path) -> None:
    still = np.zeros(200)
    bump = np.where(np.arange(200) == 100, 40.0, 9.81)
    columns = {"acc.x (m/s²)": still, "acc.y (m/s²)": still, "acc.z (m/s²)": bump}
    commands.upload(table(tmp_path / "bump.csv", columns), store)
    calm = {**columns, "acc.z (m/s²)": still + 9.81}
    commands.upload(table(tmp_path / "calm.csv", calm), store)
    _, out, _ = commands.run("query", "--store", store, "--question", "shocks", "--format", "json")
    (result,) = json.loads(out)
    assert result["title"] == "bump.csv"
    assert result["peak_g"] == pytest.approx(40 / 9.80665)
