"""A real folder: listing, editing, deleting, restoring; hostile names and damaged files do no harm."""

import json
import os
from pathlib import Path
from types import SimpleNamespace

import mcap.writer
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.recordings.columns.store import ChannelLayout, ColumnStoreWriter
from imuscope.recordings.errors import RecordingError
from imuscope.recordings.file_names import clean_name
from imuscope.recordings.library import quota
from imuscope.recordings.library.index import summarize, thumbnail
from imuscope.recordings.library.library import INDEX, KEPT_S, STALE_S, Library
from imuscope.recordings.library.probe import is_pinned as pinned_in_file
from imuscope.recordings.library.quota import BIN, cull, excess_bytes, is_pinned, is_short
from imuscope.recordings.mcap.compaction import compact
from imuscope.recordings.mcap.writer import McapWriter
from imuscope.recordings.readers.file_suffixes import suffixes
from imuscope.recordings.sidecar import Edits, MarkerInfo, sidecar_path
from tests.recordings.store_fixtures import ACCELERATION, ANGLES, NS, START, recording, store
from tests.support.each_row import each_row
from tests.support.manual_clock import ManualClock
from tests.support.read_library import ReadLibrary


def ids(library: Library, search: str = "") -> list[str]:
    return [entry.id for entry in library.all(search) if entry.deleted is None]


def test_the_folder_is_listed_newest_first(tmp_path: Path) -> None:
    recording(tmp_path / "old.mcap")
    compact(recording(tmp_path / "new.mcap", start=NS + 10**12))
    (tmp_path / "sub").mkdir()
    recording(tmp_path / "sub" / "hidden.mcap")
    recording(tmp_path / ".hidden.mcap")
    (tmp_path / "README.txt").write_text("notes")
    library = ReadLibrary(tmp_path)
    assert ids(library) == ["new", "old"]
    for entry in library.all():
        assert entry.title == "Yard loop"
        assert entry.probe.duration == pytest.approx(0.9)
        assert entry.probe.devices[0].serial_number == "0080A1B2"
        assert entry.probe.devices[0].messages is None  # message counts were given for chunks
        assert entry.markers == 1
        assert not entry.probe.damaged
    (tmp_path / "old.mcap").unlink()
    assert ids(library) == ["new"]
    assert ids(ReadLibrary(tmp_path / "none")) == []


def test_an_unchanged_file_is_not_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = recording(tmp_path / "a.mcap")
    library = ReadLibrary(tmp_path)
    library.all()
    from tests.support import read_library as module

    visited: list[Path] = []
    monkeypatch.setattr(module, "probe", lambda path: visited.append(path))
    library.all()
    assert visited == []
    os.utime(path, (1, 1))
    library.all()
    assert visited == [path]


def test_torn_and_damaged_files_are_listed_with_a_sentence(tmp_path: Path) -> None:
    whole = recording(tmp_path / "whole.mcap").read_bytes()
    (tmp_path / "torn.mcap").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "stub.mcap").write_bytes(whole[:9])
    (tmp_path / "noise.mtb").write_bytes(b"")
    (tmp_path / "noise.bin").write_bytes(b"\x55" * 5000)
    results = {entry.id: entry.probe.damaged for entry in ReadLibrary(tmp_path).all()}
    assert not results.pop("whole")
    assert results.keys() == {"torn", "stub", "noise", "noise.bin"}
    assert all(words.endswith(".") for words in results.values())


def test_user_changes_are_stored_beside_the_file(tmp_path: Path) -> None:
    path = recording(tmp_path / "a.mcap")
    before = path.read_bytes()
    ReadLibrary(tmp_path).edit("a", Edits(title="New mast", tags=("yard", "höhe"), pinned=True))
    ReadLibrary(tmp_path).edit("a", Edits(notes="3 laps"))
    marker = ReadLibrary(tmp_path).mark("a", MarkerInfo(START + 0.5, text="later"))
    entry = ReadLibrary(tmp_path).get("a")
    assert (entry.title, entry.edits.tags, entry.edits.notes) == ("New mast", ("yard", "höhe"), "3 laps")
    assert entry.edits.pinned
    assert is_pinned(path, pinned_in_file)
    assert entry.edits.markers == (marker,)
    assert entry.markers == 2
    assert path.read_bytes() == before
    for word in ("mast", "HÖHE", "laps", "mti-630", "0080A1B2", "later", "new mast yard"):
        assert ids(ReadLibrary(tmp_path), word) == ["a"], word
    assert ids(ReadLibrary(tmp_path), "new drone") == []


