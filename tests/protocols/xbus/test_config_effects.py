"""Effects of a change on the link, rediscovery of the device, and factory settings."""

import pytest

from imuscope.protocols.commands.transactions import DeviceContext, Transaction, Values
from imuscope.protocols.xbus.simulator.settings import PRODUCTS
from tests.protocols.xbus.xbus_simulators import CHANGES, Between, DeafXbusDevice, known_of, names, phase, wire
from tests.protocols.xbus.xbus_values import DRIVER
from tests.support.each_row import each_row
from tests.support.transaction_player import PlayedWire, play

# -- the line ----------------------------------------------------------------------------------------------------------


@each_row(("product", "setting"), [("MTi-630", "PortConfig"), ("MTi-30", "Baudrate")])
def test_a_new_rate_acts_after_the_restart_and_the_device_is_found_there(product: str, setting: str) -> None:
    line = wire(product, baud=115_200)
    known = DeviceContext(product=product, baud=115_200)
    values: Values = CHANGES[setting][1]
    change = DRIVER.line_change(setting, None, values, known)
    assert change is not None
    assert (change.kind, change.baud) == ("baud", 921_600)
    assert "921 600 Bd" in change.words
    play(DRIVER.within(DRIVER.write(setting, values, known), known), line)
    play(DRIVER.store_and_restart(known), line)
    assert names(line)[-1] == "Reset"
    line.relink(921_600)
    assert play(DRIVER.is_alive(known), line)
    line.relink(115_200)
    assert not play(DRIVER.is_alive(known), line)


def test_a_silent_device_is_found_alive() -> None:
    line = wire()
    known = DeviceContext(product="MTi-630")
    play(DRIVER.within(DRIVER.write("OutputConfiguration", {"outputs": []}, known), known), line)
    assert play(DRIVER.is_alive(known), line)
    assert phase(line) == "measurement"
    assert not play(DRIVER.is_alive(known), PlayedWire(DeafXbusDevice(), "xbus"))


class Switched(Between):
    """A device that is power-cycled while 0xDE is sent."""

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


def test_communication_is_restored_during_a_power_cycle() -> None:
    line = PlayedWire(Switched(), "xbus", 230_400, step_ns=300_000)
    assert play(DRIVER.restore_communication(DeviceContext()), line)
    assert line.baud == 115_200
    assert "WakeUpAck" in names(line)
    assert play(DRIVER.is_alive(DeviceContext()), line)


def test_a_restore_without_a_power_cycle_ends() -> None:
    line = PlayedWire(DeafXbusDevice(), "xbus", step_ns=1_000_000_000)
    assert not play(DRIVER.restore_communication(DeviceContext()), line)
    assert line.now_ns == pytest.approx(60e9, rel=0.01)


