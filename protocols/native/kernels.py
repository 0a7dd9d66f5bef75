"""Hot loops: plain Python, which runs as machine code where a library of it was built.

`compiled` marks a function to be translated for exactly one signature. When its module is imported, the function is
taken from the package's library (`PACKAGE/native/*.so`), if that was built from the same source; else the plain
function runs and gives the same results, a hundred times slower. Nothing is compiled while a program runs.

    python -m imuscope.protocols.native.compiler [PACKAGE]   builds the library; the package's build hook does the same

There is one library per kind of processor; the best one that this processor can run is loaded. Its functions are keyed
by what each was made of (`Kernel.fingerprint`), so a library is never used with another source.

Rules for the functions themselves (protocols/native/compiler/translate.py names what it cannot translate):

    - Bytes are read as `int(data[i])`: plain Python works on numpy scalars, whose 8-bit sums would overflow.
    - Where a loop must run at memory speed its indices are `unsigned`, as machine code compares and adds them.
    - Numbers are of 64 bits, and an index is not checked: an oracle in tests runs the plain function beside it.
    - An argument of another type or layout than the signature's is a TypeError.
"""

import ctypes
import functools
import hashlib
import importlib.machinery
import importlib.util
import os
import platform
import struct
import sys
import sysconfig
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, TypeVar, cast

import numpy as np

F = TypeVar("F", bound=Callable[..., Any])


@dataclass(frozen=True)
class NumberType:
    """A number type: "int64", "uint64", "float64", "bool" or, as a result, "void"."""

    name: str


@dataclass(frozen=True)
class ArrayType:
    """An array of numbers; `contiguous` is in C order, else any layout."""

    item: str
    dimensions: int
    contiguous: bool = True
    readonly: bool = False


@dataclass(frozen=True)
class TupleType:
    kinds: "tuple[Kind, ...]"


Kind = NumberType | ArrayType | TupleType


def several(*kinds: Kind) -> TupleType:
    """A tuple of these types."""
    return TupleType(kinds)


BYTES = ArrayType("uint8", 1, readonly=True)  # the result of np.frombuffer(bytes); a writable array fits too
ROWS = ArrayType("uint8", 2)
READ_ROWS = ArrayType("uint8", 2, readonly=True)
INTS = ArrayType("int64", 1)
TABLE = ArrayType("int64", 2)  # one row per quantity, one column per frame: each quantity is contiguous
FLOATS = ArrayType("float64", 1)
STRIDED = ArrayType("int64", 2, contiguous=False)  # a TABLE without some of its columns
INT = NumberType("int64")
FLOAT = NumberType("float64")
FLAG = NumberType("bool")
NOTHING = NumberType("void")
PAIR = several(INT, INT)
TRIPLE = several(INT, INT, INT)
FOUR = several(INT, INT, INT, INT)

unsigned = np.uint64


def short(value: int) -> int:
    """The last 16 bits of a number. In machine code such numbers stay short, so that a register holds many of them; put
    the result of each sum and product through this again.
    """
    return int(value) & 0xFFFF


VARIABLE = "IMUSCOPE_PLAIN_PYTHON"
DISABLED = os.environ.get(VARIABLE, "") not in ("", "0")
"""Whether plain Python runs even where there is machine code."""
FOLDER_VARIABLE = "IMUSCOPE_NATIVE"
"""Another folder of libraries, for tests: of code that checks each index."""


class LibraryFunction:
    """A function of the C library, for kernels that call the system: plain Python calls it through ctypes, machine code
    directly. Pointers are passed as numbers (`array.ctypes.data`).

    Args:
        name: as in C.
        result, arguments: names of numbers; with `c_` those of ctypes, with `_t` those of C.
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

    def fingerprint(self) -> str:
        return f"{self.__name__}{self.types}"


def fence() -> int:
    """Order accesses to memory that another thread shares: those before come before those after. In plain Python the
    interpreter's lock does so.
    """
    return 0


class Kernel:
    """A function that may have machine code.

    Args:
        function: plain Python.
        signature: result and arguments; None inlines the function into its translated callers.
        waits: other threads run while it does.
    """

    def __init__(self, function: Callable[..., Any], signature: tuple[Kind, ...] | None, *, waits: bool) -> None:
        self.function = cast(FunctionType, function)
        self.signature = signature
        self.waits = waits
        self.native: Any = None
        self.name = f"{function.__module__}.{function.__qualname__}"

    def callees(self) -> "dict[str, Kernel | LibraryFunction]":
        """The kernels and library functions that it calls, by the names it uses for them."""
        values = self.function.__globals__
        known = {name: kernel_of(values.get(name)) for name in self.function.__code__.co_names}
        return {name: value for name, value in known.items() if value is not None}

    def fingerprint(self) -> str:
        """Equal where machine code may be used: covers the text of the module, the constants, and what it calls."""
        digest = hashlib.sha256(_text_of(self.function.__code__.co_filename))
        digest.update(repr((self.name, self.signature, self.waits)).encode())
        values, callees = self.function.__globals__, self.callees()
        for name in sorted(set(self.function.__code__.co_names) & set(values)):
            value = values[name]
            if name in callees:
                digest.update(callees[name].fingerprint().encode())
            elif isinstance(value, np.ndarray):
                digest.update(value.tobytes())
            elif isinstance(value, (int, float, tuple, bytes)):
                digest.update(repr(value).encode())
        return digest.hexdigest()[:16]


KERNELS: dict[str, Kernel] = {}
"""Kernels of the modules imported so far, by dotted name."""
_by_callable: dict[int, Kernel] = {}


def kernel_of(value: object) -> Kernel | LibraryFunction | None:
    """The kernel behind what a module's name stands for, plain or machine code; None for anything else."""
    if isinstance(value, LibraryFunction):
        return value
    return _by_callable.get(id(value))