def test_the_files_own_metadata_counts_without_a_sidecar(tmp_path: Path) -> None:
    path = recording(tmp_path / "a.mcap")
    edits = Edits(
        title="From elsewhere", tags=("x",), pinned=True, markers=(MarkerInfo(START, text="there", id=1_000_001),)
    )
    compact(path, edit=edits.as_metadata())
    library = ReadLibrary(tmp_path)
    assert library.get("a").edits == edits
    library.edit("a", Edits(pinned=False))
    assert library.get("a").edits == Edits("From elsewhere", ("x",), None, False, edits.markers)
    assert library.mark("a", MarkerInfo(START, text="more")).id == 1_000_002


def test_a_damaged_sidecar_is_reported_and_keeps_the_recording_pinned(tmp_path: Path) -> None:
    path = recording(tmp_path / "a.mcap")
    library = ReadLibrary(tmp_path)
    library.edit("a", Edits(title="Precious", pinned=True))
    sidecar_path(path).write_text(sidecar_path(path).read_text()[:-9])
    assert "a.mcap.json is damaged" in library.get("a").probe.damaged
    assert is_pinned(path, pinned_in_file)


@each_row("text", ["[" * 100_000, "null", '{"size": 1}', "{}", "[]", '"old"', "7"])
def test_a_damaged_or_older_index_is_rebuilt(tmp_path: Path, text: str) -> None:
    path = recording(tmp_path / "a.mcap")
    stat = path.stat()
    stamp = {"size": stat.st_size, "modified_ns": stat.st_mtime_ns}
    older = {**stamp, "thumbnail": [[1.0]], "losses": None}
    whole = {**stamp, "started": "x", "duration": None, "damaged": ""}
    wrong = {**whole, "devices": 7, "markers": [], "thumbnail": [], "losses": []}
    (tmp_path / INDEX).mkdir()
    for one in (text, *map(json.dumps, (stamp, older, wrong))):
        (tmp_path / INDEX / "a.mcap.json").write_text(one)
        (entry,) = ReadLibrary(tmp_path).all()
        assert not entry.indexed
        assert entry.probe.damaged == ""


def test_an_unexpected_folder_in_the_bin_hides_no_recording(tmp_path: Path) -> None:
    recording(tmp_path / "a.mcap")
    (tmp_path / BIN / "²").mkdir(parents=True)
    assert ids(ReadLibrary(tmp_path)) == ["a"]
    assert cull(tmp_path, 1 << 30, pinned_in_file) == []


@each_row("text", ["", "{", "[]", '{"imuscope": 1, "tags": 7, "title": ["x"], "markers": [1, {}]}'])
def test_a_broken_file_beside_a_recording_changes_nothing(tmp_path: Path, text: str) -> None:
    sidecar_path(recording(tmp_path / "a.mcap")).write_text(text)
    library = ReadLibrary(tmp_path)
    assert library.get("a").title == "Yard loop"
    assert library.edit("a", Edits(title="Again")).title == "Again"


def test_a_deleted_recording_is_restored_with_all_its_files(tmp_path: Path) -> None:
    time = [START]
    recording(tmp_path / "a.mcap")
    library = ReadLibrary(tmp_path, lambda: time[0])
    library.edit("a", Edits(title="Mine"))
    gone = library.delete("a")
    assert gone.deleted == START
    assert ids(library) == []
    assert [(entry.id, entry.title, entry.deleted) for entry in library.all()] == [("a", "Mine", START)]
    assert not list(tmp_path.glob("a*"))
    with pytest.raises(KeyError):
        library.get("a")
    assert library.undelete("a").title == "Mine"
    assert ids(library) == ["a"]
    library.delete("a")
    recording(tmp_path / "a.mcap", title="Another")
    (live, dead) = library.all()
    assert (live.id, live.title, dead.title) == ("a", "Another", "Mine")
    with pytest.raises(RecordingError, match="already"):
        library.undelete(dead.id)
    time[0] += KEPT_S + 1000
    assert [entry.title for entry in library.all()] == ["Another"]
    assert not list((tmp_path / ".bin").iterdir())


def test_a_recording_that_was_deleted_before_the_clock_was_set_can_be_restored(tmp_path: Path) -> None:
    """A robot without a clock of its own had emptied the bin as soon as it found the time."""
    now, steady = ManualClock(START), ManualClock(0.0)
    recording(tmp_path / "a.mcap")
    library = ReadLibrary(tmp_path, now, steady=steady)
    library.delete("a")
    now.now += 3650 * 86_400.0
    steady.now += 3600.0
    assert [entry.id for entry in library.all()] == ["a"]
    steady.now += KEPT_S
    assert not library.all()


