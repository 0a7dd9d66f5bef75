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
import json
import struct
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

from websockets.asyncio.client import ClientConnection, connect

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from imuscope.server.wire import FLAG_HISTORY, HEADER, SUBPROTOCOL  # noqa: E402
from tests.bench.report import options_of, percentile, report  # noqa: E402
from tests.bench.serial_device import Feed, must_be_live  # noqa: E402
from tests.processes import seconds_of  # noqa: E402
from tests.server_process import ServerProcess, tied  # noqa: E402

SETTLE_S = 3.0


class FanoutReader:
    """Samples and losses seen by one client."""

    def __init__(self) -> None:
        self.delays: list[float] = []
        self.messages = 0
        self.bytes = 0
        self.samples: dict[int, int] = defaultdict(int)
        self.lost = 0
        self._next: dict[int, int] = {}
        self.measuring = False

    def take(self, data: bytes, now: float) -> None:
        """Account for one binary message of one or more sample frames."""
        at, stamp = 0, 0.0
        while at < len(data):
            _, flags, _, channel, n, dropped, sequence, size, _, stamp = HEADER.unpack_from(data, at)
            at += size
            if flags & FLAG_HISTORY or not self.measuring:
                self._next[channel] = sequence + n
                continue
            self.lost += dropped + max(0, sequence - self._next.get(channel, sequence) - dropped)
            self._next[channel] = sequence + n
            self.samples[channel] += n
        if self.measuring:
            self.messages += 1
            self.bytes += len(data)
            self.delays.append(now - stamp)


async def client(url: str, reader: FanoutReader) -> None:
    address = url.replace("http", "ws", 1) + "/ws"
    async with connect(address, subprotocols=[SUBPROTOCOL], compression=None, max_size=None, origin=url) as socket:  # type: ignore[arg-type,list-item]
        await socket.send(json.dumps({"op": "subscribe", "history": 0, "channels": None}))
        async for data in socket:
            if isinstance(data, bytes):
                reader.take(data, time.time())


async def product(clients: int, rate: float, seconds: float) -> dict[str, Any]:
    """The server with `clients` readers for `seconds`."""
    readers = [FanoutReader() for _ in range(clients)]
    with (
        tempfile.TemporaryDirectory() as data,
        Feed(rate, SETTLE_S + seconds + 2) as feed,
        ServerProcess(f"serial://{feed.terminal}?baud=2000000", data=Path(data)) as server,
    ):
        tasks = [asyncio.create_task(client(server.url, reader)) for reader in readers]
        await asyncio.sleep(1)
        feed.begin()
        await asyncio.sleep(SETTLE_S)
        must_be_live(server.url)
        for reader in readers:
            reader.measuring = True
        used, began = seconds_of(server.process.pid), time.monotonic()
        await asyncio.sleep(seconds)
        used, elapsed = seconds_of(server.process.pid) - used, time.monotonic() - began
        for reader in readers:
            reader.measuring = False
        broken = [task for task in tasks if task.done()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    samples = [max(reader.samples.values(), default=0) for reader in readers]
    delays = [delay for reader in readers for delay in reader.delays]
    messages = sum(reader.messages for reader in readers)
    return {
        "disconnected": len(broken),
        "dropped": sum(reader.lost for reader in readers),
        "samples_per_s": min(samples) / elapsed,
        "server_core_share": used / elapsed,
        "p50_ms": 1000 * percentile(delays, 0.5),
        "p99_ms": 1000 * percentile(delays, 0.99),
        "messages_per_s_and_client": messages / clients / elapsed,
        "bytes_per_message": sum(reader.bytes for reader in readers) / max(1, messages),
    }


async def bare(clients: int, per_s: float, size: int, seconds: float) -> dict[str, float]:
    """The reference: a relay without other work, in a separate process."""
    command = tied([sys.executable, str(ROOT / "tests/bench/relay.py")])
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
        for task in tasks:
            task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
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
