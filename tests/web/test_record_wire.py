"""Recorded wire frames of the component tests are those that a server of today sends.

Run `python -m tests.web.record_wire` when this fails.
"""

from __future__ import annotations

import base64
from typing import Any, get_args

from pydantic import TypeAdapter

from imuscope.recordings.columns.health_history import HealthHistory
from imuscope.recordings.sidecar import MarkerInfo
from imuscope.server import wire
from imuscope.server.configuration.api_models import Forms, SnapshotBody, SnapshotInfo
from imuscope.server.library.api_models import RecordingDetail, RecordingInfo
from tests.support.each_row import each_row
from tests.web.record_wire import FAMILIES, recorded
from tests.web.wire_scenes import SCENES

KINDS: dict[str, Any] = {one.__dataclass_fields__["op"].default: one for one in get_args(wire.ServerText)}
ANSWERS: dict[str, Any] = {
    "forms": Forms,
    "values": SnapshotBody,
    "snapshots": list[SnapshotInfo],
    "recordings": list[RecordingInfo],
}


def has_shape(value: Any, kind: Any) -> None:
    """Every field is there, with its type, and no other."""
    again = TypeAdapter(kind).dump_python(TypeAdapter(kind).validate_python(value), mode="json")
    assert again == value


@each_row("name", [*FAMILIES, *SCENES])
def test_recorded_texts_are_those_of_today(name: str) -> None:
    page = recorded(name)
    assert {"hello", "devices", "channels", "health"} <= {text["op"] for text in page["texts"]}
    for text in [*page["texts"], *page.get("read", [])]:
        has_shape(text, KINDS[text["op"]])


@each_row("name", [*FAMILIES, "library"])
def test_recorded_answers_are_those_of_today(name: str) -> None:
    for place, answer in recorded(name)["answers"].items():
        if kind := ANSWERS.get(place.rpartition("/")[2]):
            has_shape(answer, kind)


def test_recorded_recordings_are_those_of_today() -> None:
    page = recorded("recordings")
    answers = page["answers"]
    has_shape(answers["GET /api/recordings"], list[RecordingInfo])
    for name in page["windows"]:
        detail = answers[f"GET /api/recordings/{name}"]
        has_shape(detail, RecordingDetail)
        has_shape(answers[f"POST /api/recordings/{name}/markers"], MarkerInfo)
        for device in detail["devices"]:
            has_shape(answers[f"GET /api/recordings/{name}/health?device={device['id']}"], HealthHistory)
        sent = base64.b64decode(page["windows"][name])
        results = []
        while sent:
            header = dict(zip(wire.HEADER_FIELDS, wire.HEADER.unpack_from(sent), strict=True))
            results.append((header["channel"], header["columns"]))
            sent = sent[header["size"] :]
        assert results == [(one["id"], len(one["columns"]) + 2) for one in detail["channels"]]
