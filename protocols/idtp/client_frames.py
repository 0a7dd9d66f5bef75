"""Size of an IDTP frame from its header, in plain Python: for the holder of a shared port, which imports no numpy.

Source: IDTP v2.1.0, section 3.
"""

PREAMBLE = b"IDTP"
HEADER = 20
MAX_PAYLOAD = 972
TRAILERS = (0, 4, 32)  # by mode: Lite, Safety, Secure


def frame_size(data: bytes, at: int) -> int:
    """Size of the frame that begins at `at`; 0: its header is incomplete; −1: none begins there."""
    head = data[at : at + 4]
    if head != PREAMBLE[: len(head)]:
        return -1
    if len(data) - at < HEADER:
        return 0
    size, mode = data[at + 14] | data[at + 15] << 8, data[at + 17]
    return HEADER + size + TRAILERS[mode] if size <= MAX_PAYLOAD and mode < len(TRAILERS) else -1
