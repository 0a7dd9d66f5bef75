"""Benchmark of decoding on one core.

    python tests/bench/decode.py --protocol xbus FILE [--size MB] [--save]

The file is repeated to at least `--size` megabytes, fed in chunks of 1 MB, drained after each, and every column of
every batch is asked for, so that all conversion is done. Best of several passes. The yardstick, in the same run:
zlib.adler32 over the same buffer. One line of JSON is printed (and with `--save` kept in results/):

    {"protocol", "frames", "mb_per_s", "adler32_mb_per_s", "ratio"}

Budgets (design, section 9): ratio at least 0.30 for ISB (isb_mixed.py writes a file) and Xbus, 0.25 for IDTP Lite and
Safety (idtp_mixed.py writes a file). A frame alone, as a live stream has them, is measured by single_frame.py.
"""

from __future__ import annotations

import sys
import time
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from imuscope.protocols.events import Batch, Decoder, Reply, Text  # noqa: E402
from imuscope.protocols.registry.families import PROTOCOLS  # noqa: E402
from imuscope.recordings.system.freed_memory import keep_freed_memory  # noqa: E402
from tests.bench.support.report import options_of, report  # noqa: E402

CHUNK = 1 << 20
PASSES = 25


def best(*runs: Callable[[], Any]) -> list[float]:
    """Shortest of several passes of each, in s. They alternate, so that a busy machine slows all of them equally."""
    shortest = [float("inf")] * len(runs)
    for _ in range(PASSES):
        for i, run in enumerate(runs):
            start = time.perf_counter()
            run()
            shortest[i] = min(shortest[i], time.perf_counter() - start)
    return shortest


def decoder_of(protocol: str) -> Decoder:
    """A new decoder. Replay checks are switched off, because the file is repeated."""
    row = PROTOCOLS[protocol]
    return row.decoding.decoder(**row.frames.permissive)


def decode(protocol: str, chunks: Sequence[bytes]) -> int:
    """All of `chunks`, every column made; returns the number of messages."""
    decoder = decoder_of(protocol)
    messages = 0
    for arrival, chunk in enumerate(chunks):
        decoder.feed(chunk, arrival)
        for event in decoder.drain():
            if isinstance(event, Batch):
                messages += len(event)
                for name in event.columns:
                    event.columns[name]
            elif isinstance(event, (Reply, Text)):
                messages += 1
    return messages


def measure(protocol: str, file: Path, size: int) -> dict[str, Any]:
    """The figures of one file."""
    keep_freed_memory()  # as the decoding of a file does
    once = file.read_bytes()
    data = once * -(-size // len(once))
    megabytes = len(data) / 1e6
    chunks = [data[at : at + CHUNK] for at in range(0, len(data), CHUNK)]  # as a link gives them
    frames = decode(protocol, chunks)  # also warms everything
    speed, yardstick = (megabytes / s for s in best(lambda: decode(protocol, chunks), lambda: zlib.adler32(data)))
    return {
        "protocol": protocol,
        "frames": frames,
        "mb_per_s": speed,
        "adler32_mb_per_s": yardstick,
        "ratio": speed / yardstick,
    }


def main() -> None:
    """The command line."""
    parser = options_of(__doc__.partition("\n")[0])
    parser.add_argument("--protocol", required=True, choices=sorted(PROTOCOLS))
    parser.add_argument("--size", type=float, default=16, help="megabytes to decode in a pass")
    parser.add_argument("file", type=Path)
    arguments = parser.parse_args()
    figures = measure(arguments.protocol, arguments.file, int(arguments.size * 1e6))
    report(f"decode-{arguments.protocol}", {**figures, "file": arguments.file.name})


if __name__ == "__main__":
    main()
