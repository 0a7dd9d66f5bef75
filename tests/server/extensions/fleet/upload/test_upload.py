"""`imuscope upload`: every file that `decode` reads, exactly once, whatever happens."""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
from pathlib import Path

import pytest

from imuscope.recordings import sidecar
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.mcap.compaction import compact
from imuscope.recordings.mcap.writer import McapWriter
from imuscope.recordings.readers.message_source import MessageSource
from imuscope.server.extensions.fleet.store.store import StoreError, location, store_error
from imuscope.server.extensions.fleet.store.tables import TABLES
from imuscope.server.extensions.fleet.upload import upload as uploading
from tests.recordings.recorded_drive import START, drive
from tests.server.extensions.fleet import halting_upload, without_package
from tests.server.extensions.fleet.store_fixtures import Commands, delta
from tests.support.each_row import each_row
from tests.support.server_process import begun, imuscope
from tests.support.timeouts import PATIENCE_S

COUNTS = {"recordings": 1, "devices": 1, "events": 5, "losses": 1, "minutes": 22, "samples": 345}


def counts(store: Path) -> dict[str, int]:
    """Rows of each table, as another program reads them."""
    return {name: delta(store, name).num_rows for name in COUNTS}


def test_a_recording_is_stored_as_it_is(commands: Commands, recording: Path, store: Path) -> None:
    printed = commands.upload(recording, store)
    (row,) = commands.query(store, "SELECT * FROM recordings")
    data = recording.read_bytes()
    assert (store / row["object"]).read_bytes() == data
    assert str(store / row["object"]) in printed
    assert row["object"] == f"robots/otter/2025-10-09/{row['recording']}.mcap"
    assert (row["bytes"], row["checksum"]) == (len(data), hashlib.sha256(data).hexdigest())
    assert (row["robot"], row["title"], row["name"], row["format"]) == ("otter", "A drive", "drive.mcap", "mcap")
    assert row["started"] == "2025-10-09T08:53:20Z"
    assert row["duration_s"] == pytest.approx(3.99, abs=0.05)
    assert (row["devices"], row["lost"], row["markers"], row["damaged"]) == (1, 5, 1, "")
    assert counts(store) == COUNTS


def test_the_first_upload_makes_all_tables_also_those_without_rows(
    commands: Commands, recording: Path, store: Path
) -> None:
    """Other engines failed on `settings` where `imuscope query` answered."""
    commands.uploaded(recording, store)
    assert {name: delta(store, name).num_rows for name in TABLES} == {**COUNTS, "settings": 0}
    assert delta(store, "settings").schema.names == TABLES["settings"].schema.names


def test_again_is_the_same_as_once(commands: Commands, recording: Path, store: Path) -> None:
    commands.uploaded(recording, store)
    before = {path: path.read_bytes() for path in store.rglob("*") if path.is_file()}
    assert "was uploaded before" in commands.upload(recording, f"file://{store}")
    assert {path: path.read_bytes() for path in store.rglob("*") if path.is_file()} == before


def test_a_recording_that_was_renamed_compacted_and_titled_is_the_same(
    commands: Commands, recording: Path, store: Path, tmp_path: Path
) -> None:
    commands.uploaded(recording, store)
    other = tmp_path / "other.mcap"
    shutil.copyfile(recording, other)
    compact(other, edit={"title": "Another title"})
    assert other.read_bytes() != recording.read_bytes()
    assert "was uploaded before" in commands.upload(other, store)
    assert counts(store) == COUNTS


def test_other_content_and_another_robot_are_other_recordings(
    commands: Commands, recording: Path, store: Path, tmp_path: Path
) -> None:
    drive(tmp_path / "second.mcap", seconds=2.0)
    commands.uploaded(recording, store, "a")
    commands.upload(recording, store, "b c")
    commands.upload(tmp_path / "second.mcap", store, "a")
    result = commands.query(
        store, "SELECT robot, count(*) AS n, count(DISTINCT recording) AS d FROM recordings GROUP BY 1"
    )
    assert sorted(map(str, result)) == sorted(
        map(str, [{"robot": "a", "n": 2, "d": 2}, {"robot": "b c", "n": 1, "d": 1}])
    )


