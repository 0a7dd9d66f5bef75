"""Hot loops: plain Python until compiled, machine code afterwards.

`compiled` marks a function to be compiled by numba for exactly one signature, and changes nothing else: until `load` is
called the function runs as plain Python and gives the same results, slower. So no caller waits for a compiler:

    a small file, the first second of a server   plain Python; some kilobytes take less time than importing numba
    load()                                       numba takes each function from its cache on disk, or compiles it
    afterwards                                   every caller runs the machine code, whatever it imported before

Code that reads much data calls `load_for` with its size and need not call `load`; a server, which must not wait, takes
that over (`automatic`) and loads in a thread.

numba keeps its cache in NUMBA_CACHE_DIR (server/jit_cache.py chooses it), beside the source file or in the user's cache
folder; if none of them is writable the functions are compiled for this run only. An entry is keyed by what the machine
code is made of (`Kernel.fingerprint`, numba's version, the processor), so copies of the source and versions of it share
one folder. With NUMBA_DISABLE_JIT=1 the functions stay Python.

Because numba may not be imported, a signature names its types: a `TypeSpec` makes the numba type from the module
`numba.types` once it is imported.

Rules for the functions themselves:

    - Bytes are read as `int(data[i])`: plain Python works on numpy scalars, whose 8-bit sums would overflow.
    - Where a loop must run at memory speed its indices are `unsigned`. A signed index may be negative and then counts
      from the end; the test for that prevents vectorisation (a sum of bytes: 14 times slower).
    - Arguments are not checked: an array of another layout than the signature's is read wrongly. Tests call
      `load(checked=True)`, which keeps numba's own check.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import importlib
import os
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any, TypeVar, cast

import numpy as np

F = TypeVar("F", bound=Callable[..., Any])
TypeSpec = Callable[[Any], Any]
"""numba.types -> one of its types."""


def scalar(name: str) -> TypeSpec:
    """A number type, by numba's name."""
    return lambda types: getattr(types, name)


def array(item: str, dimensions: int, layout: str, *, readonly: bool = False) -> TypeSpec:
    """An array; `layout` is "C" where it is contiguous, "A" for any."""
    return lambda types: types.Array(getattr(types, item), dimensions, layout, readonly=readonly)


def several(*kinds: TypeSpec) -> TypeSpec:
    """A tuple."""
    return lambda types: types.Tuple([kind(types) for kind in kinds])


BYTES = array("uint8", 1, "C", readonly=True)  # the result of np.frombuffer(bytes); a writable array fits too
ROWS = array("uint8", 2, "C")
READ_ROWS = array("uint8", 2, "C", readonly=True)
INTS = array("int64", 1, "C")
TABLE = array("int64", 2, "C")  # one row per quantity, one column per frame: each quantity is contiguous
FLOATS = array("float64", 1, "C")
STRIDED = array("int64", 2, "A")  # a TABLE without some of its columns
INT = scalar("int64")
FLOAT = scalar("float64")
FLAG = scalar("boolean")
NOTHING = scalar("void")
PAIR = several(INT, INT)
TRIPLE = several(INT, INT, INT)
FOUR = several(INT, INT, INT, INT)

unsigned = np.uint64

INTERPRETED_BYTES = 1 << 16
"""Plain Python processes this many bytes in half the time of importing numba and its compiled code."""

DISABLED = os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0")


class LibraryFunction:
    """A function of the C library, for kernels that call the system: plain Python calls it through ctypes, machine code
    directly. Pointers are passed as numbers (`array.ctypes.data`).

    Args:
        name: as in C.
        result, arguments: names of numbers, the same in numba and, with `c_`, in ctypes.
    """

    def __init__(self, name: str, result: str, *arguments: str) -> None:
        self.__name__ = name
        self.types = (result, *arguments)

    @functools.cached_property
    def _plain(self) -> Any:
        function = ctypes.CDLL(None)[self.__name__]
        function.restype, *function.argtypes = (getattr(ctypes, f"c_{name}") for name in self.types)
        return function

    def __call__(self, *arguments: int) -> int:
        return cast(int, self._plain(*arguments))

    def compile(self) -> Any:
        """The function as numba's compiled code calls it."""
        from numba import types

        result, *arguments = (getattr(types, name) for name in self.types)
        return types.ExternalFunction(self.__name__, result(*arguments))

    def fingerprint(self) -> str:
        return f"{self.__name__}{self.types}"


