"""The folder of what takes long to make and depends on nothing but its sources: one for all clones on a machine.

    mypy        results of mypy, keyed by the contents of each file
    mypy-guide  the same, of the examples of the guide
    checked     machine code that checks each index, by its source (tests/protocols/native/test_kernels.py)

It is in the user's cache folder and may be deleted at any time. Where that cannot be written, artifacts/ serves.
"""

import os
from pathlib import Path

import platformdirs

ROOT = Path(__file__).resolve().parents[2]


def cache_folder(name: str) -> Path:
    """The folder of this name, which exists."""
    for parent in (platformdirs.user_cache_path("imuscope-tests"), ROOT / "artifacts" / "cache"):
        try:
            (parent / name).mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(parent / name, os.W_OK):
            return parent / name
    raise PermissionError(f"{ROOT} cannot be written: run the tests in a folder of your own")
