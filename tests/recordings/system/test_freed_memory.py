"""A process that decodes asks the system for its memory once, not for each chunk."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.support.timeouts import PATIENCE_S

CHUNKS = 50
ARRAYS = f"""
import resource, sys
import numpy as np
from imuscope.recordings.system.freed_memory import keep_freed_memory
if sys.argv[1] == "kept":
    keep_freed_memory()
for chunk in range(-5, {CHUNKS}):
    if chunk == 0:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    arrays = [np.full(40_000, 1.0) for _ in range(20)]
    del arrays
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def page_faults(stored: str) -> int:
    """Page faults of a process that makes and frees 6.4 MB of arrays for each chunk."""
    done = subprocess.run(
        [sys.executable, "-c", ARRAYS, stored], capture_output=True, text=True, timeout=PATIENCE_S, check=True
    )
    return int(done.stdout)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the setting is one of the C library of Linux")
def test_freed_memory_is_used_again() -> None:
    assert page_faults("kept") < CHUNKS  # not one page for each chunk
    assert page_faults("returned") > 100 * CHUNKS
