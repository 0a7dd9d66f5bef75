"""Benchmark of recording: cost, and loss after kill -9.

    python tests/bench/recording.py [--rate 2000] [--seconds 4] [--turns 5] [--kills 5] [--save]

A server reads a device on a pseudo-terminal; recording is switched on and off in turns, and what it costs is the
processor time of the turns with it minus that of those without (the middle of all pairs of neighbours, as both drift
alike). The yardstick, in the same run: a bare loop that writes the same bytes at the same pace to a file every 8 ms and
asks the disk for them once a second, i.e. what the kernel and this machine's disk alone cost.

Then a server that records is killed, and what had been sent to it is compared with what is in its file: the age of the
oldest byte that is missing.

Budget: at most 3 % of a core at 2 kHz; at most 20 ms lost.
"""

from __future__ import annotations

import os
import signal
import statistics
import tempfile
import time
from pathlib import Path

from tests.bench.support import serial_device as feeding
from tests.bench.support.report import options_of, report
from tests.bench.support.tcp_device import TcpDevice
from tests.support.processes import seconds_of
from tests.support.recorder_harness import chunks, flowing, recorded
from tests.support.server_process import ServerProcess

SETTLE_S = 3.0
PAUSE_S = 0.5
BUDGET_SHARE, BUDGET_LOST_MS = 0.03, 20.0


def share(pid: int, seconds: float) -> float:
    """Processor time of a process over some seconds, in cores."""
    before, began = seconds_of(pid), time.monotonic()
    time.sleep(seconds)
    return (seconds_of(pid) - before) / (time.monotonic() - began)


def cost(rate: float, seconds: float, turns: int) -> dict[str, float]:
    """Shares of a core, without recording, with it, and the difference."""
    whole = SETTLE_S + 2 * turns * (seconds + 2 * PAUSE_S) + 10
    with tempfile.TemporaryDirectory() as folder, feeding.Feed(rate, whole) as feed:
        config = Path(folder) / "imuscope.toml"
        config.write_text("record_head = false\n")  # nothing listens there
        source = f"serial://{feed.terminal}?baud=2000000"
        with ServerProcess(source, data=Path(folder), arguments=("--config", str(config))) as server:
            feed.begin()
            time.sleep(SETTLE_S)
            feeding.must_be_live(server.url)
            off, on = [], []
            for _ in range(turns):
                off.append(share(server.process.pid, seconds))
                server.request("POST", "/api/recordings/start", {})
                time.sleep(PAUSE_S)
                on.append(share(server.process.pid, seconds))
                server.request("POST", "/api/recordings/stop", {})
                time.sleep(2 * PAUSE_S)
    pairs = [with_it - without for with_it, without in zip(on, off, strict=True)]
    return {"without": statistics.median(off), "with": statistics.median(on), "cost": statistics.median(pairs)}


def bare(rate: float, seconds: float) -> float:
    """The yardstick: share of a core of a loop that only writes."""
    size = len(feeding.frame(0, rate))
    with tempfile.NamedTemporaryFile() as file:
        fd, done, synced = file.fileno(), 0, 0.0
        began, before = time.monotonic(), time.process_time()
        while (now := time.monotonic() - began) < seconds:
            due = int(now * rate)
            os.write(fd, bytes(size * (due - done)))
            done = due
            if now - synced >= 1:
                os.fdatasync(fd)
                synced = now
            time.sleep(0.008)
        return (time.process_time() - before) / seconds


def lost_by_kill(data: Path) -> float:
    """Kill a server while it records 2000 frames/s: the age of the oldest byte that is not in its file, s."""
    with TcpDevice(2000) as line, ServerProcess(line.source, data=data, arguments=("--record",)) as server:
        flowing(server, line)
        killed = time.monotonic()
        os.kill(server.process.pid, signal.SIGKILL)
        server.process.wait()
        results = chunks(recorded(data), "rx/1")
        sent = line.sent
    assert len(results) > 30_000  # of a file of 50 kB, for which `flowing` waits
    assert sent.startswith(results), "what is in the file is what was sent, in order, from the beginning"
    return max(0.0, killed - line.sent_at(len(results))) if len(results) < len(sent) else 0.0


def killed(times: int) -> list[float]:
    """Milliseconds lost, sorted."""
    lost = []
    for _ in range(times):
        with tempfile.TemporaryDirectory() as folder:
            lost.append(lost_by_kill(Path(folder)) * 1e3)
    return sorted(lost)


def main() -> None:
    """The command line."""
    parser = options_of(__doc__.splitlines()[0])
    parser.add_argument("--rate", type=float, default=2000)
    parser.add_argument("--seconds", type=float, default=4)
    parser.add_argument("--turns", type=int, default=5)
    parser.add_argument("--kills", type=int, default=5)
    options = parser.parse_args()
    result = cost(options.rate, options.seconds, options.turns)
    yardstick = bare(options.rate, options.seconds)
    lost = killed(options.kills)
    report(
        "recording",
        {
            "rate_hz": options.rate,
            "share_of_a_core": result,
            "yardstick_share": yardstick,
            "ratio": result["cost"] / yardstick,
            "lost_by_kill_ms": {"each": lost, "median": statistics.median(lost) if lost else None},
            "budget": {"share_of_a_core": BUDGET_SHARE, "lost_ms": BUDGET_LOST_MS},
        },
    )


if __name__ == "__main__":
    main()
