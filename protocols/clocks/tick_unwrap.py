"""Ticks of a clock that wraps, row by row: each row continues, wraps, is late, jumps or restarts.

The loop of counters.TickUnwrapper, compiled. Each row is decided from the rows before it alone, so the result does not
depend on how the stream was cut. With `newest` the highest unwrapped tick so far and `value` this row's raw ticks plus
the turns so far:

    newest − late              newest        newest + near
    ────┼──────────────────────────┼──────────────┼────>
        │ late: keeps its time, if │ continues    │ jumped ahead
        │ few in a row are         │              │
    far behind: it wrapped if value + wrap is just after newest; else the clock was set back (jump) or restarted (reset)

With arrival times, `near` is the time elapsed at the host, so that an outage is not a jump.
"""

from imuscope.protocols.arrays import Ints
from imuscope.protocols.native.kernels import FLAG, INT, INTS, TABLE, compiled

LATE_ROWS = 8  # after this many late rows in a row the clock was set back
NEAR_SHARE = 4096  # without arrival times, a step of more than this share of the wrap is a jump

# The state of a clock between calls.
STARTED, NEWEST, TURNS, LATE_RUN, ARRIVAL, WRAP, OPEN_FROM, OPEN_TO, ADVANCE, FIRST_LATE = range(10)
STATES = 10
#   ADVANCE     the last advance from one tick to a newer one: what the clock would have done in place of a step
#   FIRST_LATE  the first of the late rows: if they go on, the clock was set back to it

RESET, JUMP = 0, 1


@compiled(FLAG, INT, INT, INTS, INTS)
def _wraps(ticks: int, near: int, state: Ints, wraps: Ints) -> bool:
    """Whether `ticks` is just after the newest tick, across the end of the clock. If so, count the turn and fix the
    modulus.

    Args:
        near: the most ticks that count as "just after"; -1: the usual share of the modulus.
    """
    last = state[NEWEST] - state[TURNS]
    for candidate in range(state[OPEN_FROM], state[OPEN_TO]):
        wrap = wraps[candidate]
        limit = near if near >= 0 else max(wrap // NEAR_SHARE, 1)
        if last < wrap and 0 <= ticks + wrap - last <= limit:
            state[WRAP] = candidate
            state[OPEN_FROM] = candidate
            state[OPEN_TO] = candidate + 1
            state[TURNS] += wrap
            return True
    return False


@compiled(INT, INTS, INTS, INTS, INTS, INT, INT, INT, INTS, TABLE)
def follow(
    raw: Ints,
    arrival: Ints,
    state: Ints,
    wraps: Ints,
    late: int,
    tick_ns: int,
    slack_ns: int,
    out: Ints,
    steps: Ints,
) -> int:
    """Unwrap the rows `raw`.

    Args:
        arrival: (n,) ns, or (0,) where not known.
        state: (STATES,), updated. WRAP: index into `wraps` of the modulus in effect; OPEN_FROM, OPEN_TO: those still
            possible.
        wraps: candidates for the modulus, ascending.
        late: ticks by which a row may be older than the newest.
        tick_ns: length of a tick, for comparison with arrival times; 0: unknown.
        slack_ns: how far the device's clock may advance beyond the host's in a step.
        out: (n,), written.
        steps: (3, n), written: row, RESET or JUMP, by how many ticks the clock differs from one that continued.

    Returns:
        Number of steps.
    """
    count = 0
    timed = len(arrival) > 0 and tick_ns > 0
    soon = slack_ns // tick_ns if timed else -1  # at least so many ticks are near: no division for the usual row
    for row in range(len(raw)):
        ticks = raw[row]
        if state[STARTED] == 0:
            state[STARTED] = 1
            state[NEWEST] = ticks + state[TURNS]
            if timed:
                state[ARRIVAL] = arrival[row]
        wrap = wraps[state[WRAP]]
        newest = state[NEWEST]
        value = ticks + state[TURNS]
        passed = arrival[row] - state[ARRIVAL] if timed else 0
        near = soon
        if passed < 0 or not 0 <= value - newest <= soon:
            near = (passed + passed // 1000 + slack_ns) // tick_ns if timed else max(wrap // NEAR_SHARE, 1)
        if value < newest or value - newest > near:
            before = value - wrap
            if state[TURNS] > 0 and before <= newest <= before + late:
                out[row] = before  # late, and from before the wrap
                continue
            wrapped = value < newest and _wraps(ticks, near if timed else -1, state, wraps)
            if not wrapped and value < newest and newest - value <= late and state[LATE_RUN] + 1 < LATE_ROWS:
                if state[LATE_RUN] == 0:
                    state[FIRST_LATE] = value
                state[LATE_RUN] += 1
                out[row] = value
                continue
            if not wrapped:
                restarted = value < newest and ticks < max(wrap // NEAR_SHARE // 4, 1)
                steps[0, count] = row
                steps[1, count] = RESET if restarted else JUMP
                first = state[FIRST_LATE] if value < newest and state[LATE_RUN] > 0 else value
                steps[2, count] = first - newest - state[ADVANCE]
                count += 1
                if restarted:
                    state[TURNS] = 0
        elif value > newest:
            state[ADVANCE] = value - newest
        state[NEWEST] = ticks + state[TURNS]
        state[LATE_RUN] = 0
        if timed:
            state[ARRIVAL] = arrival[row]
        while state[OPEN_FROM] + 1 < state[OPEN_TO] and ticks >= wraps[state[OPEN_FROM]]:
            state[OPEN_FROM] += 1  # a value at or past a candidate rules it out
            state[WRAP] = max(state[WRAP], state[OPEN_FROM])
        out[row] = state[NEWEST]
    return count
