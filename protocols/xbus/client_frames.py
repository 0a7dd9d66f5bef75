"""Frames of an MTi as the holder of a shared port needs them, which imports no numpy: in plain Python, their size from
the header, and their effect on the configuration.

Settings are written in the config state only, so a program configures the device from GoToConfig to GoToMeasurement,
or to a Reset. WakeUpAck, in answer to a device that starts, leads there too.

Source: MT0101P 2020.A, "Message structure", 5.2 and 5.3.1.
"""

from __future__ import annotations

TYPE_CHECKING = False  # a holder has no room for typing
if TYPE_CHECKING:
    from typing import Literal

PREAMBLE, EXTENDED = 0xFA, 0xFF
MAX_DATA_BYTES = 2048  # bytes of data in an extended frame


def frame_size(data: bytes, at: int) -> int:
    """Size of the frame that begins at `at`; 0: its header is incomplete; −1: none begins there."""
    if data[at] != PREAMBLE:
        return -1
    if len(data) - at < 4:
        return 0
    length = data[at + 3]
    if length != EXTENDED:
        return length + 5
    if len(data) - at < 6:
        return 0
    length = data[at + 4] << 8 | data[at + 5]
    return length + 7 if length <= MAX_DATA_BYTES else -1


GO_TO_MEASUREMENT, GO_TO_CONFIG, WAKE_UP_ACK, RESET = 0x10, 0x30, 0x3F, 0x40


def effect_of(frame: bytes) -> Literal["", "begin", "change", "end"]:
    """The effect of a whole frame (server/extensions/shares/holder/client_frames.py, Effect)."""
    number = frame[2]
    if number in (GO_TO_CONFIG, WAKE_UP_ACK):
        return "begin"
    return "end" if number in (GO_TO_MEASUREMENT, RESET) else ""
