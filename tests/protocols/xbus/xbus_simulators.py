"""An MTi to hold dialogues with: a simulator at the other end of a wire, one that is deaf, one whose answers are
spoilt.
"""

import copy
import functools
from typing import Any

from imuscope.protocols.commands.transactions import DeviceContext, Values
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from tests.protocols.xbus.xbus_values import DRIVER
from tests.support.transaction_player import PlayedWire, play


def wire(product: str = "MTi-630", *, seconds: float = 1.0, baud: int | None = None, **options: Any) -> PlayedWire:
    """A simulator that has been on for a while; what it has sent until then is gone."""
    device = copy.deepcopy(_running(product, seconds, tuple(sorted(options.items()))))
    return PlayedWire(device, "xbus", baud, start_ns=round(seconds * 1e9))


@functools.cache
def _running(product: str, seconds: float, options: tuple[tuple[str, Any], ...]) -> XbusSimulator:
    """Made once: a second of samples takes longer than most dialogues."""
    device = XbusSimulator(product, **dict(options))
    device.advance(round(seconds * 1e9))
    return device


def phase(line: PlayedWire) -> str:
    assert isinstance(line.device, XbusSimulator)
    return line.device.phase


def known_of(line: PlayedWire) -> DeviceContext:
    return play(DRIVER.identify(DeviceContext()), line)


def names(line: PlayedWire) -> list[str]:
    """Sent messages, by name."""
    return [DRIVER.name_of(send.frame) for send in line.sent]


class DeafXbusDevice:
    """A device that never answers."""

    baud = 115_200

    def advance(self, now_ns: int) -> bytes:
        return b""

    def receive(self, data: bytes, now_ns: int) -> bytes:
        return b""


class Between:
    """A simulator whose answers are modified."""

    def __init__(self, **options: Any) -> None:
        self.device = XbusSimulator(**options)
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
