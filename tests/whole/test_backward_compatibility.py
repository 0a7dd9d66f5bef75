"""Backward compatibility: files of every earlier format open with their values; later formats are refused.

tests/golden/previous_formats/N holds files as a server of format N left them: a recording of each family (of the
simulators,
0.6 s), what a person changed about one, a snapshot, a rollback record, a configuration file, and what `imuscope decode`
made of the recordings then. They are never made anew: a format that changes gets a folder of its own beside them.
"""

from __future__ import annotations

import csv
import io
import json
import os
import re
import shutil
import time
from pathlib import Path
from typing import Any

import pytest
from mcap.records import Metadata

from imuscope.recordings import sidecar
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.library.probe import probe
from imuscope.recordings.mcap import writer as mcap_writer
from imuscope.recordings.mcap.reader import McapReader
from imuscope.recordings.mcap.records import bytes_of
from imuscope.recordings.mcap.writer import McapWriter
from imuscope.server.commands.decode import decode_file
from imuscope.server.configuration.rollback import RollbackRecord, RollbackStore
from imuscope.server.configuration.snapshot_text import from_text
from imuscope.server.configuration.snapshots import SnapshotError, to_text
from imuscope.server.devices.decode.decode_options import DecodeOptions
from tests.support.read_library import ReadLibrary
from tests.support.server_process import ROOT

PREVIOUS = ROOT / "tests" / "golden" / "previous_formats"
FORMATS = sorted(folder.name for folder in PREVIOUS.iterdir())
FAMILIES = ("xbus", "isb", "idtp")
NEWER = "was written by a newer imuscope (format {}; this one reads {})."


