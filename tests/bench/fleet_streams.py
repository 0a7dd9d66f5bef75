"""Benchmark of live pages through a fleet server: fifty robots at 1 kHz, watched in twenty browsers.

    python -m tests.bench.fleet_streams [--robots 50] [--browsers 20] [--rate 1000] [--seconds 15] [--save]

    robots (a process, a session each) ─> imuscope fleet (a process, router too) ── a WebSocket for each page ──> here

A robot's end of the line is that of the product (http_tunnel_robot.py); in place of a device it has frames of
ten values, made as often as a server sends them. Each robot is watched once, so a browser has some pages open.

Figures: p50 and p99 from the moment at which a robot made a frame to its arrival in the browser, samples that were
missing, and the fleet server's share of a core. `missing` is counted by the numbers of samples. The yardstick, in the
same run: a bare WebSocket server that relays as many messages of the same size to as many sockets.

Budget: p99 ≤ 150 ms and nothing missing, with 50 robots and 20 browsers.
"""

from __future__ import annotations

import argparse
import asyncio
import multiprocessing
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from imuscope.server.access.route_rules import RouteRules
from imuscope.server.extensions.fleet.model.bus import BusCredentials, client_settings, open_bus
from imuscope.server.extensions.fleet.tunnel.http_tunnel_robot import PageServer
from imuscope.server.wire import HEADER, OPCODE_SAMPLES, SUBPROTOCOL
from tests.bench.fanout import FanoutReader, bare, cancel, figures_of
from tests.bench.support.report import options_of, report
from tests.server.extensions.fleet.fleet_robot import FleetRobot
from tests.support.free_ports import free_port
from tests.support.server_process import ServerProcess
from tests.support.timeouts import get

FRAMES_PER_S = 60  # of a server
SAMPLE_BYTES = 128  # of ten values with their times, as tests/bench/fanout.py finds
SETTLE_S, PATIENCE_S = 3.0, 60.0


class Pages:
    """The page of a robot: its WebSocket sends samples as long as somebody watches."""

    def __init__(self, rate: float, place: float) -> None:
        self.rate, self.place = rate, place

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        await receive()
        await send({"type": "websocket.accept", "subprotocol": SUBPROTOCOL})
        sent, began = 0, time.monotonic() + self.place / FRAMES_PER_S
        for frame in range(1, 1 << 40):
            await asyncio.sleep(began + frame / FRAMES_PER_S - time.monotonic())
            made = time.time()
            if not (count := int(frame * self.rate / FRAMES_PER_S) - sent):
                continue
            body = bytes(count * SAMPLE_BYTES)
            size = HEADER.size + len(body)
            head = HEADER.pack(OPCODE_SAMPLES, 0, 10, 1, count, 0, sent, size, 0, made)
            await send({"type": "websocket.send", "bytes": head + body})
            sent += count


async def robots(count: int, rate: float, router: str) -> None:
    """All robots, until the process is ended."""
    held: list[object] = []
    settings = client_settings(router, BusCredentials())
    for number in range(count):
        session = await asyncio.to_thread(open_bus, settings)
        robot = FleetRobot(name_of(number), session=session)
        pages = PageServer(robot.name, robot.journal.boot, "view", RouteRules(), lambda level, text: None)
        pages.serve(Pages(rate, number / count))
        held += [robot, pages, pages.declare(session)]
    while True:
        for one in held:
            if isinstance(one, PageServer):
                one.tick()
        await asyncio.sleep(1.0)


def run_robots(count: int, rate: float, router: str) -> None:
    """The process of the robots."""
    asyncio.run(robots(count, rate, router))


def name_of(number: int) -> str:
    return f"robot-{number:02}"


async def browser(pages: Iterable[tuple[str, FanoutReader]]) -> None:
    """Watch some robots at once."""
    await asyncio.gather(*(reader.run(url) for url, reader in pages))


async def until_live(url: str, count: int) -> None:
    """Wait until the fleet server has all robots."""
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until:
        listed = await asyncio.to_thread(get, f"{url}/api/fleet/robots")
        if sum(one["state"] == "live" for one in listed.json()["robots"]) == count:
            return
        await asyncio.sleep(0.2)
    raise SystemExit(f"after {PATIENCE_S:.0f} s not all of {count} robots are live")


async def product(options: argparse.Namespace) -> dict[str, Any]:
    """The fleet server between robots and browsers."""
    router = f"tcp/127.0.0.1:{free_port()}"
    readers = [FanoutReader() for _ in range(options.robots)]
    with (
        tempfile.TemporaryDirectory() as data,
        ServerProcess(data=Path(data), arguments=("--listen", router), command="fleet") as server,
    ):
        process = multiprocessing.get_context("spawn").Process(
            target=run_robots, args=(options.robots, options.rate, router)
        )
        process.start()
        try:
            await until_live(server.url, options.robots)
            pages = [(f"{server.url}/robots/{name_of(n)}", reader) for n, reader in enumerate(readers)]
            own = [pages[first :: options.browsers] for first in range(options.browsers)]
            tasks = [asyncio.create_task(browser(one)) for one in own if one]
            await asyncio.sleep(SETTLE_S)
            observed = await figures_of(readers, server.process.pid, options.seconds)
            ended = await cancel(tasks)
        finally:
            process.kill()
            process.join()
    return {
        "browsers_ended": ended,
        "missing": observed["lost"],
        "samples_per_s": [pick(observed["samples_per_s"]) for pick in (min, max)],
        "p50_ms": observed["p50_ms"],
        "p99_ms": observed["p99_ms"],
        "fleet_server_core_share": observed["core_share"],
        "messages_per_s": observed["messages_per_s"],
        "bytes_per_message": observed["bytes_per_message"],
    }


async def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Product, then yardstick."""
    ours = await product(options)
    yardstick = await bare(options.robots, FRAMES_PER_S, round(ours["bytes_per_message"]), options.seconds)
    figures = {"robots": options.robots, "browsers": options.browsers, "rate_hz": options.rate, "values": 10}
    return {**figures, **ours, "yardstick": yardstick, "budget": {"p99_ms": 150, "missing": 0}}


def main() -> None:
    """The command line."""
    parser = options_of(__doc__.split("\n")[0])
    parser.add_argument("--robots", type=int, default=50)
    parser.add_argument("--browsers", type=int, default=20)
    parser.add_argument("--rate", type=float, default=1000, help="samples/s of each robot")
    parser.add_argument("--seconds", type=float, default=15)
    report("fleet-streams", asyncio.run(measure(parser.parse_args())))


if __name__ == "__main__":
    main()
