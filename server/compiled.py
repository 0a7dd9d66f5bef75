"""Where is compiled code kept between runs?

numba looks at NUMBA_CACHE_DIR once, when it is imported, so this is decided first and without importing it:

    data folder/compiled/<mark>   the usual place; or NUMBA_CACHE_DIR, where that is set already (a container image)
    a copy of it in a fresh       where that place is there but read-only: numba reads no cache that it cannot write
    temporary folder
    nowhere                       nothing can be written: compiled for this run only (protocols/jit.py), a few seconds

The mark is that of the sources: numba notices a change in the file of a function, but not in the files of the functions
it calls, so after an update it could run half of the old code. Marks of former versions are swept away.

A temporary folder is made anew for each run, never found by name: whoever could put files there could run code.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import sys
import tempfile
from pathlib import Path

import protocols

VARIABLE = "NUMBA_CACHE_DIR"


def prepare_cache(data: Path) -> tuple[bool, list[str]]:
    """Settle the place.

    Returns:
        whether there is no compiled code yet, and sentences that the user should read.
    """
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        return False, []
    home = data / "compiled"
    wanted = Path(os.environ.get(VARIABLE) or home / _mark())
    if _writable(wanted):
        os.environ[VARIABLE] = str(wanted)
        if wanted.parent == home:
            _sweep(home, wanted)
        return _is_empty(wanted), []
    try:
        copy = Path(tempfile.mkdtemp(prefix="imuscope-"))
    except OSError:
        os.environ.pop(VARIABLE, None)
        return True, [f"{wanted} and the temporary folder cannot be written: compiled code is kept for this run only."]
    atexit.register(shutil.rmtree, copy, ignore_errors=True)
    if wanted.is_dir():
        shutil.copytree(wanted, copy, dirs_exist_ok=True)
        for folder in [copy, *copy.rglob("*/")]:
            folder.chmod(0o700)  # the copy is as read-only as what it is a copy of
    os.environ[VARIABLE] = str(copy)
    if _is_empty(copy):
        return True, [f"{wanted} cannot be written: compiled code is kept for this run only."]
    return False, []


def is_there(data: Path) -> bool:
    """Is there compiled code of these sources, with this data folder? Looks only."""
    return not _is_empty(Path(os.environ.get(VARIABLE) or data / "compiled" / _mark()))


def _mark() -> str:
    """Names the sources of everything that is compiled, and the Python that runs them."""
    digest = hashlib.sha256(sys.version.encode())
    root = Path(protocols.__file__).parent
    for source in sorted(root.rglob("*.py")):
        digest.update(source.relative_to(root).as_posix().encode() + b"\0" + source.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


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


def _is_empty(folder: Path) -> bool:
    return next(folder.rglob("*.nbi"), None) is None
