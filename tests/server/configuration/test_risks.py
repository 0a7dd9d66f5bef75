"""Risky changes need confirmation on every route: as a setting, as a data set, by the page, the API, the command
line.
"""

import asyncio
import io
from pathlib import Path
from typing import Any

import pytest

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.isb.commands import COMMAND_ROWS
from imuscope.protocols.isb.config_effects import line_change
from imuscope.protocols.isb.driver import IsbDriver
from imuscope.protocols.xbus.driver import XbusDriver
from imuscope.server.commands import send
from imuscope.server.configuration.change_plan import plan_command
from imuscope.server.configuration.form_builder import forms_of
from imuscope.server.configuration.risks import dangers_of_write
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.errors import UsageError
from tests.support.control_harness import BRIEFEST, house_of
from tests.support.each_row import each_row

DRIVER = IsbDriver()
KNOWN = DeviceContext(product="IMX-5.0.4", firmware="2.7.1", baud=921_600)
OLD: dict[str, Any] = {
    "ser0BaudRate": 921_600,
    "ser1BaudRate": 921_600,
    "insRotation": [0.0, 0.0, 0.0],
    "startupNavDtMs": 10,
    "size": 288,
}


@each_row(
    ("values", "cautions"),
    [
        ({"ser0BaudRate": 9600}, {"cuts-line", "restarts"}),
        ({"insRotation": [1.5, 0.0, 0.0]}, {"moves-frame", "restarts"}),
        ({"startupNavDtMs": 0}, {"stops-output", "restarts"}),
        ({"startupNavDtMs": 20}, {"restarts"}),  # it restarted without a word
        ({"size": 0}, {"loses-settings", "restarts"}),
        (OLD, set()),
    ],
)
def test_a_configuration_is_never_written_without_confirmation(values: dict[str, Any], cautions: set[str]) -> None:
    row = next(row for row in DRIVER.settings(KNOWN) if row.name == "DID_FLASH_CONFIG")
    results = dangers_of_write(DRIVER, row, OLD, values, KNOWN)
    assert {one.caution for one in results} == cautions
    assert all(one.consequence for one in results)


def test_a_port_that_may_be_ours_is_searched_for_at_every_rate() -> None:
    """Regression: if one of two ports with our rate changed, or both changed differently, only the old
    rate was tried.
    """
    one = line_change("DID_FLASH_CONFIG", OLD, {"ser0BaudRate": 115_200}, KNOWN)
    assert one is not None
    assert (one.baud, one.others) == (115_200, (921_600,))
    both = line_change("DID_FLASH_CONFIG", OLD, {"ser0BaudRate": 115_200, "ser1BaudRate": 230_400}, KNOWN)
    assert both is not None
    assert (both.baud, both.others) == (115_200, (230_400,))


@each_row(
    ("command", "values", "harms"),
    [
        ("SET_DID_SYS_CMD", {"command": 1357924682, "invCommand": 2937042613}, True),  # erases the chip
        ("SET_DID_SYS_CMD", {"command": 99, "invCommand": 0}, True),
        ("SET_DID_SYS_CMD", {"command": 1, "invCommand": 0}, True),  # saves the current streams
        ("SET_DID_SYS_CMD", {"command": 3, "invCommand": 0}, False),
        ("SET_DID_RMC", {"bits": 0, "options": 0}, True),
        ("SET_DID_MANUFACTURING_INFO", {}, True),
        ("SET_DID_WHEEL_ENCODER", {}, False),
    ],
)
def test_a_harmful_data_set_is_reported_like_its_command(command: str, values: dict[str, Any], harms: bool) -> None:
    row = COMMAND_ROWS[command]
    assert row.is_risky(values) == harms
    assert bool(row.consequence) or not harms


async def test_a_data_set_of_a_setting_is_written_like_the_setting(tmp_path: Path) -> None:
    """Its form opened with zeros, and sent all of them, without a question and without a way back."""
    forms = forms_of(DRIVER, "isb", KNOWN)
    writes = {form.name: form.writes for form in forms.commands}
    assert writes["SET_DID_FLASH_CONFIG"] == "DID_FLASH_CONFIG"

    async with house_of("sim:isb?rate=20", tmp_path, is_read=True, listening=BRIEFEST) as (_, desk):
        values = {**desk.values["DID_FLASH_CONFIG"], "ser0BaudRate": 460_800}
        wish = plan_command(desk, "SET_DID_FLASH_CONFIG", values)
        assert wish.setting == "DID_FLASH_CONFIG"
        assert {"size", "key", "checksum"}.isdisjoint(wish.values["DID_FLASH_CONFIG"])
        assert {one.caution for one in wish.risks} == {"cuts-line", "restarts"}


@each_row(
    ("message", "pairs", "words"),
    [
        ("DID_FLASH_CONFIG", ["ser0BaudRate=9600"], "serial port 0"),
        ("SET_DID_FLASH_CONFIG", ["insRotation=[1.5,0,0]"], "frame"),
        ("streams", ["streams=[]"], "stops streaming"),
        ("SET_DID_RMC", ["bits=0", "options=0"], "streams"),
    ],
)
def test_the_command_line_requires_confirmation_where_the_page_does(message: str, pairs: list[str], words: str) -> None:
    """Regression: changes that cut the line or turn the frame were sent without the confirmation
    described in the help.
    """
    wish = send.SendRequest("sim:isb?rate=20", message, pairs)
    with pytest.raises(UsageError, match=words) as refused:
        asyncio.run(send.send(wish, DecodeOptions(), io.StringIO(), io.StringIO()))
    assert "--yes" in str(refused.value)


@each_row(
    ("product", "values", "ports"),
    [
        ("MTi-630", {"PortConfig": {"words": [0x10002, 0x1000A, 0]}}, ["PortConfig.words.0"]),
        ("MTi-630", {"PortConfig": {"words": [0x10002, 0x10002, 0]}}, ["PortConfig.words.0", "PortConfig.words.1"]),
        ("MTi-630", {}, []),
        (
            "IMX-5",
            {"DID_FLASH_CONFIG": {"ser0BaudRate": 921_600, "ser1BaudRate": 115_200}},
            ["DID_FLASH_CONFIG.ser1BaudRate"],
        ),
        ("IMX-5", {"DID_FLASH_CONFIG": {"ser0BaudRate": 921_600}}, []),
    ],
)
def test_the_port_of_the_link_is_known_by_its_rate(product: str, values: dict[str, Any], ports: list[str]) -> None:
    driver = DRIVER if product.startswith("IMX") else XbusDriver()
    assert list(driver.own_ports(values, DeviceContext(product=product, baud=115_200))) == ports
    assert not driver.own_ports(values, DeviceContext(product=product)), "a link without a rate has no port to mark"
