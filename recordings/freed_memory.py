"""Memory that decoding frees, kept for the next chunk.

Each chunk of a file becomes some twenty arrays, of megabytes in sum, which are freed again when their columns are
written. The C library returns such memory to the system and asks for it again, page by page: a tenth of the time of
decoding. A process that decodes keeps KEPT_BYTES of it instead.
"""

from __future__ import annotations

import contextlib
import ctypes

KEPT_BYTES = 16 << 20
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # of mallopt(3)


def keep_freed_memory() -> None:
    """Let this process keep what it frees, up to KEPT_BYTES. Where the C library has no such setting: nothing."""
    with contextlib.suppress(AttributeError, OSError):
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(_MMAP_THRESHOLD, KEPT_BYTES)  # larger arrays go back at once, as before
        mallopt(_TRIM_THRESHOLD, KEPT_BYTES)
