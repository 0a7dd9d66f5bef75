"""A fleet of simulated robots that report once a second through a real router: nothing lost, nothing doubled; costs.

    python tests/bench/fleet_live.py --robots 1000

    robots (this process, a session each) ─> router (a process) ─> imuscope fleet --router (a process) ─> HTTP (here)

Each robot changes with each report, which is the worst case, and each report has an event with its number. After a
while the router is killed and started again, then the fleet server. In the end the events of each robot in the database
must be 1, 2, 3 … without a hole and without a repetition. With --sessions 100, ten robots share a session of Zenoh.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sqlite3
import statistics
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import zenoh

from imuscope.server.extensions.fleet.model.access import RouterSettings
from imuscope.server.extensions.fleet.model.bus import BusCredentials, client_settings, open_bus
from tests.bench.support.report import options_of, report
from tests.server.extensions.fleet.fleet_robot import FleetRobot
from tests.support.free_ports import free_port
from tests.support.processes import resident_mb, seconds_of
from tests.support.server_process import ServerProcess
from tests.support.timeouts import get, http_client

PERIOD_S = 1.0


def route(address: str) -> None:
    """The router, in a process of its own."""
    session = open_bus(RouterSettings(address).settings())
    signal.sigwait([signal.SIGTERM])
    session.close()  # type: ignore[no-untyped-call]


class Process:
    """Processor time and memory of a process."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.began = time.monotonic(), seconds_of(pid)

    @property
    def load(self) -> float:
        """Share of a core since the last look."""
        (at, cpu), self.began = self.began, (time.monotonic(), seconds_of(self.pid))
        return (self.began[1] - cpu) / max(self.began[0] - at, 1e-9)


class Fleet:
    """All robots; a thread lets each report once a second."""

    def __init__(self, count: int, sessions: int, router: str) -> None:
        settings = client_settings(router, BusCredentials())
        self.sessions: list[zenoh.Session] = [open_bus(settings) for _ in range(sessions)]
        shared = [self.sessions[number % sessions] for number in range(count)]
        self.robots = [FleetRobot(f"robot-{number:05}", session=one) for number, one in enumerate(shared)]
        self.numbers = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        due = time.monotonic()
        while not self._stop.is_set():
            self.numbers += 1
            for place, robot in enumerate(self.robots):
                robot.report(self.numbers, time.time())
                if place % 50 == 49:  # spread over the second
                    ahead = due + PERIOD_S * place / len(self.robots) - time.monotonic()
                    if ahead > 0:
                        time.sleep(ahead)
            due += PERIOD_S
            time.sleep(max(0.0, due - time.monotonic()))

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()

    def beat(self) -> None:
        """Let every robot tell that nothing happened."""
        for robot in self.robots:
            robot.beat(time.time())

    def close(self) -> None:
        for session in self.sessions:
            session.close()  # type: ignore[no-untyped-call]


class Page:
    """A page that asks for changes, as the fleet page does."""

    def __init__(self, url: str) -> None:
        self.url = f"{url}/api/fleet/robots"
        self.client = http_client()
        self.after: int | None = None
        self.known: dict[str, dict[str, Any]] = {}
        self.request_ms: list[float] = []
        self.bytes: list[int] = []

    def request(self) -> None:
        began = time.perf_counter()
        answer = self.client.get(self.url, params={} if self.after is None else {"after": self.after})
        self.request_ms.append((time.perf_counter() - began) * 1000)
        self.bytes.append(len(answer.content))
        reply = answer.json()
        self.after = reply["revision"]
        self.known.update({one["name"]: one for one in reply["robots"]})

    @property
    def live(self) -> int:
        return sum(one["state"] == "live" for one in self.known.values())

    def behind(self, number: int) -> int:
        """Robots whose report of that number was not seen."""
        return sum((one["devices"] or [{"lost": 0}])[0]["lost"] < number for one in self.known.values())


@contextmanager
def running_route(address: str) -> Iterator[multiprocessing.process.BaseProcess]:
    process = multiprocessing.get_context("spawn").Process(target=route, args=(address,))
    process.start()
    try:
        yield process
    finally:
        process.kill()
        process.join()


def until_back(page: Page, count: int, fleet: Fleet, limit_s: float = 120.0) -> float:
    """Time until all robots are live with a report that is made from now on."""
    began, number = time.monotonic(), fleet.numbers
    while time.monotonic() - began < limit_s:
        page.request()
        if page.live == count and page.behind(number) == 0:
            return time.monotonic() - began
        time.sleep(0.2)
    raise SystemExit(f"after {limit_s} s {page.live} of {count} are live, {page.behind(number)} are behind")


