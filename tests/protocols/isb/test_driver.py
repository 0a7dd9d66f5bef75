"""Configuration of an Inertial Sense device as documented: requests, writes, read-back, refusals and silence."""

from __future__ import annotations

import json
import struct
from collections import Counter
from typing import Any

import pytest

from imuscope.protocols.commands.transactions import (
    DeviceContext,
    DeviceRejectedError,
    NoReplyError,
    Send,
    WaitFor,
    cancel,
)
from imuscope.protocols.events import Text
from imuscope.protocols.isb import frames
from imuscope.protocols.isb.commands import COMMAND_ROWS
from imuscope.protocols.isb.dataset_loader import SETS
from imuscope.protocols.isb.decoder import IsbDecoder
from imuscope.protocols.isb.driver import version_of
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.protocols.isb.stored_settings import settings_of
from imuscope.protocols.isb.streams import STREAMS
from imuscope.protocols.schema.layouts import EncodeError
from tests.protocols.isb.isb_driving import DRIVER, KNOWN, S, read, wire
from tests.support.each_row import each_row
from tests.support.source_files import ROOT
from tests.support.transaction_player import PlayedWire, play

VECTORS = json.loads((ROOT / "tests" / "golden" / "isb" / "commands.json").read_text())


# -- reading and writing -----------------------------------------------------------------------------------------------


def test_the_identity_is_read() -> None:
    known = play(DRIVER.identify(DeviceContext(baud=115_200)), wire(serial=61_234))
    assert (known.product, known.serial_number, known.firmware, known.baud) == ("IMX-5.0.4", "61234", "2.7.1", 115_200)
    assert play(DRIVER.is_alive(KNOWN), wire())


def test_one_field_is_written_by_its_offset_and_read_back() -> None:
    there = wire()
    before = read("DID_FLASH_CONFIG", there)
    written = play(DRIVER.write("DID_FLASH_CONFIG", {"magDeclination": 0.25, "refLla": [1.0, 2.0, 3.0]}, KNOWN), there)
    assert written.refused == ""
    assert written.actual is not None
    changed = {name for name in before if before[name] != written.actual[name]}
    assert changed == {"magDeclination", "refLla", "checksum"}
    sets = [send.frame for send in there.sent if send.frame[2] & frames.TYPE_MASK == frames.SET_DATA]
    assert sets == [
        frames.set_data(12, struct.pack("<3d", 1, 2, 3), 72),
        frames.set_data(12, struct.pack("<f", 0.25), 180),
    ]


def test_a_configuration_is_restored_without_fields_maintained_by_the_device() -> None:
    there = wire()
    before = read("DID_FLASH_CONFIG", there)
    packets = DRIVER.setting_frames("DID_FLASH_CONFIG", before, KNOWN)
    spans = [(int.from_bytes(one[6:8], "little"), int.from_bytes(one[4:6], "little") - 2) for one in packets]
    assert spans == [(12, 84), (128, 160)]  # not size, checksum and key; not the last place
    play(DRIVER.write("DID_FLASH_CONFIG", {"dynamicModel": 8, "ser1BaudRate": 115_200}, KNOWN), there)
    written = play(DRIVER.write("DID_FLASH_CONFIG", before, KNOWN), there)
    assert written.actual is not None
    assert DRIVER.same("DID_FLASH_CONFIG", before, written.actual) == []


def test_a_value_rounded_by_the_device_is_reported() -> None:
    there = wire()
    request = {
        "startupNavDtMs": 4,
        "startupImuDtMs": 8,
    }  # slower than navigation: sent unchecked only as values once held
    written = play(DRIVER.write("DID_FLASH_CONFIG", request, KNOWN), there)

    assert written.actual is not None
    assert written.actual["startupImuDtMs"] == 4
    assert DRIVER.same("DID_FLASH_CONFIG", request, written.actual) == ["startupImuDtMs"]


def test_every_setting_is_read_or_refused_with_a_reason() -> None:
    there = wire()
    report, refused = [], []
    for setting in DRIVER.settings(KNOWN):
        try:
            values = read(setting.name, there)
        except DeviceRejectedError as error:
            refused.append((setting.name, error.why))
            continue
        report.append(setting.name)
        json.dumps(values, allow_nan=False)
        names = {field.name for field in setting.fields}
        assert values.keys() <= names, setting.name
    assert {
        "streams",
        "DID_FLASH_CONFIG",
        "DID_NMEA_BCAST_PERIOD",
        "DID_MAG_CAL",
        "DID_DEV_INFO",
        "DID_SYS_PARAMS",
    } <= set(report)
    assert {"DID_EVB_FLASH_CFG", "DID_GPX_FLASH_CFG"} <= {name for name, _ in refused}
    assert all("not supported" in why for _, why in refused)


