"""Is an Inertial Sense device configured as its documents say: asked, told, read back, refused, silent?"""

from __future__ import annotations

import json
import struct
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from protocols.dialogues import Dialogue, Expect, Known, RefusedError, Send, SilentError, stop
from protocols.events import Text
from protocols.isb import frames
from protocols.isb.commands import COMMAND_ROWS, PERSISTENT, settings_of
from protocols.isb.decoder import IsbDecoder
from protocols.isb.device import IsbDevice
from protocols.isb.dialogues import IsbDriver, version_of
from protocols.isb.streams import PRESETS, STREAMS, dids_of
from protocols.isb.tables import SETS
from protocols.layouts import EncodeError
from tests.dialogues import Wire, play

DRIVER = IsbDriver()
KNOWN = Known(product="IMX-5.0.4", firmware="2.7.1", baud=921_600)
S = 10**9
VECTORS = json.loads((Path(__file__).parents[1] / "golden" / "isb" / "commands.json").read_text())


def wire(**options: Any) -> Wire:
    """A twin that has its first fix."""
    there = Wire(IsbDevice(**options), "isb", step_ns=5_000_000)
    there.pass_time(5)
    return there


def read(setting: str, there: Wire) -> Mapping[str, Any]:
    return play(DRIVER.read(setting, KNOWN), there)


# -- reading and writing -----------------------------------------------------------------------------------------------


def test_who_it_is() -> None:
    known = play(DRIVER.identify(Known(baud=115_200)), wire(serial=61_234))
    assert (known.product, known.serial_number, known.firmware, known.baud) == ("IMX-5.0.4", "61234", "2.7.1", 115_200)
    assert play(DRIVER.alive(KNOWN), wire())


def test_one_field_is_written_by_its_offset_and_read_back() -> None:
    there = wire()
    before = read("DID_FLASH_CONFIG", there)
    written = play(DRIVER.write("DID_FLASH_CONFIG", {"magDeclination": 0.25, "refLla": [1.0, 2.0, 3.0]}, KNOWN), there)
    assert written.refused == ""
    assert written.got is not None
    changed = {name for name in before if before[name] != written.got[name]}
    assert changed == {"magDeclination", "refLla", "checksum"}
    sets = [send.frame for send in there.sent if send.frame[2] & frames.TYPE_MASK == frames.SET_DATA]
    assert sets == [
        frames.set_data(12, struct.pack("<3d", 1, 2, 3), 72),
        frames.set_data(12, struct.pack("<f", 0.25), 180),
    ]


def test_a_whole_configuration_is_put_back_without_what_the_device_keeps_itself() -> None:
    there = wire()
    before = read("DID_FLASH_CONFIG", there)
    packets = DRIVER.setting_frames("DID_FLASH_CONFIG", before, KNOWN)
    spans = [(int.from_bytes(one[6:8], "little"), int.from_bytes(one[4:6], "little") - 2) for one in packets]
    assert spans == [(12, 84), (128, 160)]  # not size, checksum and key; not the last place
    play(DRIVER.write("DID_FLASH_CONFIG", {"dynamicModel": 8, "ser1BaudRate": 115_200}, KNOWN), there)
    written = play(DRIVER.write("DID_FLASH_CONFIG", before, KNOWN), there)
    assert written.got is not None
    assert DRIVER.same("DID_FLASH_CONFIG", before, written.got) == []


def test_a_value_that_the_device_rounds_is_told() -> None:
    there = wire()
    asked = {"startupNavDtMs": 4, "startupImuDtMs": 8}  # inertial data cannot be slower than navigation
    written = play(DRIVER.write("DID_FLASH_CONFIG", asked, KNOWN), there)
    assert written.got is not None
    assert written.got["startupImuDtMs"] == 4
    assert DRIVER.same("DID_FLASH_CONFIG", asked, written.got) == ["startupImuDtMs"]


