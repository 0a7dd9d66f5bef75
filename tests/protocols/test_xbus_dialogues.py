"""Do the dialogues bring an MTi to where they should, and back, whatever it does? Played against the twin."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any

import pytest

from protocols.dialogues import Dialogue, Expect, InState, Known, RefusedError, Send, SilentError, Values, stop
from protocols.xbus import frames
from protocols.xbus.device import XbusDevice
from protocols.xbus.moods import Moods
from protocols.xbus.products import MODELS
from protocols.xbus.settings import PRODUCTS
from tests.dialogues import Wire, play
from tests.protocols.xbus_values import DRIVER, sensible


def wire(product: str = "MTi-630", *, seconds: float = 1.0, baud: int | None = None, **options: Any) -> Wire:
    """A twin that has been on for a while."""
    line = Wire(XbusDevice(product, **options), "xbus", baud)
    line.pass_time(seconds)
    return line


def phase(line: Wire) -> str:
    assert isinstance(line.device, XbusDevice)
    return line.device.phase


def known_of(line: Wire) -> Known:
    return play(DRIVER.identify(Known()), line)


def names(line: Wire) -> list[str]:
    """What was sent, by name."""
    return [DRIVER.name_of(send.frame) for send in line.sent]


# -- reading and writing -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("product", PRODUCTS)
def test_a_device_tells_who_it_is_and_goes_on_measuring(product: str) -> None:
    line = wire(product)
    known = known_of(line)
    assert known.product.startswith(product)
    assert len(known.serial_number) == 8
    assert known.firmware.count(".") == 2
    assert phase(line) == "measurement"


@pytest.mark.parametrize("product", PRODUCTS)
def test_everything_that_a_product_keeps_is_read_written_and_put_back(product: str) -> None:
    """What is read may be written as it is, and then nothing has changed."""
    line = wire(product)
    known = known_of(line)
    settings = DRIVER.settings(known)

    def body() -> Dialogue[dict[str, Values]]:
        found: dict[str, Values] = {}
        for setting in settings:
            values = yield from DRIVER.read(setting.name, known)
            assert set(values) == {field.name for field in setting.fields}, setting.name
            found[setting.name] = values
            if setting.write and values != {"outputs": []}:
                written = yield from DRIVER.write(setting.name, values, known)
                assert written.refused == "", (setting.name, written)
                assert written.got is not None
                assert DRIVER.same(setting.name, values, written.got) == []
        return found

    found = play(DRIVER.within(body(), known), line)
    assert len(found) == len(settings) >= 11
    assert phase(line) == "measurement"


CHANGES: dict[str, tuple[str, Values]] = {  # setting → product, values that are not its factory's
    "OutputConfiguration": ("MTi-630", {"outputs": [{"data_identifier": 0x2014, "output_frequency": 200}]}),
    "StringOutputType": ("MTi-680G", {"string_types": 0x4400, "frequency": 5}),
    "Period": ("MTi-30", {"period": 225}),
    "OutputSkipFactor": ("MTi-30", {"skip_factor": 4}),
    "CanOutputConfig": (
        "MTi-630",
        {"outputs": [{"can_data_id": 5, "frame_format": 1, "can_id": 0x123, "frequency": 100}]},
    ),
    "AlignmentRotation.RotSensor": ("MTi-630", {"q0": 0.0, "q1": 1.0, "q2": 0.0, "q3": 0.0}),
    "AlignmentRotation.RotLocal": ("MTi-630", {"q0": 0.6, "q1": 0.0, "q2": 0.0, "q3": 0.8}),
    "LatLonAlt": ("MTi-630", {"latitude": -33.8688197, "longitude": -179.9999, "altitude": -5.0}),
    "FilterProfile": ("MTi-630", {"profile": "Robust/VRU"}),
    "OptionFlags": ("MTi-630", {"flags": 0x80}),
    "SyncSettings": (
        "MTi-630",
        {
            "settings": [
                {
                    **{"function": 3, "line": 9, "polarity": 2, "trigger_once": 0, "skip_first": 0, "skip_factor": 0},
                    **{"pulse_width": 0, "delay_offset_or_clock_period": 7},
                }
            ]
        },
    ),
    "Baudrate": ("MTi-3", {"baudrate_code": 0x80}),
    "PortConfig": ("MTi-630", {"words": [0x1000A, 0x10002, 0]}),
    "CanConfig": ("MTi-630", {"word": 0x10C}),
    "ExtOutputMode": ("MTi-30", {"mode": 32}),
    "TransmitDelay": ("MTi-30", {"delay": 1000}),
    "GnssPlatform": ("MTi-G-710", {"platform": 8}),
    "GnssLeverArm": ("MTi-680G", {"x": 0.25, "y": -1.5, "z": 0.1}),
    "LocationID": ("MTi-630", {"location_id": 4660}),
}


def test_every_setting_that_can_be_written_is_among_the_changes() -> None:
    written = {
        setting.name
        for model in MODELS.values()
        for setting in DRIVER.settings(Known(product=model.name))
        if setting.write
    }
    assert set(CHANGES) == written


@pytest.mark.parametrize("setting", CHANGES)
def test_a_change_is_read_back_and_survives_a_restart(setting: str) -> None:
    product, values = CHANGES[setting]
    line = wire(product)
    known = known_of(line)
    before = play(DRIVER.within(DRIVER.read(setting, known), known), line)
    written = play(DRIVER.within(DRIVER.write(setting, values, known), known), line)
    assert written.refused == ""
    assert written.got is not None
    assert DRIVER.same(setting, values, written.got) == []
    assert DRIVER.same(setting, before, written.got) != []
    play(DRIVER.store_and_restart(known), line)
    line.pass_time(2)
    again = play(DRIVER.within(DRIVER.read(setting, known), known), line)
    assert DRIVER.same(setting, values, again) == []


def test_a_rate_that_the_device_altered_is_read_back_as_it_is() -> None:
    line = wire()
    known = known_of(line)
    values = {"outputs": [{"data_identifier": 0x4020, "output_frequency": 150}]}
    written = play(DRIVER.within(DRIVER.write("OutputConfiguration", values, known), known), line)
    assert written.got == {"outputs": [{"data_identifier": 0x4020, "output_frequency": 100}]}
    assert DRIVER.same("OutputConfiguration", values, written.got) == ["outputs.0.output_frequency"]


def test_no_outputs_and_no_sync_settings_are_written_and_read_as_empty_lists() -> None:
    line = wire()
    known = known_of(line)
    for setting, name in (("OutputConfiguration", "outputs"), ("SyncSettings", "settings")):
        written = play(DRIVER.within(DRIVER.write(setting, {name: []}, known), known), line)
        assert written.got == {name: []}


def test_a_refusal_is_told_in_the_documents_words_and_the_device_measures_again() -> None:
    line = wire()
    known = known_of(line)
    written = play(DRIVER.within(DRIVER.write("FilterProfile", {"profile": "Nonsense"}, known), known), line)
    assert written.refused == "parameter invalid or outside its range"
    assert written.got is None
    assert phase(line) == "measurement"


def test_option_flags_are_set_and_cleared_to_the_wanted_word() -> None:
    line = wire("MTi-3")
    known = known_of(line)
    for word in (0x90, 0x82, 0):
        written = play(DRIVER.within(DRIVER.write("OptionFlags", {"flags": word}, known), known), line)
        assert written.got == {"flags": word}


# -- every command of every product ------------------------------------------------------------------------------------


@pytest.mark.parametrize("product", PRODUCTS)
def test_every_command_of_every_product_is_answered(product: str) -> None:
    """In the state that it says it needs; refused is only what depends on something that is not there."""
    for command in DRIVER.commands(Known(product=product)):
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


def test_a_command_says_in_which_state_it_runs() -> None:
    known = Known(product="MTi-630")
    states = {
        ("ResetOrientation", 0): "config",
        ("ResetOrientation", 3): "measuring",
        ("IccCommand", 2): "config",
        ("IccCommand", 1): "measuring",
    }
    arguments = {"ResetOrientation": "code", "IccCommand": "command"}
    for (command, code), state in states.items():
        dialogue = DRIVER.run(command, {arguments[command]: code}, known)
        assert isinstance(dialogue, InState)
        assert dialogue.state == state


def test_what_may_not_be_done_twice_is_asked_once() -> None:
    """A second AdjustUTCTime after a lost acknowledgement would move the clock twice."""
    line = Wire(Deaf(), "xbus")
    with pytest.raises(SilentError) as silent:
        play(DRIVER.run("AdjustUTCTime", {"correction": 5}, Known()), line)
    assert silent.value.tries == 1
    assert names(line) == ["AdjustUTCTime"]


# -- devices that do not do as they should -----------------------------------------------------------------------------


class Deaf:
    """Says nothing, ever."""

    baud = 115_200

    def advance(self, now_ns: int) -> bytes:
        return b""

    def receive(self, data: bytes, now_ns: int) -> bytes:
        return b""


class Between:
    """A twin whose answers something happens to."""

    def __init__(self, **options: Any) -> None:
        self.device = XbusDevice(**options)
        self.answers = 0

    @property
    def baud(self) -> int:
        return self.device.baud

    def advance(self, now_ns: int) -> bytes:
        return self.device.advance(now_ns)

    def receive(self, data: bytes, now_ns: int) -> bytes:
        answer = self.device.receive(data, now_ns)
        self.answers += 1
        return self.spoil(answer, now_ns)

    def spoil(self, answer: bytes, now_ns: int) -> bytes:
        return answer


def test_a_stubborn_device_is_reset_and_its_wake_up_answered() -> None:
    line = wire(moods=Moods(stubborn=True))
    known = Known(product="MTi-630")
    assert play(DRIVER.within(DRIVER.read("LocationID", known), known), line) == {"location_id": 0}
    sent = names(line)
    assert sent.count("Reset") == 1
    assert "WakeUpAck" in sent[sent.index("Reset") :]
    assert sent[-1] == "GoToMeasurement"
    assert phase(line) == "measurement"
    assert line.now_ns < 5e9


def test_a_device_that_is_just_starting_is_kept_in_config() -> None:
    line = Wire(XbusDevice(start_ns=50_000_000), "xbus")
    known = Known(product="MTi-630")
    play(DRIVER.within(DRIVER.read("LocationID", known), known), line)
    assert names(line)[:2] == ["GoToConfig", "WakeUpAck"]


def test_silence_is_told_with_what_was_asked_and_how_often() -> None:
    line = Wire(Deaf(), "xbus")
    with pytest.raises(SilentError, match="No answer to GoToConfig") as silent:
        play(DRIVER.within(DRIVER.read("LocationID", Known()), Known()), line)
    assert silent.value.tries == 45
    assert line.now_ns == pytest.approx(4.5e9, rel=0.01)


def test_an_answer_that_is_lost_is_asked_for_again() -> None:
    class Lossy(Between):
        def spoil(self, answer: bytes, now_ns: int) -> bytes:
            return b"" if self.answers % 2 else answer

    line = Wire(Lossy(), "xbus")
    line.pass_time(1)
    known = Known(product="MTi-630")
    written = play(DRIVER.within(DRIVER.write("LocationID", {"location_id": 7}, known), known), line)
    assert written.got == {"location_id": 7}


def test_a_late_acknowledgement_of_a_set_is_not_taken_for_values() -> None:
    """Both have one number; an empty one holds no values."""

    class Late(Between):
        held = b""

        def spoil(self, answer: bytes, now_ns: int) -> bytes:
            late, self.held = self.held, answer
            return late

    line = Wire(Late(), "xbus")
    line.pass_time(1)
    known = Known(product="MTi-630")
    line.device.receive(frames.build(0x30), line.now_ns)
    written = play(DRIVER.write("LocationID", {"location_id": 7}, known), line)
    assert written.got == {"location_id": 7}


def test_a_device_that_stops_answering_is_told_of_and_left_measuring_where_it_hears() -> None:
    class Mute(Between):
        def spoil(self, answer: bytes, now_ns: int) -> bytes:
            return b"" if b"\xfa\xff\x85" in answer else answer

    line = Wire(Mute(), "xbus")
    line.pass_time(1)
    known = Known(product="MTi-630")
    with pytest.raises(SilentError, match="ReqLocationID"):
        play(DRIVER.within(DRIVER.read("LocationID", known), known), line)
    assert names(line)[-1] == "GoToMeasurement"


def test_a_stopped_dialogue_still_tells_the_device_to_measure() -> None:
    """The browser has gone, the job is stopped: what remains to be written is GoToMeasurement."""
    line = wire()
    known = Known(product="MTi-630")

    def body() -> Dialogue[None]:
        yield from DRIVER.read("LocationID", known)
        yield from DRIVER.read("LatLonAlt", known)

    dialogue = DRIVER.within(body(), known)
    act = next(dialogue)
    while not (isinstance(act, Send) and DRIVER.name_of(act.frame) == "ReqLatLonAlt"):
        act = dialogue.send(line.do(act))
    assert phase(line) == "config"
    for send in stop(dialogue):
        line.write(send)
    assert names(line)[-1] == "GoToMeasurement"
    assert phase(line) == "measurement"


def test_an_error_of_the_device_has_its_detail() -> None:
    class Broken(Between):
        def spoil(self, answer: bytes, now_ns: int) -> bytes:
            return frames.build(0x42, struct.pack(">BI", 40, 6))

    line = Wire(Broken(), "xbus")
    with pytest.raises(RefusedError, match="DSP crashed") as refused:
        play(DRIVER.run("ReqDID", {}, Known()), line)
    assert refused.value.code == 40


def test_answers_that_get_lost_or_say_something_else_are_asked_for_again() -> None:
    """Three tries each: with one answer in five lost and one in ten another, a few hundred exchanges go through."""
    line = wire(moods=Moods(mute=0.2, wrong=0.1), seed=5)
    known = Known(product="MTi-630")
    done = failed = 0
    for number in range(60):
        try:
            written = play(DRIVER.within(DRIVER.write("LocationID", {"location_id": number}, known), known), line)
        except SilentError:
            failed += 1
        else:
            assert written.got == {"location_id": number}
            done += 1
    assert done > 45
    assert failed < 15


def test_answers_that_are_late_are_still_the_right_ones() -> None:
    """Each comes when the next try is on its way: what is read back is what was written."""
    line = wire(moods=Moods(late_ns=700_000_000))
    known = Known(product="MTi-630")
    for number in (7, 8):
        written = play(DRIVER.within(DRIVER.write("LocationID", {"location_id": number}, known), known), line)
        assert written.got == {"location_id": number}


def test_power_that_fails_before_a_setting_is_stored_leaves_the_old_one() -> None:
    line = wire(moods=Moods(cut=1))
    known = Known(product="MTi-630")
    written = play(DRIVER.within(DRIVER.write("LocationID", {"location_id": 7}, known), known), line)
    assert written.refused == "the device restarted before it answered"
    line.pass_time(2)
    assert phase(line) == "measurement"
    assert play(DRIVER.within(DRIVER.read("LocationID", known), known), line) == {"location_id": 0}
    written = play(DRIVER.within(DRIVER.write("LocationID", {"location_id": 7}, known), known), line)
    assert written.got == {"location_id": 7}


# -- the line ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("product", "setting"), [("MTi-630", "PortConfig"), ("MTi-30", "Baudrate")])
def test_a_new_rate_acts_after_the_restart_and_the_device_is_found_there(product: str, setting: str) -> None:
    line = wire(product, baud=115_200)
    known = Known(product=product, baud=115_200)
    values: Values = CHANGES[setting][1]
    change = DRIVER.line_change(setting, None, values, known)
    assert change is not None
    assert (change.kind, change.baud) == ("baud", 921_600)
    assert "921 600 Bd" in change.words
    play(DRIVER.within(DRIVER.write(setting, values, known), known), line)
    play(DRIVER.store_and_restart(known), line)
    assert names(line)[-1] == "Reset"
    line.relink(921_600)
    assert play(DRIVER.alive(known), line)
    line.relink(115_200)
    assert not play(DRIVER.alive(known), line)


def test_a_device_that_sends_nothing_is_alive_all_the_same() -> None:
    line = wire()
    known = Known(product="MTi-630")
    play(DRIVER.within(DRIVER.write("OutputConfiguration", {"outputs": []}, known), known), line)
    assert play(DRIVER.alive(known), line)
    assert phase(line) == "measurement"
    assert not play(DRIVER.alive(known), Wire(Deaf(), "xbus"))


class Switched(Between):
    """A device whose power a person switches off and on while 0xDE comes."""

    def __init__(self) -> None:
        super().__init__(baud=921_600)
        self.off_s, self.on_s = 2.0, 4.0
        self.on = False

    @property
    def baud(self) -> int:
        return self.device.baud

    def advance(self, now_ns: int) -> bytes:
        if self.off_s * 1e9 <= now_ns < self.on_s * 1e9:
            return b""
        if now_ns >= self.on_s * 1e9 and not self.on:
            self.on, self.device = True, self.device.repowered(now_ns)
        return self.device.advance(now_ns)


def test_communication_is_restored_while_somebody_switches_the_power() -> None:
    line = Wire(Switched(), "xbus", 230_400, step_ns=300_000)
    assert play(DRIVER.restore_communication(Known()), line)
    assert line.baud == 115_200
    assert "WakeUpAck" in names(line)
    assert play(DRIVER.alive(Known()), line)


def test_a_restore_that_nobody_helps_ends() -> None:
    line = Wire(Deaf(), "xbus", step_ns=1_000_000_000)
    assert not play(DRIVER.restore_communication(Known()), line)
    assert line.now_ns == pytest.approx(60e9, rel=0.01)


LINE_CHANGES: list[tuple[str, str, Values | None, Values, str | None]] = [
    ("MTi-3", "Baudrate", {"baudrate_code": 2}, {"baudrate_code": 10}, "baud"),
    ("MTi-3", "Baudrate", {"baudrate_code": 10}, {"baudrate_code": 0x80}, None),  # the same rate
    ("MTi-3", "Baudrate", None, {"baudrate_code": 2}, None),
    ("MTi-630", "PortConfig", {"words": [0x10002, 0x10002, 0]}, {"words": [0x10002, 0x10002, 5]}, None),
    ("MTi-630", "PortConfig", {"words": [0x10002, 0x10002, 0]}, {"words": [0x50002, 0x10002, 0]}, "protocol"),
    ("MTi-630", "PortConfig", {"words": [0x10002, 0x10002, 0]}, {"words": [2, 0x10002, 0]}, "port"),
    ("MTi-630", "PortConfig", {"words": [0x10002, 0x10002, 0]}, {"words": [0x10102, 0x10002, 0]}, "port"),
    ("MTi-630", "PortConfig", {"words": [0x1000A, 0x10002, 0]}, {"words": [0x1000A, 0x1000A, 0]}, "baud"),
    ("MTi-630", "OutputConfiguration", None, {"outputs": []}, "silent"),
    ("MTi-630", "OutputConfiguration", None, CHANGES["OutputConfiguration"][1], None),
    ("MTi-630", "StringOutputType", None, {"string_types": 1, "frequency": 1}, "protocol"),
    ("MTi-630", "StringOutputType", None, {"string_types": 0, "frequency": 1}, None),
    ("MTi-30", "ExtOutputMode", {"mode": 0}, {"mode": 16}, "port"),
    ("MTi-30", "ExtOutputMode", {"mode": 0}, {"mode": 32}, None),
    ("MTi-30", "OutputSkipFactor", None, {"skip_factor": 65535}, "silent"),
    ("MTi-3", "OptionFlags", {"flags": 0}, {"flags": 2}, "silent"),
    ("MTi-3", "OptionFlags", {"flags": 2}, {"flags": 3}, None),
    ("MTi-630", "LocationID", None, {"location_id": 1}, None),
]


@pytest.mark.parametrize(("product", "setting", "old", "new", "kind"), LINE_CHANGES)
def test_what_could_cut_the_line_is_known_before_it_is_written(
    product: str, setting: str, old: Values | None, new: Values, kind: str | None
) -> None:
    change = DRIVER.line_change(setting, old, new, Known(product=product, baud=115_200))
    assert (change.kind if change else None) == kind
    assert change is None or change.words.endswith(".")


# -- what is the same, and what the factory set ------------------------------------------------------------------------


@pytest.mark.parametrize("product", PRODUCTS)
def test_the_factory_values_can_be_written_and_are_accepted(product: str) -> None:
    line = wire(product)
    known = known_of(line)
    factory = DRIVER.factory(known)
    assert set(factory) <= {setting.name for setting in DRIVER.settings(known)}
    assert "OutputConfiguration" in factory

    def body() -> Dialogue[None]:
        for setting, values in factory.items():
            if "string_types" not in values:  # 0 is what it is
                written = yield from DRIVER.write(setting, values, known)
                assert written.refused == "", (setting, written)
                assert written.got is not None
                assert DRIVER.same(setting, values, written.got) == [], setting

    play(DRIVER.within(body(), known), line)


def test_an_unknown_product_has_no_known_factory_values() -> None:
    assert DRIVER.factory(Known()) == {}


def test_the_order_of_outputs_and_two_names_of_a_rate_mean_nothing() -> None:
    one = {"data_identifier": 0x2010, "output_frequency": 100}
    two = {"data_identifier": 0x1020, "output_frequency": 0}
    also_two = {"data_identifier": 0x1020, "output_frequency": 0xFFFF}
    assert DRIVER.same("OutputConfiguration", {"outputs": [one, two]}, {"outputs": [also_two, one]}) == []
    assert DRIVER.same("OutputConfiguration", {"outputs": [one]}, {"outputs": [one, two]}) == ["outputs.1"]
    assert DRIVER.same("LatLonAlt", {"latitude": 1.0}, {"latitude": 1.0000000001}) == []
    assert DRIVER.same("FilterProfile", {"profile": "A"}, {"profile": "a"}) == ["profile"]
    assert DRIVER.same("FilterProfile", {"profile": 39}, {"profile": 39, "version": 1}) == []


def waits(dialogue: Dialogue[Any]) -> Iterator[Expect]:
    """The expectations of a dialogue that nobody answers."""
    try:
        act = next(dialogue)
        while True:
            if isinstance(act, Expect):
                yield act
            act = dialogue.send(None)
    except (StopIteration, SilentError):
        return


def test_waits_are_as_long_as_the_vendors_software_waits() -> None:
    known = Known(product="MTi-30")
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
