"""The driver of an IMX with a simulated device."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from protocols.isb.driver import IsbDriver
from protocols.isb.simulator.device import IsbSimulator
from protocols.transactions import DeviceContext
from tests.transaction_player import PlayedWire, play

DRIVER = IsbDriver()


KNOWN = DeviceContext(product="IMX-5.0.4", firmware="2.7.1", baud=921_600)


S = 10**9


def wire(**options: Any) -> PlayedWire:
    """A simulator that has its first fix."""
    there = PlayedWire(IsbSimulator(**options), "isb", step_ns=5_000_000)
    there.pass_time(5)
    return there


def read(setting: str, there: PlayedWire) -> Mapping[str, Any]:
    return play(DRIVER.read(setting, KNOWN), there)