def test_every_setting_is_read_or_refused_in_words() -> None:
    there = wire()
    told, refused = [], []
    for setting in DRIVER.settings(KNOWN):
        try:
            values = read(setting.name, there)
        except RefusedError as error:
            refused.append((setting.name, error.why))
            continue
        told.append(setting.name)
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
    } <= set(told)
    assert {"DID_EVB_FLASH_CFG", "DID_GPX_FLASH_CFG"} <= {name for name, _ in refused}
    assert all("does not have it" in why for _, why in refused)


def test_reading_does_not_end_what_streams() -> None:
    """GET_DATA with period 0 ends a stream, whatever its size: neither a snapshot nor a single question must."""
    there = wire()
    for did in (4, 58, 15):
        values = play(DRIVER.within(DRIVER.run(f"GET_{SETS[did].name}", {}, KNOWN), KNOWN), there)
        assert values
    rows = read("streams", there)["streams"]
    assert {row["did"]: row["period"] for row in rows} == {58: 1, 4: 1, 5: 2, 52: 1, 53: 1, 13: 1, 30: 1, 15: 5}


def test_reading_all_settings_does_not_end_a_stream_that_has_no_bit() -> None:
    """DID_SYS_PARAMS is a setting that is read, and a data set that may stream."""
    there = wire()
    play(DRIVER.within(DRIVER.run("GET_DID_SYS_PARAMS", {"period": 10}, KNOWN), KNOWN), there)

    def survey() -> Dialogue[None]:
        for name in ("streams", "DID_SYS_PARAMS", "DID_GROUND_VEHICLE"):
            yield from DRIVER.read(name, KNOWN)

    play(DRIVER.within(survey(), KNOWN), there)
    assert {row["did"]: row["period"] for row in read_within("streams", there)["streams"]}[10] == 10


def test_a_stream_that_was_asked_for_all_the_same_is_begun_again() -> None:
    """One that has its bit and sends nothing, as RTK without corrections: its answer costs it its stream."""
    there = wire()
    device = there.device
    assert isinstance(device, IsbDevice)
    device.streams = {**device.streams, 13: 60_000}  # every three hours
    device._make()
    play(DRIVER.within(DRIVER.run("GET_DID_GPS1_POS", {}, KNOWN), KNOWN), there)
    assert 13 in device.streams
    device.streams = {**device.streams, 13: 60_000}
    device._make()
    stopped = DRIVER.within(DRIVER.run("GET_DID_GPS1_POS", {}, KNOWN), KNOWN)
    act, asked = next(stopped), False
    while not asked:
        asked = isinstance(act, Send) and act.frame == frames.get_data(13, period=0)
        act = act if asked else stopped.send(there.do(act))
    assert [send.frame for send in stop(stopped)] == [frames.get_data(13, period=1)]


def read_within(setting: str, there: Wire) -> Mapping[str, Any]:
    return play(DRIVER.within(DRIVER.read(setting, KNOWN), KNOWN), there)


def test_a_set_that_is_refused_is_in_the_result_and_an_ask_raises() -> None:
    there = wire()
    written = play(DRIVER.write("DID_GPX_FLASH_CFG", {"ser0BaudRate": 115_200}, KNOWN), there)
    assert (written.got, "NACK" in written.refused) == (None, True)
    with pytest.raises(RefusedError):
        play(DRIVER.run("GET_DID_EVB_STATUS", {}, KNOWN), there)
    with pytest.raises(RefusedError):
        play(DRIVER.run("DID_SYS_CMD.MANF_CHIP_ERASE", {}, KNOWN), there)


class Deaf(IsbDevice):
    """Hears nothing for a while."""

    deaf_until_ns = 10**18

    def receive(self, data: bytes, now_ns: int) -> bytes:
        return super().receive(data if now_ns >= self.deaf_until_ns else b"", now_ns)


