"""The driver of an IMX with a simulated device."""

import copy
import functools
from collections.abc import Mapping
from typing import Any

from imuscope.protocols.commands.transactions import DeviceContext
from imuscope.protocols.isb.driver import IsbDriver
from imuscope.protocols.isb.simulator.device import IsbSimulator
from tests.support.transaction_player import PlayedWire, play

DRIVER = IsbDriver()


KNOWN = DeviceContext(product="IMX-5.0.4", firmware="2.7.1", baud=921_600)


S = 10**9


def wire(**options: Any) -> PlayedWire:
    """A simulator that has its first fix; what it has sent until then is gone."""
    device = copy.deepcopy(_running(tuple(sorted(options.items()))))
    return PlayedWire(device, "isb", start_ns=5 * S, step_ns=5_000_000)


@functools.cache
def _running(options: tuple[tuple[str, Any], ...]) -> IsbSimulator:
    """Made once: five seconds of samples take longer than most dialogues."""
    device = IsbSimulator(**dict(options))
    device.advance(5 * S)
    return device


def read(setting: str, there: PlayedWire) -> Mapping[str, Any]:
    return play(DRIVER.read(setting, KNOWN), there)
