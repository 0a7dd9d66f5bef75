"""Time that a server takes to end with everything running (tests/fault_injection/test_shutdown.py lists everything).

python tests/bench/shutdown.py [TIMES]      prints one JSON line: seconds from SIGTERM to the end of the process
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from pathlib import Path

from tests.fault_injection.ending import end

BUDGET_S = 2.0


def main() -> int:
    times = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    before = os.getloadavg()[0]
    seconds = []
    for _ in range(times):
        with tempfile.TemporaryDirectory() as folder:
            seconds.append(round(end(Path(folder)), 2))
    details = {
        "seconds": seconds,
        "budget_s": BUDGET_S,
        "load_before": round(before, 1),
        "within": max(seconds) <= BUDGET_S,
    }
    print(json.dumps(details))
    return 0 if details["within"] else 1


if __name__ == "__main__":
    raise SystemExit(main())