class Kernel:
    """A function that is compiled by `load`.

    Each kernel is the only instance of a class of its own, whose `__call__` is the plain function first and the entry
    of the machine code later: Python then calls either without an intermediate step.

    Args:
        function: plain Python.
        signature: result and arguments; None inlines the function into its compiled callers.
    """

    def __init__(self, function: Callable[..., Any], signature: tuple[TypeSpec, ...] | None) -> None:
        self.function = cast(FunctionType, function)
        self.signature = signature
        self.dispatcher: Any = None
        self.__name__, self.__doc__, self.__module__ = function.__name__, function.__doc__, function.__module__

    def callees(self) -> dict[str, Kernel | LibraryFunction]:
        """The kernels and library functions that it calls, by the names it uses for them."""
        values = self.function.__globals__
        return {
            name: value
            for name in self.function.__code__.co_names
            if isinstance(value := values.get(name), Kernel | LibraryFunction)
        }

    def fingerprint(self) -> str:
        """Equal where the machine code may be reused: covers the function's code, its callees and their constants.

        numba's cache notices a change in the function's own file, not in the files of its callees.
        """
        code, values = self.function.__code__, self.function.__globals__
        digest = hashlib.sha256(code.co_code + repr((code.co_consts, code.co_names)).encode())
        for name in code.co_names:
            value = values.get(name)
            if isinstance(value, Kernel | LibraryFunction):
                digest.update(value.fingerprint().encode())
            elif isinstance(value, np.ndarray):
                digest.update(value.tobytes())
            elif isinstance(value, (int, float, tuple, bytes)):
                digest.update(repr(value).encode())
        return digest.hexdigest()[:12]

    def stored_name(self) -> str:
        """Name of its entry in the cache, and of the symbol in machine code."""
        return f"{self.function.__qualname__}_{self.fingerprint()}"

    def compile(self) -> Any:
        """Numba's dispatcher of it, compiled or loaded from the cache."""
        if self.dispatcher is None:
            import numba

            code, plain = self.function.__code__, self.function
            inner = {name: one.compile() for name, one in self.callees().items()}
            source = FunctionType(
                code, plain.__globals__ | inner, plain.__name__, plain.__defaults__, plain.__closure__
            )
            source.__module__ = plain.__module__
            source.__qualname__ = self.stored_name()
            if self.signature is None:
                self.dispatcher = numba.njit(inline="always")(source)
            else:
                result, *arguments = (kind(numba.types) for kind in self.signature)
                self.dispatcher = _cached(numba, source, result(*arguments))
        return self.dispatcher

    def install(self, *, checked: bool) -> None:
        """Run the machine code from now on."""
        if self.signature is not None:
            [made] = self.dispatcher.overloads.values()
            type(self).__call__ = staticmethod(self.dispatcher if checked else made.entry_point)  # type: ignore


_kernels: list[Kernel] = []
_loaded = False
_checked = False
automatic = True
"""Whether `load_for` may load."""


def compiled(result: TypeSpec, *arguments: TypeSpec) -> Callable[[F], F]:
    """Compile the decorated function for exactly these types when `load` is called; at once if it was called before."""

    def decorate(function: F) -> F:
        return cast(F, _kernel(function, (result, *arguments)))

    return decorate


def inlined(function: F) -> F:
    """Inline the decorated function into its compiled callers; worth it only in a loop over frames."""
    return cast(F, _kernel(function, None))


def _kernel(function: Callable[..., Any], signature: tuple[TypeSpec, ...] | None) -> Any:
    if DISABLED:
        return function
    kernel = type(function.__name__, (Kernel,), {"__call__": staticmethod(function)})(function, signature)
    _kernels.append(kernel)
    if _loaded:
        kernel.compile()
        kernel.install(checked=_checked)
    return kernel


def load(*, checked: bool = False, stop: Callable[[], bool] = lambda: False) -> None:
    """Compile every kernel of the modules imported now or later.

    Takes a second if numba has them in its cache, otherwise half a minute of a core. May be called in a thread: other
    threads continue with plain Python until it is done.

    Args:
        checked: let numba check the arguments of each call.
        stop: called between two functions; true ends loading, and plain Python continues.
    """
    global _loaded, _checked
    if DISABLED or (_loaded and _checked == checked):
        return
    for kernel in list(_kernels):
        if stop():
            return
        kernel.compile()
    _loaded, _checked = True, checked
    for kernel in list(_kernels):
        kernel.compile()  # of a module imported since
        kernel.install(checked=checked)


def load_for(size: int) -> None:
    """Load if that is worth it for `size` bytes and no server does it itself (`automatic`)."""
    if automatic and not _loaded and size > INTERPRETED_BYTES:
        load()


def is_loaded() -> bool:
    """Whether machine code is in use."""
    return _loaded


def is_stored(folder: Path) -> bool:
    """Whether the cache in `folder` has every kernel of the modules imported so far. Does not import numba."""
    if DISABLED:
        return True
    mine = [one for one in _kernels if one.signature is not None]
    return all(
        any((folder / one.__module__).glob(f"*.{one.stored_name()}-*.{kind}"))
        for one in mine
        for kind in ("nbi", "nbc")  # numba's index, and what it points to
    )


def recompiled() -> int:
    """Number of functions compiled because the cache lacked them."""
    return sum(sum(one.dispatcher.stats.cache_misses.values()) for one in _kernels if one.dispatcher is not None)


def _cached(numba: Any, function: FunctionType, signature: Any) -> Any:
    """Numba's dispatcher, from the cache or compiled into it.

    Its cache is keyed by the folder of the source, the contents of the file and a line number, so that another copy of
    the same source compiles everything again. Here the function's name decides, which holds its kernel's fingerprint.
    """
    caching: Any = importlib.import_module("numba.core.caching")

    class Locator(caching.UserProvidedCacheLocator):  # type: ignore[misc]
        def __init__(self, function: FunctionType, file: str) -> None:
            self._py_file, self._cache_path = file, os.path.join(caching.config.CACHE_DIR, function.__module__)

        def get_source_stamp(self) -> str:
            return ""

        def get_disambiguator(self) -> str:
            return ""

    class Storage(caching.CompileResultCacheImpl):  # type: ignore[misc]
        _locator_classes = (Locator, *caching.CompileResultCacheImpl._locator_classes)

    class Cache(caching.FunctionCache):  # type: ignore[misc]
        _impl_class = Storage

    dispatcher = numba.njit(nogil=True)(function)
    try:
        dispatcher._cache = Cache(function)
    except RuntimeError as problem:
        if "locator" not in str(problem):  # no cache folder is writable
            raise
    dispatcher.compile(signature)
    dispatcher.disable_compile()
    return dispatcher
