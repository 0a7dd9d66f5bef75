"""Streams of an Inertial Sense device are read, changed and preserved."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from imuscope.protocols.commands.transactions import Send, Transaction, cancel
from imuscope.protocols.isb import frames
from imuscope.protocols.isb.dataset_loader import SETS
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.protocols.isb.stored_settings import PERSISTENT
from imuscope.protocols.isb.streams import PRESETS, dids_of
from tests.protocols.isb.isb_driving import DRIVER, KNOWN, S, read, wire
from tests.support.each_row import each_row
from tests.support.transaction_player import PlayedWire, play


def test_reading_settings_ends_no_stream() -> None:
    """GET_DATA with period 0 ends a stream regardless of its size; neither a snapshot nor a single query may do so."""
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

    def survey() -> Transaction[None]:
        for name in ("streams", "DID_SYS_PARAMS", "DID_GROUND_VEHICLE"):
            yield from DRIVER.read(name, KNOWN)

    play(DRIVER.within(survey(), KNOWN), there)
    assert {row["did"]: row["period"] for row in read_within("streams", there)["streams"]}[10] == 10


def test_a_stream_that_was_requested_nevertheless_is_restarted() -> None:
    """A stream with its bit set that sends nothing, such as RTK without corrections; reading it ends the stream."""
    there = wire()
    device = there.device
    assert isinstance(device, IsbSimulator)
    device.streams = {**device.streams, 13: 60_000}  # every three hours
    device._make()
    play(DRIVER.within(DRIVER.run("GET_DID_GPS1_POS", {}, KNOWN), KNOWN), there)
    assert 13 in device.streams
    device.streams = {**device.streams, 13: 60_000}
    device._make()
    stopped = DRIVER.within(DRIVER.run("GET_DID_GPS1_POS", {}, KNOWN), KNOWN)
    act, request = next(stopped), False
    while not request:
        request = isinstance(act, Send) and act.frame == frames.get_data(13, period=0)
        act = act if request else stopped.send(there.do(act))
    assert [send.frame for send in cancel(stopped)] == [frames.get_data(13, period=1)]


def read_within(setting: str, there: PlayedWire) -> Mapping[str, Any]:
    return play(DRIVER.within(DRIVER.read(setting, KNOWN), KNOWN), there)


def test_streams_are_read_with_their_periods() -> None:
    rows = {row["did"]: row for row in read("streams", wire())["streams"]}
    assert {did: row["period"] for did, row in rows.items()} == {58: 1, 4: 1, 5: 2, 52: 1, 53: 1, 13: 1, 30: 1, 15: 5}
    assert (rows[4]["size"], rows[4]["source_ms"]) == (80, 10.0)
    assert (rows[15]["size"], rows[13]["source_ms"]) == (128, 200.0)


def test_streams_are_begun_changed_and_ended() -> None:
    there = wire()
    expected: dict[str, Any] = {
        "streams": [{"did": 4, "period": 4}, {"did": 52, "period": 1}, {"did": 10, "period": 100}]
    }
    written = play(DRIVER.within(DRIVER.write("streams", expected, KNOWN), KNOWN), there)
    assert written.actual is not None
    got = {row["did"]: row["period"] for row in written.actual["streams"]}
    assert got == {4: 4, 52: 1, 10: 100}  # DID_SYS_PARAMS has no bit: it was found by listening
    assert DRIVER.same("streams", expected, written.actual) == []


def requested_ids(there: PlayedWire) -> list[int]:
    """Data sets that were requested to stream."""
    packets = [send.frame for send in there.sent if send.frame[2] & frames.TYPE_MASK == frames.GET_DATA]
    return [int.from_bytes(one[6:8], "little") for one in packets if one[12:14] != b"\0\0"]


@each_row("source", ["nav", "imu"])
def test_a_row_that_was_not_touched_is_not_sent(source: str) -> None:
    """It was, with a multiple that was guessed: DID_IMU went from 62 to 3.5 Hz when only DID_INS_1 was changed."""
    there = wire(imu_source=source, rate=62.5)
    play(DRIVER.write("DID_FLASH_CONFIG", {"startupImuDtMs": 1}, KNOWN), there)
    play(DRIVER.run("DID_SYS_CMD.SAVE_PERSISTENT_MESSAGES", {}, KNOWN), there)
    play(DRIVER.run("DID_SYS_CMD.SOFTWARE_RESET", {}, KNOWN), there)
    there.pass_time(5)
    device = there.device
    assert isinstance(device, IsbSimulator)
    before = dict(device.streams)
    values = read_within("streams", there)
    rows = {row["did"]: row for row in values["streams"]}
    assert rows[58]["period"] * rows[58]["source_ms"] == pytest.approx(16 if source == "nav" else 1, rel=0.05)
    expected = [{**row, "period": 3} if row["did"] == 4 else row for row in values["streams"]]
    there.sent.clear()
    written = play(DRIVER.within(DRIVER.write("streams", {"streams": expected}, KNOWN), KNOWN), there)
    assert requested_ids(there) == [4]
    assert device.streams == {**before, 4: 3}
    assert written.actual is not None
    assert DRIVER.same("streams", {"streams": expected}, written.actual) == []
    previewed = DRIVER.setting_frames("streams", {"streams": expected}, KNOWN, old=values)
    assert previewed == [frames.get_data(4, period=3)]


@each_row(("source", "multiple"), [("nav", 2), ("imu", 8)])
def test_the_chosen_rate_is_measured_for_either_source(source: str, multiple: int) -> None:
    """The document and the header disagree on what DID_IMU is timed by; 31 Hz are 31 Hz."""
    there = wire(imu_source=source)
    play(DRIVER.write("DID_FLASH_CONFIG", {"startupNavDtMs": 16, "startupImuDtMs": 4}, KNOWN), there)
    play(DRIVER.run("DID_SYS_CMD.SOFTWARE_RESET", {}, KNOWN), there)
    there.pass_time(5)
    device = there.device
    assert isinstance(device, IsbSimulator)
    expected = {"streams": [{"did": 58, "period": 2, "size": 0, "source_ms": 16.0}]}
    written = play(DRIVER.within(DRIVER.write("streams", expected, KNOWN), KNOWN), there)
    assert written.actual is not None
    row = written.actual["streams"][0]
    assert row["period"] * row["source_ms"] == pytest.approx(32, rel=0.05)
    assert device.streams == {58: multiple}
    assert DRIVER.same("streams", expected, written.actual) == []
    alone = {"streams": [{"did": 58, "period": 4}]}
    play(DRIVER.within(DRIVER.write("streams", alone, KNOWN), KNOWN), there)
    assert device.streams == {58: 4}  # a multiple alone is a multiple


def test_a_refused_stream_is_reported_with_the_others() -> None:
    there = wire()
    expected = {"streams": [{"did": 4, "period": 2}, {"did": 123, "period": 1}]}
    written = play(DRIVER.within(DRIVER.write("streams", expected, KNOWN), KNOWN), there)
    assert "DID_GPX_STATUS" in written.refused
    assert written.actual is not None
    assert {row["did"]: row["period"] for row in written.actual["streams"]} == {4: 2}


def test_a_request_to_save_is_carried_out_and_is_not_a_state() -> None:
    """The answer was "Nothing to change" to a wish to keep what streams, and of streams with it no save was sent."""
    streams = {"streams": [{"did": 4, "period": 1}], "options": 0}
    wish = {**streams, "options": PERSISTENT}
    assert DRIVER.same("streams", streams, wish) == ["options"]
    assert DRIVER.same("streams", {"options": 0}, {"options": PERSISTENT}) == ["options"]
    assert DRIVER.same("streams", wish, streams) == []  # as requested: it cannot be read back
    sentences = {"options": 0, "nmeaBroadcastMsgs": [{"msgID": 7, "msgPeriod": 1}]}
    assert DRIVER.same("DID_NMEA_BCAST_PERIOD", sentences, {**sentences, "options": PERSISTENT}) == ["options"]


def test_streams_are_saved_over_a_restart_on_request() -> None:
    for options, stored in ((1 << 9, {4}), (0, {58, 4, 5, 52, 53, 13, 30, 15})):
        there = wire()
        play(DRIVER.write("streams", {"streams": [{"did": 4, "period": 1}], "options": options}, KNOWN), there)
        play(DRIVER.run("DID_SYS_CMD.SOFTWARE_RESET", {}, KNOWN), there)
        there.pass_time(5)
        assert {row["did"] for row in read("streams", there)["streams"]} == stored


def test_options_alone_save_the_current_streams() -> None:
    there = wire()
    play(DRIVER.run("STOP_DID_BROADCAST", {"id": 58}, KNOWN), there)
    written = play(DRIVER.write("streams", {"options": 1 << 9}, KNOWN), there)
    assert written.actual is not None
    assert len(written.actual["streams"]) == 7
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


@each_row(
    ("options", "rate"),
    [
        ({"streams": [{"did": 4, "period": 1}]}, 100),
        ({"streams": [{"did": 5, "period": 3}, {"did": 15, "period": 2}]}, 200),
    ],
)
def test_the_load_is_what_the_device_sends_to_the_byte(options: dict[str, Any], rate: float) -> None:
    there = wire(rate=rate)
    written = play(DRIVER.write("streams", options, KNOWN), there)
    assert written.actual is not None
    request = DRIVER.load({"streams": written.actual}, KNOWN)
    seconds = 12  # a multiple of every period
    begin = -(-there.now_ns // S) * S + 1
    there.device.advance(begin)
    measured = len(there.device.advance(begin + seconds * S))
    assert request.total * seconds == pytest.approx(measured)
    assert sum(part.bytes_per_s for part in request.parts) == request.total


def test_the_load_follows_a_configuration_that_is_not_in_effect_yet() -> None:
    streams = {"streams": [{"did": 4, "period": 2, "size": 80, "source_ms": 10.0}]}
    assert DRIVER.load({"streams": streams}, KNOWN).total == 88 * 50
    assert DRIVER.load({"streams": streams, "DID_FLASH_CONFIG": {"startupNavDtMs": 2}}, KNOWN).total == 88 * 250
    pimu = {"streams": [{"did": 3, "period": 2}]}
    assert "cannot be changed" in DRIVER.load({"streams": pimu}, KNOWN).limits[0]


def test_streams_are_made_to_fit() -> None:
    streams = {"streams": [{"did": did, "period": 1, "source_ms": 1.0} for did in (4, 5, 58, 52)]}
    fitted = DRIVER.fit_rates({"streams": streams}, 11_520, KNOWN)
    assert DRIVER.load({"streams": streams}, KNOWN).total > 11_520 >= DRIVER.load(fitted, KNOWN).total
    assert all(row["period"] == 1 for row in streams["streams"])  # the argument is not changed
    assert DRIVER.fit_rates({"streams": streams}, 1e9, KNOWN) == {"streams": streams}
