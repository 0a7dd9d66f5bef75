"""Compiled decoders for benchmarks of a running server: compiling is a benchmark of its own (start.py)."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from tests.cache_folder import compiled_code

ROOT = Path(__file__).resolve().parents[2]
COMPILE = "from imuscope.protocols import jit, registry; from imuscope.recordings import mcap_reader; jit.load()"


def use_compiled_code() -> None:
    """Have every server of this benchmark find its decoders compiled."""
    os.environ.setdefault("NUMBA_CACHE_DIR", str(compiled_code()))
    subprocess.run([sys.executable, "-c", COMPILE], cwd=ROOT, check=True)