def plain(function: F) -> F:
    """The function, and all kernels that it calls, as plain Python: the oracle of tests."""
    kernel = kernel_of(function)
    if not isinstance(kernel, Kernel):
        return function
    source = kernel.function
    inner = {name: plain(cast(Any, source.__globals__[name])) for name in kernel.callees()}
    made = FunctionType(source.__code__, source.__globals__ | inner, source.__name__, source.__defaults__)
    return cast(F, made)


def compiled(result: Kind, *arguments: Kind, waits: bool = False) -> Callable[[F], F]:
    """Run the decorated function as machine code for exactly these types, where it was built.

    Args:
        waits: it waits for the system, and other threads run during the call. Else they do not: to release the lock and
            take it again lasts longer than most calls.
    """

    def decorate(function: F) -> F:
        return _kernel(function, (result, *arguments), waits=waits)

    return decorate


def inlined(function: F) -> F:
    """Inline the decorated function into its translated callers; worth it only in a loop over frames."""
    return _kernel(function, None, waits=False)


def _kernel(function: F, signature: tuple[Kind, ...] | None, *, waits: bool) -> F:
    kernel = Kernel(function, signature, waits=waits)
    KERNELS[kernel.name] = kernel
    used: Any = function
    library = None if DISABLED or signature is None else _library(kernel.function.__module__.partition(".")[0])
    if library is not None:
        native = getattr(library, kernel.name, None)
        if native is not None and native.__doc__ == kernel.fingerprint():
            kernel.native = used = native
    _by_callable[id(used)] = kernel
    return cast(F, used)


def library_place(function: Callable[..., Any]) -> tuple[str, str] | None:
    """The file of the library that a kernel runs from, and its name there: for a process without numpy, which passes no
    arrays. None if it runs as plain Python.
    """
    kernel = kernel_of(function)
    if not isinstance(kernel, Kernel) or kernel.native is None:
        return None
    library = _library(kernel.function.__module__.partition(".")[0])
    return None if library is None else (str(library.__file__), kernel.name)


def is_complete() -> bool:
    """Whether every kernel of imuscope's modules that were imported so far is machine code."""
    return not missing()


def missing(package: str = "imuscope") -> list[str]:
    """A package's kernels that run as plain Python, for lack of a library of this source for this processor."""
    own = [kernel for name, kernel in KERNELS.items() if name.startswith(f"{package}.")]
    return [kernel.name for kernel in own if kernel.signature is not None and kernel.native is None]


LEVELS = {  # of x86-64, best first: what /proc/cpuinfo must list beside the level before
    "x86_64_v4": "avx512f avx512bw avx512cd avx512dq avx512vl",
    "x86_64_v3": "avx avx2 bmi1 bmi2 f16c fma abm movbe",
    "x86_64": "",
}
"""Libraries for x86-64, by what they require; `aarch64` has one."""


def library_folder(package: str) -> Path | None:
    """Folder of the libraries of a top-level package or module; None if it has no files."""
    if package == "imuscope" and (other := os.environ.get(FOLDER_VARIABLE)):
        return Path(other)
    file = getattr(sys.modules.get(package), "__file__", None)
    if file is None:
        spec = importlib.util.find_spec(package)
        file = None if spec is None else spec.origin
    return None if file is None else Path(file).parent / "native"


def libraries() -> Iterator[str]:
    """Names of the libraries that this interpreter and processor can run, best first."""
    if not sys.platform.startswith("linux") or struct.calcsize("P") != 8 or sys.byteorder != "little":
        return
    if sysconfig.get_config_var("Py_GIL_DISABLED") or sysconfig.get_config_var("Py_DEBUG"):
        return
    machine = platform.machine()
    if machine != "x86_64":
        yield machine
        return
    try:
        flags = set(Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").split("flags", 2)[1].split())
    except (OSError, IndexError):
        flags = set()
    for name, needed in LEVELS.items():
        lower = LEVELS["x86_64_v3"] if name == "x86_64_v4" else ""
        if flags.issuperset(f"{needed} {lower}".split()):
            yield name


@functools.cache
def _library(package: str) -> ModuleType | None:
    """The package's library, loaded; None if there is none for this processor."""
    folder = library_folder(package)
    for name in libraries() if folder is not None else ():
        path = cast(Path, folder) / f"kernels.{name}.so"
        if not path.is_file():
            continue
        loader = importlib.machinery.ExtensionFileLoader(f"{package}_native.kernels", str(path))
        spec = importlib.util.spec_from_loader(loader.name, loader)
        try:
            module = importlib.util.module_from_spec(cast(Any, spec))
            loader.exec_module(module)
        except ImportError:  # cut short, or of another system
            continue
        return module
    return None


@functools.cache
def _text_of(path: str) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError:
        return b""
