"""Rules for deleting what was uploaded: only what the store has, whole, and nobody keeps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from imuscope.recordings import sidecar
from imuscope.recordings.library.entry import LibraryEntry
from imuscope.recordings.library.recording_probe import RecordingProbe
from imuscope.recordings.sidecar import Edits
from imuscope.server.extensions.fleet.model.settings import StoreSettings
from imuscope.server.extensions.fleet.upload.upload_log import UploadLog, UploadOutcome
from imuscope.server.extensions.fleet.upload.uploads import DAY_S, edits_of, next_to_go
from imuscope.server.settings.config import ConfigError, load
from tests.support.each_row import each_row

NOW = 1_760_000_000.0
RULES = StoreSettings("/srv", upload=True, keep_days=30, keep_tags=("keep",))
STORED = UploadOutcome(1_000_000, 5.0, "stored", NOW - 31 * DAY_S, "id", "key", "sum")


def entry(folder: Path, name: str = "a", edits: Edits = Edits(), kind: str = "mcap") -> LibraryEntry:  # noqa: B008
    return LibraryEntry(
        name, [folder / f"{name}.mcap"], 1_000_000, 5.0, RecordingProbe(kind, started=100.0), edits, [], [], []
    )


def goes(one: LibraryEntry, outcome: UploadOutcome | None = STORED, rules: StoreSettings = RULES, **more: Any) -> bool:
    return next_to_go([one], lambda _: outcome, rules, NOW, **more) is one


def test_what_was_stored_long_ago_goes(tmp_path: Path) -> None:
    assert goes(entry(tmp_path))
    assert not goes(entry(tmp_path), replace(STORED, time=NOW - 29 * DAY_S))
    assert not goes(entry(tmp_path), rules=replace(RULES, keep_days=0))


def test_what_was_not_stored_stays(tmp_path: Path) -> None:
    assert not goes(entry(tmp_path), None)
    assert not goes(entry(tmp_path), replace(STORED, state="refused"))


def test_what_a_user_keeps_stays(tmp_path: Path) -> None:
    assert not goes(entry(tmp_path, edits=Edits(tags=("Keep",))))
    assert not goes(entry(tmp_path, edits=Edits(pinned=True)))
    assert not goes(entry(tmp_path, kind="csv"))
    assert not goes(entry(tmp_path), played=[f"{tmp_path}/a.mcap?loop=1"])
    assert goes(entry(tmp_path), played=[f"{tmp_path}/ab.mcap"])


def test_words_that_the_store_does_not_have_keep_a_recording(tmp_path: Path) -> None:
    one = entry(tmp_path)
    sidecar.write(one.path, Edits(notes="Slow."))
    assert not goes(one)
    assert goes(one, replace(STORED, edits=edits_of(one)))


def test_the_oldest_go_until_the_library_is_small_enough(tmp_path: Path) -> None:
    rules = replace(RULES, keep_days=0, keep_gb=0.0015)
    entries = [entry(tmp_path, name) for name in ("new", "old")]
    entries[0].probe.started = 200.0
    assert next_to_go(entries, lambda _: STORED, rules, NOW) is entries[1]
    assert next_to_go(entries[:1], lambda _: STORED, rules, NOW) is None


def test_an_outcome_is_of_a_file_as_it_was_in_this_store(tmp_path: Path) -> None:
    one = entry(tmp_path)
    log = UploadLog(tmp_path, "/srv", "otter")
    log.add(one, STORED)
    log.save()
    for store, robot, known in (("/srv", "otter", STORED), ("/other", "otter", None), ("/srv", "fox", None)):
        again = UploadLog(tmp_path, store, robot)
        again.load()
        assert again.of(one) == known
        assert again.of(replace(one, size=2)) is None
    (tmp_path / "uploads.json").write_text("[{")
    again.load()
    assert again.of(one) is None


@each_row("rule", ["keep_days = 3.0", "keep_gb = 3.0"])
def test_deletion_needs_uploads(rule: str, tmp_path: Path) -> None:
    file = tmp_path / "imuscope.toml"
    file.write_text(f"[store]\nurl = '/srv'\n{rule}\n")
    with pytest.raises(ConfigError, match=r"need store\.upload"):
        load(file)
