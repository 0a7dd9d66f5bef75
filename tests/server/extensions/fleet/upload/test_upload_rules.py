"""Rules for uploads: which recordings go to the store, and when."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from imuscope.recordings.library.entry import LibraryEntry
from imuscope.recordings.library.recording_probe import RecordingProbe
from imuscope.recordings.sidecar import Edits
from imuscope.server.extensions.fleet.model.settings import FleetTables, StoreSettings
from imuscope.server.extensions.fleet.upload.uploads import pause_until, refusal
from imuscope.server.settings.config import ConfigError, load
from tests.support.each_row import each_row


def entry(*tags: str, title: str = "Yard", markers: tuple[str, ...] = (), size: int = 2_000_000) -> LibraryEntry:
    """A recording of 20 s."""
    probe = RecordingProbe("mcap", title, duration=20.0)
    return LibraryEntry("a", [Path("a.mcap")], size, 0.0, probe, Edits(tags=tags), [], [], list(markers))


@each_row(
    ("rules", "case", "reason"),
    [
        ({}, entry(), ""),
        ({"skip_tags": ("private",)}, entry("wet", "Private"), "It has the tag private."),
        ({"skip_tags": ("private",)}, entry("wet"), ""),
        ({"upload_tags": ("a", "b")}, entry("wet"), "It has none of the tags a, b."),
        ({"upload_tags": ("a", "b")}, entry("B"), ""),
        ({"upload_tags": ("a",), "skip_tags": ("b",)}, entry("a", "b"), "It has the tag b."),
        ({"upload_min_s": 20.5}, entry(), "It is shorter than 20.5 s."),
        ({"upload_min_s": 20.0}, entry(), ""),
        ({"upload_max_mb": 1.5}, entry(), "It is larger than 1.5 MB."),
        ({"upload_max_mb": 2.0}, entry(), ""),
        ({"upload_alarms_only": True}, entry(markers=("bump",)), "No alarm has begun or marked it."),
        ({"upload_alarms_only": True}, entry(markers=("bump", "Alarm “Hot”")), ""),
        ({"upload_alarms_only": True}, entry(title="Alarm Hot"), ""),
    ],
)
def test_a_rule_refuses_with_its_reason(rules: dict[str, Any], case: LibraryEntry, reason: str) -> None:
    assert refusal(case, StoreSettings(**rules)) == reason


def test_a_duration_that_is_unknown_does_not_refuse() -> None:
    one = entry()
    one.probe.duration = None
    assert refusal(one, StoreSettings(upload_min_s=60)) == ""


@each_row(
    ("hours", "time", "until"),
    [
        ("", "12:00", ""),
        ("22:00-06:00", "21:59", "22:00"),
        ("22:00-06:00", "22:00", ""),
        ("22:00-06:00", "00:00", ""),
        ("22:00-06:00", "06:00", "22:00"),
        ("08:30-09:00", "08:29", "08:30"),
        ("08:30 - 09:00", "08:59", ""),
        ("08:30-09:00", "09:00", "08:30"),
    ],
)
def test_uploads_begin_in_their_hours(hours: str, time: str, until: str) -> None:
    now = datetime.fromisoformat(f"2026-03-01 {time}")
    assert pause_until(StoreSettings(upload_hours=hours), now) == until


@each_row(
    ("text", "words"),
    [
        ("upload = true", "store.upload needs store.url"),
        ('url = "/srv"\nupload = "yes"', "store.upload must be true or false"),
        ('upload_hours = "22-6"', "store.upload_hours '22-6' is not a span of time such as 22:00-06:00"),
        ('upload_hours = "22:00-22:00"', "is not a span of time"),
        ("upload_min_s = -1.0", "store.upload_min_s -1 is outside"),
        ("upload_max_mb = -1.0", "store.upload_max_mb -1 is neither"),
        ("upload_kb_s = 5.0", "store.upload_kb_s 5 is neither 0"),
        ('skip_tags = "private"', "store.skip_tags must be a list of strings"),
    ],
)
def test_what_is_not_a_rule(text: str, words: str, tmp_path: Path) -> None:
    file = tmp_path / "imuscope.toml"
    file.write_text(f"[store]\n{text}\n")
    with pytest.raises(ConfigError, match=words):
        load(file)


def test_rules_of_a_file(tmp_path: Path) -> None:
    file = tmp_path / "imuscope.toml"
    file.write_text('[store]\nurl = "/srv"\nupload = true\nskip_tags = ["a"]\nupload_min_s = 10\n')
    assert load(file).of(FleetTables).store == StoreSettings("/srv", upload=True, skip_tags=("a",), upload_min_s=10)
