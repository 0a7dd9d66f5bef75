"""The device outranks the tables: what it reports may be written back beside an edit of something else.

A fake MTi reports, in each setting and field in turn, a value that the tables do not have. Another value of the same
setting is then changed, and the reported one is sent as it was.
"""

import dataclasses
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.schema.fields import Field
from imuscope.protocols.xbus import frames
from imuscope.protocols.xbus.driver import XbusDriver
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.server.configuration.change_plan import plan_changes
from imuscope.server.configuration.device_controller import DeviceController
from imuscope.server.configuration.preview import DevicePresentState, preview_setting
from imuscope.server.errors import DomainError
from tests.server.configuration.logging_device import DEVICES, LoggingDevice, first_value, other_values
from tests.support.control_harness import BRIEFEST, house_of, over
from tests.support.each_row import each_row
from tests.support.transaction_player import PlayedWire

SOURCES = [source for source in DEVICES if "idtp" not in source]


def outside(field: Field, value: Any) -> Iterator[Any]:
    """The value with one number in it that the table does not allow."""
    if field.fields and isinstance(value, list):
        value = value or [first_value(dataclasses.replace(field, shape=()))] * 2
        for part in field.fields if value else ():
            for new in outside(part, value[-1].get(part.name)) if not part.read_only else ():
                yield [*value[:-1], {**value[-1], part.name: new}]
    elif isinstance(value, list):
        for new in outside(dataclasses.replace(field, shape=(), axes=()), value[-1]) if value else ():
            yield [*value[:-1], new]
    elif field.choices:
        yield max(field.choices) + 1
    elif isinstance(value, int) and field.high is not None and field.high < np.iinfo(np.dtype(field.dtype)).max:
        yield int(field.high) + 1


def sync(function: int, line: int, **more: int) -> dict[str, int]:
    names = ("polarity", "trigger_once", "skip_first", "skip_factor", "pulse_width", "delay_offset_or_clock_period")
    return {"function": function, "line": line, **dict.fromkeys(names, 0), "polarity": 1, **more}


def edited(fields: list[Field], values: Mapping[str, Any], name: str) -> Iterator[dict[str, Any]]:
    """Changes of something else than the last number of a field."""
    for field in fields:
        value = values.get(field.name)
        if field.name == name and isinstance(value, list) and len(value) > 1:
            for new in other_values(field, value[:1]):
                yield {field.name: [*new, *value[1:]]}
        elif field.name != name and value is not None:
            for new in other_values(field, value):
                yield {field.name: new, name: values[name]}


def _is_writable(desk: DeviceController, setting: str, values: dict[str, Any]) -> bool:
    announced = preview_setting(desk.present, setting, values)
    try:
        plan_changes(desk, {setting: values})
    except DomainError:
        return False
    return not announced.problems and bool(announced.frames)


@pytest.mark.parametrize("source", SOURCES)
async def test_what_a_device_reports_outside_the_tables_may_be_written_back(source: str, tmp_path: Path) -> None:
    """An MTi-630 that itself reported raw data could not have any rate changed: "MTi-630 has no such data"."""
    async with house_of(source, tmp_path, listening=BRIEFEST) as (here, desk):
        await LoggingDevice.behind(here, desk, DEVICES[source])
        before, tried = desk.values, 0
        for setting, row in desk.rows.items():
            fields = [one for one in row.fields if not one.read_only]
            for field in fields if row.write and setting in before and setting != "streams" else ():  # of bits
                for value in outside(field, before[setting].get(field.name)):
                    desk.values = {**before, setting: {**before[setting], field.name: value}}
                    whole = {} if row.partial else {one.name: desk.values[setting].get(one.name) for one in fields}
                    edits = [{**whole, **one} for one in edited(fields, desk.values[setting], field.name)]
                    assert not edits or any(_is_writable(desk, setting, one) for one in edits), (setting, field.name)
                    tried += bool(edits)
        assert tried >= (2 if "isb" in source else 3)


FLAGS, OUTPUT, PORT = "OptionFlags", "OutputConfiguration", "PortConfig"


@each_row(
    ("product", "setting", "reported", "edit", "refused"),
    [
        ("MTi-630", FLAGS, {"flags": 0x2008}, {"flags": 0x2088}, {"flags": 0x200C}),
        ("MTi-630", PORT, {"words": [2, 0x30002, 0]}, {"words": [0x10005, 0x30002, 0]}, {"words": [0x30002] * 3}),
        (
            "MTi-630",
            "SyncSettings",
            {"settings": [ODD := sync(3, 2), WRONG := sync(8, 4), sync(8, 2)]},
            {"settings": [ODD, WRONG, sync(8, 9)]},
            {"settings": [ODD, WRONG, sync(8, 4, skip_factor=1)]},
        ),
    ],
)
def test_a_combination_that_a_device_reports_may_stay(
    product: str, setting: str, reported: Any, edit: Any, refused: Any
) -> None:
    present = DevicePresentState(XbusDriver(), DeviceContext(product=product), values={setting: reported})
    announced = preview_setting(present, setting, edit)
    assert (announced.problems, len(announced.frames) > 0) == ([], True)
    assert preview_setting(present, setting, refused).problems


class FakeMti(XbusSimulator):
    """It stores whatever it is sent of one setting, and reports it."""

    mid, stored = 0xC0, b""

    def receive(self, data: bytes, now_ns: int) -> bytes:
        if len(data) > 4 and data[2] == self.mid:
            before, FakeMti.stored = self.advance(now_ns), data[4:-1] or FakeMti.stored
            return before + frames.build(self.mid + 1, b"" if data[3] else FakeMti.stored)
        return super().receive(data, now_ns)


async def test_a_rate_is_changed_beside_an_output_that_the_tables_do_not_have(tmp_path: Path) -> None:
    source = "sim:xbus?product=MTi-630"
    reported = "1020ffff2010003240200032" + "6010000a" + "a010ffff"
    FakeMti.stored = bytes.fromhex(reported)
    async with house_of(source, tmp_path) as (here, desk):
        device = await LoggingDevice.behind(here, desk, ("xbus", lambda: FakeMti("MTi-630", measuring=True)))
        assert isinstance(device.wire, PlayedWire)
        outputs = desk.values["OutputConfiguration"]["outputs"]
        assert [one["data_identifier"] for one in outputs][-2:] == [0x6010, 0xA010]
        slower = [{**one, "output_frequency": 25} if one["output_frequency"] == 50 else one for one in outputs]
        request = plan_changes(desk, {"OutputConfiguration": {"outputs": slower}})
        work = partial(here.desks.jobs.apply, changes=request.values, reason="", base=None, held=request.current)
        job = await over(desk.add("Write", work))
        assert (job.state, job.outcomes) == ("done", [])
        assert FakeMti.stored.hex() == reported.replace("0032", "0019")
        new = [*outputs, {"data_identifier": 0x6020, "output_frequency": 10}]
        with pytest.raises(DomainError, match="no such data"):
            plan_changes(desk, {"OutputConfiguration": {"outputs": new}})
