"""A 600-series MTi with the host on its UART: port changes need confirmation."""

from functools import partial
from pathlib import Path

import pytest

from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.server.configuration.change_plan import plan_changes
from imuscope.server.links.base import LinkError
from imuscope.server.links.simulated_device import SimulatorOptions, make_device
from imuscope.server.links.source_url import SourceUrl, open_link
from tests.support.control_harness import house_of, over
from tests.support.each_row import each_row
from tests.support.waiting import until

UART, FAST = "sim:xbus?product=MTi-680G&port=uart&baud=115200&rate=20", 0x10080
XBUS_115200 = 0x10002


def test_the_host_is_on_the_port_that_the_source_names() -> None:
    for port, word in (("rs232", 0), ("uart", 1)):
        device = make_device(SimulatorOptions.of(SourceUrl.parse(f"sim:xbus?port={port}&rate=20")), 0)
        assert isinstance(device, XbusSimulator)
        words = [XBUS_115200] * 2
        words[word] = FAST
        device.settings[0x8C] = b"".join(one.to_bytes(4, "big") for one in (*words, 0))
        device.store()
        device.reset(0)
        device.advance(2_000_000_000)
        assert device.baud == 921_600


@each_row(("words", "rate"), [([XBUS_115200, FAST, 0], 921_600), ([FAST, XBUS_115200, 0], 115_200)])
async def test_a_change_of_either_port_is_tried_and_goes_back(tmp_path: Path, words: list[int], rate: int) -> None:
    async with house_of(UART, tmp_path, is_read=True, rollback_s=60.0) as (here, desk):
        task = desk.add("Ports", partial(here.desks.jobs.apply, changes={"PortConfig": {"words": words}}, reason=""))
        await until(lambda: desk.pending_rollback is not None and desk.pending_rollback.state == "pending", "it asks")
        assert desk.member.access.baud == rate
        desk.decide(keep=False)
        await over(task)
        assert desk.pending_rollback is not None
        assert (desk.pending_rollback.state, desk.member.access.baud) == ("rolled-back", 115_200)
        assert desk.values["PortConfig"]["words"][:2] == [XBUS_115200] * 2


async def test_changes_that_may_cut_the_line_need_confirmation_on_either_port(tmp_path: Path) -> None:
    async with house_of(UART, tmp_path, is_read=True) as (_, desk):
        for place in (0, 1):
            for word in (0x00002, 0x50002, FAST, XBUS_115200 | 1 << 8):  # off, NMEA, another rate, flow control
                words = [XBUS_115200, XBUS_115200, 0]
                words[place] = word
                wish = plan_changes(desk, {"PortConfig": {"words": words}})
                assert "cuts-line" in [danger.caution for danger in wish.risks], (place, hex(word))


def test_a_product_with_one_port_has_no_second() -> None:
    with pytest.raises(LinkError, match="an MTi-3 has one port"):
        open_link("sim:xbus?product=MTi-3&port=uart&rate=20")
