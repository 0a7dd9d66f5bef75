"""`python -m server.integrations.rrd_stream_worker`: an opened recording as a stream of `.rrd`, in a subprocess.

A wish comes on standard input, one JSON object: store, title, t0, t1, most. The file goes to standard output while it
is made: whoever reads slowly slows the making, and who goes ends it, because writing fails then.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import sys
from pathlib import Path

from recordings.column_store import ColumnStore
from recordings.parent_death import die_with_parent


def main() -> int:
    """Stream what standard input asks for."""
    die_with_parent()
    with contextlib.suppress(OSError):
        os.nice(5)  # live devices come first
    told = json.loads(sys.stdin.read())
    columns = ColumnStore(Path(told["store"]))
    from recordings.rrd.writer import Work, fill, stream_of

    t0 = -math.inf if told["t0"] is None else told["t0"]
    t1 = math.inf if told["t1"] is None else told["t1"]
    stream = stream_of(told["title"])
    work = Work(columns, t0, t1, most=told["most"])
    fill(stream, work, told["title"], lambda layout: stream.stdout(layout))
    stream.flush()
    stream.disconnect()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
