"""Loops over the messages of bags: their places in a chunk of ROS 1, and their copies as a stream of messages.

Source: ROS wiki, "Bags/Format/2.0"; protocols/messages/records.py.
"""

from imuscope.protocols.arrays import Array, Bytes, Ints
from imuscope.protocols.native.kernels import BYTES, INT, INTS, PAIR, TABLE, ArrayType, compiled

NUMBER, TIME, START, SIZE = range(4)
"""Rows of a table of messages: number of the topic, arrival in ns, place in the bytes."""
_SECOND_NS = 1_000_000_000
_HEAD, _FIXED = 31, 22  # bytes of a message's record before its data, and of those after the length
_MESSAGE = 5


@compiled(INT, BYTES, INT)
def _word(data: Bytes, at: int) -> int:
    return int(data[at]) | int(data[at + 1]) << 8 | int(data[at + 2]) << 16 | int(data[at + 3]) << 24


@compiled(PAIR, BYTES, INT, BYTES, BYTES, INT, INT, TABLE)
def alike_messages(
    data: Bytes, at: int, header: Bytes, is_constant: Bytes, number_at: int, time_at: int, table: Ints
) -> tuple[int, int]:
    """Messages of ROS 1 whose headers are laid out as a known one: (written to the table, where it stopped).

    Args:
        header: the known one, with its length.
        is_constant: (bytes of the header,) 1 where all are the same.
        number_at, time_at: places of the connection and the time in the header.
    """
    count = 0
    size = len(header)
    while at + size + 4 <= len(data) and count < table.shape[1]:
        for place in range(size):
            if is_constant[place] == 1 and data[at + place] != header[place]:
                return count, at
        length = _word(data, at + size)
        if length > len(data) - at - size - 4:
            return count, at
        table[NUMBER, count] = _word(data, at + number_at)
        table[TIME, count] = _word(data, at + time_at) * _SECOND_NS + _word(data, at + time_at + 4)
        table[START, count] = at + size + 4
        table[SIZE, count] = length
        count += 1
        at += size + 4 + length
    return count, at


@compiled(INT, BYTES, TABLE, INTS, ArrayType("uint8", 1), INT)
def copy_records(data: Bytes, table: Ints, channels: Ints, out: Array, at: int) -> int:
    """Write messages as records of a stream from a place on; returns the place after them.

    Args:
        channels: number in the stream of the channel of each message.
    """
    for k in range(table.shape[1]):
        size = table[SIZE, k]
        length = size + _FIXED
        out[at] = _MESSAGE
        for place in range(8):
            out[at + 1 + place] = (length >> (8 * place)) & 255
        out[at + 9] = channels[k] & 255
        out[at + 10] = (channels[k] >> 8) & 255
        for place in range(11, _HEAD):
            out[at + place] = 0
        at += _HEAD
        start = table[START, k]
        for place in range(size):
            out[at + place] = data[start + place]
        at += size
    return at
