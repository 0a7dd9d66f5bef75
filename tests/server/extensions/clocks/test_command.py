"""`imuscope time`: the clocks of a file, their steps, drift and jitter, and which one is the time axis."""

import json
from pathlib import Path

import pytest

from imuscope.server.cli import main
from tests.recordings.recorded_drive import drive
from tests.support.each_row import each_row

ROWS = 400


def table(path: Path, heading: str, *columns: list[str]) -> Path:
    rows = [heading, *(",".join(row) for row in zip(*columns, strict=True))]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def clocks(capsys: pytest.CaptureFixture[str], path: Path, *more: str) -> dict[str, dict[str, object]]:
    """The clocks of a table with one message, by name."""
    assert main(["time", str(path), "--json", *more]) == 0
    message, *_ = json.loads(capsys.readouterr().out)["messages"]
    return {one["name"]: one for one in message["clocks"]}


def test_drift_and_jitter_are_against_the_axis(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    times = [f"{1_500_000_000 + n / 100:.2f}" for n in range(ROWS)]
    device = [str(round(n * 10_000 * 1.0002 + 300 * (n % 3 - 1))) for n in range(ROWS)]  # 200 ppm fast
    path = clocks(capsys, table(tmp_path / "a.csv", "time (s),TimeUS,gx", times, device, ["1"] * ROWS))
    assert path["time"]["is_axis"]
    assert path["time"]["drift_ppm"] is None
    assert path["TimeUS"]["unit"] == "µs"
    assert path["TimeUS"]["drift_ppm"] == pytest.approx(200, abs=5)
    assert path["TimeUS"]["jitter_s"] == pytest.approx(300e-6 * (2 / 3) ** 0.5, rel=0.05)


@each_row(
    ("counts", "kind", "by_s"),
    [
        ([n * 10 + (5000 if n < 200 else 0) for n in range(ROWS)], "back", -5.0),
        ([n * 10 + (5000 if n >= 200 else 0) for n in range(ROWS)], "ahead", 5.0),
        ([5000 + n * 10 if n < 200 else n * 10 - 2000 for n in range(ROWS)], "restart", -7.0),
        ([(65_536 - 2000 + n * 10) % 65_536 for n in range(ROWS)], "wrap", -65.536),
    ],
)
def test_steps_are_listed_with_their_size(
    counts: list[int], kind: str, by_s: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = table(tmp_path / "a.csv", "millis,gx", list(map(str, counts)), ["1"] * ROWS)
    [step] = clocks(capsys, path)["millis"]["steps"]  # type: ignore[misc]
    assert (step["kind"], step["row"]) == (kind, 201)  # type: ignore[index]
    assert step["by_s"] == pytest.approx(by_s, abs=1e-6)  # type: ignore[index]
    assert main(["time", str(path)]) == 0
    out, notes = capsys.readouterr()
    assert "sample 201" in out
    assert "The time axis is millis in ms" in notes


def test_repeats_and_bursts_are_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    times = [f"{1_500_000_000 + n / 100:.2f}" for n in range(ROWS)]
    bursts = [f"{1_500_000_000 + n // 4 * 4 / 100:.2f}" for n in range(ROWS)]
    path = clocks(capsys, table(tmp_path / "a.csv", "time (s),host_time (s),gx", times, bursts, ["1"] * ROWS))
    assert path["host_time"]["repeats"] == 300
    assert path["host_time"]["bursts"] == pytest.approx(0.75, abs=0.01)
    assert path["host_time"]["burst_samples"] == 4
    assert path["host_time"]["rate_hz"] == pytest.approx(100)


def test_the_difference_is_drawn_in_few_points(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    times = [f"{1_500_000_000 + n / 100:.2f}" for n in range(ROWS)]
    device = [str(round(n * 10_000 * 1.001) + (10**9 if n >= 300 else 0)) for n in range(ROWS)]
    path = clocks(capsys, table(tmp_path / "a.csv", "time (s),TimeUS,gx", times, device, ["1"] * ROWS))
    course = path["TimeUS"]["difference"]
    assert isinstance(course, dict)
    assert len(course["times"]) == len(course["low"]) == len(course["high"]) == 200
    assert course["edges"] == pytest.approx([1_500_000_003])
    assert max(course["high"]) == pytest.approx(2.99e-3, abs=1e-5)  # from zero again after the step
    assert path["TimeUS"]["drift_ppm"] == pytest.approx(1000, abs=1)
    assert path["time"]["difference"] is None


def test_a_stall_that_is_caught_up_is_no_step_of_the_difference(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    times = [f"{1_500_000_000 + n / 100:.2f}" for n in range(ROWS)]
    late = [f"{1_500_000_000 + max(n, 230 if 200 <= n < 230 else 0) / 100:.2f}" for n in range(ROWS)]
    path = clocks(capsys, table(tmp_path / "a.csv", "time (s),host_time (s),gx", times, late, ["1"] * ROWS))
    host = path["host_time"]
    assert host["steps"]
    assert host["difference"]["edges"] == []  # type: ignore[index]
    assert abs(host["drift_ppm"]) < 4 * host["drift_error_ppm"]  # type: ignore[arg-type, operator]


def test_a_counter_has_no_drift_of_its_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drive(tmp_path / "drive.mcap", seconds=2.0)
    assert main(["time", str(tmp_path / "drive.mcap"), "--json"]) == 0
    printed = [one for message in json.loads(capsys.readouterr().out)["messages"] for one in message["clocks"]]
    [counter] = [one for one in printed if one["name"] == "PacketCounter"]
    assert counter["unit"] == "counts of 0.01 s"
    assert counter["drift_ppm"] is None
    [sampled] = [one for one in printed if one["name"] == "SampleTimeFine"]
    assert sampled["unit"] == "100 µs"


def test_what_is_not_certain_is_requested(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = table(tmp_path / "a.csv", "time,gx", [str(n) for n in range(ROWS)], ["1"] * ROWS)
    assert main(["time", str(path)]) == 1
    error = capsys.readouterr().err
    assert "s (1 Hz) or ms (1000 Hz)" in error
    assert "--time-unit" in error
    for options, rate in ((["--time-unit", "ms"], 1000), (["--rate", "1"], 1), (["--time-unit", "s"], 1)):
        assert clocks(capsys, path, *options)["time"]["rate_hz"] == pytest.approx(rate, rel=1e-3)


def test_a_file_of_names_describes_the_columns(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = table(tmp_path / "a.csv", "c1,c2,c3", [str(n * 20) for n in range(ROWS)], ["1"] * ROWS, ["2"] * ROWS)
    assert main(["time", str(path)]) == 1
    assert "no column of times" in capsys.readouterr().err
    names = tmp_path / "columns.txt"
    names.write_text("# of the logger\nc1 = time (ms)\n2 = Gyro.x (rad/s)\nc3 =\n", encoding="utf-8")
    assert clocks(capsys, path, "--columns", str(names))["time"]["rate_hz"] == pytest.approx(50)
    names.write_text("c1\n", encoding="utf-8")
    assert main(["time", str(path), "--columns", str(names)]) == 1
    assert "line 1" in capsys.readouterr().err


def test_a_live_source_is_received_for_some_seconds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = ["--data", str(tmp_path)]
    source = "sim:idtp?rate=400&burst_ms=16&packet=0"  # an MTi wakes up first, and then may be silent for a second
    assert main(["time", source, "--seconds", "1", "--json", *data]) == 0
    message, *_ = json.loads(capsys.readouterr().out)["messages"]
    results = {one["name"]: one for one in message["clocks"]}
    assert results["time"]["is_axis"]
    assert results["arrival"]["bursts"] > 0.5
    for words, problem in ((["none:here"], "none:here"), (["sim:xbus", "--seconds", "0"], "--seconds 0")):
        assert main(["time", *words, *data]) == 1
        assert problem in capsys.readouterr().err


def test_a_source_that_sends_nothing_is_not_waited_for_without_end(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("imuscope.server.extensions.clocks.command.PATIENCE_S", 0.2)
    assert main(["time", "udp://127.0.0.1:0", "--seconds", "1", "--data", str(tmp_path)]) == 1
    assert "No data was received. " in capsys.readouterr().err


def test_a_file_without_numbers_is_an_error_that_states_what_it_holds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nothing was printed, and the exit code was 0."""
    empty = tmp_path / "empty.mtb"
    empty.write_bytes(bytes.fromhex("faff3000d1") * 20)
    assert main(["time", str(empty)]) == 1
    assert "empty.mtb has no numbers that can be shown. It holds: " in capsys.readouterr().err
