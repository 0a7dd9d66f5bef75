"""Transactions bring an MTi to the requested state and back, whatever it does. Played against the simulator."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any

import pytest

from imuscope.protocols.commands.transactions import (
    DeviceContext,
    DeviceRejectedError,
    NoReplyError,
    RequiresState,
    Send,
    Transaction,
    Values,
    WaitFor,
    cancel,
)
from imuscope.protocols.events import Reply
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.schema.layouts import EncodeError
from imuscope.protocols.xbus import frames, requests
from imuscope.protocols.xbus.device_info import identity
from imuscope.protocols.xbus.products import MODELS
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.protocols.xbus.simulator.faults import FaultInjection
from imuscope.protocols.xbus.simulator.settings import PRODUCTS
from tests.protocols.xbus.xbus_simulators import CHANGES, Between, DeafXbusDevice, known_of, names, phase, wire
from tests.protocols.xbus.xbus_values import DRIVER, sensible
from tests.support.each_row import each_row
from tests.support.transaction_player import PlayedWire, play

# -- reading and writing -----------------------------------------------------------------------------------------------


@each_row("product", PRODUCTS)
def test_a_device_is_identified_and_continues_measuring(product: str) -> None:
    line = wire(product)
    known = known_of(line)
    assert known.product.startswith(product)
    long = known.serial_number.startswith("00808")  # 64 bits, as the 600-series has them
    assert len(known.serial_number) == (10 if long else 8)
    assert long == (PRODUCTS[product].series == 600)
    assert known.firmware.count(".") == 2
    assert phase(line) == "measurement"


@each_row("product", PRODUCTS)
def test_every_stored_setting_of_a_product_is_read_written_and_restored(product: str) -> None:
    """Values that were read can be written unchanged, without any effect."""
    line = wire(product)
    known = known_of(line)
    settings = DRIVER.settings(known)

    def body() -> Transaction[dict[str, Values]]:
        results: dict[str, Values] = {}
        for setting in settings:
            values = yield from DRIVER.read(setting.name, known)
            assert set(values) == {field.name for field in setting.fields}, setting.name
            results[setting.name] = values
            if setting.write and values != {"outputs": []}:
                written = yield from DRIVER.write(setting.name, values, known)
                assert written.refused == "", (setting.name, written)
                assert written.actual is not None
                assert DRIVER.same(setting.name, values, written.actual) == []
        return results

    results = play(DRIVER.within(body(), known), line)
    assert len(results) == len(settings) >= 11
    assert phase(line) == "measurement"


def test_every_setting_that_can_be_written_is_among_the_changes() -> None:
    written = {
        setting.name
        for model in MODELS.values()
        for setting in DRIVER.settings(DeviceContext(product=model.name))
        if setting.write
    }
    assert set(CHANGES) == written


@each_row("setting", CHANGES)
def test_a_change_is_read_back_and_survives_a_restart(setting: str) -> None:
    product, values = CHANGES[setting]
    line = wire(product)
    known = known_of(line)
    before = play(DRIVER.within(DRIVER.read(setting, known), known), line)
    written = play(DRIVER.within(DRIVER.write(setting, values, known), known), line)
    assert written.refused == ""
    assert written.actual is not None
    assert DRIVER.same(setting, values, written.actual) == []
    assert DRIVER.same(setting, before, written.actual) != []
    play(DRIVER.store_and_restart(known), line)
    line.pass_time(2)
    again = play(DRIVER.within(DRIVER.read(setting, known), known), line)
    assert DRIVER.same(setting, values, again) == []


def test_a_rate_that_the_device_altered_is_read_back_as_it_is() -> None:
    line = wire()
    known = known_of(line)
    values = {"outputs": [{"data_identifier": 0x4020, "output_frequency": 150}]}
    written = play(DRIVER.within(DRIVER.write("OutputConfiguration", values, known), known), line)
    assert written.actual == {"outputs": [{"data_identifier": 0x4020, "output_frequency": 100}]}
    assert DRIVER.same("OutputConfiguration", values, written.actual) == ["outputs.0.output_frequency"]


def test_no_outputs_and_no_sync_settings_are_written_and_read_as_empty_lists() -> None:
    line = wire()
    known = known_of(line)
    for setting, name in (("OutputConfiguration", "outputs"), ("SyncSettings", "settings")):
        written = play(DRIVER.within(DRIVER.write(setting, {name: []}, known), known), line)
        assert written.actual == {name: []}


def test_a_refusal_has_the_documented_text_and_measurement_resumes() -> None:
    line = wire()
    known = known_of(line)
    written = play(DRIVER.within(DRIVER.write("FilterProfile", {"profile": "Nonsense"}, known), known), line)
    assert written.refused == "parameter invalid or outside its range"
    assert written.actual is None
    assert phase(line) == "measurement"


def test_option_flags_are_set_and_cleared_to_the_wanted_word() -> None:
    line = wire("MTi-3")
    known = known_of(line)
    for word in (0x90, 0x82, 0):
        written = play(DRIVER.within(DRIVER.write("OptionFlags", {"flags": word}, known), known), line)
        assert written.actual == {"flags": word}


# -- every command of every product ------------------------------------------------------------------------------------


@each_row("product", PRODUCTS)
def test_every_command_of_every_product_is_answered(product: str) -> None:
    """Each command in its required state; only those that depend on missing data are refused."""
    for command in DRIVER.commands(DeviceContext(product=product)):
        line = wire(product)
        known = known_of(line)
        if command.name == "ReqData":
            software = {"settings": [{**dict.fromkeys(SYNC_FIELDS, 0), "function": 8, "line": 6, "polarity": 1}]}
            play(DRIVER.within(DRIVER.write("SyncSettings", software, known), known), line)
            line.pass_time(0.1)
        if command.name == "WakeUpAck":
            play(DRIVER.run("Reset", {}, known), line)
            line.pass_time(0.4)
        values = dict(sensible(command, known))
        play(DRIVER.within(DRIVER.run(command.name, values, known), known), line)
        if command.name == "GoToConfig" or command.name == "WakeUpAck":
            assert phase(line) == "config"
        elif command.name == "Reset":
            assert phase(line) == "boot"
        else:
            assert phase(line) == "measurement", command.name


SYNC_FIELDS = (
    *("function", "line", "polarity", "trigger_once", "skip_first", "skip_factor", "pulse_width"),
    "delay_offset_or_clock_period",
)


def test_a_command_states_in_which_state_it_runs() -> None:
    known = DeviceContext(product="MTi-630")
    states = {
        ("ResetOrientation", 0): "config",
        ("ResetOrientation", 3): "measuring",
        ("IccCommand", 2): "config",
        ("IccCommand", 1): "measuring",
    }
    arguments = {"ResetOrientation": "code", "IccCommand": "command"}
    for (command, code), state in states.items():
        dialogue = DRIVER.run(command, {arguments[command]: code}, known)
        assert isinstance(dialogue, RequiresState)
        assert dialogue.state == state


def alignments(line: PlayedWire, known: DeviceContext) -> tuple[Values, Values]:
    """Stored alignments: sensor rotation and local frame rotation."""

    def body() -> Transaction[tuple[Values, Values]]:
        sensor = yield from DRIVER.read("AlignmentRotation.RotSensor", known)
        return sensor, (yield from DRIVER.read("AlignmentRotation.RotLocal", known))

    return play(DRIVER.within(body(), known), line)


UNITY = {"q0": 1.0, "q1": 0.0, "q2": 0.0, "q3": 0.0}


def test_an_orientation_reset_that_is_not_stored_is_discarded_when_measuring_begins() -> None:
    line = wire(seconds=5.0)
    known = known_of(line)
    play(DRIVER.within(DRIVER.run("ResetOrientation", {"code": 4}, known), known), line)
    play(DRIVER.within(DRIVER.read("LocationID", known), known), line)
    play(DRIVER.within(DRIVER.run("ResetOrientation", {"code": 0}, known), known), line)
    assert alignments(line, known) == (UNITY, UNITY)


@each_row("stubborn", [False, True])
def test_an_orientation_reset_is_stored_by_the_code_that_stores_it(stubborn: bool) -> None:
    """No message is sent between the two, not even the Reset of a device that ignores GoToConfig."""
    line = wire(seconds=5.0, measuring=True, moods=FaultInjection(ignores_goto_config=stubborn))
    known = DeviceContext(product="MTi-630")
    play(DRIVER.within(DRIVER.run("ResetOrientation", {"code": 4}, known), known), line)
    store = DRIVER.within(DRIVER.run("ResetOrientation", {"code": 0}, known), known)
    if stubborn:
        with pytest.raises(NoReplyError, match="GoToConfig"):
            play(store, line)
        assert "Reset" not in names(line)
        return
    play(store, line)
    assert names(line) == ["ResetOrientation", "GoToConfig", "ResetOrientation", "GoToMeasurement"]
    sensor, local = alignments(line, known)
    assert UNITY not in (sensor, local)


def test_an_orientation_is_reset_and_stored_in_one_action() -> None:
    line = wire(seconds=5.0)
    known = known_of(line)
    line.sent.clear()
    play(DRIVER.within(DRIVER.run("ResetOrientation.Stored", {"code": 3}, known), known), line)
    assert names(line) == ["ResetOrientation", "GoToConfig", "ResetOrientation", "GoToMeasurement"]
    assert phase(line) == "measurement"
    sensor, local = alignments(line, known)
    assert sensor != UNITY
    assert local == UNITY


def test_a_measuring_command_sends_no_gotomeasurement_to_a_streaming_device() -> None:
    """It is an error to it, and stood in the log before every such command."""
    line = wire()
    known = known_of(line)
    line.sent.clear()
    play(DRIVER.within(DRIVER.run("SetNoRotation", {"duration": 1}, known), known), line)
    assert names(line) == ["SetNoRotation"]


def test_a_failed_read_restores_measurement() -> None:
    """Regression: all answers were lost; the device had received GoToConfig and stayed silent."""

    class Unheard(Between):
        def spoil(self, answer: bytes, now_ns: int) -> bytes:
            return b""

    line = PlayedWire(Unheard(), "xbus")
    line.pass_time(1)
    with pytest.raises(NoReplyError, match="not restarted"):
        play(DRIVER.within(DRIVER.read("LocationID", DeviceContext()), DeviceContext()), line)
    assert names(line)[-1] == "GoToMeasurement"
    line.pass_time(2)
    assert isinstance(line.device, Unheard)
    assert line.device.device.phase == "measurement"


def test_a_sample_that_was_streamed_is_not_the_answer_to_a_request_that_is_refused() -> None:
    """Regression: without SendLatest the device refuses after samples that were already sent, but the job reported
    "Done.".
    """
    line = wire(moods=FaultInjection(late_ns=30_000_000))
    with pytest.raises(DeviceRejectedError, match="ReqData"):
        play(DRIVER.within(DRIVER.run("ReqData", {}, DeviceContext(product="MTi-630")), DeviceContext()), line)


def test_a_period_longer_than_ten_milliseconds_is_made_of_skips() -> None:
    line = wire("MTi-30")
    known = known_of(line)

    def body() -> Transaction[tuple[Values | None, Values]]:
        written = yield from DRIVER.write("Period", {"period": 2304}, known)
        return written.actual, (yield from DRIVER.read("OutputSkipFactor", known))

    assert play(DRIVER.within(body(), known), line) == ({"period": 1152}, {"skip_factor": 1})
    with pytest.raises(EncodeError, match="multiple of 1152"):
        DRIVER.setting_frames("Period", {"period": 2000}, known)


def test_a_serial_number_of_64_bits_is_the_same_in_every_message() -> None:
    """Configuration has the low word first: before and after a reading one device was two."""
    line = wire("MTi-680G", serial=0x80AB_CDEF)
    line.device.receive(frames.build(0x30), line.now_ns)
    messages = []
    for number in (0x00, 0x0C):
        decoder = PROTOCOLS["xbus"].decoding.decoder()
        decoder.feed(line.device.receive(frames.build(number), line.now_ns), 0)
        messages += [identity(event)["serial_number"] for event in decoder.drain() if isinstance(event, Reply)]
    assert messages == ["0080ABCDEF"] * 2
    assert DRIVER.formerly("0080ABCDEF") == ("80ABCDEF", "80ABCDEF00000000")
    assert DRIVER.formerly("03880001") == ()


def test_unrepeatable_commands_are_sent_once() -> None:
    """A second AdjustUTCTime after a lost acknowledgement would move the clock twice."""
    line = PlayedWire(DeafXbusDevice(), "xbus")
    with pytest.raises(NoReplyError) as silent:
        play(DRIVER.run("AdjustUTCTime", {"correction": 5}, DeviceContext()), line)
    assert silent.value.attempts == 1
    assert names(line) == ["AdjustUTCTime"]


# -- devices that do not do as they should -----------------------------------------------------------------------------


@each_row("writes", [False, True])
def test_a_stubborn_device_is_never_restarted_unasked(writes: bool) -> None:
    """A read restarted a device that ignored GoToConfig: clock, counter and filter with it."""
    line = wire(measuring=True, moods=FaultInjection(ignores_goto_config=True))
    known = DeviceContext(product="MTi-630")
    body: Transaction[Any] = DRIVER.read("LocationID", known)
    if writes:
        body = DRIVER.write("LocationID", {"location_id": 1}, known)
    with pytest.raises(NoReplyError, match="not restarted: run the command Reset if that is what you want"):
        play(DRIVER.within(body, known), line)
    assert "Reset" not in names(line)
    assert phase(line) == "measurement"
    play(DRIVER.within(DRIVER.run("Reset", {}, known), known), line)
    assert play(DRIVER.within(DRIVER.read("LocationID", known), known), line) == {"location_id": 0}


def test_a_device_is_left_in_the_state_in_which_it_was_found() -> None:
    """Whatever another program had begun in the config state was broken off by a read: the device measured again."""
    line = wire(measuring=True)
    known = DeviceContext(product="MTi-630")
    play(DRIVER.within(DRIVER.read("LocationID", known), known), line)
    assert phase(line) == "measurement"
    line.device.receive(frames.build(0x30), line.now_ns)
    play(DRIVER.within(DRIVER.read("LocationID", known), known), line)
    assert phase(line) == "config"
    with pytest.raises(DeviceRejectedError):
        play(DRIVER.within(requests.send_request(frames.build(0xF0), "0xF0", 0.5), known), line)
    assert phase(line) == "config"


def test_a_device_that_is_just_starting_is_kept_in_config() -> None:
    line = PlayedWire(XbusSimulator(start_ns=50_000_000), "xbus")
    known = DeviceContext(product="MTi-630")
    play(DRIVER.within(DRIVER.read("LocationID", known), known), line)
    assert names(line)[:3] == ["ReqDID", "WakeUpAck", "GoToConfig"]
    assert phase(line) == "measurement"


def test_silence_is_reported_with_request_and_attempts() -> None:
    line = PlayedWire(DeafXbusDevice(), "xbus")
    with pytest.raises(NoReplyError, match="No answer to GoToConfig") as silent:
        play(DRIVER.within(DRIVER.read("LocationID", DeviceContext()), DeviceContext()), line)
    assert silent.value.attempts == 20
    assert line.now_ns == pytest.approx(0.2e9 + 2e9 + 3 * 0.5e9, rel=0.01)


def test_a_device_that_does_not_answer_is_not_called_back_in_its_state() -> None:
    line = PlayedWire(DeafXbusDevice(), "xbus")
    with pytest.raises(NoReplyError):
        play(DRIVER.within(DRIVER.read("LocationID", DeviceContext()), DeviceContext()), line)
    assert line.put_back == [(frames.build(0x10),)]


def test_a_lost_answer_is_requested_again() -> None:
    class Lossy(Between):
        def spoil(self, answer: bytes, now_ns: int) -> bytes:
            return b"" if self.answers % 2 else answer

    line = PlayedWire(Lossy(), "xbus")
    line.pass_time(1)
    known = DeviceContext(product="MTi-630")
    written = play(DRIVER.within(DRIVER.write("LocationID", {"location_id": 7}, known), known), line)
    assert written.actual == {"location_id": 7}


def test_a_late_acknowledgement_of_a_set_is_not_taken_for_values() -> None:
    """Both have one number; an empty one holds no values."""

    class Late(Between):
        held = b""

        def spoil(self, answer: bytes, now_ns: int) -> bytes:
            late, self.held = self.held, answer
            return late

    line = PlayedWire(Late(), "xbus")
    line.pass_time(1)
    known = DeviceContext(product="MTi-630")
    line.device.receive(frames.build(0x30), line.now_ns)
    written = play(DRIVER.write("LocationID", {"location_id": 7}, known), line)
    assert written.actual == {"location_id": 7}


def test_a_device_that_stops_answering_is_reported_and_left_measuring() -> None:
    class Mute(Between):
        def spoil(self, answer: bytes, now_ns: int) -> bytes:
            return b"" if b"\xfa\xff\x85" in answer else answer

    line = PlayedWire(Mute(), "xbus")
    line.pass_time(1)
    known = DeviceContext(product="MTi-630")
    with pytest.raises(NoReplyError, match="ReqLocationID"):
        play(DRIVER.within(DRIVER.read("LocationID", known), known), line)
    assert names(line)[-1] == "GoToMeasurement"


def test_a_stopped_transaction_still_restores_measurement() -> None:
    """If the browser disconnects and the job is stopped, GoToMeasurement is still sent."""
    line = wire()
    known = DeviceContext(product="MTi-630")

    def body() -> Transaction[None]:
        yield from DRIVER.read("LocationID", known)
        yield from DRIVER.read("LatLonAlt", known)

    dialogue = DRIVER.within(body(), known)
    act = next(dialogue)
    while not (isinstance(act, Send) and DRIVER.name_of(act.frame) == "ReqLatLonAlt"):
        act = dialogue.send(line.do(act))
    assert phase(line) == "config"
    for send in cancel(dialogue):
        line.write(send)
    assert names(line)[-1] == "GoToMeasurement"
    assert phase(line) == "measurement"


def test_an_error_of_the_device_has_its_detail() -> None:
    class Broken(Between):
        def spoil(self, answer: bytes, now_ns: int) -> bytes:
            return frames.build(0x42, struct.pack(">BI", 40, 6))

    line = PlayedWire(Broken(), "xbus")
    with pytest.raises(DeviceRejectedError, match="DSP crashed") as refused:
        play(DRIVER.run("ReqDID", {}, DeviceContext()), line)
    assert refused.value.code == 40


def test_lost_or_unrelated_answers_are_requested_again() -> None:
    """Three attempts each: with one answer in five lost and one in ten another, a few hundred exchanges go through."""
    line = wire(moods=FaultInjection(drop_share=0.2, corrupt_share=0.1), seed=5)
    known = DeviceContext(product="MTi-630")
    done = failed = 0
    for number in range(60):
        try:
            written = play(DRIVER.within(DRIVER.write("LocationID", {"location_id": number}, known), known), line)
        except NoReplyError:
            failed += 1
        else:
            assert written.actual == {"location_id": number}
            done += 1
    assert done > 45
    assert failed < 15


def test_late_answers_are_matched_to_their_requests() -> None:
    """Each answer arrives after the next attempt was sent; the value read back is the written one."""
    line = wire(moods=FaultInjection(late_ns=700_000_000))
    known = DeviceContext(product="MTi-630")
    for number in (7, 8):
        written = play(DRIVER.within(DRIVER.write("LocationID", {"location_id": number}, known), known), line)
        assert written.actual == {"location_id": number}


def waits(dialogue: Transaction[Any]) -> Iterator[WaitFor]:
    """Waits of a transaction without answers."""
    try:
        act = next(dialogue)
        while True:
            if isinstance(act, WaitFor):
                yield act
            act = dialogue.send(None)
    except (StopIteration, NoReplyError):
        return


def test_waits_are_as_long_as_the_vendors_software_waits() -> None:
    known = DeviceContext(product="MTi-30")
    waited = {
        "RunSelftest": 3.0,
        "RestoreFactoryDef": 2.0,
        "SetBaudrate": 1.0,
        "ReqConfiguration": 5.0,
        "IccCommand": 3.5,
        "ReqDID": 0.5,
    }
    rows = {command.name: command for command in DRIVER.commands(known)}
    for name, seconds in waited.items():
        acts = list(waits(DRIVER.run(name, sensible(rows[name], known), known)))
        assert {act.timeout_s for act in acts} == {seconds}, name
