"""Benchmark of long load: losses, latency and memory over minutes.

    4 devices × 2 kHz ══ ptys ══> server ── WebSocket × 20 ──> clients that keep up
                                    ├── one recording, from before the first byte
                                    └── one export, of a minute of one of them

    python tests/bench/load.py                                   four devices, 20 browsers, 10 minutes
    python tests/bench/load.py --devices 1 --clients 50          … as budgeted for one device
    python tests/bench/load.py --disturb                         in the second half also one stalled, one slow and one
                                                                 flooding client: the others' figures side by side
    … --minutes 0.5 to try it · --save to keep the result (load.json, load-50.json, load-disturbed.json)

Figures: bytes sent by the devices against bytes received and bytes in the recording (by count and CRC-32); samples
dropped for clients that keep up; latency from the arrival of a message's oldest sample at the server to a client; how
late the devices themselves could write; the server's memory every 5 s, with its slope over the second half; its share
of a core. The yardstick for the latency is the machine: `late_p99_ms`, how late a process is that only sleeps and
writes.

Verdict, and the exit status: nothing lost, nothing dropped, p99 ≤ 50 ms, memory flat (≤ 1 MB/min once the history is
full; it is limited to `--memory-mb`, so that it is full early).
"""

from __future__ import annotations

import argparse
import asyncio
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import httpx

from imuscope.recordings.mcap.writer import McapWriter
from tests.bench.support.memory import Memory
from tests.bench.support.report import options_of, percentile, report, status_of
from tests.bench.support.serial_devices import Speakers, frames, is_whole, numbered, received_in
from tests.support import load_clients
from tests.support.processes import seconds_of
from tests.support.server_process import ServerProcess

EARLIER, EARLIER_S = "20260101T000000Z-earlier", 60  # the recording that is exported
SETTLE_S = 8.0
BUDGET = {"lost": 0, "dropped": 0, "p99_ms": 50.0, "memory_mb_per_min": 1.0}


class Api:
    """The server's HTTP side."""

    def __init__(self, url: str) -> None:
        self._client = httpx.AsyncClient(base_url=url, timeout=60)

    async def get(self, path: str) -> Any:
        return (await self._client.get(path)).raise_for_status().json()

    async def post(self, path: str, body: Any = None) -> Any:
        return (await self._client.post(path, json=body if body is not None else {})).raise_for_status().json()

    async def received(self, counter: str) -> int:
        """What a counter of /metrics counts, all devices."""
        text = (await self._client.get("/metrics")).raise_for_status().text
        lines = [line for line in text.splitlines() if line.startswith(f"{counter}{{")]
        return sum(int(float(line.rsplit(" ", 1)[1])) for line in lines)

    async def received_all(self, sent: Sequence[dict[str, Any]], *, decoded: bool = False) -> bool:
        """Wait until the server has read, or decoded, what the devices have written, 20 s at most; whether it has."""
        unit, counter = ("frames", "frames") if decoded else ("bytes", "received_bytes")
        whole = sum(one[unit] for one in sent)
        for _ in range(400):
            if await self.received(f"imuscope_link_{counter}_total") >= whole:
                return True
            await asyncio.sleep(0.05)
        return False

    async def drops(self) -> int:
        text = (await self._client.get("/metrics")).raise_for_status().text
        (line,) = [line for line in text.splitlines() if line.startswith("imuscope_dropped_samples_total")]
        return int(float(line.rsplit(" ", 1)[1]))


async def exported(api: Api) -> dict[str, Any]:
    """The export of the recording that was made before; how it went."""
    began = time.monotonic()
    job = await api.post(f"/api/recordings/{EARLIER}/exports", {"format": "csv"})
    while True:
        state = next(one for one in await api.get("/api/recordings/exports") if one["id"] == job["id"])
        if state["state"] in ("done", "failed", "cancelled"):
            return {"state": state["state"], "seconds": time.monotonic() - began, "bytes": state["size"]}
        await asyncio.sleep(0.5)


def figures_of(goods: list[load_clients.Good]) -> dict[str, Any]:
    """Samples seen by the clients that keep up, since counting started."""
    ages = sorted(age for good in goods for age in good.ages)
    return {
        "dropped": sum(good.lost for good in goods),
        "messages": sum(good.messages for good in goods),
        "p50_ms": 1e3 * percentile(ages, 0.5),
        "p99_ms": 1e3 * percentile(ages, 0.99),
        "max_ms": 1e3 * ages[-1] if ages else None,
        "worst_client_p99_ms": max(1e3 * percentile(sorted(good.ages), 0.99) for good in goods),
    }


