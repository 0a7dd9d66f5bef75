"""Effect of a frame to an MTi on its configuration, in plain Python: for the holder of a shared port, which imports no
numpy.

Settings are written in the config state only, so a program configures the device from GoToConfig to GoToMeasurement,
or to a Reset. WakeUpAck, in answer to a device that starts, leads there too.

Source: MT0101P 2020.A, 5.2 and 5.3.1.
"""

from __future__ import annotations

from typing import Literal

GO_TO_MEASUREMENT, GO_TO_CONFIG, WAKE_UP_ACK, RESET = 0x10, 0x30, 0x3F, 0x40


def effect_of(frame: bytes) -> Literal["", "begin", "change", "end"]:
    """The effect of a whole frame (server/holder/client_frames.py, Effect)."""
    number = frame[2]
    if number in (GO_TO_CONFIG, WAKE_UP_ACK):
        return "begin"
    return "end" if number in (GO_TO_MEASUREMENT, RESET) else ""