def test_silence_is_raised_after_three_tries_and_a_late_device_is_heard() -> None:
    there = Wire(Deaf(), "isb", step_ns=5_000_000)
    there.pass_time(2)
    with pytest.raises(SilentError, match="No answer to GET DID_FLASH_CONFIG"):
        read("DID_FLASH_CONFIG", there)
    assert len(there.sent) == 3
    assert not play(DRIVER.alive(KNOWN), there)
    device = Deaf()
    device.deaf_until_ns = round(2.6 * S)
    late = Wire(device, "isb", step_ns=5_000_000)
    late.pass_time(2)
    assert read("DID_FLASH_CONFIG", late)["key"] == 21


# -- streams -----------------------------------------------------------------------------------------------------------


def test_streams_are_read_with_their_periods() -> None:
    rows = {row["did"]: row for row in read("streams", wire())["streams"]}
    assert {did: row["period"] for did, row in rows.items()} == {58: 1, 4: 1, 5: 2, 52: 1, 53: 1, 13: 1, 30: 1, 15: 5}
    assert (rows[4]["size"], rows[4]["source_ms"]) == (80, 10.0)
    assert (rows[15]["size"], rows[13]["source_ms"]) == (128, 200.0)


def test_streams_are_begun_changed_and_ended() -> None:
    there = wire()
    wanted: dict[str, Any] = {
        "streams": [{"did": 4, "period": 4}, {"did": 52, "period": 1}, {"did": 10, "period": 100}]
    }
    written = play(DRIVER.within(DRIVER.write("streams", wanted, KNOWN), KNOWN), there)
    assert written.got is not None
    got = {row["did"]: row["period"] for row in written.got["streams"]}
    assert got == {4: 4, 52: 1, 10: 100}  # DID_SYS_PARAMS has no bit: it was heard
    assert DRIVER.same("streams", wanted, written.got) == []


def asked_for(there: Wire) -> list[int]:
    """The data sets that were asked to stream."""
    packets = [send.frame for send in there.sent if send.frame[2] & frames.TYPE_MASK == frames.GET_DATA]
    return [int.from_bytes(one[6:8], "little") for one in packets if one[12:14] != b"\0\0"]


@pytest.mark.parametrize("source", ["nav", "imu"])
def test_a_row_that_was_not_touched_is_not_sent(source: str) -> None:
    """It was, with a multiple that was guessed: DID_IMU went from 62 to 3.5 Hz when only DID_INS_1 was changed."""
    there = wire(imu_source=source, rate=62.5)
    play(DRIVER.write("DID_FLASH_CONFIG", {"startupImuDtMs": 1}, KNOWN), there)
    play(DRIVER.run("DID_SYS_CMD.SAVE_PERSISTENT_MESSAGES", {}, KNOWN), there)
    play(DRIVER.run("DID_SYS_CMD.SOFTWARE_RESET", {}, KNOWN), there)
    there.pass_time(5)
    device = there.device
    assert isinstance(device, IsbDevice)
    before = dict(device.streams)
    values = read_within("streams", there)
    rows = {row["did"]: row for row in values["streams"]}
    assert rows[58]["period"] * rows[58]["source_ms"] == pytest.approx(16 if source == "nav" else 1, rel=0.05)
    wanted = [{**row, "period": 3} if row["did"] == 4 else row for row in values["streams"]]
    there.sent.clear()
    written = play(DRIVER.within(DRIVER.write("streams", {"streams": wanted}, KNOWN), KNOWN), there)
    assert asked_for(there) == [4]
    assert device.streams == {**before, 4: 3}
    assert written.got is not None
    assert DRIVER.same("streams", {"streams": wanted}, written.got) == []
    previewed = DRIVER.setting_frames("streams", {"streams": wanted}, KNOWN, old=values)
    assert previewed == [frames.get_data(4, period=3)]