SEND_LATEST = {
    **{"function": 8, "line": 6, "polarity": 1, "trigger_once": 0, "skip_first": 0, "skip_factor": 0},
    **{"pulse_width": 0, "delay_offset_or_clock_period": 0},
}
LINE_CHANGES: list[tuple[str, str, Values | None, Values, str | None]] = [
    ("MTi-3", "Baudrate", {"baudrate_code": 2}, {"baudrate_code": 10}, "baud"),
    ("MTi-3", "Baudrate", {"baudrate_code": 10}, {"baudrate_code": 0x80}, None),  # the same rate
    ("MTi-3", "Baudrate", None, {"baudrate_code": 2}, None),
    ("MTi-630", "PortConfig", {"words": [0x10002, 0x10002, 0]}, {"words": [0x10002, 0x10002, 5]}, None),
    ("MTi-630", "PortConfig", {"words": [0x10002, 0x10002, 0]}, {"words": [0x50002, 0x10002, 0]}, "protocol"),
    ("MTi-630", "PortConfig", {"words": [0x10002, 0x10002, 0]}, {"words": [2, 0x10002, 0]}, "port"),
    ("MTi-630", "PortConfig", {"words": [0x10002, 0x10002, 0]}, {"words": [0x10102, 0x10002, 0]}, "port"),
    ("MTi-630", "PortConfig", {"words": [0x1000A, 0x10002, 0]}, {"words": [0x1000A, 0x1000A, 0]}, "baud"),
    ("MTi-630", "PortConfig", {"words": [0x10002, 0x10002, 0]}, {"words": [0x10002, 0x1000A, 0]}, "baud"),
    ("MTi-630", "PortConfig", {"words": [0x10002, 0x10002, 0]}, {"words": [0x10002, 2, 0]}, "port"),
    ("MTi-630", "PortConfig", {"words": [0x10002, 0x10002, 0]}, {"words": [0x10002, 0x50002, 0]}, "protocol"),
    ("MTi-630", "PortConfig", {"words": [0x10002, 0x1000A, 0]}, {"words": [0x10002, 0x10000, 0]}, None),
    ("MTi-630", "SyncSettings", {"settings": []}, {"settings": [SEND_LATEST]}, "silent"),
    ("MTi-630", "SyncSettings", {"settings": [SEND_LATEST]}, {"settings": [{**SEND_LATEST, "polarity": 2}]}, None),
    ("MTi-630", "SyncSettings", {"settings": []}, {"settings": [{**SEND_LATEST, "polarity": 0}]}, None),
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


@each_row(("product", "setting", "old", "new", "kind"), LINE_CHANGES)
def test_changes_that_could_cut_the_line_are_known_before_writing(
    product: str, setting: str, old: Values | None, new: Values, kind: str | None
) -> None:
    change = DRIVER.line_change(setting, old, new, DeviceContext(product=product, baud=115_200))
    assert (change.kind if change else None) == kind
    assert change is None or change.words.endswith(".")


def test_a_change_of_one_of_two_ports_gives_both_possible_rates() -> None:
    known = DeviceContext(product="MTi-630", baud=115_200)
    both = {"words": [0x10002, 0x10002, 0]}
    change = DRIVER.line_change("PortConfig", both, {"words": [0x10002, 0x1000A, 0]}, known)
    assert change is not None
    assert (change.baud, change.others) == (921_600, (115_200,))
    change = DRIVER.line_change("PortConfig", both, {"words": [0x1000A, 0x1000A, 0]}, known)
    assert change is not None
    assert (change.baud, change.others) == (921_600, ())


def test_the_600_series_gets_its_rate_as_a_port_configuration() -> None:
    """SetBaudrate is deprecated there, and no trial would guard it."""
    known, six = DeviceContext(product="MTi-30", baud=115_200), DeviceContext(product="MTi-630", baud=115_200)
    present: dict[str, Values] = {"PortConfig": {"words": [0x10002, 0x1000A, 0]}}
    assert DRIVER.instead("SetBaudrate", {"baudrate_code": 0}, present, known) is None
    assert DRIVER.instead("SetBaudrate", {"baudrate_code": 0}, present, six) == (
        "PortConfig",
        {"words": [0x10000, 0x1000A, 0]},
    )
    assert DRIVER.instead("SetBaudrate", {"baudrate_code": 0}, {}, six) == ("PortConfig", {})


# -- what is the same, and what the factory set ------------------------------------------------------------------------


@each_row("product", PRODUCTS)
def test_the_factory_values_can_be_written_and_are_accepted(product: str) -> None:
    line = wire(product)
    known = known_of(line)
    factory = DRIVER.factory(known)
    assert set(factory) <= {setting.name for setting in DRIVER.settings(known)}
    assert "OutputConfiguration" in factory

    def body() -> Transaction[None]:
        for setting, values in factory.items():
            if "string_types" not in values:  # 0 is the stored value
                written = yield from DRIVER.write(setting, values, known)
                assert written.refused == "", (setting, written)
                assert written.actual is not None
                assert DRIVER.same(setting, values, written.actual) == [], setting

    play(DRIVER.within(body(), known), line)


def test_an_unknown_product_has_no_known_factory_values() -> None:
    assert DRIVER.factory(DeviceContext()) == {}


def test_the_order_of_outputs_and_equal_rates_are_no_difference() -> None:
    one = {"data_identifier": 0x2010, "output_frequency": 100}
    two = {"data_identifier": 0x1020, "output_frequency": 0}
    also_two = {"data_identifier": 0x1020, "output_frequency": 0xFFFF}
    assert DRIVER.same("OutputConfiguration", {"outputs": [one, two]}, {"outputs": [also_two, one]}) == []
    assert DRIVER.same("OutputConfiguration", {"outputs": [one]}, {"outputs": [one, two]}) == ["outputs.1"]
    assert DRIVER.same("LatLonAlt", {"latitude": 1.0}, {"latitude": 1.0000000001}) == []
    assert DRIVER.same("FilterProfile", {"profile": "A"}, {"profile": "a"}) == ["profile"]
    assert DRIVER.same("FilterProfile", {"profile": 39}, {"profile": 39, "version": 1}) == []
