"""Frames sent and frames announced are equal: each setting and command of each family, on a device that logs.

Jobs run as in the server; only their transactions are played to the simulator in virtual time, which logs each frame.
Besides reads, and the states of an MTi in which it is read and written, it must receive the frames of the preview.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from imuscope.protocols.idtp.simulator import IdtpSimulator
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.protocols.isb.simulator.gpx import GpxSimulator
from imuscope.protocols.schema import Field
from imuscope.protocols.validation import bounds, is_whole
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.server.configuration.api_models import PreviewResult
from imuscope.server.configuration.change_plan import plan_changes, plan_command
from imuscope.server.configuration.device_controller import DeviceController
from imuscope.server.configuration.preview import preview_command, preview_setting
from imuscope.server.configuration.rollback import RollbackRun
from imuscope.server.errors import DomainError
from tests.server.control_harness import BRIEFEST, ControlHarness, house_of, over
from tests.transaction_player import PlayedWire, Simulator, play

STATES = ("GoToConfig", "GoToMeasurement", "WakeUpAck")
TOGETHER: Mapping[str, Mapping[str, float]] = {"q0": {"q0": 0.0, "q1": 1.0, "q2": 0.0, "q3": 0.0}}
MOST_FIELDS = 3  # of one setting: a flash configuration has sixty, and each is written and read back alike
DEVICES: Mapping[str, tuple[str, Any]] = {
    "sim:xbus?product=MTi-630": ("xbus", lambda: XbusSimulator("MTi-630", rate=20, measuring=True)),
    "sim:xbus?product=MTi-680G": ("xbus", lambda: XbusSimulator("MTi-680G", rate=20, measuring=True)),
    "sim:xbus?product=MTi-30": ("xbus", lambda: XbusSimulator("MTi-30", rate=20, measuring=True)),
    "sim:xbus?product=MTi-3": ("xbus", lambda: XbusSimulator("MTi-3", rate=20, measuring=True)),
    "sim:isb?rate=20": ("isb", lambda: IsbSimulator(rate=20)),
    "sim:isb?product=GPX-1": ("isb", GpxSimulator),
    "sim:idtp": ("idtp", IdtpSimulator),
}


@dataclass
class LoggingDevice:
    """The controller of a device that logs what it receives."""

    here: ControlHarness
    desk: DeviceController
    family: str
    make: Any
    wire: PlayedWire

    @classmethod
    async def behind(cls, here: ControlHarness, desk: DeviceController, row: tuple[str, Any]) -> LoggingDevice:
        made = cls(here, desk, *row, wire=_wire(row[1](), row[0]))

        async def run(transaction: Any) -> Any:
            return play(transaction, made.wire)

        async def reopen(baud: int | None) -> bool:
            made.wire.relink(None)  # the line follows the device
            return True

        desk.run, desk.runner.reopen = run, reopen  # type: ignore[method-assign]
        if desk.rows:
            await here.read(desk)
        return made

    def begin(self) -> None:
        """A new device, as it left the factory."""
        self.wire = _wire(self.make(), self.family)

    @property
    def changed(self) -> list[str]:
        """Received frames that could change something, once each in a row: what is not answered is sent again."""
        frames = [one.frame for one in self.wire.sent if not self.is_harmless(one.frame)]
        return [frame.hex() for n, frame in enumerate(frames) if n == 0 or frame != frames[n - 1]]

    def is_harmless(self, frame: bytes) -> bool:
        name = self.desk.driver.name_of(frame)
        asks = {row.name for row in self.desk.driver.commands(self.desk.context) if row.kind == "ask"}
        if name.startswith("GET_DATA") and self.family == "isb":
            return frame[12:14] == b"\0\0"
        return name in asks or name in STATES


def _wire(device: Simulator, family: str) -> PlayedWire:
    wire = PlayedWire(device, family, step_ns=100_000_000)
    wire.pass_time(1)
    return wire


def other_values(field: Field, value: Any) -> Iterator[Any]:
    """Values near a present one; the device or the preview may refuse some."""
    if field.fields:
        if isinstance(value, list):
            yield value[:-1] or [{part.name: _first(part) for part in field.fields}]
            for part in field.fields:
                for new in other_values(part, value[0][part.name]) if value and not part.read_only else ():
                    yield [{**value[0], part.name: new}, *value[1:]]
        return
    if isinstance(value, list):
        for new in other_values(_element(field), value[0]) if value else ():
            yield [new, *value[1:]]
    elif field.options:
        yield from (one for one in field.options if one != value)
    elif field.choices:
        yield from (one for one in field.choices if one != value)
    elif field.bits:
        yield from (value ^ 1 << bits.low for bits in field.bits)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        low, high = bounds(field)
        step = 1 if is_whole(field) else 0.25
        yield from (one for one in (value + step, value - step, low, high) if low <= one <= high)


def _element(field: Field) -> Field:
    return Field(field.name, field.dtype, choices=field.choices, bits=field.bits, low=field.low, high=field.high)


async def _compare(device: LoggingDevice, what: Any, announced: PreviewResult, work: Any) -> bool:
    """Whether a job had something to write. One that the device refuses may end earlier."""
    job = await over(device.desk.add("Write", work))
    expected = [one.hex for one in announced.frames if not device.is_harmless(bytes.fromhex(one.hex))]
    received = device.changed
    if "Nothing to change" in job.message:
        return False
    is_over = job.state == "failed" and received == expected[: len(received)]
    assert received == expected or is_over, (what, job.message)
    return job.state == "done"


async def _write_each_setting(device: LoggingDevice) -> set[str]:
    """Settings that were written, field after field."""
    desk, written = device.desk, set[str]()
    before = desk.values
    for name, row in desk.rows.items():
        fields = [one for one in row.fields if not one.read_only and one.name in before.get(name, {})]
        for field in fields[:MOST_FIELDS] if row.write else ():
            for value in other_values(field, before[name][field.name]):
                device.begin()
                desk.values = dict(before)
                new = {field.name: value, **TOGETHER.get(field.name, {})}
                new = new if row.partial else {**before[name], **new}
                announced = preview_setting(desk.present, name, new)
                try:
                    request = plan_changes(desk, {name: new})
                except DomainError:  # a value that cannot be, or more than the line carries
                    continue
                work = device.here.desks.jobs.apply(desk, request.values, "")
                if await _compare(device, (name, new), announced, work):
                    written.add(name)
                    break
    desk.values = before
    return written


async def _run_each_command(device: LoggingDevice) -> set[str]:
    """Commands that were run."""
    desk, jobs, run = device.desk, device.here.desks.jobs, set[str]()
    before = desk.values
    for row in sorted(desk.driver.commands(desk.context), key=lambda one: one.kind):  # those that ask first
        if row.kind != "ask":
            device.begin()
        device.wire.sent.clear()
        desk.values = dict(before)
        setting = desk.present.setting_of(row.name)
        held = before.get(setting.name, {}) if setting is not None else {}
        values = {one.name: held[one.name] if one.name in held else _first(one) for one in row.arguments}
        announced = preview_command(desk.present, row.name, values)
        try:
            request = plan_command(desk, row.name, values)
        except DomainError:
            continue
        options = {"changes": request.changes, "restarts": request.restarts}
        work = jobs.run(desk, row.name, values, **options)
        if request.setting:
            work = jobs.apply(desk, request.values, "")
        await _compare(device, (row.name, values), announced, work)
        run.add(row.name)
    return run


def _first(field: Field) -> Any:
    """A value that is allowed."""
    if field.dtype in ("bytes", "ascii") and len(field.shape) < 2:
        return "00" * math.prod(field.shape) if field.dtype == "bytes" and field.shape[0] > 0 else ""
    if field.shape:
        rest = field.shape[1:] if field.dtype == "ascii" else ()
        return [
            _first(replace(field, shape=rest))
            for _ in range(field.shape[0] if rest else max(0, math.prod(field.shape)))
        ]
    if field.fields:
        return {part.name: _first(part) for part in field.fields}
    low, high = bounds(field)
    if field.default is not None and low <= field.default <= high:
        return field.default
    return min(field.choices, default=1 if low <= 1 <= high else low)


@pytest.mark.parametrize("source", DEVICES)
async def test_what_is_sent_is_what_was_announced(source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def confirmed(self: RollbackRun) -> bool:
        return True

    monkeypatch.setattr(RollbackRun, "_is_confirmed", confirmed)
    async with house_of(source, tmp_path, listening=BRIEFEST) as (here, desk):
        device = await LoggingDevice.behind(here, desk, DEVICES[source])
        written = await _write_each_setting(device)
        run = await _run_each_command(device)
        left = {name for name, row in desk.rows.items() if row.write and name in desk.values} - written
        assert left <= {"DID_NMEA_BCAST_PERIOD", "DID_GPX_RMC"}  # a list of them is not changed field by field
        assert len(run) > 0.9 * len(desk.driver.commands(desk.context))