@pytest.fixture(params=FORMATS)
def previous(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A copy of what one format left."""
    return Path(shutil.copytree(PREVIOUS / request.param, tmp_path / "kept"))


FRAME = "ENU|NED|NWU|ECEF|WGS84"
RENAMED = {"time #2 (s)": "DID_BAROMETER.time (s)"}


def test_the_previous_formats_stay_small() -> None:
    assert sum(path.stat().st_size for path in PREVIOUS.rglob("*") if path.is_file()) < 60_000 * len(FORMATS)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_recording_opens_with_its_values(previous: Path, family: str) -> None:
    """Every message with the same number of samples and the same last value. Times are mapped again at each opening,
    possibly better, so only arrival is compared.
    """
    then = json.loads((previous / "decoded.json").read_text(encoding="utf-8"))
    made = decode_file(previous / f"{family}.mcap", previous / f"{family}.csv", DecodeOptions(), io.StringIO())
    assert sorted(path.name for path in made) == sorted(name for name in then if name.startswith(family))
    for path in made:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.reader(line for line in file if not line.startswith("#")))
        last = dict(zip(rows[0], rows[-1], strict=True))
        assert len(rows) - 1 == then[path.name]["rows"], path.name
        last |= {_plain(name): value for name, value in last.items()}
        for name, value in then[path.name]["last"].items():
            assert _number(last[RENAMED.get(name, name)]) == pytest.approx(_number(value), rel=1e-6), (
                f"{path.name} {name}"
            )


def _plain(heading: str) -> str:
    """A heading as it was before it named the frame: "vel.x (m/s; NED)" was "vel.x (m/s)", "q.w (NED from body)" "q.w".

    Columns are found by whole headings in files of today; this is for the values that were kept.
    """
    return re.sub(rf"(; | \()({FRAME})( from body)?\)$", lambda results: ")" if results[1] == "; " else "", heading)


def _number(text: str) -> Any:
    try:
        return float(text)
    except ValueError:
        return text


def test_edits_of_a_recording_are_read(previous: Path) -> None:
    (entry,) = [one for one in ReadLibrary(previous).all() if one.path.name == "xbus.mcap"]
    assert (entry.title, entry.edits.tags, entry.edits.pinned) == ("Drive to the pond", ("outdoor", "föhn"), True)
    assert entry.edits.notes == "Two laps.\nWind from the west."
    (marker,) = entry.edits.markers
    assert (marker.time, marker.kind, marker.text, marker.device) == (1795252226.5, "note", "the bump", "1")
    assert entry.probe.devices[0].product.startswith("MTi-630")
    assert entry.probe.damaged == ""


def test_a_snapshot_is_read(previous: Path) -> None:
    snapshot = from_text((previous / "snapshot.yaml").read_text(encoding="utf-8"))
    assert (snapshot.protocol, snapshot.product, snapshot.serial_number) == ("xbus", "MTi-630-8A1G6", "0080A1B2")
    assert (snapshot.firmware, snapshot.title, snapshot.pinned) == ("1.12.0", "Before this change", True)
    assert snapshot.taken == 1795252226.0
    outputs = snapshot.values["OutputConfiguration"]["outputs"]
    assert outputs == [
        {"data_identifier": 0x2010, "output_frequency": 100},
        {"data_identifier": 0x4020, "output_frequency": 400},
    ]
    assert snapshot.values["Gravity"] == {"magnitude": 9.80665, "none": None, "big": 2**60}
    assert snapshot.missing == {"CanConfig": "message unknown"}


def test_a_rollback_record_is_found(previous: Path, tmp_path: Path) -> None:
    folder = tmp_path / "rollbacks"
    folder.mkdir()
    shutil.copy(previous / "trial.json", folder / "xbus-0080A1B2.json")
    (record,) = RollbackStore(folder).all()
    assert record.old == {"Baudrate": {"baudrate": 2}}
    assert (record.old_baud, record.new_baud, record.restart, record.state) == (115_200, 921_600, True, "pending")
    assert (record.serial_number, record.deadline) == ("0080A1B2", 1795252300.5)


# ── later formats ────────────────────────────────────────────────────────────────────────────────────────────────────


def test_written_files_name_their_format(tmp_path: Path) -> None:
    writer = McapWriter(tmp_path / "new.mcap", {"title": "New"})
    writer.close()
    with McapReader(tmp_path / "new.mcap") as recording:
        assert recording.meta(mcap_writer.RECORDING)["format"] == str(mcap_writer.FORMAT)
    sidecar.write(tmp_path / "new.mcap", sidecar.Edits(title="Newer"))
    assert json.loads((tmp_path / "new.mcap.json").read_text())["imuscope"] == sidecar.VERSION
    RollbackStore(tmp_path).save(RollbackRecord("s", "xbus", "", "1", "", {}, {}, None, None, False))
    assert json.loads((tmp_path / "xbus-1.json").read_text())["imuscope"] == 1


def later(path: Path) -> Path:
    """A recording of a format that is not there yet."""
    writer = McapWriter(path, {"title": "Later"})
    writer.chunk("1", "rx", b"\xfa\xff", 1)
    writer.close()
    old, new = (
        {"title": "Later", "format": number} for number in (str(mcap_writer.FORMAT), str(mcap_writer.FORMAT + 1))
    )
    name = mcap_writer.RECORDING
    data = path.read_bytes()
    assert bytes_of(Metadata(name=name, metadata=old)) in data
    path.write_bytes(data.replace(*(bytes_of(Metadata(name=name, metadata=one)) for one in (old, new))))
    return path


def test_a_recording_of_a_later_format_is_refused(tmp_path: Path) -> None:
    path = later(tmp_path / "later.mcap")
    words = NEWER.format(mcap_writer.FORMAT + 1, mcap_writer.FORMAT)
    with pytest.raises(RecordingError) as error:
        open_file(path)
    assert error.value.message == f"later.mcap {words}"
    assert error.value.hint.startswith("Update imuscope")
    with pytest.raises(RecordingError, match="newer imuscope"):
        decode_file(path, tmp_path / "out.csv", DecodeOptions(), io.StringIO())
    report = probe(path)
    assert report is not None
    assert (report.title, report.damaged, report.devices) == ("Later", f"It {words}", [])
    (entry,) = ReadLibrary(tmp_path).all()
    assert entry.probe.damaged == f"It {words}"


def test_edits_by_a_newer_imuscope_are_not_overwritten(tmp_path: Path) -> None:
    shutil.copy(PREVIOUS / "1" / "xbus.mcap", tmp_path)
    beside = sidecar.sidecar_path(tmp_path / "xbus.mcap")
    beside.write_text('{"imuscope": 2, "title": {"en": "Pond"}}')
    library = ReadLibrary(tmp_path)
    (entry,) = library.all()
    words = NEWER.format(2, sidecar.VERSION)
    assert entry.probe.damaged == f"xbus.mcap.json {words}"
    assert entry.edits == sidecar.Edits()
    with pytest.raises(RecordingError, match="newer imuscope"):
        library.edit("xbus", sidecar.Edits(title="Mine"))
    assert beside.read_text() == '{"imuscope": 2, "title": {"en": "Pond"}}'
    beside.unlink()
    os.utime(tmp_path / "xbus.mcap", (time.time(), time.time()))
    assert library.edit("xbus", sidecar.Edits(title="Mine")).title == "Mine"


def test_a_snapshot_of_a_later_format_is_refused() -> None:
    text = to_text(from_text((PREVIOUS / "1" / "snapshot.yaml").read_text(encoding="utf-8")), {})
    with pytest.raises(SnapshotError, match="This snapshot was written by a newer imuscope") as error:
        from_text(text.replace("imuscope: 1", "imuscope: 2"))
    assert error.value.hint.startswith("Update imuscope")
    with pytest.raises(SnapshotError, match="This is not a snapshot"):
        from_text(text.replace("imuscope: 1", "imuscope: old"))


def test_a_rollback_record_of_a_later_format_is_left_alone(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    body = json.loads((PREVIOUS / "1" / "trial.json").read_text())
    path = tmp_path / "xbus-1.json"
    path.write_text(json.dumps({"imuscope": 2, **body, "old": "elsewhere"}))
    assert RollbackStore(tmp_path).all() == []
    assert "newer imuscope" in caplog.text
    assert path.exists()
