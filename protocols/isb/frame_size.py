"""Size of an Inertial Sense packet from its header, or of an NMEA sentence by its end, in plain Python: for the holder
of a shared port, which imports no numpy.

Source: Inertial Sense binary protocol, "ISB Packet"; NMEA 0183.
"""

from __future__ import annotations

PREAMBLE = b"\xef\x49"
HEADER, TRAILER = 6, 2
MAX_PACKET = 2048
TYPES = range(1, 9)
MAX_SENTENCE = 512  # $ASCE with 20 messages has 170 characters


def frame_size(data: bytes, at: int) -> int:
    """Size of the packet or sentence that begins at `at`; 0: too few bytes; −1: none begins there."""
    if data[at : at + 1] == b"$":
        return _sentence_size(data, at)
    head = data[at : at + 2]
    if head != PREAMBLE[: len(head)]:
        return -1
    if len(data) - at < HEADER:
        return 0
    size = (data[at + 4] | data[at + 5] << 8) + HEADER + TRAILER
    return size if data[at + 2] & 0x0F in TYPES and size <= MAX_PACKET else -1


def _sentence_size(data: bytes, at: int) -> int:
    sentence = data[at : at + MAX_SENTENCE]
    end = sentence.find(b"\n") + 1
    text = sentence[:end].rstrip(b"\r\n") if end else sentence.rstrip(b"\r")
    if not text.isascii() or not text.decode("ascii").isprintable():
        return -1
    return end or (0 if len(sentence) < MAX_SENTENCE else -1)