class LoadRun:
    """One run: the server, who sends and who reads."""

    def __init__(self, options: argparse.Namespace, server: ServerProcess, speakers: Speakers) -> None:
        self.options, self.server, self.speakers = options, server, speakers
        self.seconds = options.minutes * 60
        self.api = Api(server.url)
        self.goods = [load_clients.Good() for _ in range(options.clients)]
        self.tasks: list[asyncio.Task[Any]] = []
        self.out: dict[str, Any] = {}
        self.thrown_out: list[float] = []
        self.answered = [0]

    def start(self, work: Any) -> None:
        self.tasks.append(asyncio.create_task(work))

    async def measure(self) -> dict[str, Any]:
        for good in self.goods:
            self.start(good.run(self.server.url))
        await asyncio.gather(*(good.subscribed.wait() for good in self.goods))
        await asyncio.to_thread(self.speakers.go)
        await asyncio.sleep(SETTLE_S)
        memory = Memory(self.server.process.pid)
        self.start(memory.watch())
        export = asyncio.create_task(exported(self.api))
        used, began = seconds_of(self.server.process.pid), time.monotonic()
        mine = time.process_time()
        halves = await self.halves()
        elapsed = time.monotonic() - began
        shares = {
            "server_core_share": (seconds_of(self.server.process.pid) - used) / elapsed,
            "clients_core_share": (time.process_time() - mine) / elapsed,
            "devices_core_share": seconds_of(self.speakers.pid) / (elapsed + SETTLE_S),
        }
        sent = await asyncio.to_thread(self.speakers.sent)
        await self.api.received_all(sent["devices"])
        self.out = {
            **halves,
            **shares,
            "late_p99_ms": sent["late_p99_ms"],
            "late_max_ms": sent["late_max_ms"],
            "export": await export,
            "memory": memory.curve(),
        }
        await self.api.post("/api/recordings/stop")
        for task in self.tasks:
            task.cancel()
        ended = await asyncio.gather(*self.tasks, return_exceptions=True)
        self.out["broken"] = [repr(one) for one in ended if not isinstance(one, asyncio.CancelledError)]
        return self.out

    async def halves(self) -> dict[str, Any]:
        """The figures of the whole time; with disturbers, of the half without and the half with them."""
        for good in self.goods:
            good.begin()
        if not self.options.disturb:
            await asyncio.sleep(self.seconds)
            return figures_of(self.goods)
        await asyncio.sleep(self.seconds / 2)
        calm = figures_of(self.goods)
        for work in (
            load_clients.stalled(self.server.url, self.thrown_out),
            load_clients.slow(self.server.url, 20_000),
            load_clients.flooding(self.server.url, self.answered),
        ):
            self.start(work)
        for good in self.goods:
            good.begin()
        await asyncio.sleep(self.seconds / 2)
        disturbed = figures_of(self.goods)
        others = {"stalled_thrown_out": len(self.thrown_out), "flood_answered": self.answered[0]}
        others["dropped_for_them"] = await self.api.drops()
        return {**disturbed, "calm": calm, "disturbed": disturbed, **others}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Server and devices around a run; then what is in the recordings."""
    length = options.minutes * 60 + SETTLE_S + 2
    with tempfile.TemporaryDirectory() as folder, Speakers(options.devices, options.rate, length) as speakers:
        data = Path(folder)
        config = data / "imuscope.toml"
        config.write_text(f"memory_mb = {options.memory_mb}\nrecord_head = false\n")
        write_recording(data / "recordings" / f"{EARLIER}.mcap", options.rate)
        sources = [f"serial://{terminal}?baud=2000000&protocol=xbus" for terminal in speakers.terminals]
        with ServerProcess(*sources, data=data, arguments=("--record", "--config", str(config))) as server:
            out = asyncio.run(LoadRun(options, server, speakers).measure())
        sent = speakers.sent()["devices"]
        received = received_in([path for path in sorted((data / "recordings").glob("*.mcap")) if path.stem != EARLIER])
    out["bytes_sent"] = sum(one["bytes"] for one in sent)
    out["bytes_recorded"] = sum(one["bytes"] for one in received.values())
    out["recorded_as_sent"] = is_whole(received, sent)
    return out


def write_recording(path: Path, rate: float) -> None:
    """A recording of one device, as it would be after `EARLIER_S`."""
    path.parent.mkdir(parents=True)
    writer = McapWriter(path, {"title": "Earlier"})
    writer.device("1", {"source": "load", "protocol": "xbus"})
    template = frames(0, round(rate), rate)
    for second in range(EARLIER_S):
        data = numbered(template, second * len(template), rate).tobytes()
        writer.chunk("1", "rx", data, (1_767_225_600 + second) * 10**9)
    writer.close()


def verdict(out: dict[str, Any]) -> dict[str, bool]:
    """Of each promise, whether it was kept."""
    calm = out.get("calm", {"dropped": 0, "p99_ms": out["p99_ms"]})
    return {
        "nothing_lost": out["recorded_as_sent"] and not out["broken"],
        "nothing_dropped": out["dropped"] + calm["dropped"] == 0,
        "others_change_nothing": out["p99_ms"] <= 1.5 * calm["p99_ms"] + 5,
        "in_time": out["p99_ms"] <= BUDGET["p99_ms"],
        "memory_flat": out["memory"]["mb_per_min"] <= BUDGET["memory_mb_per_min"],
        "export_done": out["export"]["state"] == "done",
    }


def main() -> int:
    """The command line."""
    parser = options_of("Devices, browsers, a recording and an export at once.")
    parser.add_argument("--devices", type=int, default=4)
    parser.add_argument("--clients", type=int, default=20)
    parser.add_argument("--rate", type=float, default=2000)
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--memory-mb", type=int, default=64, help="of history; full after a minute at 4 × 2 kHz")
    parser.add_argument("--disturb", action="store_true", help="a stalled, a slow and a flooding client")
    options = parser.parse_args()
    out = measure(options)
    stored = verdict(out)
    request = {
        name: getattr(options, name) for name in ("devices", "clients", "rate", "minutes", "memory_mb", "disturb")
    }
    name = "load-disturbed" if options.disturb else "load" if options.clients == 20 else f"load-{options.clients}"
    report(name, {**request, **out, "budget": BUDGET, "verdict": stored})
    return status_of(stored)


if __name__ == "__main__":
    raise SystemExit(main())
