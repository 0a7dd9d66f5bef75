"""Size of an Xbus frame from its header, in plain Python: for the holder of a shared port, which imports no numpy.

Source: MT0101P 2020.A, "Message structure".
"""

from __future__ import annotations

PREAMBLE, EXTENDED = 0xFA, 0xFF
LARGEST = 2048  # bytes of data in an extended frame


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
    return length + 7 if length <= LARGEST else -1