def test_a_capture_is_imported_into_a_recording(commands: Commands, store: Path, tmp_path: Path) -> None:
    path = drive(tmp_path / "a.mcap")
    capture = tmp_path / "capture.bin"
    capture.write_bytes(path)
    commands.upload(capture, store)
    os.utime(capture, (1_700_000_000, 1_700_000_000))  # its times come from here; its content is the same
    assert "was uploaded before" in commands.upload(capture, store)
    (row,) = commands.query(store, "SELECT object, format, messages FROM recordings")
    made = open_file(store / row["object"])
    assert (row["format"], made.format) == ("bin", "mcap")
    assert b"".join(part.data for part in made.parts()) == path
    assert row["messages"] > 300


def test_a_table_is_imported_into_a_recording(commands: Commands, store: Path, tmp_path: Path) -> None:
    table = tmp_path / "numbers.csv"
    table.write_text("time,ax,ay\n" + "".join(f"{1_760_000_000 + n / 100},{n},{-n}\n" for n in range(200)))
    commands.upload(table, store)
    (row,) = commands.query(store, "SELECT object, format, duration_s FROM recordings")
    assert row["format"] == "csv"
    assert row["duration_s"] == pytest.approx(1.99)
    assert isinstance(open_file(store / row["object"]), MessageSource)


def test_tags_and_markers_of_the_page_come_along(commands: Commands, recording: Path, store: Path) -> None:
    later = sidecar.MarkerInfo(START / 1e9 + 1, "note", "curb")
    sidecar.write(recording, sidecar.Edits(title="Yard", tags=("wet", "night"), notes="Slow.", markers=(later,)))
    commands.upload(recording, store)
    (row,) = commands.query(store, "SELECT title, tags, notes, markers FROM recordings")
    assert row == {"title": "Yard", "tags": "wet, night", "notes": "Slow.", "markers": 2}
    result = commands.query(store, "SELECT kind, text FROM events WHERE kind IN ('marker', 'note') ORDER BY time")
    assert result == [{"kind": "note", "text": "curb"}, {"kind": "marker", "text": "bump"}]


def test_settings_have_a_row_for_each_field(commands: Commands, store: Path, tmp_path: Path) -> None:
    writer = McapWriter(tmp_path / "a.mcap", {})
    writer.device(
        "1", {"protocol": "xbus", "source": "/dev/serial/by-id/usb-FTDI_A10K-if00?baud=9600", "link": "serial"}
    )
    values = {"OutputConfiguration": {"outputs": [{"id": 4, "rate": 100}]}, "Baudrate": {"baud": 115200, "on": True}}
    writer.snapshot("1", {"values": values, "missing": {}}, START)
    writer.chunk("1", "rx", bytes.fromhex("faff3000d1"), START)
    writer.close()
    commands.upload(tmp_path / "a.mcap", store)
    rows = commands.query(store, "SELECT setting, field, value, number FROM settings ORDER BY ALL")
    assert rows == [
        {"setting": "Baudrate", "field": "baud", "value": "115200", "number": 115200.0},
        {"setting": "Baudrate", "field": "on", "value": "true", "number": None},
        {"setting": "OutputConfiguration", "field": "outputs[0].id", "value": "4", "number": 4.0},
        {"setting": "OutputConfiguration", "field": "outputs[0].rate", "value": "100", "number": 100.0},
    ]
    assert commands.query(store, "SELECT adapter, baud FROM devices") == [
        {"adapter": "usb-FTDI_A10K-if00", "baud": None}
    ]


class Cut(BaseException):
    """A process that ends here."""


