"""Groups of parts to leave out together: that none needs another is seen in few tries."""

from collections.abc import Sequence
from itertools import combinations, count, islice
from math import comb


def groups_to_leave_out(names: Sequence[str]) -> list[list[str]]:
    """Groups, the fewest, such that each name is in one that does not have the other, for any two of them.

    Each name has as many groups as every other, and no two have the same (Sperner 1928), so none has all of another's.
    """
    size = next(n for n in count(2) if comb(n, n // 2) >= len(names))
    groups: list[list[str]] = [[] for _ in range(size)]
    for name, own in zip(names, islice(combinations(groups, size // 2), len(names)), strict=True):
        for group in own:
            group.append(name)
    for name in names:
        together = [set(group) for group in groups if name in group]
        assert set.intersection(*together) == {name}
    return groups