def test_the_bin_is_emptied_after_the_clock_was_set_back(tmp_path: Path) -> None:
    """Nothing was removed until the clock had reached the time of the last look at the bin again."""
    now, steady = ManualClock(START + 3650 * 86_400.0), ManualClock(0.0)
    recording(tmp_path / "a.mcap")
    library = ReadLibrary(tmp_path, now, steady=steady)
    library.all()
    now.now = START
    library.delete("a")
    now.now += KEPT_S + 1000
    steady.now += KEPT_S + 1000
    assert not library.all()


def test_the_index_goes_with_its_recording_and_not_before(tmp_path: Path) -> None:
    """There was one more file for each recording that a robot had ever made, whatever its quota."""
    now = ManualClock(START)
    for name in "abc":
        recording(tmp_path / f"{name}.mcap")
    library = ReadLibrary(tmp_path, now)
    indexes = [tmp_path / INDEX / f"{name}.mcap.json" for name in "abc"]
    (tmp_path / INDEX).mkdir()
    for index in indexes:
        index.write_text("{}")
    library.delete("a")
    (tmp_path / "b.mcap").unlink()  # by a user, in a file manager
    library.all()
    assert [index.exists() for index in indexes] == [True, False, True]
    assert cull(tmp_path, 0, pinned_in_file) == [
        tmp_path / ".bin" / str(round(START * 1000)) / "a.mcap",
        tmp_path / "c.mcap",
    ]
    assert not list((tmp_path / INDEX).iterdir())


def test_nothing_is_remembered_of_a_recording_that_has_left_the_bin(tmp_path: Path) -> None:
    now = ManualClock(START)
    library = ReadLibrary(tmp_path, now)
    for number in range(5):
        recording(tmp_path / f"{number}.mcap")
        library.all()
        library.delete(str(number))
        library.all()
    now.now += KEPT_S + 1000
    assert not library.all()
    assert not library._probes
    assert not library._paths
    assert not library._deleted_at


def test_a_split_log_is_one_and_goes_as_one(tmp_path: Path) -> None:
    for part in (1, 2):
        (tmp_path / f"LOG_SN60339_20261120_120000_000{part}.raw").write_bytes(bytes.fromhex("FAFF3E00C3") * 100)
    (tmp_path / "LOG_SN60339_20261120_120000_0001.idx").write_bytes(bytes(16))
    library = ReadLibrary(tmp_path)
    (entry,) = library.all()
    assert entry.size == 1000
    assert [file.name[-8:] for file in entry.files] == ["0001.raw", "0002.raw"]
    assert entry.probe.started == 1795176000.0
    library.delete(entry.id)
    assert [file.name for file in tmp_path.iterdir()] == [".bin"]
    library.undelete(entry.id)
    assert len(library.get(entry.id).files) == 2
    assert (tmp_path / "LOG_SN60339_20261120_120000_0001.idx").exists()


