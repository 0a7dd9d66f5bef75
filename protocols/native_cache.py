"""How does compiled code come back in the next process, without the compiler?

Importing numba takes a second and getting what it cached takes another half: too long for a page that is to be there
when one opens it. The machine code itself is small (360 kB) and loads in 5 ms. So what numba made is written to one
file, and the next process hands that file to LLVM's loader and wraps each entry as numba wraps it:

    numba ── keep ──> kept.bin ── load ──> {"protocols.checksums.sum8": a function like numba's, ...}
                        SHA-256 of all that follows (32 bytes)
                        u32 size of the head, little-endian
                        head, JSON: {"mark": ..., "functions": [[name, entry symbol, environment symbol, size], ...]}
                        the object files, one after the other

What a function is called with is not looked at as closely as numba does: a wrong item size is refused, a wrong layout
is not. Tests therefore run with numba itself, and compare both.

The file fits only what it was made of: the mark names the sources, Python, numba, llvmlite, numpy and the processor
with its features. Whatever does not fit, or is not whole, is as if it were not there, and numba does the work.

What is used of numba here, besides its object files: `_helperlib` and `_nrt_python` have the functions that the object
files call, `_dynfunc` makes a Python function of an entry. All three are loaded from their own files, without the
package around them. Sources: numba.core.codegen, numba.core.cpu, numba.core.runtime.nrt (0.68).
"""

from __future__ import annotations

import builtins
import ctypes
import hashlib
import importlib.util
import json
import os
import struct
import sys
from collections.abc import Callable, Mapping
from functools import cache
from importlib import machinery, metadata
from pathlib import Path
from types import ModuleType
from typing import Any

VARIABLE = "IMUSCOPE_MACHINE_CODE"
"""Where a process finds the file; those that it starts find it too."""

NAME = "kept.bin"

_SOURCES = ("protocols/**/*.py", "recordings/mcap_reader.py")  # what holds compiled functions and their constants
_HEAD = struct.Struct("<I")
_DIGEST = hashlib.sha256().digest_size


