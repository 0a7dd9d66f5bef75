"""`python -m imuscope.server.extensions.rerun.stream_worker`: an opened recording as a stream of `.rrd`.

The request comes on standard input, one JSON object: store, title, t0, t1, most. The file is written to standard output
while it is made: a slow reader slows it down, and if the reader disconnects it ends, because writing fails.
"""

import json
import math
import sys
from pathlib import Path

from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.system.parent_death import die_with_parent
from imuscope.recordings.system.priority import lower_priority


def main() -> int:
    """Stream the recording that standard input requests."""
    die_with_parent()
    lower_priority(5)  # live devices come first
    request = json.loads(sys.stdin.read())
    columns = ColumnStore(Path(request["store"]))
    from imuscope.server.extensions.rerun.rrd.writer import Work, fill, stream_of

    t0 = -math.inf if request["t0"] is None else request["t0"]
    t1 = math.inf if request["t1"] is None else request["t1"]
    stream = stream_of(request["title"])
    work = Work(columns, t0, t1, most=request["most"])
    fill(stream, work, request["title"], lambda layout: stream.stdout(layout))
    stream.flush()
    stream.disconnect()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
