"""Names of the previous version remain accepted: settings, sources, rollbacks, paths, event levels."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from imuscope.server import wire
from imuscope.server.api.answers import DeviceAnswer, JobAnswer, TrafficAnswer
from imuscope.server.configuration.rollback import RollbackStore
from imuscope.server.diagnostics.metrics import LEVEL_LABELS
from imuscope.server.library import decode
from imuscope.server.links.source_url import SourceUrl
from imuscope.server.previous_names import LEVELS, PreviousPaths, path_of, rename_folder
from imuscope.server.settings.config import load
from tests.each_row import each_row
from tests.server_process import ROOT

PREVIOUS = ROOT / "tests" / "golden" / "previous_formats" / "1"


def test_a_simulator_has_its_previous_scheme() -> None:
    source = SourceUrl.parse("twin:xbus?rate=400")
    assert (source.text, source.kind, source.place) == ("sim:xbus?rate=400", "simulator", "xbus")


def test_the_previous_setting_is_read(tmp_path: Path) -> None:
    toml = tmp_path / "imuscope.toml"
    toml.write_text("trial_s = 31\n")
    assert load(toml).rollback_s == 31


def test_rollback_records_of_the_previous_folder_are_found(tmp_path: Path) -> None:
    (tmp_path / "trials").mkdir()
    (tmp_path / "trials" / "xbus-1.json").write_bytes((PREVIOUS / "trial.json").read_bytes())
    rename_folder(tmp_path / "trials", tmp_path / "rollbacks")
    (record,) = RollbackStore(tmp_path / "rollbacks").all()
    assert record.state == "pending"
    (tmp_path / "trials").mkdir()
    rename_folder(tmp_path / "trials", tmp_path / "rollbacks")
    assert (tmp_path / "trials").is_dir(), "a folder of today is never replaced"


@each_row(
    ("old", "new"),
    [
        ("/api/recordings/a/fared", "/api/recordings/a/health"),
        ("/api/devices/1.2/control", "/api/devices/1.2/jobs"),
        ("/api/devices/1/exchange", "/api/devices/1/traffic"),
        ("/api/devices/1/reading", "/api/devices/1/decode-options"),
        ("/api/devices/1/fit", "/api/devices/1/fit-rates"),
        ("/api/devices/1/keep", "/api/devices/1/confirm"),
        ("/api/devices/1/revert", "/api/devices/1/roll-back"),
        ("/api/devices/1/keep/x", "/api/devices/1/keep/x"),
        ("/api/devices/keep", "/api/devices/keep"),
    ],
)
def test_a_previous_path_is_served(old: str, new: str) -> None:
    seen: list[str] = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        seen.extend([scope["path"], scope["raw_path"].decode()])

    scope = {"type": "http", "path": old, "raw_path": old.encode()}
    asyncio.run(PreviousPaths(app)(scope, None, None))  # type: ignore[arg-type]
    assert seen == [new, new]
    assert path_of(new) == new


@each_row(("old", "new"), LEVELS.items())
def test_an_event_of_an_earlier_recording_has_its_level(old: str, new: wire.Level) -> None:
    assert decode._event({"kind": "gap", "level": old}, 0).level == new


def test_metrics_keep_their_labels() -> None:
    assert {new: old for old, new in LEVELS.items()} == LEVEL_LABELS


def test_answers_have_their_previous_keys() -> None:
    outcome = wire.FieldOutcome("s", "p", "t", requested="400 Hz", actual="100 Hz", reason="too much")
    job = wire.Job(1, "1", "Write", "done", outcomes=[outcome])
    [shown] = TypeAdapter(JobAnswer).dump_python(job, mode="json")["outcomes"]
    assert (shown["asked"], shown["got"], shown["why"]) == ("400 Hz", "100 Hz", "too much")
    assert (shown["requested"], shown["actual"], shown["reason"]) == ("400 Hz", "100 Hz", "too much")
    device = wire.DeviceInfo("1", "MTi", "sim:xbus", "simulator", "connecting", required_action="key")
    assert TypeAdapter(list[DeviceAnswer]).dump_python([device])[0]["wants"] == "key"
    entry = wire.TrafficEntry(1, 0.0, "1", "tx", "GoToConfig")
    assert TypeAdapter(TrafficAnswer).dump_python(entry)["way"] == "tx"
    assert "wants" not in json.dumps(TypeAdapter(DeviceAnswer).json_schema(mode="serialization"))
