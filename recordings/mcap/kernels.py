"""Loops over the records of an MCAP file (reader.py).

Source: MCAP specification, "Records".
"""

from imuscope.protocols.arrays import Bytes, Ints
from imuscope.protocols.native.kernels import BYTES, FOUR, INT, TABLE, compiled

TORN, FULL, AT_END = -1, -2, -3


@compiled(INT, BYTES, INT)
def _u8(data: Bytes, at: int) -> int:
    low = int(data[at]) | int(data[at + 1]) << 8 | int(data[at + 2]) << 16 | int(data[at + 3]) << 24
    high = int(data[at + 4]) | int(data[at + 5]) << 8 | int(data[at + 6]) << 16 | (int(data[at + 7]) & 0x7F) << 24
    return low | high << 32


@compiled(FOUR, BYTES, INT, TABLE)
def messages_from(data: Bytes, at: int, table: Ints) -> tuple[int, int, int, int]:
    """Walk over records from `at`: (messages written, where it stopped, opcode there, its length).

    Stops before a record that is not a message (its opcode is returned), before an incomplete one (TORN), at the end
    (AT_END), or when the table is full (FULL).
    """
    n = 0
    end = len(data)
    while at < end:
        if end - at < 9:
            return n, at, TORN, 0
        opcode = int(data[at])
        length = _u8(data, at + 1)
        if opcode != 5:
            return n, at, opcode, length
        if length < 22 or length > end - at - 9:
            return n, at, TORN, length
        if n == table.shape[1]:
            return n, at, FULL, 0
        body = at + 9
        table[0, n] = int(data[body]) | int(data[body + 1]) << 8
        table[1, n] = _u8(data, body + 6)
        table[2, n] = body + 22
        table[3, n] = length - 22
        n += 1
        at = body + length
    return n, at, AT_END, 0


@compiled(INT, BYTES, INT, BYTES)
def resume(data: Bytes, at: int, known: Bytes) -> int:
    """Next offset at or after `at` where records follow each other: a message of a known channel or a chunk, then three
    more whole records or the end of the data; −1 if there is none.

    Args:
        known: (65536,) 1 at the id of every described channel.
    """
    end = len(data)
    while at + 31 <= end:
        first = int(data[at])
        if (first == 5 and known[int(data[at + 9]) | int(data[at + 10]) << 8] == 1) or first == 6:
            count = 0
            here = at
            while count < 4 and here + 9 <= end:
                opcode = int(data[here])
                length = _u8(data, here + 1)
                if opcode < 3 or opcode > 15 or (opcode == 5 and length < 22) or (opcode == 6 and length < 40):
                    break
                if length > end - here - 9:
                    break
                count += 1
                here += 9 + length
                if opcode == 15:
                    count = 4
            if count >= 4 or (count > 0 and here == end):
                return at
        at += 1
    return -1
