"""Groups of frames with the same layout: rows with equal keys, grouped without sorting.

A drain finds frames of several layouts (and devices) in any order; each combination becomes one batch. Its number is
the frame's key, and a hash table finds the group of a key in a few nanoseconds, where a sort would take tens:

    keys    7 7 9 7 −1 9        −1 belongs to no group
    order   0 1 3 | 2 5         rows by group, groups by first appearance, each in the order of the stream
    bounds  0       3     5     group g is order[bounds[g] : bounds[g + 1]]
"""

import numpy as np

from imuscope.protocols.arrays import Ints
from imuscope.protocols.native.kernels import INT, INTS, compiled, unsigned

_MAX_SLOTS = 4096  # a stream has a handful of keys; noise with more only makes chains longer and slower


@compiled(INT, INTS, INTS, INTS)
def group(keys: Ints, order: Ints, bounds: Ints) -> int:
    """Group the rows with a key of 0 or more.

    Args:
        keys: (n,).
        order: (n,), written.
        bounds: (n + 1,), written.

    Returns:
        Number of groups.
    """
    n = len(keys)
    slots = 16
    while slots < 2 * n and slots < _MAX_SLOTS:
        slots *= 2
    newest = np.full(slots, -1, np.int64)  # slot → the newest group whose key hashes to it …
    before = np.empty(n, np.int64)  # … → the group before it
    key_of = np.empty(n, np.int64)
    of = np.empty(n, np.int64)
    groups = 0
    for row in range(unsigned(n)):
        key = keys[row]
        g = -1
        if key >= 0:
            slot = (key ^ key >> 13 ^ key >> 26 ^ key >> 39) & (slots - 1)
            g = newest[slot]
            while g >= 0 and key_of[g] != key:
                g = before[g]
            if g < 0:
                g = groups
                groups += 1
                key_of[g] = key
                before[g] = newest[slot]
                newest[slot] = g
                bounds[g + 1] = 0
            bounds[g + 1] += 1
        of[row] = g
    bounds[0] = 0
    for g in range(groups):
        bounds[g + 1] += bounds[g]
    for row in range(unsigned(n)):
        g = of[row]
        if g >= 0:
            order[bounds[g]] = row
            bounds[g] += 1
    for g in range(groups, 0, -1):
        bounds[g] = bounds[g - 1]
    bounds[0] = 0
    return groups