@cache
def sources_mark() -> str:
    """Names the sources of everything that is compiled, and the Python that runs them, as at the first call."""
    digest = hashlib.sha256(sys.version.encode())
    root = Path(__file__).parents[1]
    for pattern in _SOURCES:
        for source in sorted(root.glob(pattern)):
            digest.update(source.relative_to(root).as_posix().encode() + b"\0" + source.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def is_valid(path: Path) -> bool:
    """Is `path` a file whose code may run here and now?"""
    return _read(path) is not None


def cache_path() -> Path | None:
    """Where this process was told to look for its machine code."""
    return Path(os.environ[VARIABLE]) if os.environ.get(VARIABLE) else None


def save(path: Path, functions: Mapping[str, Any], *parts: Path) -> None:
    """Write the machine code of numba's dispatchers, each compiled for one signature, by their names.

    Args:
        path: the file.
        functions: the dispatchers; compiled in this process, since numba forgets what it took from its cache.
        parts: files of the same kind that go into it.

    Raises:
        OSError: the file cannot be written; it is there whole or not at all.
    """
    rows, objects = [], []
    for name, dispatcher in functions.items():
        [made] = dispatcher.overloads.values()
        code = made.library._get_compiled_object()
        rows.append([name, made.fndesc.llvm_cpython_wrapper_name, made.fndesc.env_name, len(code)])
        objects.append(code)
    for part in parts:
        found = _read(part)
        if found is None:  # never a file without what it should hold: numba cannot compile what calls kept functions
            raise OSError(f"{part} cannot be read any more")
        rows += found[0]
        objects.append(found[2][found[1] :])
    head = json.dumps({"mark": _mark(), "functions": rows}).encode()
    body = _HEAD.pack(len(head)) + head + b"".join(objects)
    fresh = path.with_name(f"{path.name}.{os.getpid()}")
    try:
        fresh.write_bytes(hashlib.sha256(body).digest() + body)
        fresh.replace(path)
    finally:
        fresh.unlink(missing_ok=True)


def load(path: Path) -> dict[str, Callable[..., Any]]:
    """The functions of the file by their names; none where it does not fit, or numba is not made as we know it."""
    found = _read(path)
    if found is None:
        return {}
    try:
        return _functions(*found)
    except (ImportError, AttributeError, LookupError, RuntimeError, TypeError):
        return {}


def _functions(rows: list[Any], at: int, data: bytes) -> dict[str, Callable[..., Any]]:
    engine, dynfunc = _engine(), _extension("numba._dynfunc")
    from llvmlite import binding as llvm

    for *_, size in rows:
        engine.add_object_file(llvm.ObjectFileRef.from_data(data[at : at + size]))
        at += size
    engine.finalize_object()
    functions: dict[str, Callable[..., Any]] = {}
    for name, entry, environment_symbol, _ in rows:
        # An entry refuses to run without the environment that numba made for it; ours has nothing in it, because a
        # function whose signature is written out asks it for nothing.
        environment = dynfunc.Environment({})
        ctypes.c_void_p.from_address(engine.get_global_value_address(environment_symbol)).value = id(environment)
        module, _, plain = name.rpartition(".")
        functions[name] = dynfunc.make_function(
            sys.modules.get(module, sys.modules[__name__]),
            plain,
            f"Compiled {name}.",
            engine.get_function_address(entry),
            environment,
            (engine, environment),
        )
    return functions


def _read(path: Path) -> tuple[list[Any], int, bytes] | None:
    """The rows of the head, where the first object file begins, and the file; None where it does not fit."""
    try:
        data = path.read_bytes()
        if len(data) < _DIGEST + _HEAD.size or hashlib.sha256(data[_DIGEST:]).digest() != data[:_DIGEST]:
            return None
        at = _DIGEST + _HEAD.size
        [size] = _HEAD.unpack_from(data, _DIGEST)
        head = json.loads(data[at : at + size])
        return (head["functions"], at + size, data) if head["mark"] == _mark() else None
    except (OSError, ValueError, ImportError):
        return None


def _mark() -> str:
    """Names all that the machine code depends on."""
    from llvmlite import binding as llvm

    cpu = os.environ.get("NUMBA_CPU_NAME") or llvm.get_host_cpu_name()
    features = os.environ.get("NUMBA_CPU_FEATURES")
    if features is None:
        features = "" if cpu == "generic" else llvm.get_host_cpu_features().flatten()
    versions = [f"{name} {metadata.version(name)}" for name in ("numba", "llvmlite", "numpy")]
    return hashlib.sha256("\0".join([sources_mark(), *versions, cpu, features]).encode()).hexdigest()


def _engine() -> Any:
    """LLVM's loader, which knows by name all that the object files call."""
    from llvmlite import binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    llvm.add_symbol("_Py_NoneStruct", id(None))
    for name, address in _extension("numba._helperlib").c_helpers.items():
        llvm.add_symbol(f"numba_{name}", address)
    for name, address in _extension("numba.core.runtime._nrt_python").c_helpers.items():
        llvm.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)
    for one in vars(builtins).values():
        if isinstance(one, type) and issubclass(one, BaseException):
            llvm.add_symbol(f"PyExc_{one.__name__}", id(one))
    machine = llvm.Target.from_default_triple().create_target_machine(opt=3, jit=True, codemodel="jitdefault")
    return llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)


def _extension(name: str) -> ModuleType:
    """One of numba's modules that are written in C, without the package around it.

    Raises:
        ImportError: numba is not there, or has no such module.
    """
    package = importlib.util.find_spec("numba")
    if package is None or not package.submodule_search_locations:
        raise ImportError("numba is not installed")
    base = Path(package.submodule_search_locations[0], *name.split(".")[1:])
    for suffix in machinery.EXTENSION_SUFFIXES:
        path = base.with_name(base.name + suffix)
        if path.exists():
            spec = importlib.util.spec_from_file_location(name, path)
            if spec is not None and spec.loader is not None:
                module = importlib.util.module_from_spec(spec)
                spec.loader.exec_module(module)
                return module
    raise ImportError(f"numba has no {name}")
