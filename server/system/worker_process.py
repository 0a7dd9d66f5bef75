"""The process of a worker (workers.py): what it does first, and how it reports progress and failures."""

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from imuscope.recordings.errors import RecordingError
from imuscope.recordings.system.parent_death import die_with_parent, report_to_parent
from imuscope.recordings.system.priority import lower_priority
from imuscope.recordings.system.resource_limits import TooLong, bounded

PROGRESS_STEP = 0.005  # of the progress


def begin(priority: int) -> dict[str, Any]:
    """Limit this process, and read the request on standard input; empty if there is none.

    Args:
        priority: by how much it is lowered: live devices come first.
    """
    die_with_parent()
    bounded()
    lower_priority(priority)
    text = sys.stdin.read()
    return dict(json.loads(text)) if text else {}


def progress_reports() -> Callable[[float], None]:
    """Reports the progress, 0..1, each time that it has grown by a step."""
    reported = 0.0

    def report(share: float) -> None:
        nonlocal reported
        if share >= reported + PROGRESS_STEP:
            reported = share
            report_to_parent(progress=round(min(share, 1.0), 3))

    return report


@contextmanager
def reporting(work: str, hint: str, on_disk: Callable[[OSError], tuple[str, str]]) -> Iterator[None]:
    """Report a failure in the block, as message and hint, and end this process.

    Args:
        work: with a verb in the third person: "The export".
        hint: where it exceeds a limit.
        on_disk: message and hint of another error.

    Raises:
        SystemExit: after a report.
    """
    try:
        yield
        return
    except RecordingError as error:
        message, hint = error.message, error.hint
    except (MemoryError, TooLong) as error:
        message = f"{work} exceeds the {'memory' if isinstance(error, MemoryError) else 'time'} limit."
    except OSError as error:
        message, hint = on_disk(error)
    report_to_parent(message=message, hint=hint)
    raise SystemExit(1)
