"""Tests run again and again beside a busy loop on each core: `tests/check.py --stress FILE…`.

For whatever is about time. A test that passes here twenty times does not depend on the machine's speed; one that fails
once is a defect of the test or of the product.
"""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

BUSY = "import os\nparent = os.getppid()\nwhile os.getppid() == parent:\n    sum(range(100_000))"


@contextmanager
def busy_loops(count: int) -> Iterator[None]:
    """Keep some cores busy with nothing; the loops end with this process."""
    loops = [subprocess.Popen([sys.executable, "-I", "-S", "-c", BUSY]) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def stress(run: Callable[[], int], *, times: int, report: Callable[[str], None]) -> Sequence[int]:
    """Run something beside a busy loop on each core.

    Args:
        run: returns its exit status.
        times: how often.
        report: is called with a line after each run.

    Returns:
        numbers of the runs that failed, from 1.
    """
    failed: list[int] = []
    loops = os.cpu_count() or 1
    with busy_loops(loops):
        for number in range(1, times + 1):
            if run():
                failed.append(number)
            report(f"run {number} of {times} beside {loops} busy loops: {len(failed)} failed")
    return failed
