"""`import imuscope`: files as arrays, a running server as an iterator; the guide's examples and the notebook run."""

import datetime
import doctest
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import imuscope.recording
import imuscope.signals
from imuscope.recordings.columns.units import UNITS, Units
from imuscope.signals import Signal
from tests.support.cache_folder import cache_folder
from tests.support.server_process import ROOT, ServerProcess
from tests.support.server_process import imuscope as run_command
from tests.support.timeouts import PATIENCE_S

GUIDE, NOTEBOOK = ROOT / "docs" / "guide" / "python.md", ROOT / "docs" / "python.ipynb"
ROWS, CUT, RATE_HZ = 400, 250, 100


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of a simulated MTi."""
    path = tmp_path_factory.mktemp("drive") / "drive.mcap"
    done = run_command("record", "sim:xbus", "--duration", "5", "-o", str(path), "--data", str(path.parent / "data"))
    assert done.returncode == 0, done.stderr
    return path


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """A table in SI units whose clock goes back by 2 s."""
    path = tmp_path / "walk.csv"
    times = np.arange(ROWS) / RATE_HZ - 2.0 * (np.arange(ROWS) >= CUT)
    lines = [f"{1.5e9 + t:.3f},{k / 7:.9f},{-k}" for k, t in enumerate(times)]
    path.write_text("time (s),gyr_x (rad/s),count\n" + "\n".join(lines) + "\n")
    return path


def test_importing_it_loads_nothing() -> None:
    code = "import sys, imuscope; print(sorted({'numpy', 'pyarrow', 'asyncio', 'fastapi'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
    assert set(imuscope.__all__) <= set(dir(imuscope))
    with pytest.raises(AttributeError, match="no attribute 'reed'"):
        imuscope.reed  # noqa: B018


def test_signals_are_as_sent_with_units_and_frames(drive: Path) -> None:
    with imuscope.open(drive) as recording:
        assert [one.protocol for one in recording.devices] == ["xbus"]
        rate = recording["Rate of turn"]
        assert recording["RateOfTurn"] == rate
        assert recording[f"{recording.devices[0].name}/RateOfTurn"] == rate
        assert (rate.columns, rate.units, rate.message) == (("x", "y", "z"), ("°/s",) * 3, "MTData2")
        assert recording["Quaternion"].frame == "ENU from body"
        assert rate.values.shape == (len(rate), 3)
        assert rate.values.dtype == np.float32
        np.testing.assert_array_equal(rate.values[:, 1], rate.column("y"))
        assert (np.diff(rate.time) > 0).all()
        assert recording.start is not None
        part = rate.between(1, 2)
        inside = (rate.time >= recording.start + 1) & (rate.time <= recording.start + 2)
        np.testing.assert_array_equal(part.time, rate.time[inside])
        np.testing.assert_array_equal(part.values, rate.values[inside])
        assert 0 < len(part) < len(rate)
        assert any("MTi" in event.text for event in recording.events)
    np.testing.assert_array_equal(rate.values[:1], rate.values[:1])  # arrays that were read stay


def test_tables_of_others_have_the_same_rows(drive: Path) -> None:
    with imuscope.open(drive) as recording:
        rate = recording["RateOfTurn"]
        arrow = rate.to_arrow()
        assert arrow.column_names == ["time", "arrival", "x", "y", "z"]
        assert arrow.schema.field("x").metadata == {b"unit": "°/s".encode()}
        assert recording["Quaternion"].to_arrow().schema.metadata[b"frame"] == b"ENU from body"
        np.testing.assert_array_equal(arrow["z"].to_numpy(), rate.values[:, 2])
        pandas = rate.to_pandas()
        np.testing.assert_allclose(pandas.index.as_unit("ns").asi8 / 1e9, rate.time, atol=1e-6)
        np.testing.assert_array_equal(pandas["x"].to_numpy(), rate.values[:, 0])
        polars = rate.to_polars()
        assert polars.shape == (len(rate), 5)
        np.testing.assert_array_equal(polars["y"].to_numpy(), rate.values[:, 1])


def test_each_kind_of_signal_becomes_a_table(drive: Path) -> None:
    with imuscope.open(drive) as recording:
        assert len(recording.signals) > 5
        for signal in recording:
            assert signal.to_arrow().num_rows == len(signal) > 0
            assert signal.title in repr(signal)


def test_a_step_of_the_clock_begins_a_segment(table: Path) -> None:
    with imuscope.open(table) as recording:
        signal = recording["gyr_x"]
        assert [len(part) for part in signal.segments()] == [CUT, ROWS - CUT]
        for part in signal.segments():
            np.testing.assert_allclose(np.diff(part.time), 1 / RATE_HZ, atol=1e-6)
        np.testing.assert_allclose(np.concatenate([part.values for part in signal.segments()]), np.arange(ROWS) / 7)
        assert recording.clock["unit"] == "s"
        assert [event.data["by_s"] for event in recording.events if event.data.get("kind") == "back"] == [-2.0]


def test_what_could_not_be_read_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time (s),a,note\n1500000000,1,on\n1500000001,x,on\n1500000002,3,off\n")
    with imuscope.open(path) as recording:
        cells = "1 cell was not a number and was left empty: a in row 2 ('x')."
        assert recording.remarks == (cells, "Columns without numbers are left out: note ('on').")


def test_analyses_and_exports_are_those_of_the_command_line(drive: Path, tmp_path: Path) -> None:
    data = ("--data", str(tmp_path / "data"))
    with imuscope.open(drive) as recording:
        figures = recording.analyse("psd", "RateOfTurn.x", begin_s=1, end_s=4)
        assert recording.analyse("psd", "Rate of turn.x", begin_s=1, end_s=4) == figures  # by its title
        [path] = recording.export(tmp_path / "own.csv", signals=["Rate of turn"], begin_s=1)
        words = ("analyse", str(drive), "psd", "--signal", "RateOfTurn.x", "--from", "1", "--to", "4")
        report = run_command(*words, "--format", "json", *data)
        assert report.returncode == 0, report.stderr
        assert json.loads(report.stdout) == json.loads(json.dumps(figures))
        header, *rows = path.read_text().splitlines()
        assert "RateOfTurn" in header or "Rate of turn" in header
        assert len(rows) == len(recording["RateOfTurn"].between(1, 1e6))


def test_a_recording_is_a_mapping_of_names(drive: Path) -> None:
    with imuscope.open(drive) as recording:
        assert "RateOfTurn" in recording
        assert "RateOfTurn.x" in recording
        assert f"{recording.devices[0].id}/RateOfTurn" in recording
        assert "Rate" not in recording
        assert 0 not in recording
        assert recording.get("Rate") is None
        assert len(recording) == len(recording.signals)
        assert dict(recording)["RateOfTurn"] == recording["RateOfTurn"]
        assert recording["EulerAngles"].columns == ("roll", "pitch", "yaw")
        assert "<th>frame</th>" in recording._repr_html_()
        assert "RateOfTurn" in recording._repr_html_()


def test_a_signal_is_an_array_that_is_not_written(drive: Path) -> None:
    with imuscope.open(drive) as recording:
        rate = recording["RateOfTurn"]
        assert np.asarray(rate).shape == (len(rate), 3)
        assert np.array_equal(recording["RateOfTurn.y"].values, rate.values[:, 1])
        assert np.array_equal(rate[10:20].values, rate.values[10:20])
        assert rate.rate == pytest.approx(100, abs=1)
        assert rate.values_in("rad/s") == pytest.approx(np.radians(rate.values))
        for array in (rate.values, rate.time, rate.arrival, rate.column("x"), recording["RateOfTurn.y"].values):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 0


def test_a_range_is_given_by_moments_too(drive: Path) -> None:
    with imuscope.open(drive) as recording:
        rate = recording["RateOfTurn"]
        assert recording.start is not None
        begin = datetime.datetime.fromtimestamp(recording.start + 1, datetime.UTC)
        expected = rate.between((begin.timestamp() - recording.start), 1e6)
        assert len(rate.between(begin, begin + datetime.timedelta(days=1))) == len(expected) > 300
        naive = np.datetime64(begin.replace(tzinfo=None), "ns")
        assert len(rate.between(naive, naive + np.timedelta64(1, "D"))) == len(expected)


def table_of(path: Path, time: Any, **columns: Any) -> Path:
    """A table of these columns, at 2017 and `time` s."""
    heads = ["time (s)", *(name.replace("__", " (").replace("_per_", "/") + ")" for name in columns)]
    rows = zip(1.5e9 + time, *columns.values(), strict=True)
    path.write_text("\n".join([",".join(heads), *(",".join(f"{cell:.9f}" for cell in row) for row in rows)]) + "\n")
    return path


def test_signals_of_different_rates_stand_in_one_frame(tmp_path: Path) -> None:
    """Nearest within half a step; interpolated linearly, never across a gap."""
    fast, slow = np.arange(1000) / 100, np.arange(100) / 10
    slow = slow[(slow < 3.05) | (slow > 4.95)]
    a = table_of(tmp_path / "a.csv", fast, gyr_x__rad_per_s=np.sin(fast))
    b = table_of(tmp_path / "b.csv", slow, acc_x__m_per_s=3 * slow)
    with imuscope.open(a) as one, imuscope.open(b) as other:
        gyr, acc = one.signals[0], other.signals[0]
        times, values = acc.time - 1.5e9, acc.values
        grid = gyr.time - 1.5e9
        nearest = one.to_pandas([gyr, acc])
        assert nearest.columns.tolist() == ["gyr_x", "acc_x"]
        np.testing.assert_array_equal(nearest.index.asi8, gyr.time_ns)
        np.testing.assert_array_equal(nearest["gyr_x"], gyr.values)
        distance = np.abs(grid[:, np.newaxis] - times)
        within = distance.min(1) < 0.0499
        np.testing.assert_allclose(nearest["acc_x"][within], values[distance.argmin(1)][within])
        assert nearest["acc_x"][distance.min(1) > 0.051].isna().all()
        linear = one.to_pandas([gyr, acc], align="interpolate")["acc_x"].to_numpy()
        hole = (grid > 3.001) & (grid < 4.999)
        assert np.isnan(linear[hole]).all()
        inside = ~hole & (grid <= times[-1])
        np.testing.assert_allclose(linear[inside], np.interp(grid[inside], times, values), atol=1e-6)
        even = one.to_pandas([gyr, acc], rate=50, align="interpolate", units="SI")
        assert set(np.diff(even.index.asi8).tolist()) == {20_000_000}
        assert even.attrs["units"] == {"gyr_x": "rad/s", "acc_x": "m/s"}


def test_nothing_is_interpolated_across_a_step_of_the_clock(table: Path) -> None:
    with imuscope.open(table) as recording:
        frame = recording.to_pandas("gyr_x", rate=1000, align="interpolate")["gyr_x"]
        before, after = (part.time_ns for part in recording["gyr_x"].segments())
        between = (frame.index.asi8 > before[-1]) & (frame.index.asi8 < after[0])
        assert between.any()
        np.testing.assert_array_equal(frame.isna(), between)


def test_angles_and_attitudes_are_interpolated_on_their_circle(drive: Path) -> None:
    with imuscope.open(drive) as recording:
        names = ["Quaternion", "EulerAngles.yaw", "StatusWord", "RateOfTurn.x"]
        frame = recording.to_pandas(names, align="interpolate", rate=333)
        assert frame.columns.tolist() == [*(f"Quaternion.{one}" for one in "wxyz"), *names[1:]]
        norm = np.linalg.norm(frame[[f"Quaternion.{one}" for one in "wxyz"]].to_numpy(), axis=1)
        np.testing.assert_allclose(norm[np.isfinite(norm)], 1, atol=1e-6)
        status = set(np.unique(recording["StatusWord"].values).tolist())
        assert set(frame["StatusWord"].dropna().unique().tolist()) <= status, "flags are those of a sample"
        component = recording.to_pandas("Quaternion.x", align="interpolate", rate=333)["Quaternion.x"]
        np.testing.assert_array_equal(component, frame["Quaternion.x"])


def test_units_are_a_choice(drive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with imuscope.open(drive) as recording:
        rate = recording["RateOfTurn"]
        shown, si = rate.to_pandas(), rate.to_pandas(units="SI")
        assert shown.attrs["units"]["x"] == "°/s"
        assert si.attrs["units"]["x"] == "rad/s"
        np.testing.assert_allclose(np.degrees(si["y"]), rate.values[:, 1], rtol=1e-6)
        assert rate.to_arrow(units="SI").schema.field("z").metadata == {b"unit": b"rad/s"}
        dataset = recording.to_xarray(["RateOfTurn", "Temperature"], units="SI")
        assert dataset["RateOfTurn.x"].attrs["units"] == "rad/s"
        assert dataset["Temperature"].attrs["units"] == "°C"
        np.testing.assert_array_equal(dataset["time"].to_numpy().astype(np.int64), rate.time_ns)
        np.testing.assert_array_equal(rate.to_xarray()["z"], rate.values[:, 2])
        assert "<th>y (°/s)</th>" in rate._repr_html_()
        monkeypatch.setitem(sys.modules, "xarray", None)
        with pytest.raises(imuscope.ImuscopeError, match=r"xarray is not installed: pip install xarray\.$"):
            recording.to_xarray()


def test_calibrations_comparisons_and_clocks_are_those_of_the_command_line(tmp_path: Path) -> None:
    random, time = np.random.default_rng(7), np.arange(4000) / 100
    bias = np.array([0.01, -0.02, 0.03])
    noise = random.normal(0, 1e-3, (3, len(time)))
    gyr = {f"gyr_{axis}__rad_per_s": one + offset for axis, one, offset in zip("xyz", noise, bias, strict=True)}
    still = table_of(tmp_path / "still.csv", time, **gyr)
    data = ("--data", str(tmp_path / "data"))
    with imuscope.open(still) as recording:
        made = recording.calibrate("gyroscope")
        printed = json.loads(run_command("calibrate", str(still), "gyroscope", "--format", "json", *data).stdout)
        assert made.bias.tolist() == pytest.approx(printed["correction"]["bias"])
        assert np.radians(made.bias) == pytest.approx(bias, abs=1e-4)
        assert made.apply(recording["gyr"]).mean(0) == pytest.approx(np.zeros(3), abs=0.01)
        assert [*made.figures] == [one["name"] for one in printed["figures"]]
        [clocks] = recording.time()
        printed = json.loads(run_command("time", str(still), "--json", *data).stdout)
        assert clocks.clocks[0].rate_hz == printed["messages"][0]["clocks"][0]["rate_hz"] == pytest.approx(100)
        walk = random.normal(0, 1, len(time)).cumsum()
        first = table_of(tmp_path / "first.csv", time, u__m=walk)
        second = table_of(tmp_path / "second.csv", time + 0.5, u__m=walk + 2)
        with imuscope.open(first) as a, imuscope.open(second) as b:
            compared = a.compare(b, "u", align="correlation")
            assert compared.offset_s == pytest.approx(-0.5, abs=1e-3)
            assert compared.signals[0].figures["mean"] == pytest.approx(2, abs=1e-3)


def test_mistakes_are_one_sentence(drive: Path, table: Path, tmp_path: Path) -> None:
    with imuscope.open(drive) as recording:
        for use, words in (
            (lambda: recording["Speed"], "no signal 'Speed'.*; it has: .*Rate of turn"),
            (lambda: recording["rateofturn"], r"did you mean 'RateOfTurn'\?"),
            (lambda: recording[0], "0 is no name of a signal"),  # type: ignore[index]
            (lambda: recording["RateOfTurn"].column(7), "no column 7; it has: x, y, z"),
            (lambda: recording["RateOfTurn"].values_in("m/s²"), "is in °/s, which cannot be given in 'm/s²'"),
            (lambda: recording["RateOfTurn"].between(3, 1), "the end is before the beginning"),
            (lambda: recording.analyse("psd", ["Rate"]), "is no name of a signal"),  # type: ignore[arg-type]
            (lambda: recording.export(tmp_path / "x.csv", signals="Rate"), "no signal 'Rate'"),
            (lambda: recording.export(tmp_path / "x.csv", device="MTi"), "has no device 'MTi'"),
            (lambda: imuscope.open(table, time_unt="us"), r"no option 'time_unt' \(did you mean 'time_unit'\?\)"),
            (lambda: imuscope.connect(8080), "8080 is not the address of a server"),  # type: ignore[arg-type]
            (lambda: recording["RateOfTurn"].column("w"), "no column 'w'; it has: x, y, z"),
            (lambda: recording.analyse("guess"), "guess"),
            (lambda: recording.to_pandas(aling="nearest"), r"no option 'aling' \(did you mean 'align'\?\)"),  # type: ignore[call-arg]
            (lambda: recording.to_pandas(align="neerest"), r"did you mean 'nearest'\?"),  # type: ignore[arg-type]
            (lambda: recording.to_pandas(units="si"), r"did you mean 'SI'\?"),  # type: ignore[arg-type]
            (lambda: recording.to_pandas(rate=-1), "rate=-1 is no rate"),
            (lambda: recording.to_pandas(rate=1e9), "which are too many; choose a lower one"),
            (lambda: recording.calibrate("gyro"), r"did you mean 'gyroscope'\?"),  # type: ignore[arg-type]
            (lambda: recording.calibrate("gyroscope", devise="1"), r"did you mean 'device'\?"),  # type: ignore[call-arg]
            (lambda: recording.calibrate("accelerometer", gravity=30), "gravity 30 is outside 0 … 20"),
            (lambda: recording.calibrate("gyroscope"), "The longest rest is"),
            (lambda: recording.compare(recording), "needs the names of signals"),
            (lambda: recording.compare(recording, "Speed"), "Speed"),
            (lambda: recording.analyse("psd", "Speed"), "Speed"),
            (lambda: recording.export(tmp_path / "x.abc"), "not a valid format"),
            (lambda: recording.export(tmp_path / "none" / "x.csv"), "folder not found"),
            (lambda: imuscope.open(tmp_path / "gone.mcap"), "does not exist"),
            (lambda: imuscope.open(table, time_column="hour"), "hour"),
            (lambda: imuscope.connect("ftp://robot"), "looks like http://robot.local:8080"),
            (lambda: imuscope.connect("http://127.0.0.1:9"), "No server answers at http://127.0.0.1:9"),
        ):
            with pytest.raises(imuscope.ImuscopeError, match=words):
                use()
    unclear = tmp_path / "millis.csv"
    unclear.write_text("timestamp,x\n" + "".join(f"{5000 + 100 * k},{k}\n" for k in range(50)))
    with pytest.raises(imuscope.ImuscopeError, match=r"time.unit"):
        imuscope.open(unclear)
    with imuscope.open(unclear, time_unit="ms") as recording:
        assert recording.end is not None
        assert recording.start is not None
        assert recording.end - recording.start == pytest.approx(4.9)


def test_a_server_is_an_iterator(server: ServerProcess) -> None:
    with imuscope.connect(server.url) as live:
        assert live.version
        batches: list[Any] = []
        for batch in live.stream("RateOfTurn", timeout_s=PATIENCE_S):
            batches.append(batch)
            if sum(map(len, batches)) > 20:
                break
        assert {one.signal.name for one in batches} == {"RateOfTurn"}
        assert {one.frame for one in live.signals if one.name in ("RateOfTurn", "Acceleration")} == {"body"}
        assert batches[0].signal.device.id in {one.id for one in live.devices}
        for batch in batches:
            assert batch.values.shape == (len(batch), 3)
            assert batch.signal.units == ("°/s",) * 3
        times = np.concatenate([one.time for one in batches])
        assert (np.diff(times) > 0).all()
        again: list[float] = []
        for batch in live.stream("RateOfTurn", history_s=3, timeout_s=PATIENCE_S):
            again += batch.time.tolist()
            if len(again) > 300:
                break
        assert len(set(again)) == len(again)
        with pytest.raises(
            imuscope.ImuscopeError, match=r"Nothing of 'Rate' arrived .*; the server sends: .*Rate of turn"
        ):
            next(live.stream("Rate", timeout_s=0.2))
    received: dict[Units, dict[float, Any]] = {}
    for units in UNITS:
        with imuscope.connect(server.url, units=units) as live:
            received[units] = {}
            for batch in live.stream("RateOfTurn", history_s=60, timeout_s=PATIENCE_S):
                assert batch.signal.units == ("°/s" if units == "shown" else "rad/s",) * 3
                received[units] |= zip(batch.time.tolist(), batch.values, strict=True)
                if len(received["shown"].keys() & received[units]) > 300:
                    break
    for time in set.intersection(*map(set, received.values())):
        sent = received["device"][time]
        assert sent.dtype == np.float32
        np.testing.assert_array_equal(received["shown"][time], sent * np.float32(180 / np.pi))
        np.testing.assert_array_equal(received["SI"][time], sent)
    for address in (server.url.replace("http://", "tcp://"), server.url.removeprefix("http://")):
        with imuscope.connect(address) as live:
            assert live.version


def test_the_examples_of_the_guide_run(drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    blocks = re.findall(r"^```python\n(.*?)^```", GUIDE.read_text(), re.MULTILINE | re.DOTALL)
    assert len(blocks) >= 4
    assert run_examples(blocks, drive, tmp_path, monkeypatch)["rate"].title == "Rate of turn"


def test_the_examples_of_the_guide_are_typed(tmp_path: Path) -> None:
    """A script elsewhere, under mypy --strict: the package says that it has types."""
    blocks = re.findall(r"^```python[^\n]*\n(.*?)^```", GUIDE.read_text(), re.MULTILINE | re.DOTALL)
    (tmp_path / "script.py").write_text("\n".join(blocks) + "\nreveal_type(rate.time)\n")
    cache = f"--cache-dir={cache_folder('mypy-guide')}"
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file=", cache, "script.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=5 * PATIENCE_S)
    assert done.returncode == 0, done.stdout
    assert "numpy.float64" in done.stdout


def test_the_examples_of_its_docstrings_are_right() -> None:
    names = {**vars(imuscope.recording)}
    [module, *others] = sorted(doctest.DocTestFinder().find(imuscope.recording), key=lambda one: one.name)
    others += doctest.DocTestFinder().find(imuscope.signals)
    runner = doctest.DocTestRunner()
    for one in (module, *others):
        one.globs = names
        assert runner.run(one, clear_globs=False).failed == 0, one.name
    assert runner.summarize().attempted > 10


def test_the_notebook_runs(drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cells = json.loads(NOTEBOOK.read_text())["cells"]
    names = run_examples(
        ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"], drive, tmp_path, monkeypatch
    )
    assert isinstance(names["rate"], Signal)
    assert all(cell.get("outputs", []) == [] for cell in cells), "outputs are not stored"


def run_examples(blocks: list[str], drive: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Run them one after the other in a folder with drive.mcap; returns the names that they made."""
    (folder / "drive.mcap").write_bytes(drive.read_bytes())
    monkeypatch.chdir(folder)
    names: dict[str, Any] = {}
    for block in blocks:
        exec(compile(block, "example", "exec"), names)
    return names