@pytest.mark.parametrize(("source", "multiple"), [("nav", 2), ("imu", 8)])
def test_the_rate_that_was_chosen_is_measured_whichever_source_the_device_counts(source: str, multiple: int) -> None:
    """The document and the header disagree on what DID_IMU is timed by; 31 Hz are 31 Hz."""
    there = wire(imu_source=source)
    play(DRIVER.write("DID_FLASH_CONFIG", {"startupNavDtMs": 16, "startupImuDtMs": 4}, KNOWN), there)
    play(DRIVER.run("DID_SYS_CMD.SOFTWARE_RESET", {}, KNOWN), there)
    there.pass_time(5)
    device = there.device
    assert isinstance(device, IsbDevice)
    wanted = {"streams": [{"did": 58, "period": 2, "size": 0, "source_ms": 16.0}]}
    written = play(DRIVER.within(DRIVER.write("streams", wanted, KNOWN), KNOWN), there)
    assert written.got is not None
    row = written.got["streams"][0]
    assert row["period"] * row["source_ms"] == pytest.approx(32, rel=0.05)
    assert device.streams == {58: multiple}
    assert DRIVER.same("streams", wanted, written.got) == []
    alone = {"streams": [{"did": 58, "period": 4}]}
    play(DRIVER.within(DRIVER.write("streams", alone, KNOWN), KNOWN), there)
    assert device.streams == {58: 4}  # a multiple alone is a multiple


def test_a_refused_stream_says_so_and_the_others_are_told() -> None:
    there = wire()
    wanted = {"streams": [{"did": 4, "period": 2}, {"did": 123, "period": 1}]}
    written = play(DRIVER.within(DRIVER.write("streams", wanted, KNOWN), KNOWN), there)
    assert "DID_GPX_STATUS" in written.refused
    assert written.got is not None
    assert {row["did"]: row["period"] for row in written.got["streams"]} == {4: 2}


def test_a_wish_to_save_is_carried_out_and_is_no_state() -> None:
    """ "Nothing to change" was the answer to a wish to keep what streams, and of streams with it no save was sent."""
    streams = {"streams": [{"did": 4, "period": 1}], "options": 0}
    wish = {**streams, "options": PERSISTENT}
    assert DRIVER.same("streams", streams, wish) == ["options"]
    assert DRIVER.same("streams", {"options": 0}, {"options": PERSISTENT}) == ["options"]
    assert DRIVER.same("streams", wish, streams) == []  # as asked: it cannot be read back
    sentences = {"options": 0, "nmeaBroadcastMsgs": [{"msgID": 7, "msgPeriod": 1}]}
    assert DRIVER.same("DID_NMEA_BCAST_PERIOD", sentences, {**sentences, "options": PERSISTENT}) == ["options"]


def test_streams_are_kept_over_a_restart_when_that_is_asked_for() -> None:
    for options, kept in ((1 << 9, {4}), (0, {58, 4, 5, 52, 53, 13, 30, 15})):
        there = wire()
        play(DRIVER.write("streams", {"streams": [{"did": 4, "period": 1}], "options": options}, KNOWN), there)
        play(DRIVER.run("DID_SYS_CMD.SOFTWARE_RESET", {}, KNOWN), there)
        there.pass_time(5)
        assert {row["did"] for row in read("streams", there)["streams"]} == kept


def test_options_alone_keep_what_streams_and_end_nothing() -> None:
    there = wire()
    play(DRIVER.run("STOP_DID_BROADCAST", {"id": 58}, KNOWN), there)
    written = play(DRIVER.write("streams", {"options": 1 << 9}, KNOWN), there)
    assert written.got is not None
    assert len(written.got["streams"]) == 7
    play(DRIVER.run("DID_SYS_CMD.SOFTWARE_RESET", {}, KNOWN), there)
    there.pass_time(5)
    assert {row["did"] for row in read("streams", there)["streams"]} == {4, 5, 52, 53, 13, 30, 15}


