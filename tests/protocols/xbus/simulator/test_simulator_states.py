"""The state in which an MTi is found, and left after a transaction."""

import pytest

from imuscope.protocols.commands.transactions import DeviceContext, DeviceRestartedError
from imuscope.protocols.xbus import frames
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.protocols.xbus.simulator.faults import FaultInjection
from tests.protocols.xbus.xbus_simulators import phase, wire
from tests.protocols.xbus.xbus_values import DRIVER
from tests.support.each_row import each_row
from tests.support.transaction_player import PlayedWire, play


class _AnswersWhileMeasuring(XbusSimulator):
    """It answers ReqDID in the measurement state, too."""

    def receive(self, data: bytes, now_ns: int) -> bytes:
        if data == frames.build(0x00) and self.phase == "measurement":
            return self.advance(now_ns) + frames.build(0x01, (0x0080800077).to_bytes(8, "big"))
        return super().receive(data, now_ns)


@each_row(("rate", "sample_s"), [(100, 0.01), (1, 1.0)])
def test_samples_outweigh_a_device_identifier(rate: int, sample_s: float) -> None:
    """A device that answers ReqDID while it streams was taken for one at rest, and was left in the config state."""
    line = PlayedWire(_AnswersWhileMeasuring("MTi-630", rate=rate, measuring=True), "xbus")
    line.pass_time(2)
    known = DeviceContext(sample_s=sample_s)
    play(DRIVER.within(DRIVER.read("LocationID", known), known), line)
    assert phase(line) == "measurement"


def test_power_that_fails_before_a_setting_is_stored_leaves_the_old_one() -> None:
    line = wire(moods=FaultInjection(power_cut_at=1))
    known = DeviceContext(product="MTi-630")
    with pytest.raises(DeviceRestartedError):
        play(DRIVER.within(DRIVER.write("LocationID", {"location_id": 7}, known), known), line)
    line.pass_time(2)
    assert phase(line) == "measurement"
    assert play(DRIVER.within(DRIVER.read("LocationID", known), known), line) == {"location_id": 0}
    written = play(DRIVER.within(DRIVER.write("LocationID", {"location_id": 7}, known), known), line)
    assert written.actual == {"location_id": 7}
