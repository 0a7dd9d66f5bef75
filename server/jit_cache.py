"""Where is compiled code kept between runs?

numba looks at NUMBA_CACHE_DIR once, when it is imported, so this is decided first and without importing it:

    data folder/compiled/<mark>   the usual place; or NUMBA_CACHE_DIR, where that is set already (a container image)
    a fresh temporary folder      where that place cannot be written: compiled for this run only, a few seconds
    nowhere                       nothing can be written: each process compiles for itself (protocols/jit.py)

In that folder lie numba's own cache and, once all is compiled, one file with the machine code, from which a process
starts without numba (protocols/native_cache.py). That one is only read: a place that is read-only will do, if the file
fits.

The mark is that of the sources: numba notices a change in the file of a function, but not in the files of the functions
it calls, so after an update it could run half of the old code. Marks of former versions are swept away.

A temporary folder is made anew for each run, never found by name: whoever could put files there could run code.
"""

from __future__ import annotations

import atexit
import os
import shutil
import subprocess
import sys
import tempfile
from importlib import import_module
from pathlib import Path

from protocols import native_cache

ROOT = Path(__file__).resolve().parents[1]
_ISB = """
import sys
from pathlib import Path
from protocols import jit
from protocols.isb import decoder
jit.save_module(Path(sys.argv[1]), "protocols.isb")
"""
VARIABLE = "NUMBA_CACHE_DIR"


def prepare_cache(data: Path) -> tuple[bool, list[str]]:
    """Settle the place.

    Returns:
        whether there is no compiled code yet, and sentences that the user should read.
    """
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        return False, []
    home = data / "compiled"
    place = _wanted(data)
    fits, words = native_cache.is_valid(place / native_cache.NAME), []
    if _writable(place):
        if place.parent == home:
            _sweep(home, place)
    elif not fits:
        words = [f"{place} cannot be written: compiled code is kept for this run only."]
        try:
            place = Path(tempfile.mkdtemp(prefix="imuscope-"))
        except OSError:
            os.environ.pop(VARIABLE, None)
            return True, words
        atexit.register(shutil.rmtree, place, ignore_errors=True)
    os.environ[VARIABLE] = str(place)
    os.environ[native_cache.VARIABLE] = str(place / native_cache.NAME)
    return not fits, words


def compile_by_two() -> None:
    """Compile all, half of it in a second process: a process compiles on one core only, and ISB is half of it."""
    place = native_cache.cache_path()
    if place is None or (os.cpu_count() or 1) < 2:
        return
    part = place.with_name(f"isb-{os.getpid()}.bin")
    nothing = (
        subprocess.DEVNULL
    )  # should it fail, this process finds nothing to take, compiles ISB too and says why not
    with subprocess.Popen([sys.executable, "-c", _ISB, part], cwd=ROOT, stdin=nothing, stderr=nothing):
        for module in ("protocols.idtp.decoder", "protocols.xbus.decoder", "recordings.mcap_reader"):
            import_module(module)
    from protocols import jit

    jit.load_module(part)


def is_there(data: Path) -> bool:
    """Is there compiled code of these sources, with this data folder? Looks only."""
    return native_cache.is_valid(_wanted(data) / native_cache.NAME)


def _wanted(data: Path) -> Path:
    return Path(os.environ.get(VARIABLE) or data / "compiled" / native_cache.sources_mark())


def _sweep(home: Path, kept: Path) -> None:
    """Former versions' code; another imuscope of theirs may still run, and has loaded what it needs."""
    for folder in home.iterdir():
        if folder != kept:
            shutil.rmtree(folder, ignore_errors=True)


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False