def holes_and_doubles(data: Path, last: int) -> tuple[int, int, int]:
    """Events that are missing and that are there twice, of all robots; and how many there are."""
    file = sqlite3.connect(data / "fleet" / "fleet.sqlite")
    rows = file.execute(
        "SELECT robot, count(*), count(DISTINCT text) FROM events WHERE kind = 'marker' GROUP BY robot"
    ).fetchall()
    file.close()
    return (
        sum(last - distinct for _, _, distinct in rows),
        sum(count - distinct for _, count, distinct in rows),
        sum(count for _, count, _ in rows),
    )


def metric(url: str, name: str) -> float:
    text = get(f"{url}/metrics").text
    return float(next(line for line in text.splitlines() if line.startswith(name)).rpartition(" ")[2])


def main() -> None:
    parser = options_of(__doc__.split("\n")[0])
    parser.add_argument("--robots", type=int, default=1000)
    parser.add_argument("--sessions", type=int, default=1000, help="of Zenoh, shared by the robots")
    parser.add_argument("--seconds", type=float, default=30.0, help="of the steady part")
    options = parser.parse_args()
    address = f"tcp/127.0.0.1:{free_port()}"
    results: dict[str, Any] = {"robots": options.robots, "sessions": options.sessions}
    with tempfile.TemporaryDirectory() as folder, running_route(address) as router:
        data = Path(folder)
        server = ServerProcess(data=data, arguments=("--router", address), command="fleet", fresh=True)
        fleet = Fleet(options.robots, options.sessions, address)
        page = Page(server.url)
        results["joined_s"] = round(until_back(page, options.robots, fleet), 1)
        results["steady"] = steady(fleet, page, server, router.pid or 0, options.seconds)
        os.kill(router.pid or 0, signal.SIGKILL)
        router.join()
        time.sleep(5.0)
        with running_route(address) as second:
            results["back_after_router_killed_s"] = round(until_back(page, options.robots, fleet), 1)
            server.process.kill()
            server.process.wait()
            server.stop()
            server = ServerProcess(data=data, arguments=("--router", address), command="fleet", fresh=True)
            page = Page(server.url)
            results["back_after_fleet_server_killed_s"] = round(until_back(page, options.robots, fleet), 1)
            results["after"] = steady(fleet, page, server, second.pid or 0, options.seconds)
            fleet.stop()
            fleet.beat()
            until = time.monotonic() + 120
            while (state := holes_and_doubles(data, fleet.numbers))[0] and time.monotonic() < until:
                time.sleep(1.0)
            results["reports"] = fleet.numbers * options.robots
            results["missing"], results["doubled"], results["stored_events"] = state
            results["stored_mb"] = round(sum(one.stat().st_size for one in (data / "fleet").iterdir()) / 1e6, 1)
            server.stop()
            fleet.close()
    report("fleet-live", results)


def steady(fleet: Fleet, page: Page, server: ServerProcess, router: int, seconds: float) -> dict[str, Any]:
    """Costs while all report: processor time, memory, and what a page that asks once a second gets."""
    processes = {"fleet_server": Process(server.process.pid), "router": Process(router), "robots": Process(os.getpid())}
    bytes_before = metric(server.url, "imuscope_fleet_received_bytes_total")
    numbers = fleet.numbers
    page.request_ms.clear()
    page.bytes.clear()
    before = {name: round(resident_mb(one.pid)) for name, one in processes.items()}
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        page.request()
        time.sleep(1.0)
    received = metric(server.url, "imuscope_fleet_received_bytes_total") - bytes_before
    reports = max(1, (fleet.numbers - numbers) * len(fleet.robots))
    return {
        "core_share": {name: round(one.load, 3) for name, one in processes.items()},
        "rss_mb": {name: [before[name], round(resident_mb(one.pid))] for name, one in processes.items()},
        "reports_per_s": round(reports / seconds),
        "bytes_per_report": round(received / reports),
        "page_answer_ms": [round(statistics.median(page.request_ms), 1), round(max(page.request_ms), 1)],
        "page_answer_kb": round(statistics.median(page.bytes) / 1000, 1),
    }


if __name__ == "__main__":
    main()
