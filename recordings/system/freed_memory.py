"""Memory that a process has freed: what the C library does with it.

Each chunk of a file becomes some twenty arrays, of megabytes in sum, which are freed again when their columns are
written. The C library returns such memory to the system and asks for it again, page by page: a tenth of the time of
decoding. A process that decodes keeps KEPT_BYTES of it instead.

In a server each reading thread would have a heap of its own, with holes of its own: 4 MB more after ten minutes of
three devices. Its threads take turns anyway, so one heap serves all.
"""

import contextlib
import ctypes

KEPT_BYTES = 16 << 20
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8  # of mallopt(3)


def keep_freed_memory() -> None:
    """Let this process keep what it frees, up to KEPT_BYTES."""
    _set(_MMAP_THRESHOLD, KEPT_BYTES)  # larger arrays go back at once, as before
    _set(_TRIM_THRESHOLD, KEPT_BYTES)


def share_one_heap() -> None:
    """Let the threads of this process share one heap. Call it before there are any."""
    _set(_ARENA_MAX, 1)


def _set(name: int, value: int) -> None:
    """Set it, where the C library has such a setting."""
    with contextlib.suppress(AttributeError, OSError):
        ctypes.CDLL(None).mallopt(name, value)
