"""Benchmark of the fan-out: losses and cost with fifty browsers at 2 kHz × 10 values.

    feed ══ pty ══> server ── WebSocket × 50 ──> one process that reads them all

Figures: samples dropped or missing, the server's share of one core, and p99 from a message's stamp (when the server
encoded it) to its arrival at a client. The yardstick, measured in the same run on the same machine: a bare WebSocket
server that relays messages of the same size at the same rate from one sender to fifty clients, and does nothing else.

Budget: no drops, at most 15 % of a core, p99 at most the yardstick's.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from websockets.asyncio.client import ClientConnection, connect

from imuscope.server.wire import HEADER
from tests.bench.support.report import options_of, percentile, report
from tests.bench.support.serial_device import Feed, must_be_live
from tests.support.load_clients import Good
from tests.support.processes import seconds_of
from tests.support.server_process import ROOT, ServerProcess, tied

SETTLE_S = 3.0


class FanoutReader(Good):
    """A client that also notes how long after its stamp each message arrived."""

    def __init__(self) -> None:
        super().__init__()
        self.delays: list[float] = []

    def take(self, data: bytes, now: float) -> None:
        """Note the delay as well."""
        super().take(data, now)
        self.delays.append(now - HEADER.unpack_from(data)[-1])

    def begin(self) -> None:
        """Count from here on."""
        super().begin()
        self.delays.clear()


async def figures_of(readers: Sequence[FanoutReader], server: int, seconds: float) -> dict[str, Any]:
    """What the readers see from now on in so many seconds, and the share of a core that the server's process takes."""
    for reader in readers:
        reader.begin()
    used, began = seconds_of(server), time.monotonic()
    await asyncio.sleep(seconds)
    used, elapsed = seconds_of(server) - used, time.monotonic() - began
    delays = [delay for reader in readers for delay in reader.delays]
    messages = sum(reader.messages for reader in readers)
    return {
        "lost": sum(reader.lost for reader in readers),
        "samples_per_s": [max(reader.samples.values(), default=0) / elapsed for reader in readers],
        "core_share": used / elapsed,
        "p50_ms": 1000 * percentile(delays, 0.5),
        "p99_ms": 1000 * percentile(delays, 0.99),
        "messages_per_s": messages / elapsed,
        "bytes_per_message": sum(reader.bytes for reader in readers) / max(1, messages),
    }


async def cancel(tasks: Sequence[asyncio.Task[Any]]) -> int:
    """End the tasks; how many had ended before."""
    ended = sum(task.done() for task in tasks)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    return ended


async def product(clients: int, rate: float, seconds: float) -> dict[str, Any]:
    """The server with `clients` readers for `seconds`."""
    readers = [FanoutReader() for _ in range(clients)]
    with (
        tempfile.TemporaryDirectory() as data,
        Feed(rate, SETTLE_S + seconds + 2) as feed,
        ServerProcess(f"serial://{feed.terminal}?baud=2000000", data=Path(data)) as server,
    ):
        tasks = [asyncio.create_task(reader.run(server.url)) for reader in readers]
        await asyncio.sleep(1)
        feed.begin()
        await asyncio.sleep(SETTLE_S)
        must_be_live(server.url)
        observed = await figures_of(readers, server.process.pid, seconds)
        disconnected = await cancel(tasks)
    return {
        "disconnected": disconnected,
        "dropped": observed["lost"],
        "samples_per_s": min(observed["samples_per_s"]),
        "server_core_share": observed["core_share"],
        "p50_ms": observed["p50_ms"],
        "p99_ms": observed["p99_ms"],
        "messages_per_s_and_client": observed["messages_per_s"] / clients,
        "bytes_per_message": observed["bytes_per_message"],
    }


async def bare(clients: int, per_s: float, size: int, seconds: float) -> dict[str, float]:
    """The reference: a relay without other work, in a separate process."""
    command = tied([sys.executable, str(ROOT / "tests/bench/support/relay.py")])
    relay = subprocess.Popen(command, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True)
    assert relay.stdout
    address = f"ws://127.0.0.1:{relay.stdout.readline().strip()}/"
    delays: list[float] = []

    async def listen(socket: ClientConnection) -> None:
        async for data in socket:
            delays.append(time.time() - struct.unpack_from("<d", data if isinstance(data, bytes) else data.encode())[0])

    options: dict[str, Any] = {"compression": None, "max_size": None}
    with relay, contextlib.ExitStack() as ending:
        ending.callback(relay.terminate)  # also when something fails: leaving `with relay` waits for it
        sockets = [await connect(address, **options) for _ in range(clients)]
        tasks = [asyncio.create_task(listen(socket)) for socket in sockets]
        sender = await connect(address + "send", **options)
        filling, began = bytes(size - 8), time.monotonic()
        used = seconds_of(relay.pid)
        for step in range(round(per_s * seconds)):
            await asyncio.sleep(max(0.0, began + step / per_s - time.monotonic()))
            await sender.send(struct.pack("<d", time.time()) + filling)
        used, elapsed = seconds_of(relay.pid) - used, time.monotonic() - began
        await cancel(tasks)
    return {
        "p50_ms": 1000 * percentile(delays, 0.5),
        "p99_ms": 1000 * percentile(delays, 0.99),
        "relay_core_share": used / elapsed,
    }


async def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """Product, then yardstick with the sizes and the rate that the product showed."""
    ours = await product(arguments.clients, arguments.rate, arguments.seconds)
    per_s, size = ours["messages_per_s_and_client"], round(ours["bytes_per_message"])
    yardstick = await bare(arguments.clients, per_s, size, arguments.seconds)
    return {
        "clients": arguments.clients,
        "rate_hz": arguments.rate,
        "values": 10,
        **ours,
        "yardstick": yardstick,
        "p99_ratio": ours["p99_ms"] / yardstick["p99_ms"],
        "budget": {"dropped": 0, "server_core_share": 0.15, "p99_ratio": 1.0},
    }


def main() -> None:
    """The command line."""
    parser = options_of("Fan-out to many browsers, against a bare relay.")
    parser.add_argument("--clients", type=int, default=50)
    parser.add_argument("--rate", type=float, default=2000)
    parser.add_argument("--seconds", type=float, default=15)
    report("fanout", asyncio.run(measure(parser.parse_args())))


if __name__ == "__main__":
    main()