def test_files_of_one_name_have_ids_of_their_own(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(bytes.fromhex("FAFF3E00C3") * 100)
    (tmp_path / "a.mtb").write_bytes(bytes.fromhex("FAFF3E00C3") * 100)
    library = ReadLibrary(tmp_path)
    assert sorted(ids(library)) == ["a", "a.bin"]
    recording(tmp_path / "a.mcap")
    assert library.path("a").name == "a.mcap"
    assert sorted(ids(library)) == ["a", "a.bin", "a.mtb"]


def test_an_opened_recording_shows_its_motion_and_losses(tmp_path: Path) -> None:
    recording(tmp_path / "a.mcap")
    library = ReadLibrary(tmp_path)
    assert not library.get("a").indexed
    library.index("a", summarize(store(tmp_path / "store", devices=1)))
    entry = library.get("a")
    assert entry.indexed
    assert (entry.motion, len(entry.thumbnail)) == ("|a|", 64)
    assert all(0 <= low <= high <= 1 for low, high in entry.thumbnail)
    assert entry.marks == [pytest.approx(0.2, abs=0.002)]
    assert entry.losses == [pytest.approx(0.1, abs=0.002)]
    assert entry.probe.devices[0].product == "MTi-630"
    assert ids(library, "kerb") == ["a"]
    recording(tmp_path / "b.mcap").replace(tmp_path / "a.mcap")
    os.utime(tmp_path / "a.mcap", (5, 5))
    assert not library.get("a").indexed  # another file by now


def test_what_stands_still_is_a_line_and_gaps_of_samples_are_empty(tmp_path: Path) -> None:
    """Regression: noise of a resting sensor filled its picture, as a drive does."""
    n = 1000
    time = START + np.arange(n) / 100 + 5.0 * (np.arange(n) >= n // 2)
    still = np.stack((np.zeros(n), np.zeros(n), 9.81 + 0.02 * (-1.0) ** np.arange(n)))
    tilt = np.stack((np.linspace(-30, 30, n), np.zeros(n), np.linspace(0, 300, n)))
    for values, info, motion in ((still, ACCELERATION, "|a|"), (tilt, ANGLES, "attitude")):
        writer = ColumnStoreWriter(tmp_path / motion)
        writer.channel(1, ChannelLayout(("f8",) * 3, (False,) * 3))
        writer.append(1, [time, time, *values])
        columns = writer.finish({"channels": [{**info, "id": 1}], "started": time[0], "ended": time[-1]})
        named, pairs = thumbnail(columns)
        assert (named, len(pairs)) == (motion, 64)
        assert pairs[32] == []  # within the five seconds without samples
        drawn = [pair for pair in pairs if pair]
        assert len(drawn) < 50
        extent = max(high for _, high in drawn) - min(low for low, _ in drawn)
        assert extent == pytest.approx(0.04 / (0.1 * 9.83) if motion == "|a|" else 1.0, abs=0.01)


def test_an_unchanged_recording_is_listed_without_reading_anything(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in "abc":
        recording(tmp_path / f"{name}.mcap")
    library = ReadLibrary(tmp_path)
    library.index("a", summarize(store(tmp_path / "store", devices=1)))
    library.all()
    reads = list[Path]()
    for module in ("sidecar", "library.index"):
        monkeypatch.setattr(f"imuscope.recordings.{module}.read_regular", lambda path: reads.append(path) or b"")
    (first, *_) = library.all()
    assert (first.indexed, reads) == (True, [])
    monkeypatch.undo()
    library.edit("b", Edits(notes="Three laps."))
    assert [entry.edits.notes for entry in library.all() if entry.id == "b"] == ["Three laps."]


def test_findings_of_another_decoder_are_listed_until_it_is_opened_again(tmp_path: Path) -> None:
    recording(tmp_path / "a.mcap")
    columns = store(tmp_path / "store", devices=1)
    ReadLibrary(tmp_path).index("a", summarize(columns))
    assert ReadLibrary(tmp_path).get("a").is_current
    later = ReadLibrary(tmp_path, decoder=lambda: "2")
    entry = later.get("a")
    assert (entry.indexed, entry.is_current, len(entry.thumbnail)) == (True, False, 64)
    later.index("a", summarize(columns))
    assert later.get("a").is_current


def test_an_unnamed_device_is_named_after_the_renamed_file(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(bytes.fromhex("FAFF3E00C3") * 100)
    library = ReadLibrary(tmp_path)
    columns = store(tmp_path / "store", devices=1)
    columns.manifest["devices"][0]["name"] = "a.bin"
    library.index("a", summarize(columns))
    assert [device.name for device in library.get("a").probe.devices] == ["a.bin"]
    entry = library.rename("a", "battery pulled")
    assert entry.indexed
    assert [device.name for device in entry.probe.devices] == ["battery pulled.bin"]


def test_an_upload_appears_when_it_is_whole_and_is_a_recording(tmp_path: Path) -> None:
    library = ReadLibrary(tmp_path / "library")
    content = recording(tmp_path / "x.mcap").read_bytes()
    for number in (1, 2):
        path = library.incoming("../../etc/a.mcap")
        path.write_bytes(content)
        assert ids(library) == ["a"][: number - 1]
        assert library.upload(path).id == ["a", "a-2"][number - 1]
    path = library.incoming("b.mcap")
    path.write_bytes(b"hello\n" * 100)
    with pytest.raises(RecordingError):
        library.upload(path)
    assert sorted(ids(library)) == ["a", "a-2"]
    assert list((library.folder / ".incoming").iterdir()) == []


def test_an_upload_that_takes_hours_is_not_taken_for_an_abandoned_one(tmp_path: Path) -> None:
    now = 2e9
    path = ReadLibrary(tmp_path).incoming("a.mcap")
    path.write_bytes(b"the first part")
    os.utime(path.parent, (now - 2 * STALE_S,) * 2)  # a folder does not change with its files
    for age, is_kept in ((1.0, True), (1.5 * STALE_S, False)):
        os.utime(path, (now - age,) * 2)
        ReadLibrary(tmp_path, now=lambda: now).all()
        assert path.exists() == is_kept


@given(st.text(max_size=300))
def test_no_name_becomes_a_path(name: str) -> None:
    clean = clean_name(name, suffixes())
    assert clean not in ("", ".", "..")
    assert not clean.startswith(".")
    assert "/" not in clean
    assert "\\" not in clean
    assert clean.isprintable()
    assert len(clean.encode()) <= 130
    assert os.path.splitext(clean)[1].lower() in suffixes()
    assert clean_name(clean, suffixes()) == clean


@each_row("name", ["..", "../a", "a/../../a", "/etc/passwd", ".bin", "", "a\x00", "\ud800"])
def test_an_external_id_is_not_a_path(name: str, tmp_path: Path) -> None:
    recording(tmp_path / "a.mcap")
    library = ReadLibrary(tmp_path / "inside")
    library.folder.mkdir()
    with pytest.raises(KeyError):
        library.path(name)
    with pytest.raises(KeyError):
        library.undelete(name)


def test_on_a_short_disk_the_quota_deletes_no_more_than_is_needed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = [tmp_path / f"{name}.mcap" for name in "abc"]
    for age, path in enumerate(paths):
        writer = McapWriter(path, {})
        writer.chunk("1", "rx", os.urandom(100_000), 1)
        writer.close()
        os.utime(path, (1000 + age, 1000 + age))
    assert excess_bytes(tmp_path, 200_000) > 100_000
    free = iter((10**12, 10**9, 10**9, 3 * 10**9))
    monkeypatch.setattr(
        quota.shutil, "disk_usage", lambda folder: SimpleNamespace(free=next(free), total=10**12), raising=True
    )
    assert cull(tmp_path, 0, pinned_in_file, only_if_short=True) == []
    assert cull(tmp_path, 0, pinned_in_file, only_if_short=True) == paths[:2]
    assert paths[2].exists()


@each_row(
    ("free", "total", "short"),
    [(2e9, 1e12, False), (1.9e9, 1e12, True), (5e8, 8e9, False), (3e8, 8e9, True)],
)
def test_a_disk_is_short_below_its_reserve(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free: float, total: float, short: bool
) -> None:
    monkeypatch.setattr(quota.shutil, "disk_usage", lambda folder: SimpleNamespace(free=int(free), total=int(total)))
    assert is_short(tmp_path) is short


def test_the_quota_deletes_the_bin_first_and_no_file_of_others(tmp_path: Path) -> None:
    """A folder with captures of the user does not count as recordings and is never thinned out."""
    library = ReadLibrary(tmp_path)

    def record(name: str, age: int, pinned: bool = False) -> None:
        path = tmp_path / f"{name}.mcap"
        writer = McapWriter(path, {})
        writer.chunk("1", "rx", os.urandom(100_000), 1)
        writer.close()
        os.utime(path, (1000 + age, 1000 + age))
        if pinned:
            library.edit(name, Edits(pinned=True))

    for n, name in enumerate(("kept", "thrown", "oldest", "newest")):
        record(name, n, pinned=name == "kept")
    library.delete("thrown")
    (tmp_path / "drive.bin").write_bytes(bytes(500_000))
    with (tmp_path / "theirs.mcap").open("wb") as file:
        theirs = mcap.writer.Writer(file)
        theirs.start("ros2", "another")
        theirs.add_attachment(1, 1, "a", "application/octet-stream", bytes(500_000))
        theirs.finish()
    assert cull(tmp_path, 450_000, pinned_in_file) == []  # other files in the folder are not counted
    assert [path.stem for path in cull(tmp_path, 350_000, pinned_in_file)] == ["thrown"]
    assert [path.stem for path in cull(tmp_path, 250_000, pinned_in_file)] == ["oldest"]
    assert [path.stem for path in cull(tmp_path, 0, pinned_in_file, spare=[tmp_path / "newest.mcap"])] == []
    assert [path.stem for path in cull(tmp_path, 0, pinned_in_file)] == ["newest"]
    left = {path.name for path in tmp_path.iterdir() if not path.name.startswith(".")}
    assert left == {"kept.mcap", "kept.mcap.json", "drive.bin", "theirs.mcap"}