def test_a_preset_takes_the_place_of_all_streams() -> None:
    there = wire()
    play(DRIVER.run("DID_RMC.INS", {}, KNOWN), there)
    assert {row["did"] for row in read("streams", there)["streams"]} == {5, 13}
    assert dids_of(PRESETS["INS"]) == [5, 13]
    play(DRIVER.run("STOP_BROADCASTS_CURRENT_PORT", {}, KNOWN), there)
    assert read("streams", there)["streams"] == []


@pytest.mark.parametrize(
    ("options", "rate"),
    [
        ({"streams": [{"did": 4, "period": 1}]}, 100),
        ({"streams": [{"did": 5, "period": 3}, {"did": 15, "period": 2}]}, 200),
    ],
)
def test_the_load_is_what_the_device_sends_to_the_byte(options: dict[str, Any], rate: float) -> None:
    there = wire(rate=rate)
    written = play(DRIVER.write("streams", options, KNOWN), there)
    assert written.got is not None
    asked = DRIVER.load({"streams": written.got}, KNOWN)
    seconds = 12  # a multiple of every period
    begin = -(-there.now_ns // S) * S + 1
    there.device.advance(begin)
    measured = len(there.device.advance(begin + seconds * S))
    assert asked.total * seconds == pytest.approx(measured)
    assert sum(part.bytes_per_s for part in asked.parts) == asked.total


def test_the_load_follows_a_configuration_that_is_not_in_effect_yet() -> None:
    streams = {"streams": [{"did": 4, "period": 2, "size": 80, "source_ms": 10.0}]}
    assert DRIVER.load({"streams": streams}, KNOWN).total == 88 * 50
    assert DRIVER.load({"streams": streams, "DID_FLASH_CONFIG": {"startupNavDtMs": 2}}, KNOWN).total == 88 * 250
    pimu = {"streams": [{"did": 3, "period": 2}]}
    assert "no other rate" in DRIVER.load({"streams": pimu}, KNOWN).limits[0]


def test_streams_are_made_to_fit() -> None:
    streams = {"streams": [{"did": did, "period": 1, "source_ms": 1.0} for did in (4, 5, 58, 52)]}
    fitted = DRIVER.fit({"streams": streams}, 11_520, KNOWN)
    assert DRIVER.load({"streams": streams}, KNOWN).total > 11_520 >= DRIVER.load(fitted, KNOWN).total
    assert all(row["period"] == 1 for row in streams["streams"])  # what was given is not changed
    assert DRIVER.fit({"streams": streams}, 1e9, KNOWN) == {"streams": streams}


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
        spans = DRIVER.spans(frame)
        assert [span.offset for span in spans] == [sum(one.size for one in spans[:i]) for i in range(len(spans))], (
            row.name
        )
        assert sum(span.size for span in spans) == len(frame)
        assert not row.caution or row.consequence, row.name


def test_spans_of_the_golden_packets() -> None:
    for row in VECTORS:
        frame = bytes.fromhex(row["packet_hex"])
        spans = DRIVER.spans(frame)
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
    play(
        DRIVER.run("ASCE", {"options": 0, "messages": [{"id": 7, "period": 1}, {"id": 4, "period": 10}]}, KNOWN), there
    )
    told = play(DRIVER.run("$ASCE", {}, KNOWN), there)
    assert told["line"].startswith("$ASCB,0,4,10,7,1*")
    begin, sentences = there.now_ns + 1, Counter[str]()
    there.device.advance(begin)
    decoder = IsbDecoder()
    decoder.feed(there.device.advance(begin + 2 * S), 0)
    sentences.update(event.name for event in decoder.drain() if isinstance(event, Text))
    assert sentences == {"GNGGA": 10, "PINS1": 20}
    play(DRIVER.run("STPC", {}, KNOWN), there)
    now = begin + 2 * S
    assert there.device.advance(now) + there.device.advance(now + S) == b""


def test_sentences_have_a_setting_of_their_own_that_is_kept() -> None:
    there = wire()
    wanted = {"options": 1 << 9, "nmeaBroadcastMsgs": [{"msgID": 7, "msgPeriod": 1}, {"msgID": 1, "msgPeriod": 5}]}
    written = play(DRIVER.write("DID_NMEA_BCAST_PERIOD", wanted, KNOWN), there)
    assert written.got is not None
    assert DRIVER.same("DID_NMEA_BCAST_PERIOD", wanted, written.got) == []
    fewer = {"options": 0, "nmeaBroadcastMsgs": [{"msgID": 7, "msgPeriod": 2}]}
    got = play(DRIVER.write("DID_NMEA_BCAST_PERIOD", fewer, KNOWN), there).got
    assert got is not None
    assert got["nmeaBroadcastMsgs"] == [{"msgID": 7, "msgPeriod": 2}]  # what is not named any more is ended
    play(DRIVER.run("SRST", {}, KNOWN), there)
    there.pass_time(1)
    assert {one["msgID"] for one in read("DID_NMEA_BCAST_PERIOD", there)["nmeaBroadcastMsgs"]} == {7, 1}


# -- the line ----------------------------------------------------------------------------------------------------------


def test_a_rate_acts_after_the_restart_and_the_device_is_found_there() -> None:
    there = wire()
    there.baud = 921_600
    play(DRIVER.write("DID_FLASH_CONFIG", {"ser0BaudRate": 115_200}, KNOWN), there)
    assert play(DRIVER.alive(KNOWN), there)
    play(DRIVER.store_and_restart(KNOWN), there)
    there.pass_time(1)
    assert there.device.baud == 115_200
    assert not play(DRIVER.alive(KNOWN), there)
    assert play(DRIVER.restore_communication(KNOWN), there)
    assert there.baud == 115_200
    there.pass_time(1)
    assert len(read("streams", there)["streams"]) == 8  # saved before the restart


@pytest.mark.parametrize(
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
def test_what_could_cut_the_line(old: Any, new: dict[str, Any], kind: str | None, baud: int | None) -> None:
    change = DRIVER.line_change("DID_FLASH_CONFIG", old, new, KNOWN)
    assert (change and change.kind, change and change.baud) == (kind, baud)


def test_no_streams_at_all_is_said() -> None:
    change = DRIVER.line_change("streams", None, {"streams": []}, KNOWN)
    assert change is not None
    assert change.kind == "silent"


# -- what cannot be sent -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
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
    assert version_of(Known(firmware="2.3.0")) == "2.2.2"
    assert version_of(Known(firmware="1.0.0")) == "2.0.3"
    assert version_of(Known(firmware="")) == version_of(KNOWN) == "2.7.1"
    old = {field.name for field in settings_of("2.0.3")["DID_FLASH_CONFIG"].fields}
    assert "gnssCn0Minimum" not in old
    with pytest.raises(EncodeError, match="gnssCn0Minimum"):
        DRIVER.setting_frames("DID_FLASH_CONFIG", {"gnssCn0Minimum": 10}, Known(firmware="2.0.3"))


def test_a_stopped_dialogue_leaves_nothing_behind() -> None:
    dialogue = DRIVER.write("DID_FLASH_CONFIG", {"dynamicModel": 4}, KNOWN)
    assert isinstance(next(dialogue), Send)
    assert isinstance(dialogue.send(None), Expect)
    assert stop(dialogue) == []


def test_every_data_set_that_streams_has_a_group() -> None:
    assert {row.group for row in STREAMS.values()} >= {"Navigation", "Inertial", "GNSS", "System"}
    assert all(row.rmc_bit == -1 or SETS[row.did].rmc for row in STREAMS.values())


def test_what_is_kept_has_a_name_for_a_person() -> None:
    """The document has constants and abbreviations only; what is seen first is called by a word."""
    for setting in settings_of().values():
        assert setting.title != setting.title.upper(), setting.name
        assert all(field.title for field in setting.fields if field.simple), setting.name
    flash = settings_of()["DID_FLASH_CONFIG"]
    assert all(field.title or field.read_only for field in flash.fields)
