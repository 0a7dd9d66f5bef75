"""Size of an Inertial Sense packet from its header, in plain Python: for the holder of a shared port, which imports no
numpy.

Source: Inertial Sense binary protocol, "ISB Packet".
"""

from __future__ import annotations

PREAMBLE = b"\xef\x49"
HEADER, TRAILER = 6, 2
MAX_PACKET = 2048
TYPES = range(1, 9)


def frame_size(data: bytes, at: int) -> int:
    """Size of the packet that begins at `at`; 0: its header is incomplete; −1: none begins there."""
    head = data[at : at + 2]
    if head != PREAMBLE[: len(head)]:
        return -1
    if len(data) - at < HEADER:
        return 0
    size = (data[at + 4] | data[at + 5] << 8) + HEADER + TRAILER
    return size if data[at + 2] & 0x0F in TYPES and size <= MAX_PACKET else -1
