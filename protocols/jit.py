"""How is a hot loop compiled, and where is the result kept?

`compiled` is numba's `njit` with two habits of this house: the signature is written out, so that nothing is compiled
behind the reader's back while a device streams, and the machine code is cached on disk. Numba looks for a place in
`NUMBA_CACHE_DIR` (the server sets it before anything here is imported), beside the source file and in the user's cache
folder; where none of them can be written the function is compiled for this run only, and `uncached` says which.

Rules for the functions themselves:

    - Bytes are read as `int(data[i])`: with `NUMBA_DISABLE_JIT=1` the same source runs as plain Python on numpy
      scalars, whose 8-bit sums would overflow.
    - Where a loop is to run at the speed of memory its indices are `unsigned`. A signed index may be negative and then
      counts from the end; the test for that keeps the loop from being vectorised (a sum of bytes: 14 times slower).
    - Numba notices a change of the file it compiled, not of a file whose functions that one calls: after editing a
      callee, touch its callers or delete the cache.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba import types

F = TypeVar("F", bound=Callable[..., Any])

BYTES = types.Array(types.uint8, 1, "C", readonly=True)  # what np.frombuffer(bytes) gives; a writable array fits too
ROWS = types.Array(types.uint8, 2, "C")
INTS = types.Array(types.int64, 1, "C")
TABLE = types.Array(types.int64, 2, "C")  # one row per quantity, one column per frame: each quantity is contiguous
STRIDED = types.Array(types.int64, 2, "A")  # a TABLE of which some columns are left out
INT = types.int64
FLAG = types.boolean
NOTHING = types.void
PAIR: Any = types.Tuple([INT, INT])  # type: ignore[no-untyped-call]
FOUR: Any = types.Tuple([INT, INT, INT, INT])  # type: ignore[no-untyped-call]

unsigned = np.uint64

uncached: list[str] = []
"""Names of the functions that found no place for their machine code and were compiled for this run only."""


def compiled(result: Any, *arguments: Any) -> Callable[[F], F]:
    """Compile the decorated function for exactly these types, once, cached on disk where that is possible."""

    def decorate(function: F) -> F:
        signature = result(*arguments)
        try:
            return cast(F, numba.njit(signature, cache=True, nogil=True)(function))
        except RuntimeError as problem:
            if "locator" not in str(problem):
                raise
            uncached.append(f"{function.__module__}.{function.__qualname__}")
            return cast(F, numba.njit(signature, nogil=True)(function))

    return decorate


def inlined(function: F) -> F:
    """Write the decorated function into the compiled ones that call it; worth it in a loop over frames only."""
    return cast(F, numba.njit(inline="always")(function))
