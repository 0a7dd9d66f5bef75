"""Loop that appends samples to a ring buffer as they were on the wire, without a column of their own in between.

A live device has a few samples in each turn: an array for each of its columns would cost ten times the copy itself.
"""

from imuscope.protocols.arrays import Array, Ints
from imuscope.protocols.clocks.kernels import float_second
from imuscope.protocols.native.kernels import FLOATS, INT, INTS, READ_ROWS, TABLE, ArrayType, compiled

OFFSET, SIZE, SWAP = range(3)  # rows of `copies`
_MEMORY = ArrayType("uint8", 1)


@compiled(INT, READ_ROWS, TABLE, INTS, FLOATS, _MEMORY, FLOATS, INTS, INT, INT, INT)
def append_rows(
    rows: Array,
    copies: Ints,
    arrival_ns: Ints,
    time: Array,
    memory: Array,
    memory_f8: Array,
    begins: Ints,
    at: int,
    first: int,
    count: int,
) -> int:
    """Append samples to the columns of a block.

    Args:
        rows: (n, size) bytes of each sample.
        copies: (3, columns) of each column: where it is in a row, its bytes, and whether their order is not this
            machine's.
        arrival_ns, time: (n,) columns before these, ns and s since 1970.
        memory, memory_f8: memory of the block, as bytes and as numbers.
        begins: (2 + columns,) byte at which each column begins.
        at: sample of the block at which to write.
        first, count: the samples to append.
    """
    arrivals, times = (begins[0] >> 3) + at, (begins[1] >> 3) + at
    for k in range(count):
        memory_f8[arrivals + k] = float_second(arrival_ns[first + k])
        memory_f8[times + k] = time[first + k]
    for column in range(copies.shape[1]):
        offset, size = copies[OFFSET, column], copies[SIZE, column]
        to = begins[2 + column] + at * size
        for k in range(count):
            if copies[SWAP, column] != 0:
                for byte in range(size):
                    memory[to + k * size + byte] = rows[first + k, offset + size - 1 - byte]
            else:
                for byte in range(size):
                    memory[to + k * size + byte] = rows[first + k, offset + byte]
    return 0
