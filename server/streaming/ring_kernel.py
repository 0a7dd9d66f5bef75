"""Loop that appends samples to a ring buffer as they were on the wire, without a column of their own in between.

A live device has a few samples in each turn: an array for each of its columns would cost ten times the copy itself.
"""

from imuscope.protocols.arrays import Array, Ints
from imuscope.protocols.clocks.kernels import float_second
from imuscope.protocols.native.kernels import FLOATS, INT, INTS, READ_ROWS, TABLE, ArrayType, compiled

OFFSET, SIZE, SWAP, OPERATION = range(4)  # rows of `copies`
MULTIPLY, DIVIDE = 1, 2
_MEMORY, _FLOATS32 = ArrayType("uint8", 1), ArrayType("float32", 1)


@compiled(INT, READ_ROWS, TABLE, FLOATS, INTS, FLOATS, _MEMORY, _FLOATS32, FLOATS, INTS, INT, INT, INT)
def append_rows(
    rows: Array,
    copies: Ints,
    factors: Array,
    arrival_ns: Ints,
    time: Array,
    memory: Array,
    memory_f4: Array,
    memory_f8: Array,
    begins: Ints,
    at: int,
    first: int,
    count: int,
) -> int:
    """Append samples to the columns of a block.

    Args:
        rows: (n, size) bytes of each sample.
        copies: (4, columns) of each column: where it is in a row, its bytes, whether their order is not this machine's,
            and the operation on the value.
        factors: (columns,) by which a value is multiplied or divided.
        arrival_ns, time: (n,) columns before these, ns and s since 1970.
        memory, memory_f4, memory_f8: memory of the block, as bytes and as numbers.
        begins: (2 + columns,) byte at which each column begins.
        at: sample of the block at which to write.
        first, count: the samples to append.
    """
    arrivals, times = (begins[0] >> 3) + at, (begins[1] >> 3) + at
    for k in range(count):
        memory_f8[arrivals + k] = float_second(arrival_ns[first + k])
        memory_f8[times + k] = time[first + k]
    for column in range(copies.shape[1]):
        offset, size, operation = copies[OFFSET, column], copies[SIZE, column], copies[OPERATION, column]
        to = begins[2 + column] + at * size
        for k in range(count):
            if copies[SWAP, column] != 0:
                for byte in range(size):
                    memory[to + k * size + byte] = rows[first + k, offset + size - 1 - byte]
            else:
                for byte in range(size):
                    memory[to + k * size + byte] = rows[first + k, offset + byte]
        if operation != 0:
            factor = factors[column]
            for k in range(count):
                place = to // size + k
                if size == 8 and operation == MULTIPLY:
                    memory_f8[place] = memory_f8[place] * factor
                elif size == 8:
                    memory_f8[place] = memory_f8[place] / factor
                elif operation == MULTIPLY:
                    memory_f4[place] = memory_f4[place] * factor
                else:
                    memory_f4[place] = memory_f4[place] / factor
    return 0
