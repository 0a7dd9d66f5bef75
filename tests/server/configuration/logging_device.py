"""A device that logs what it receives, behind a controller of the server.

Jobs run as in the server; only their transactions are played to the simulator in virtual time, which logs each frame.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from imuscope.protocols.idtp.simulator import IdtpSimulator
from imuscope.protocols.isb.simulator.device import IsbSimulator
from imuscope.protocols.isb.simulator.gpx import GpxSimulator
from imuscope.protocols.schema.fields import Field
from imuscope.protocols.schema.validation import bounds, is_whole
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.server.configuration.device_controller import DeviceController
from tests.support.control_harness import ControlHarness
from tests.support.transaction_player import PlayedWire, Simulator, play

STATES = ("GoToConfig", "GoToMeasurement", "WakeUpAck")
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
        requests = {row.name for row in self.desk.driver.commands(self.desk.context) if row.kind == "ask"}
        if name.startswith("GET_DATA") and self.family == "isb":
            return frame[12:14] == b"\0\0"
        return name in requests or name in STATES


def _wire(device: Simulator, family: str) -> PlayedWire:
    wire = PlayedWire(device, family, step_ns=100_000_000)
    wire.pass_time(0.1)
    return wire


def other_values(field: Field, value: Any) -> Iterator[Any]:
    """Values near a present one; the device or the preview may refuse some."""
    if field.fields:
        if isinstance(value, list):
            yield value[:-1] or [{part.name: first_value(part) for part in field.fields}]
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


def first_value(field: Field) -> Any:
    """A value that is allowed."""
    if field.dtype in ("bytes", "ascii") and len(field.shape) < 2:
        return "00" * math.prod(field.shape) if field.dtype == "bytes" and field.shape[0] > 0 else ""
    if field.shape:
        rest = field.shape[1:] if field.dtype == "ascii" else ()
        return [
            first_value(replace(field, shape=rest))
            for _ in range(field.shape[0] if rest else max(0, math.prod(field.shape)))
        ]
    if field.fields:
        return {part.name: first_value(part) for part in field.fields}
    low, high = bounds(field)
    if field.default is not None and low <= field.default <= high:
        return field.default
    return min(field.choices, default=1 if low <= 1 <= high else low)
