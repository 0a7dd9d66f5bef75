"""How is a hot loop compiled, and where is the result kept?

`compiled` is numba's `njit` with two habits of this house: the signature is written out, so that nothing is compiled
behind the reader's back while a device streams, and the machine code is kept on disk:

    the server has said where    in one file of ours (protocols/native_cache.py), from which it is taken at the next
                                 start; numba is not even imported then
    it has not (tests, scripts)  by numba, in `NUMBA_CACHE_DIR`, beside the source file or in the user's cache folder;
                                 where none of them can be written the function is compiled for this run only

Because numba may never be there, the types of a signature are said as what they will be once it is: a `TypeSpec` makes
numba's type of its module `types`.

Rules for the functions themselves:

    - Bytes are read as `int(data[i])`: with `NUMBA_DISABLE_JIT=1` the same source runs as plain Python on numpy
      scalars, whose 8-bit sums would overflow.
    - Where a loop is to run at the speed of memory its indices are `unsigned`. A signed index may be negative and then
      counts from the end; the test for that keeps the loop from being vectorised (a sum of bytes: 14 times slower).
    - Numba notices a change of the file it compiled, not of a file whose functions that one calls: after editing a
      callee, touch its callers or delete the cache.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from protocols import native_cache

F = TypeVar("F", bound=Callable[..., Any])
TypeSpec = Callable[[Any], Any]
"""numba.types -> one of its types."""


def scalar(name: str) -> TypeSpec:
    """A number, as numba calls it."""
    return lambda types: getattr(types, name)


def array(item: str, dimensions: int, layout: str, *, readonly: bool = False) -> TypeSpec:
    """An array; `layout` is "C" where it is contiguous, "A" for any."""
    return lambda types: types.Array(getattr(types, item), dimensions, layout, readonly=readonly)


def several(*kinds: TypeSpec) -> TypeSpec:
    """A tuple."""
    return lambda types: types.Tuple([kind(types) for kind in kinds])


BYTES = array("uint8", 1, "C", readonly=True)  # what np.frombuffer(bytes) gives; a writable array fits too
ROWS = array("uint8", 2, "C")
INTS = array("int64", 1, "C")
TABLE = array("int64", 2, "C")  # one row per quantity, one column per frame: each quantity is contiguous
STRIDED = array("int64", 2, "A")  # a TABLE of which some columns are left out
INT = scalar("int64")
FLAG = scalar("boolean")
NOTHING = scalar("void")
PAIR = several(INT, INT)
FOUR = several(INT, INT, INT, INT)

unsigned = np.uint64

_disabled = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")
_place = None if _disabled else native_cache.cache_path()
_kept = native_cache.load(_place) if _place else {}
_is_whole = bool(_kept)
_made: dict[str, Any] = {}
_parts: list[Path] = []


def compiled(result: TypeSpec, *arguments: TypeSpec) -> Callable[[F], F]:
    """Compile the decorated function for exactly these types, once, kept on disk where that is possible."""

    def decorate(function: F) -> F:
        name = f"{function.__module__}.{function.__qualname__}"
        if name in _kept:
            return cast(F, _kept[name])
        import numba

        signature = result(numba.types)(*(kind(numba.types) for kind in arguments))
        try:
            made = numba.njit(signature, cache=_place is None, nogil=True)(function)
        except RuntimeError as problem:
            if "locator" not in str(problem):
                raise
            made = numba.njit(signature, nogil=True)(function)
        _made[name] = made
        return cast(F, made)

    return decorate


def inlined(function: F) -> F:
    """Write the decorated function into the compiled ones that call it; worth it in a loop over frames only."""
    if _kept:
        return function  # it is in the machine code of its callers
    import numba

    return cast(F, numba.njit(inline="always")(function))


def save() -> None:
    """Write the machine code of all that was compiled to where the next process looks for it, if anything was.

    Raises:
        OSError: it cannot be written.
    """
    if _place and _made and not _is_whole:
        native_cache.save(_place, _made, *_parts)
        for part in _parts:
            part.unlink(missing_ok=True)


def save_module(path: Path, package: str) -> None:
    """Write that of one package's modules only, for another process to `load_module`."""
    native_cache.save(path, {name: made for name, made in _made.items() if name.startswith(f"{package}.")})


def load_module(part: Path) -> None:
    """Use what another process has compiled, for modules that are not imported yet, and keep it with the rest."""
    functions = native_cache.load(part)
    if functions:
        _kept.update(functions)
        _parts.append(part)
