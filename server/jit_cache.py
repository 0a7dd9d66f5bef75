"""Cache folder of compiled functions, and their compilation.

numba reads NUMBA_CACHE_DIR once, at import, so the folder is determined first, without importing it:

    data folder/compiled/<version>  the default; or NUMBA_CACHE_DIR, if it is already set (a container image)
    a new temporary folder          if that folder is not writable: compiled for this run only
    none                            nothing is writable: each process compiles for itself

numba does not use a read-only cache, so one from a container image is copied to the temporary folder (2 MB). Folders of
previous versions are removed.

Nothing waits for the compiler: loops run as plain Python until `load` is done (protocols/jit.py). The first time two
subprocesses of low priority compile, because one process compiles on one core only and would slow the server down.

A temporary folder is created for each run, never found by name, because files placed there could run code.
"""

from __future__ import annotations

import atexit
import gc
import os
import pickle
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from imuscope.protocols.plugins import protocol_plugins
from imuscope.server.version import VERSION

ROOT = Path(__file__).absolute().parents[2]  # holds imuscope/
VARIABLE = "NUMBA_CACHE_DIR"
COMPILING = (
    "Compiling the decoders; this is done once, and takes minutes on a busy computer. Until then fast streams may be "
    "shown late, but nothing is lost."
)
_COMPILE = """
import os
from imuscope.recordings.parent_death import die_with_parent
die_with_parent()
os.nice(10)  # devices come first
from imuscope.protocols import jit
import {modules}
jit.load()
"""
_POLL_S = 0.1
OTHERS = ("imuscope.recordings.mcap_reader", "imuscope.server.links.read_loop")
"""Modules with loops, beside those of the families."""


def prepare_cache(data: Path) -> list[str]:
    """Determine the cache folder and set NUMBA_CACHE_DIR.

    Returns:
        messages for the user.
    """
    from imuscope.protocols import jit  # imports numpy

    if jit.DISABLED:
        return []
    root, place = data / "compiled", _cache_folder(data)
    messages: list[str] = []
    if _writable(place):
        if place.parent == root:
            _remove_others(root, place)
    else:
        read_only, temporary = place, _temporary()
        if temporary is not None and next(read_only.rglob("*.nbi"), None) is not None:
            _copy(read_only, temporary)
        else:
            messages = [f"{read_only} cannot be written: compiled code is stored for this run only."]
        if temporary is None:
            os.environ.pop(VARIABLE, None)
            return messages
        place = temporary
    os.environ[VARIABLE] = str(place)
    return messages


def is_there(data: Path) -> bool:
    """Whether this data folder has all compiled code; changes nothing."""
    return _has_code(_cache_folder(data))


def is_filled() -> bool:
    """Whether the configured folder has all compiled code; changes nothing."""
    place = os.environ.get(VARIABLE)
    return place is not None and _has_code(Path(place))


def load(*, report: Callable[[str], None], stop: Callable[[], bool] = lambda: False) -> None:
    """Compile the decoders; this takes a second or, the first time, about ten.

    Args:
        report: receives messages for the user if it takes longer than a second.
        stop: called periodically; compilation ends when it returns true.
    """
    jit = _with_loops()
    if jit.DISABLED or jit.is_loaded():
        return
    place, started_at, first = os.environ.get(VARIABLE), time.monotonic(), not is_filled()
    if first:
        report(COMPILING)
        if place is not None and (os.cpu_count() or 1) > 1:
            _compile_in_subprocesses(stop)
    try:
        jit.load(stop=stop)
    except (EOFError, pickle.UnpicklingError):  # truncated, perhaps by a power failure
        if place is not None:
            shutil.rmtree(place, ignore_errors=True)
        jit.load(stop=stop)
    if first and jit.is_loaded():
        report(f"The decoders are compiled ({time.monotonic() - started_at:.0f} s).")


def _shares() -> tuple[list[str], list[str]]:
    """Modules whose loops are compiled, in two shares: the family with the most loops is half of the work."""
    modules = [plugin.module for plugin in protocol_plugins() if not plugin.package]
    largest = max(modules, key=_compiled_functions)
    return [largest], [*(module for module in modules if module != largest), *OTHERS]


def _compiled_functions(module: str) -> int:
    """Number of functions of the module's package that are compiled."""
    folder = ROOT.joinpath(*module.split(".")[:-1])
    return sum(path.read_text(encoding="utf-8").count("\n@compiled") for path in folder.glob("*.py"))


def _compile_in_subprocesses(stop: Callable[[], bool]) -> None:
    """Fill the cache in subprocesses. If one fails, this process compiles the rest."""
    commands = [[sys.executable, "-c", _COMPILE.format(modules=", ".join(modules))] for modules in _shares()]
    running = [
        subprocess.Popen(one, cwd=ROOT, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        for one in commands
    ]
    for process in running:
        while process.poll() is None:
            if stop():
                process.kill()
            time.sleep(_POLL_S)


class BackgroundLoad:
    """`load` in a background thread; also a context manager.

    From its creation on nothing else in this process loads (protocols/jit.py: automatic): a decoder that received much
    before the thread was started would load in the event loop, and everything else would wait.

    Args:
        report: as `load`; called in the thread.
    """

    def __init__(self, report: Callable[[str], None]) -> None:
        from imuscope.protocols import jit

        jit.automatic = False
        self._report = report
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="loading compiled code")

    def start(self) -> None:
        """Start the thread; returns at once. Idempotent."""
        if self._thread.ident is None:
            self._thread.start()

    def _run(self) -> None:
        load(report=self._report, stop=self._stop.is_set)
        gc.freeze()  # numba's many objects stay: exclude them from garbage collection while devices stream

    def close(self) -> None:
        """Stop after the current function is compiled, and wait for the thread."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()

    def __enter__(self) -> BackgroundLoad:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _cache_folder(data: Path) -> Path:
    return Path(os.environ.get(VARIABLE) or data / "compiled" / VERSION)


def _with_loops() -> ModuleType:
    """protocols/jit.py, which knows the loops of the modules imported so far, after these have been imported."""
    from imuscope.protocols import jit, registry  # noqa: F401
    from imuscope.recordings import mcap_reader  # noqa: F401
    from imuscope.server.links import read_loop  # noqa: F401

    return jit


def _has_code(folder: Path) -> bool:
    """Whether every loop is compiled in a folder: a compiler that was killed leaves some of them."""
    jit = _with_loops()
    return not jit.DISABLED and bool(jit.is_stored(folder))


def _temporary() -> Path | None:
    try:
        place = Path(tempfile.mkdtemp(prefix="imuscope-"))
    except OSError:
        return None
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    return place


def _copy(read_only: Path, place: Path) -> None:
    """Copy the files without their modes, which forbid writing."""
    for file in read_only.glob("*/*.nb[ic]"):
        (place / file.parent.name).mkdir(exist_ok=True)
        shutil.copyfile(file, place / file.parent.name / file.name)


def _remove_others(root: Path, keep: Path) -> None:
    """Remove the code of previous versions; one that still runs has already loaded its functions."""
    for folder in root.iterdir():
        if folder != keep:
            shutil.rmtree(folder, ignore_errors=True)


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False