@each_row("after", range(7))
def test_an_upload_that_was_cut_off_is_finished_by_the_next(
    after: int, commands: Commands, recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cut after the object, and after each of the commits; meanwhile, no view shows a part of it."""
    store = tmp_path / "store"
    steps, append = iter(range(100)), uploading.append_once

    def cut(*case: object) -> bool:
        if next(steps) == after:
            raise Cut
        return append(*case)  # type: ignore[arg-type]

    monkeypatch.setattr(uploading, "append_once", cut)
    try:
        commands.run("upload", recording, "--store", store, "--robot", "otter")
        assert after == 6  # samples, minutes, devices, events, losses, recordings; there are no settings
    except Cut:
        rows = (f"SELECT '{name}' AS name FROM {name}" for name in TABLES)
        assert commands.query(store, " UNION ALL ".join(rows)) == []
    monkeypatch.undo()
    commands.upload(recording, store)
    assert counts(store) == COUNTS


@each_row("place", halting_upload.PLACES)
def test_a_killed_upload_leaves_nothing_lost_or_doubled(place: str, tmp_path: Path) -> None:
    recording, store = tmp_path / "drive.mcap", tmp_path / "store"
    drive(recording)
    words = ("upload", str(recording), "--store", str(store), "--robot", "otter")
    process = begun(place, *words, module=halting_upload.__name__)
    assert process.stdout is not None
    assert process.stdout.readline() == f"{halting_upload.HALTED}\n"
    process.kill()
    assert process.wait(PATIENCE_S) == -signal.SIGKILL
    process.stdout.close()
    assert delta(store, "recordings").num_rows == 0 if (store / "tables" / "recordings").exists() else True
    assert imuscope(*words).returncode == 0
    assert counts(store) == COUNTS
    objects = list((store / "robots").rglob("*.mcap"))
    assert [path.read_bytes() for path in objects] == [recording.read_bytes()]


def test_two_uploads_at_once_are_one(commands: Commands, recording: Path, store: Path, tmp_path: Path) -> None:
    drive(tmp_path / "second.mcap", seconds=3.0)
    files = (recording, recording, tmp_path / "second.mcap", tmp_path / "second.mcap")
    processes = [begun("upload", "--store", str(store), "--robot", "otter", str(file)) for file in files]
    texts = [process.communicate()[0] for process in processes]
    assert [process.returncode for process in processes] == [0, 0, 0, 0], texts
    assert counts(store) | {"samples": 0} == {name: 2 * n for name, n in COUNTS.items()} | {"samples": 0}
    rows = commands.query(store, "SELECT count(*) AS n, count(DISTINCT recording) AS d FROM recordings")
    assert rows == [{"n": 2, "d": 2}]


def test_a_lost_object_is_uploaded_again(commands: Commands, recording: Path, store: Path) -> None:
    commands.uploaded(recording, store)
    (row,) = commands.query(store, "SELECT object FROM recordings")
    for damage in (lambda path: path.unlink(), lambda path: path.write_bytes(b"x" * path.stat().st_size)):
        damage(store / row["object"])
        assert "was uploaded before" not in commands.upload(recording, store)
        assert (store / row["object"]).read_bytes() == recording.read_bytes()
    assert counts(store) == COUNTS


@each_row(
    ("store", "words"),
    [
        ("ftp://host/x", "ftp:// is not a kind of store"),
        ("s3://", "names no bucket"),
        ("s3://key:secret@bucket/x", "credentials"),
        ("file://host/x", "names no folder of this machine"),
        ("", "--store is empty"),
        ("/dev/null", "/dev/null is a file"),
        ("/dev/null/x", "/dev/null is a file"),
    ],
)
def test_an_invalid_store_is_one_line(store: str, words: str, commands: Commands, recording: Path) -> None:
    for command in (("upload", recording, "--robot", "a"), ("query", "SELECT 1")):
        message = commands.refused(*command, "--store", store)
        assert words in message
        assert "secret" not in message


@each_row("robot", ["", "..", "a/b", "a\nb", "x" * 101, "-x", "a:b"])
def test_an_invalid_name_of_a_robot_is_one_line(robot: str, commands: Commands, recording: Path, store: Path) -> None:
    assert "is not a valid name" in commands.refused("upload", recording, "--store", store, f"--robot={robot}")
    assert not store.exists()


def test_files_that_cannot_be_read_are_one_line(commands: Commands, store: Path, tmp_path: Path) -> None:
    (tmp_path / "noise.bin").write_bytes(b"\x55" * 5000)
    (tmp_path / "empty.mcap").write_bytes(b"")
    for name, words in (("none.mcap", "not found"), ("noise.bin", "not a format"), ("empty.mcap", "empty")):
        assert words in commands.refused("upload", tmp_path / name, "--store", store, "--robot", "a")
    assert not store.exists()


def test_a_recording_that_is_being_written_is_refused(commands: Commands, store: Path, tmp_path: Path) -> None:
    writer = McapWriter(tmp_path / "a.mcap", {})
    assert "is being recorded" in commands.refused("upload", tmp_path / "a.mcap", "--store", store, "--robot", "a")
    writer.close()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_missing_rights_are_one_line(commands: Commands, recording: Path, store: Path) -> None:
    store.mkdir(mode=0o500)
    assert "access is denied" in commands.refused("upload", recording, "--store", store, "--robot", "a")


@each_row(
    ("output", "words"),
    [
        ("Generic LocalFileSystem error: No space left on device (os error 28)", "the disk is full"),
        ("Server returned non-2xx status code: 507 Insufficient Storage: ", "the store is full"),
        ("<Error><Code>XMinioStorageFull</Code></Error>", "the store is full"),
        ("403 Forbidden: <Error><Code>QuotaExceeded</Code></Error>", "the quota of the store is used up"),
        ("Disk quota exceeded (os error 122)", "the quota of the disk is used up"),
        ("Unable to write: Permission denied (os error 13)", "access is denied"),
        ("Generic S3 error: Client error with status 403 Forbidden: AccessDenied", "access is denied"),
        ("Generic S3 error: <Code>InvalidAccessKeyId</Code>", "credentials are not accepted"),
        ("Generic S3 error: <Code>NoSuchBucket</Code>", "no such bucket"),
        ("error sending request for url (http://127.0.0.1:9/x): Connection refused", "does not answer"),
        ("Server error with status 503 Service Unavailable: SlowDown", "does not answer, or answers with errors"),
        ("Something else\n\nDebug source: Foo {}", "/x: Something else"),
    ],
)
def test_errors_of_the_libraries_become_one_sentence(output: str, words: str) -> None:
    made = store_error(OSError(output), location("/x"))
    assert isinstance(made, StoreError)
    assert words in made.message
    assert "\n" not in made.message


def test_a_server_that_does_not_answer_is_one_line(
    commands: Commands, recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("imuscope.server.extensions.fleet.store.store.RETRY_S", 1)
    monkeypatch.setattr("imuscope.server.extensions.fleet.store.store.MAX_RETRIES", 1)
    for name, value in (("ENDPOINT_URL", "http://127.0.0.1:9"), ("ACCESS_KEY_ID", "a"), ("SECRET_ACCESS_KEY", "b")):
        monkeypatch.setenv(f"AWS_{name}", value)
    monkeypatch.setenv("AWS_REGION", "us-east-1")
    for command in (("upload", recording, "--robot", "a"), ("query", "SELECT * FROM recordings")):
        assert "does not answer" in commands.refused(*command, "--store", "s3://bucket/prefix")


@each_row(("package", "command"), [("deltalake", "upload"), ("obstore", "upload"), ("duckdb", "query")])
def test_without_the_packages_the_commands_state_what_to_install(
    package: str, command: str, recording: Path, store: Path
) -> None:
    source = ("upload", str(recording), "--robot", "a") if command == "upload" else ("query", "SELECT 1")
    process = begun(package, *source, "--store", str(store), module=without_package.__name__, apart=True)
    assert process.communicate() == (
        "",
        "imuscope: a store needs further packages; install them with: pip install 'imuscope[fleet]'.\n",
    )
    assert process.returncode == 1