def test_a_refused_set_is_in_the_result_and_a_refused_read_raises() -> None:
    there = wire()
    written = play(DRIVER.write("DID_GPX_FLASH_CFG", {"ser0BaudRate": 115_200}, KNOWN), there)
    assert (written.actual, "NACK" in written.refused) == (None, True)
    with pytest.raises(DeviceRejectedError):
        play(DRIVER.run("GET_DID_EVB_STATUS", {}, KNOWN), there)
    with pytest.raises(DeviceRejectedError):
        play(DRIVER.run("DID_SYS_CMD.MANF_CHIP_ERASE", {}, KNOWN), there)


class DeafIsbDevice(IsbSimulator):
    """A link that receives nothing for a while."""

    deaf_until_ns = 10**18

    def receive(self, data: bytes, now_ns: int) -> bytes:
        return super().receive(data if now_ns >= self.deaf_until_ns else b"", now_ns)


def test_silence_is_raised_after_three_attempts_and_late_answers_count() -> None:
    there = PlayedWire(DeafIsbDevice(), "isb", step_ns=5_000_000)
    there.pass_time(2)
    with pytest.raises(NoReplyError, match="No answer to GET DID_FLASH_CONFIG"):
        read("DID_FLASH_CONFIG", there)
    assert len(there.sent) == 3
    assert not play(DRIVER.is_alive(KNOWN), there)
    device = DeafIsbDevice()
    device.deaf_until_ns = round(2.6 * S)
    late = PlayedWire(device, "isb", step_ns=5_000_000)
    late.pass_time(2)
    assert read("DID_FLASH_CONFIG", late)["key"] == 21


# -- commands ----------------------------------------------------------------------------------------------------------


def test_every_command_has_a_frame_a_name_and_spans() -> None:
    """A sweep of the table: with its defaults, and for a set with its first field."""
    for row in COMMAND_ROWS.values():
        values = {field.name: field.default for field in row.arguments if field.default is not None}
        if row.name in ("STOP_DID_BROADCAST", "GET_DATA"):
            values["id"] = 4
        if row.name.startswith("SET_"):
            first = row.arguments[0]
            value: Any = {"bytes": "00", "ascii": ""}.get(first.dtype, first.low or next(iter(first.choices), 0))
            values = {first.name: value if not first.shape or isinstance(value, str) else []}
            if first.shape and not first.fields and not isinstance(value, str):
                values = {first.name: [value] * first.shape[0]}
            if first.fields or first.dtype == "bytes":
                continue
        frame = DRIVER.frame(row.name, values, KNOWN)
        assert DRIVER.name_of(frame), row.name
        spans = DRIVER.annotate(frame)
        assert [span.offset for span in spans] == [sum(one.size for one in spans[:i]) for i in range(len(spans))], (
            row.name
        )
        assert sum(span.size for span in spans) == len(frame)
        assert not row.caution or row.consequence, row.name


def test_spans_of_the_golden_packets() -> None:
    for row in VECTORS:
        frame = bytes.fromhex(row["packet_hex"])
        spans = DRIVER.annotate(frame)
        assert sum(span.size for span in spans) == len(frame)
        paths = {span.path.split(".")[0] for span in spans}
        field = row["args"].get("field")
        assert not field or field in paths


def test_the_setting_of_one_field_is_the_golden_packet() -> None:
    rows = [row for row in VECTORS if row["what"] == "set_data_offset"]
    assert len(rows) == 4
    for row in rows:
        values = {row["args"]["field"]: row["args"]["value"]}
        [packet] = DRIVER.setting_frames("DID_FLASH_CONFIG", values, KNOWN)
        assert packet.hex() == row["packet_hex"]


def test_calibration_of_the_magnetometers() -> None:
    there = wire()
    play(DRIVER.run("DID_MAG_CAL.MULTI_AXIS", {}, KNOWN), there)
    assert there.sent[-1].frame.hex() == "ef49051304000100000055b0"  # the vendor's
    there.pass_time(10)
    values = read("DID_MAG_CAL", there)
    assert (values["state"], round(values["progress"])) == (200, 50)
    there.pass_time(11)
    assert read("DID_MAG_CAL", there)["state"] == 201


