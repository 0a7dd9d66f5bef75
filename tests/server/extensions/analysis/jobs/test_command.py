"""`imuscope calibrate`, `analyse A comparison --with B` and evidence by `decode`: known parameters come out."""

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from imuscope.protocols.xbus.frames import build
from imuscope.server.cli import main
from imuscope.server.http.page_files import FOLDER
from tests.server.extensions.evidence.evidence_harness import content_in

RATE = 100
BIAS = np.radians([0.4, -0.25, 0.1])
IRON = np.array([0.12, -0.3, 0.05])
Rows = NDArray[np.float64]


def written(path: Path, acceleration: Rows, turn: Rows, field: Rows | None = None) -> Path:
    """A capture with these samples, 100 a second."""
    frames = []
    for k in range(len(acceleration)):
        items = struct.pack(">HBH", 0x1020, 2, k & 0xFFFF) + struct.pack(">HBI", 0x1060, 4, k * 10_000 // RATE)
        vectors: Sequence[tuple[int, Rows | None]] = ((0x4020, acceleration), (0x8020, turn), (0xC020, field))
        for code, rows in vectors:
            if rows is not None:
                items += struct.pack(">HB3f", code, 12, *rows[k])
        frames.append(build(0x36, items))
    path.write_bytes(b"".join(frames))
    return path


def at_rest(path: Path, seconds: float = 40.0, seed: int = 1) -> Path:
    draw, count = np.random.default_rng(seed), int(seconds * RATE)
    gravity = np.array([0.0, 0.0, 9.81]) + draw.normal(0, 0.01, (count, 3))
    return written(path, gravity, BIAS + draw.normal(0, 0.002, (count, 3)))


def shaken(
    path: Path, moved_s: float = 0.0, extra: float = 0.0, seconds: float = 30.0, turn: Rows | None = None
) -> Path:
    """Accelerations without a period, `moved_s` later in their motion than those of another file, and `extra` more."""
    time = np.arange(int(seconds * RATE)) / RATE + 5.0 + moved_s
    wave = 2 * np.sin(2.1 * time) + 1.5 * np.sin(0.83 * time**1.2)
    rows = np.stack([wave + extra, 0.5 * wave, np.full(len(time), 9.81)], axis=1)
    return written(path, rows, np.zeros_like(rows) if turn is None else turn)


def printed(capsys: pytest.CaptureFixture[str], *words: Any) -> str:
    assert main([str(word) for word in words]) == 0, capsys.readouterr().err
    return capsys.readouterr().out


def refused(capsys: pytest.CaptureFixture[str], *words: Any) -> str:
    capsys.readouterr()
    assert main([str(word) for word in words]) == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    (line,) = captured.err.splitlines()
    return line


def test_a_bias_at_rest_is_found_and_written_in_every_format(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = at_rest(tmp_path / "rest.bin")
    body = json.loads(printed(capsys, "calibrate", file, "gyroscope", "--format", "json"))
    bias = np.array(body["correction"]["bias"])
    scale = 1.0 if body["correction"]["unit"] == "rad/s" else np.degrees(1)
    assert np.allclose(bias / scale, BIAS, atol=2e-4)
    text = printed(capsys, "calibrate", file, "gyroscope")
    assert "corrected = matrix · (measured − bias)" in text
    assert f"bias x   {bias[0]:+.9g} ±" in text
    for suffix, word in ((".yaml", "gyroscope:"), (".csv", "bias_x,"), (".h", "static const double gyroscope_bias[3]")):
        out = tmp_path / f"gyro{suffix}"
        assert printed(capsys, "calibrate", file, "gyroscope", "-o", out).strip() == str(out)
        assert word in out.read_text(encoding="utf-8")


def test_a_result_does_not_take_the_place_of_the_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = at_rest(tmp_path / "rest.bin")
    before = file.read_bytes()
    (tmp_path / "link.csv").symlink_to(file)
    for out in (file, tmp_path / "link.csv"):
        line = refused(capsys, "calibrate", file, "gyroscope", "--format", "csv", "-o", out)
        assert "OUT is the input file" in line
    assert file.read_bytes() == before


def test_iron_is_found_from_turns_in_all_directions(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    draw = np.random.default_rng(3)
    count = 4000
    height, angle = np.linspace(-1, 1, count), np.arange(count) * 2.39996
    ring = np.sqrt(1 - height**2)
    sphere = np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)
    field = sphere + IRON + draw.normal(0, 0.002, (count, 3))
    file = written(tmp_path / "turns.bin", 9.81 * sphere, np.zeros((count, 3)), field)
    body = json.loads(printed(capsys, "calibrate", file, "magnetometer", "--format", "json"))
    assert np.allclose(body["correction"]["bias"], IRON, atol=2e-3)


def test_a_table_is_calibrated_by_its_columns(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    draw = np.random.default_rng(4)
    turn = np.deg2rad(np.array([0.3, -0.2, 0.1]) + draw.normal(0, 0.02, (6000, 3)))
    rows = np.column_stack([1.7e9 + np.arange(6000) / 100, turn])
    file = tmp_path / "rest.csv"
    lines = [",".join(map(repr, row)) for row in rows.tolist()]
    file.write_text("\n".join(["time (s),gyr_x (rad/s),gyr_y (rad/s),gyr_z (rad/s)", *lines]))
    body = json.loads(printed(capsys, "calibrate", file, "gyroscope", "--format", "json"))
    assert np.allclose(body["correction"]["bias"], [0.3, -0.2, 0.1], atol=2e-3)
    assert main(["calibrate", str(file), "magnetometer"]) == 1
    words = capsys.readouterr().err
    assert "rest.csv has no columns of magnetometer. Name columns and units of the table" in words


def test_a_calibration_that_is_not_determined_gives_the_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = at_rest(tmp_path / "rest.bin", seconds=3.0)
    assert refused(capsys, "calibrate", file, "gyroscope").startswith("imuscope: ")
    assert "sends no data of its magnetometer" in refused(capsys, "calibrate", file, "magnetometer")
    assert "rest.bin lasts" in refused(capsys, "calibrate", file, "gyroscope", "--from", "99")
    assert "selects no format" in refused(capsys, "calibrate", file, "gyroscope", "-o", tmp_path / "a.txt")
    assert "gravity 30 is outside 0 … 20" in refused(capsys, "calibrate", file, "accelerometer", "--gravity", "30")
    with pytest.raises(SystemExit):
        main(["calibrate", str(file), "barometer"])
    assert "valid choices: gyroscope, magnetometer, accelerometer, mounting" in capsys.readouterr().err


def test_noise_of_a_sensor_in_motion_is_not_printed_for_other_programs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Regression: of a sensor swung by hand a rate random walk of 193 °/s²/√Hz could be copied for Kalibr.

    The accelerometer of the file shows the motion; its gyroscope, which is asked for, is at rest.
    """
    noise = np.random.default_rng(2).normal(0, 0.002, (30 * RATE, 3))
    moved, still = shaken(tmp_path / "moved.bin", turn=noise), at_rest(tmp_path / "still.bin")
    turn = ("allan", "--signal", "RateOfTurn", "--format", "kalibr")
    line = refused(capsys, "analyse", moved, *turn)
    assert "RateOfTurn.x: Moving: 30 s of 30 s. Lay the sensor down" in line
    assert "gyroscope_noise_density: " in printed(capsys, "analyse", still, *turn)


def test_two_files_are_compared_where_they_fit_best(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    a, b = shaken(tmp_path / "a.bin"), shaken(tmp_path / "b.bin", moved_s=1.5, extra=0.25)
    how = ("--with", b, "--signal", "Acceleration.x", "--align", "correlation")
    body = json.loads(printed(capsys, "analyse", a, "comparison", *how, "--json"))
    begin = {name: body["signals"][0][name]["time"][0] for name in "ab"}
    assert body["offset"] + begin["b"] - begin["a"] == pytest.approx(1.5, abs=0.01)
    assert body["correlation"] > 0.99
    (row,) = body["signals"]
    assert row["figures"]["mean"] == pytest.approx(0.25, abs=0.01)
    table = printed(capsys, "analyse", a, "comparison", *how)
    assert table.startswith("offset ")
    assert "Acceleration.x" in table
    assert "m/s²" in table


def test_two_parts_of_one_file_are_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = shaken(tmp_path / "a.bin", seconds=8.0)
    parts = ("--from", "1", "--to", "3", "--from-b", "4", "--to-b", "6")
    how = ("--with", file, "--signal", "Acceleration.x", "--align", "start", "--json", *parts)
    body = json.loads(printed(capsys, "analyse", file, "comparison", *how))
    assert body["offset"] == pytest.approx(-3.0, abs=0.02)
    (row,) = body["signals"]
    assert row["figures"]["n"] == pytest.approx(2 * RATE, abs=3)
    assert refused(capsys, "analyse", file, "comparison", *how, "--from-b", "7")  # after --to-b


def test_mistakes_of_a_comparison_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    a = shaken(tmp_path / "a.bin", seconds=3.0)
    signal = ("--signal", "Acceleration.x")
    assert "give the other one with --with B" in refused(capsys, "analyse", a, "comparison", *signal)
    assert "--with belongs to the comparison" in refused(capsys, "analyse", a, "psd", *signal, "--with", a)
    both = ("analyse", a, "comparison", "--with", a)
    assert "one signal of B for each" in refused(capsys, *both, *signal, "--signal-b", "A", "--signal-b", "B")
    assert "Velocity" in refused(capsys, *both, "--signal", "Velocity.x")
    assert "none.bin" in refused(capsys, "analyse", a, "comparison", *signal, "--with", tmp_path / "none.bin")
    assert "must be more than 0" in refused(capsys, *both, *signal, "--search", "-1")


@pytest.mark.skipif(not (FOLDER / "evidence").is_dir(), reason="the page has not been built")
def test_evidence_is_made_of_a_part_of_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, out = shaken(tmp_path / "run at home.bin", seconds=10.0), tmp_path / "run.html"
    printed(capsys, "decode", file, "-o", out, "--from", "2", "--to", "5", "--channel", "Acceleration")
    content = content_in(out.read_text(encoding="utf-8"))
    assert content["t1"] - content["t0"] == pytest.approx(3, abs=0.02)
    assert [plot["title"].split(" · ")[0] for plot in content["plots"]] == ["Acceleration"]
    assert content["file"] == "run at home.bin"
    printed(capsys, "decode", file, "-o", out, "--without-position")
    content = content_in(out.read_text(encoding="utf-8"))
    assert content["position"] is not None
    assert "run at home" not in out.read_text(encoding="utf-8")


def test_without_position_is_of_evidence_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = shaken(tmp_path / "a.bin", seconds=1.0)
    words = refused(capsys, "decode", file, "-o", tmp_path / "a.csv", "--without-position")
    assert "applies to evidence only; let OUT end with .html" in words
