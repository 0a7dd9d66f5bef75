"""Blackbox logs, as Betaflight's own encoder wrote them; damaged; and of several flights.

tests/golden/blackbox: 110 main frames each, of all encodings and predictors of Betaflight 4.3, and the numbers in them.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from imuscope.protocols.native.kernels import plain
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.readers.formats import blackbox_kernel
from imuscope.recordings.readers.formats.blackbox import Blackbox
from tests.recordings.readers.formats.opening import damage_of, opened, rows_of, survives_damage
from tests.support.each_row import each_row
from tests.support.source_files import ROOT

GOLDEN = ROOT / "tests" / "golden" / "blackbox"
NAMES = ["every_1", "every_4"]
"""With each loop in the log, and with each fourth."""
STARTED = 1714979289.123  # 2024-05-06 07:08:09.123 UTC


def frames_of(path: Path) -> dict[str, list[list[float]]]:
    """All numbers of the tables of a log."""
    log = Blackbox(path)
    out: dict[str, list[list[float]]] = {}
    for block in log.blocks():
        for name, data in block.records.items():
            out.setdefault(name, []).extend(map(list, np.frombuffer(data, log.tables[name].dtype).tolist()))
    return out


@each_row(("name", "way"), [(name, way) for name in NAMES for way in ("compiled", "plain")])
def test_the_numbers_are_those_of_the_firmware(name: str, way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if way == "plain":
        monkeypatch.setattr(blackbox_kernel, "frames_of", plain(blackbox_kernel.frames_of))
    assert frames_of(GOLDEN / f"{name}.bbl") == json.loads((GOLDEN / f"{name}.json").read_text())


def test_a_log_has_its_date_and_the_units_that_it_names(tmp_path: Path) -> None:
    main = json.loads((GOLDEN / "every_1.json").read_text())["main"]
    store = opened(GOLDEN / "every_1.bbl", tmp_path)
    rows = rows_of(store, "gyroADC", "main")
    np.testing.assert_allclose(np.stack(rows.columns, axis=1), [row[14:17] for row in main])
    np.testing.assert_allclose(rows.time, STARTED + (np.array([row[1] for row in main]) - main[0][1]) / 1e6, atol=1e-6)
    units = {one["name"]: one["unit"] for one in store.manifest["channels"]}
    assert (units["gyroADC"], units["accSmooth"], units["GPS_coord"]) == ("°/s", "m/s²", "°")
    assert units["vbatLatest"] == "", "its unit depends on the firmware"
    np.testing.assert_allclose(rows_of(store, "accSmooth").columns[0], [row[17] * 9.80665 / 2048 for row in main])
    assert "start datetime" in store.manifest["time"]["sentences"][1]
    assert damage_of(store) == ""


def test_without_a_clock_the_date_is_that_of_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.bbl"
    data = (GOLDEN / "every_1.bbl").read_bytes()
    path.write_bytes(data.replace(b"2024-05-06T07:08:09.123", b"0000-01-01T00:00:00.000"))
    os.utime(path, (1_600_000_000, 1_600_000_000))
    assert opened(path, tmp_path).manifest["started"] == pytest.approx(1_600_000_000)


def test_two_flights_follow_each_other(tmp_path: Path) -> None:
    """The second log has other fields, and its clock begins again."""
    first, second = ((GOLDEN / f"{name}.bbl").read_bytes() for name in NAMES)
    path = tmp_path / "a.bbl"
    path.write_bytes(first + second.replace(b"rcCommand[0]", b"setpoint[0] "))
    store = opened(path, tmp_path)
    rows = [json.loads((GOLDEN / f"{name}.json").read_text())["main"] for name in NAMES]
    np.testing.assert_array_equal(rows_of(store, "gyroADC", "main").columns[0], [r[14] for log in rows for r in log])
    assert "time goes back 1 times" in damage_of(store)


def test_a_hole_costs_frames_until_the_next_whole_one(tmp_path: Path) -> None:
    data = bytearray((GOLDEN / "every_1.bbl").read_bytes())
    main = json.loads((GOLDEN / "every_1.json").read_text())["main"]
    at = data.index(b"\nP", len(data) // 2) if b"\nP" in data[len(data) // 2 :] else len(data) // 2
    data[at : at + 9] = bytes(9)
    path = tmp_path / "a.bbl"
    path.write_bytes(data)
    results = frames_of(path)["main"]
    assert 32 < len(results) < len(main)
    assert len(main) - len(results) <= 33, "a whole frame comes every 32 loops"
    assert all(row in main for row in results)
    words = damage_of(opened(path, tmp_path))
    assert "outside frames" in words
    assert "left out" in words


def test_damage_does_no_harm(tmp_path: Path) -> None:
    path = tmp_path / "a.bbl"
    path.write_bytes((GOLDEN / "every_1.bbl").read_bytes())
    opens, refused = survives_damage(path, tmp_path)
    assert opens
    assert refused


def test_a_log_without_a_description_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.bbl"
    path.write_bytes(b"H Product:Blackbox flight data recorder by Nicholas Sherlock\nH Data version:2\n" + bytes(99))
    with pytest.raises(RecordingError, match="no records with a time") as error:
        open_file(path)
    assert "does not describe its frames" in error.value.hint


@each_row("name", NAMES)
def test_a_log_that_ends_with_a_frame_has_it(name: str, tmp_path: Path) -> None:
    """Its last numbers may take one byte together."""
    path = tmp_path / "a.bbl"
    path.write_bytes((GOLDEN / f"{name}.bbl").read_bytes().partition(b"E\xffEnd of log")[0])
    assert frames_of(path) == json.loads((GOLDEN / f"{name}.json").read_text())


def test_a_flight_whose_clock_is_earlier_begins_a_segment(tmp_path: Path) -> None:
    data = (GOLDEN / "every_1.bbl").read_bytes()
    path = tmp_path / "two.bbl"
    path.write_bytes(data + data)
    store = opened(path, tmp_path)
    rows = rows_of(store, "gyroADC", "main")
    assert np.diff(rows.time).min() > 0
    [begin] = store.manifest["segments"]["1"]
    assert begin == pytest.approx(rows.time[len(rows.time) // 2])
    [event] = [one for one in store.manifest["events"] if one["data"].get("kind") == "back"]
    assert event["text"].startswith("time goes back by ")