def test_text() -> None:
    there = wire()
    info = play(DRIVER.run("INFO", {}, KNOWN), there)
    assert info["line"].startswith("$INFO,62000,5.0.4.0,2.7.1.0,7,2.0.0.0,")
    assert info["line"].partition("*")[0].endswith(",simulator,3,2,r"), "hardware, its state, the build"
    play(
        DRIVER.run("ASCE", {"options": 0, "messages": [{"id": 7, "period": 1}, {"id": 4, "period": 10}]}, KNOWN), there
    )
    report = play(DRIVER.run("$ASCE", {}, KNOWN), there)
    assert report["line"].startswith("$ASCE,0,4,10,7,1*"), "as firmware 2.7.1 answers"
    begin, sentences = there.now_ns + 1, Counter[str]()
    there.device.advance(begin)
    decoder = IsbDecoder()
    decoder.feed(there.device.advance(begin + 2 * S), 0)
    sentences.update(event.name for event in decoder.drain() if isinstance(event, Text))
    assert sentences == {"GNGGA": 10, "PINS1": 20}
    play(DRIVER.run("STPC", {}, KNOWN), there)
    now = begin + 2 * S
    assert there.device.advance(now) + there.device.advance(now + S) == b""


def test_sentences_are_a_stored_setting() -> None:
    there = wire()
    expected = {"options": 1 << 9, "nmeaBroadcastMsgs": [{"msgID": 7, "msgPeriod": 1}, {"msgID": 1, "msgPeriod": 5}]}
    written = play(DRIVER.write("DID_NMEA_BCAST_PERIOD", expected, KNOWN), there)
    assert written.actual is not None
    assert DRIVER.same("DID_NMEA_BCAST_PERIOD", expected, written.actual) == []
    fewer = {"options": 0, "nmeaBroadcastMsgs": [{"msgID": 7, "msgPeriod": 2}]}
    got = play(DRIVER.write("DID_NMEA_BCAST_PERIOD", fewer, KNOWN), there).actual
    assert got is not None
    assert got["nmeaBroadcastMsgs"] == [{"msgID": 7, "msgPeriod": 2}]  # streams that are no longer listed are stopped
    play(DRIVER.run("SRST", {}, KNOWN), there)
    there.pass_time(1)
    assert {one["msgID"] for one in read("DID_NMEA_BCAST_PERIOD", there)["nmeaBroadcastMsgs"]} == {7, 1}


# -- the line ----------------------------------------------------------------------------------------------------------


def test_a_rate_acts_after_the_restart_and_the_device_is_found_there() -> None:
    there = wire()
    there.baud = 921_600
    play(DRIVER.write("DID_FLASH_CONFIG", {"ser0BaudRate": 115_200}, KNOWN), there)
    assert play(DRIVER.is_alive(KNOWN), there)
    play(DRIVER.store_and_restart(KNOWN), there)
    there.pass_time(1)
    assert there.device.baud == 115_200
    assert not play(DRIVER.is_alive(KNOWN), there)
    assert play(DRIVER.restore_communication(KNOWN), there)
    assert there.baud == 115_200
    there.pass_time(1)
    assert len(read("streams", there)["streams"]) == 8  # those that were saved


def test_a_restart_stores_no_streams_and_starts_again_what_ran() -> None:
    """Regression: a write of a lever arm saved the streams of the moment as persistent ones, unasked and unsaid."""
    there = wire()
    stored = dict(there.device.persistent)
    gone = next(iter(stored))
    play(DRIVER.run("GET_DATA", {"id": 4, "size": 0, "offset": 0, "period": 3}, KNOWN), there)
    play(DRIVER.run("STOP_DID_BROADCAST", {"id": gone}, KNOWN), there)
    sentences = {"options": 0, "nmeaBroadcastMsgs": [{"msgID": 7, "msgPeriod": 5}]}
    play(DRIVER.write("DID_NMEA_BCAST_PERIOD", sentences, KNOWN), there)
    running = dict(there.device.streams)
    again = play(DRIVER.store_and_restart(KNOWN), there)
    assert there.put_back[-1] == again  # also if the server is killed now
    there.pass_time(1)
    assert play(DRIVER.is_alive(KNOWN), there)
    play(DRIVER.resume(again, KNOWN), there)
    assert there.device.streams == running != stored
    assert there.device.memory.sentences == {7: 5}
    assert (there.device.persistent, there.device.memory.saved_sentences) == (stored, {})
    assert there.put_back[-1] == ()


