"""Settings in a recording are shown as in Configure, without omissions."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from imuscope.recordings.mcap.reader import McapReader
from imuscope.server.library.recorded_settings import settings_of
from imuscope.server.library.recorder import RecordingOptions
from imuscope.server.wire import codec as wire_codec
from tests.recordings.mcap_files import json_messages
from tests.support.control_harness import SILENT, outputs
from tests.support.each_row import each_row
from tests.support.recorder_harness import chunks, recorder
from tests.support.waiting import until

OUTPUTS = [
    {"data_identifier": 0x4020, "output_frequency": 400},
    {"data_identifier": 0x2014, "output_frequency": 100},
    {"data_identifier": 0, "output_frequency": 0},
]


def values_of(snapshot: dict[str, Any]) -> dict[str, dict[str, str]]:
    """Setting → title of a row → words."""
    return {one.name: {row.title: row.words for row in one.rows} for one in settings_of(snapshot).settings}


def snapshot(protocol: str, product: str, values: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"protocol": protocol, "product": product, "serial_number": "", "firmware": "", "values": values, **more}


def test_rates_flags_and_units_are_in_words() -> None:
    """They were wire values: "data identifier 16416, output frequency 400", "flags 16"."""
    place = {"latitude": 52.0, "longitude": 6.0, "altitude": 30.0}
    sentences = {"string_types": 0, "frequency": 10}
    values = {"OutputConfiguration": {"outputs": OUTPUTS}, "LatLonAlt": place, "OptionFlags": {"flags": 16}}
    values["StringOutputType"] = sentences
    results = values_of(snapshot("xbus", "MTi-630", values))
    assert results["OutputConfiguration"] == {"Acceleration": "400 Hz", "Quaternion": "100 Hz, NED"}
    assert [words[-2:] for words in results["LatLonAlt"].values()] == [" °", " °", " m"]
    assert results["StringOutputType"] == {"String types": "none", "Frequency": "10 Hz"}
    assert results["OptionFlags"][""].replace(" ", "").isidentifier()  # its name


def test_a_data_set_is_shown_by_field_with_units_and_choices() -> None:
    values = {
        "DID_FLASH_CONFIG": {"startupImuDtMs": 4, "refLla": [52.0, 6.0, 30.0], "later": 7},
        "DID_BIT": {"command": 2},
    }
    results = values_of(snapshot("isb", "IMX-5", values))
    assert "4 ms" in results["DID_FLASH_CONFIG"].values()
    assert "52.00000000 °, 6.00000000 °, 30.00000000 m" in results["DID_FLASH_CONFIG"].values()
    assert "7" in results["DID_FLASH_CONFIG"].values()  # a field that the table has not got
    assert list(results["DID_BIT"].values()) == ["Full stationary"]


@each_row(
    "values",
    [
        {"FromTomorrow": {"speed": 3, "modes": ["a", "b"]}},
        {"Baudrate": {"baudrate": {"rate": [1]}}},
        {"OutputConfiguration": {"outputs": "all of them"}},
        {"OutputConfiguration": {"outputs": [{"data_identifier": "0x4020"}]}},
        {"OutputConfiguration": {"outputs": [3]}},
        {"Baudrate": {}},
    ],
)
@each_row("protocol", ["xbus", "isb", "idtp", "", "another"])
def test_values_unknown_to_the_tables_are_shown_unchanged(protocol: str, values: dict[str, Any]) -> None:
    results = settings_of(snapshot(protocol, "MTi-630", values, missing={"FilterProfile": "no answer", "x": 3}))
    assert [one.name for one in results.settings] == list(values)
    for one in results.settings:
        assert len(one.rows) > 0 or not values[one.name]
    assert len(results.missing) == 2


@each_row("body", [{}, {"values": 3}, {"values": {"a": 1}}, {"values": None, "missing": [1]}])
def test_a_foreign_snapshot_shows_nothing(body: dict[str, Any]) -> None:
    assert settings_of(body).settings == []


async def test_a_device_that_does_not_answer_is_recorded_all_the_same(tmp_path: Path) -> None:
    plan = RecordingOptions(tmp_path / "recordings", request_header=True)
    async with recorder(tmp_path, plan, times=SILENT, patience=1.0) as (made, one):
        desk = await made.add("sim:xbus?rate=20")

        async def refuse(data: bytes) -> None:
            return  # nothing reaches the device

        desk.member.access.link.write = refuse  # type: ignore[method-assign]
        state = await one.start()
        await until(lambda: desk.job_report.done, "it has been given up")
        assert desk.job_report.done[0].state == "failed"
        assert any("no Configuration of" in event.text for event in made.telemetry.log)
        await one.stop()
        assert len(chunks(tmp_path / "recordings" / f"{state.id}.mcap", "rx/1")) > 1000


async def test_settings_that_are_known_are_in_the_recording_and_those_read_later_too(tmp_path: Path) -> None:
    async with recorder(tmp_path, RecordingOptions(tmp_path / "recordings", request_header=False)) as (made, one):
        desk = await made.add("sim:xbus?rate=20")
        await made.read(desk)
        state = await one.start()
        path = tmp_path / "recordings" / f"{state.id}.mcap"
        await until(lambda: one.state.behind_s == 0, "it is written")
        with McapReader(path) as recording:
            ((_, body),) = json_messages(recording, "snapshot/1")
        assert body["values"] == json.loads(json.dumps(wire_codec.to_json_safe(desk.values)))
        assert body["serial_number"] == "0080800001"
        await made.apply(desk, {"OutputConfiguration": outputs(200)})
        await one.stop()
        with McapReader(path) as recording:
            bodies = [body for _, body in json_messages(recording, "snapshot/1")]
        assert bodies[-1]["values"]["OutputConfiguration"] == outputs(200)
