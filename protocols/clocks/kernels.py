"""Hot loops of the clock mapping: delays and host times of the rows of a drain.

A live drain has some dozen rows, for which numpy needs a microsecond and more per operation, and the mapping some forty
of them.
"""

from imuscope.protocols.arrays import Floats, Ints
from imuscope.protocols.native.kernels import FLAG, FLOAT, FLOATS, INT, INTS, NOTHING, TRIPLE, compiled, inlined

NO_TIME = -(1 << 63)  # in place of a time in ns, where there is none


@inlined
def _after(sorted_values: Floats | Ints, count: int, value: float) -> int:
    """Number of the first `count` values that are not greater than `value`."""
    low, high = 0, count
    while low < high:
        middle = (low + high) // 2
        if sorted_values[middle] <= value:
            low = middle + 1
        else:
            high = middle
    return low


@compiled(NOTHING, INTS, INTS, INTS, FLOAT, INTS, INTS, INTS)
def earliest_sent(
    offset: Ints, size: Ints, latest: Ints, byte_ns: float, ends: Ints, arrivals: Ints, sent: Ints
) -> None:
    """Start of transmission of frames, by the chunks that end inside them; see ChunkBoundaries.sent.

    Args:
        size: of each, or one of all.
        ends, arrivals: of the chunks, at least one.
        sent: receives the result.
    """
    for i in range(len(offset)):
        at = min(_after(ends, len(ends), offset[i]), len(ends) - 1)
        inside = ends[at] - offset[i]
        sent[i] = latest[i]
        if 0 < inside < size[i if len(size) > 1 else 0]:
            early = arrivals[at] - int(inside * byte_ns)
            sent[i] = min(latest[i], early)


@compiled(TRIPLE, INTS, INTS, INT, INT, FLOAT, FLOAT, FLOATS, FLOATS)
def delays_of(
    device: Ints, sent: Ints, origin: int, host_origin: int, slope: float, intercept: float, x: Floats, delay: Floats
) -> tuple[int, int, int]:
    """Delays of rows over the line of a clock (clock_model.py).

    Args:
        x, delay: receive device time since `origin`, and the delay, ns.

    Returns:
        The rows with the least delay, the least and the greatest device time.
    """
    least = first = last = 0
    for i in range(len(device)):
        x[i] = device[i] - origin
        delay[i] = float(sent[i] - host_origin) - x[i] - slope * x[i] - intercept
        if delay[i] < delay[least]:
            least = i
        if x[i] < x[first]:
            first = i
        if x[i] > x[last]:
            last = i
    return least, first, last


@compiled(NOTHING, INTS, INT, INT, FLOATS, FLOATS, INT, FLOAT, INTS)
def host_times(
    device: Ints,
    origin: int,
    host_origin: int,
    knot_x: Floats,
    knot_h: Floats,
    knots: int,
    slope: float,
    host: Ints,
) -> None:
    """Host time of device times by a mapping, unix ns: linear between its first `knots` knots, with `slope` beyond.

    Args:
        host: receives the result.
    """
    end = knots - 1
    for i in range(len(device)):
        x = float(device[i] - origin)
        if x >= knot_x[end]:
            h = knot_h[end] + (x - knot_x[end]) * slope
        elif x < knot_x[0]:
            h = knot_h[0] + (x - knot_x[0]) * slope
        else:
            k = _after(knot_x, knots, x) - 1
            h = (knot_h[k + 1] - knot_h[k]) / (knot_x[k + 1] - knot_x[k]) * (x - knot_x[k]) + knot_h[k]
        host[i] = host_origin + int(h)


@inlined
def float_second(time_ns: int) -> float:
    """Seconds of a time in ns, the nearest float."""
    whole = time_ns // 1_000_000_000
    return float(whole) + float(time_ns - whole * 1_000_000_000) / 1e9


@compiled(NOTHING, INTS, FLOAT, FLOATS)
def float_seconds(times_ns: Ints, none: float, out: Floats) -> None:
    """Seconds of times in ns, each the nearest float; `none` in place of NO_TIME."""
    for i in range(len(times_ns)):
        out[i] = none if times_ns[i] == NO_TIME else float_second(times_ns[i])


@compiled(FLAG, INTS)
def decreases(values: Ints) -> bool:
    """Whether a value is less than the one before it."""
    drops = 0
    for i in range(1, len(values)):
        if values[i] < values[i - 1]:
            drops += 1
    return drops > 0