@each_row(
    ("old", "new", "kind", "baud"),
    [
        ({"ser0BaudRate": 921_600, "ser1BaudRate": 115_200}, {"ser0BaudRate": 460_800}, "baud", 460_800),
        ({"ser0BaudRate": 921_600, "ser1BaudRate": 115_200}, {"ser1BaudRate": 460_800}, None, None),
        (None, {"ser2BaudRate": 460_800}, "baud", 460_800),
        ({"ser0BaudRate": 1, "ser1BaudRate": 1}, {"ser0BaudRate": 1}, None, None),
        ({"ioConfig": 0}, {"ioConfig": 64}, "port", None),
        ({}, {"dynamicModel": 3}, None, None),
    ],
)
def test_changes_that_could_cut_the_line(old: Any, new: dict[str, Any], kind: str | None, baud: int | None) -> None:
    change = DRIVER.line_change("DID_FLASH_CONFIG", old, new, KNOWN)
    assert (change and change.kind, change and change.baud) == (kind, baud)


def test_the_absence_of_streams_is_reported() -> None:
    change = DRIVER.line_change("streams", None, {"streams": []}, KNOWN)
    assert change is not None
    assert change.kind == "silent"


# -- what cannot be sent -----------------------------------------------------------------------------------------------


@each_row(
    ("setting", "values", "path"),
    [
        ("DID_FLASH_CONFIG", {"startupGPSDtMs": 100}, "startupGPSDtMs"),
        ("DID_FLASH_CONFIG", {"refLla": [1, 2]}, "refLla"),
        ("DID_FLASH_CONFIG", {"refLla": [1, 2, "x"]}, "refLla.2"),
        ("DID_FLASH_CONFIG", {"nonsense": 1}, "nonsense"),
        ("streams", {"streams": [{"did": 12, "period": 1}]}, "streams.0.did"),
        ("streams", {"streams": [{"did": 4, "period": 1}, {"did": 4, "period": 2}]}, "streams.1.did"),
        ("streams", {"streams": [{"did": 4, "period": 0}]}, "streams.0.period"),
    ],
)
def test_a_wrong_value_is_refused_at_its_field(setting: str, values: dict[str, Any], path: str) -> None:
    with pytest.raises(EncodeError) as error:
        DRIVER.setting_frames(setting, values, KNOWN)
    assert error.value.path == path


def test_a_firmware_has_its_own_fields() -> None:
    assert version_of(DeviceContext(firmware="2.3.0")) == "2.2.2"
    assert version_of(DeviceContext(firmware="1.0.0")) == "2.0.3"
    assert version_of(DeviceContext(firmware="")) == version_of(KNOWN) == "2.7.1"
    old = {field.name for field in settings_of("2.0.3")["DID_FLASH_CONFIG"].fields}
    assert "gnssCn0Minimum" not in old
    with pytest.raises(EncodeError, match="gnssCn0Minimum"):
        DRIVER.setting_frames("DID_FLASH_CONFIG", {"gnssCn0Minimum": 10}, DeviceContext(firmware="2.0.3"))


def test_a_stopped_transaction_leaves_no_streams() -> None:
    dialogue = DRIVER.write("DID_FLASH_CONFIG", {"dynamicModel": 4}, KNOWN)
    assert isinstance(next(dialogue), Send)
    assert isinstance(dialogue.send(None), WaitFor)
    assert cancel(dialogue) == []


def test_every_data_set_that_streams_has_a_group() -> None:
    assert {row.group for row in STREAMS.values()} >= {"Navigation", "Inertial", "GNSS", "System"}
    assert all(row.rmc_bit == -1 or SETS[row.did].rmc for row in STREAMS.values())


def test_stored_settings_have_display_names() -> None:
    """The document has constants and abbreviations only; what is seen first is called by a word."""
    for setting in settings_of().values():
        assert setting.title != setting.title.upper(), setting.name
        assert all(field.title for field in setting.fields if field.basic), setting.name
    flash = settings_of()["DID_FLASH_CONFIG"]
    assert all(field.title or field.read_only for field in flash.fields)
