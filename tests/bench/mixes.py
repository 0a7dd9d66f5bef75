"""Benchmark of decoding on other mixes than those of decode.py's usual files, all in one run.

python -m tests.bench.mixes [--save]

isb-sizes     seven data sets from 12 to 708 bytes, in turn
isb           the usual mix (isb_mixed.py)
idtp          Lite and Safety in turn (idtp_mixed.py)
xbus-capture  the whole of a real MTi's capture, where ../shared/captures is there
"""

from __future__ import annotations

import random
import tempfile
from pathlib import Path
from typing import Any

from imuscope.protocols.isb.dataset_loader import SETS
from tests.bench.decode import measure
from tests.bench.support import idtp_mixed, isb_mixed
from tests.bench.support.report import options_of, report
from tests.support.server_process import ROOT

CAPTURE = ROOT.parent / "shared" / "captures" / "xbus" / "mti_100hz_49s.bin"
GOALS = {"isb-sizes": 0.30, "isb": 0.30, "idtp": 0.25, "xbus-capture": 0.30}
SIZES = 7


def isb_sizes(seconds: float) -> bytes:
    """Seven data sets of very different sizes, evenly from the smallest to the largest, in turn at 250 Hz."""
    clocks = ("week+timeOfWeek", "week+timeOfWeekMs", "timeOfWeekMs", "time")
    known = sorted(
        (row.struct.size, did) for did, row in SETS.items() if row.struct is not None and row.clock in clocks
    )
    chosen = [known[round(k * (len(known) - 1) / (SIZES - 1))][1] for k in range(SIZES)]
    noise = random.Random(1)
    steps = range(round(seconds / isb_mixed.STEP_S))
    return b"".join(isb_mixed.message(chosen[step % SIZES], step * isb_mixed.STEP_S, noise) for step in steps)


def main() -> None:
    """The command line."""
    parser = options_of(__doc__.partition("\n")[0])
    parser.add_argument("--size", type=float, default=16, help="megabytes to decode in a pass")
    options = parser.parse_args()
    streams = {"isb-sizes": isb_sizes(60), "isb": isb_mixed.stream(20), "idtp": idtp_mixed.mixed(20)}
    if CAPTURE.exists():
        streams["xbus-capture"] = CAPTURE.read_bytes()
    figures: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, data in streams.items():
            file = Path(folder) / name
            file.write_bytes(data)
            figures[name] = measure(name.partition("-")[0], file, int(options.size * 1e6))
    report("mixes", {**figures, "budget": {f"{name} ratio": goal for name, goal in GOALS.items()}})


if __name__ == "__main__":
    main()
