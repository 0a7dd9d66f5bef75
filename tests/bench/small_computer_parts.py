"""Parts of the benchmark of a small computer; see small_computer.py."""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
import subprocess
import threading
import time
import tty
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from tests.bench.fanout import bare
from tests.bench.load import Api
from tests.bench.overload import Page
from tests.bench.shared_port import held, relayed
from tests.bench.start import importing
from tests.bench.support.process_cost import measured, memory_mb
from tests.bench.support.serial_devices import Speakers, is_whole, received_in
from tests.support import load_clients
from tests.support.server_process import ServerProcess

ROOT = Path(__file__).resolve().parents[2]
SETTLE_S = 3.0  # after the first samples: detection, the device's identity, the first recording tick
RATE, DEVICES = 400.0, 3
HOLDER_RATE, TOO_FAST = 2000.0, 2000.0
HISTORY_S, HISTORY_SPEED = 600.0, 10.0  # at 40, a server beside others left half of it out, and its queues were full


@dataclass(slots=True)
class Place:
    """Where things run.

    Attributes:
        ours: cores of the server.
        others: cores of devices, clients and this process.
        folder: scratch.
    """

    ours: set[int]
    others: set[int]
    folder: Path = field(default=Path())

    @contextlib.contextmanager
    def server(self, *sources: str, arguments: tuple[str, ...] = ()) -> Iterator[ServerProcess]:
        """A server on its cores."""
        os.sched_setaffinity(0, self.ours)
        try:
            server = ServerProcess(*sources, data=self.folder / "data", arguments=arguments)
        finally:
            os.sched_setaffinity(0, self.others)
        with server:
            yield server

    @contextlib.contextmanager
    def on_ours(self) -> Iterator[None]:
        """What is started in the block runs on the server's cores, as its yardstick."""
        os.sched_setaffinity(0, self.ours)
        try:
            yield
        finally:
            os.sched_setaffinity(0, self.others)


@contextlib.contextmanager
def devices(count: int, rate: float, seconds: float, speed: float = 1.0) -> Iterator[list[Speakers]]:
    """Devices, each a process of its own."""
    with contextlib.ExitStack() as ending:
        yield [ending.enter_context(Speakers(1, rate, seconds, speed)) for _ in range(count)]


def sources_of(speakers: list[Speakers]) -> list[str]:
    return [f"serial://{one.terminals[0]}?baud=2000000&protocol=xbus" for one in speakers]


# ── what it costs ────────────────────────────────────────────────────────────────────────────────────────────────────


def idle(where: Place, seconds: float) -> dict[str, Any]:
    """A server whose only source was removed."""
    with where.server("sim:xbus") as server:
        request = urllib.request.Request(f"{server.url}/api/devices/1", method="DELETE")
        with urllib.request.urlopen(request, timeout=30):
            pass
        time.sleep(SETTLE_S)
        with measured(server.process.pid) as cost:
            time.sleep(seconds)
        return asdict(cost) | {"memory_mb": memory_mb(server.process.pid)}


def copied(where: Place, seconds: float) -> float:
    """The yardstick for bytes: the share of a core of `cat` from a device to a file."""
    with devices(1, RATE, seconds + 2) as (speaker,), open(where.folder / "copied", "wb") as file:
        with where.on_ours():
            copier = subprocess.Popen(["cat", speaker.terminals[0]], stdout=file)
        speaker.go()
        time.sleep(1)
        with measured(copier.pid) as cost:
            time.sleep(seconds)
        copier.kill()
        copier.wait()
    return cost.core_share


def recorded(where: Place, seconds: float) -> dict[str, Any]:
    """One device, recorded; nobody looks."""
    length = SETTLE_S + seconds
    settings = where.folder / "settings.toml"
    settings.write_text("record_head = false\n")  # this device answers nothing, and asking it again is not recording
    with devices(1, RATE, length) as speakers:
        with where.server(*sources_of(speakers), arguments=("--record", "--config", str(settings))) as server:
            speakers[0].go()
            time.sleep(SETTLE_S)
            with measured(server.process.pid) as cost:
                time.sleep(seconds - 0.5)
            memory = memory_mb(server.process.pid)
            sent = speakers[0].sent()["devices"]
            time.sleep(1)
        received = received_in(sorted((where.folder / "data" / "recordings").glob("*.mcap")))
    share = copied(where, seconds)
    return {
        **asdict(cost),
        "memory_mb": memory,
        "whole": is_whole(received, sent),
        "yardstick": {"cat_core_share": share},
        "ratio": cost.core_share / share,
    }


def watched(where: Place, seconds: float) -> dict[str, Any]:
    """Three devices and a page."""
    return asyncio.run(_watched(where, seconds))


async def _watched(where: Place, seconds: float) -> dict[str, Any]:
    with devices(DEVICES, RATE, SETTLE_S + seconds + 30) as speakers, where.server(*sources_of(speakers)) as server:
        page = load_clients.Good()
        task = asyncio.create_task(page.run(server.url))
        await page.subscribed.wait()
        for speaker in speakers:
            speaker.go()
        await asyncio.sleep(SETTLE_S)
        page.begin()
        with measured(server.process.pid) as cost:
            await asyncio.sleep(seconds)
        ages = sorted(page.ages)
        messages, size, lost = page.messages, page.bytes, page.lost
        memory = memory_mb(server.process.pid)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
    with where.on_ours():
        yardstick = await bare(1, messages / seconds, size // max(1, messages), seconds)
    return {
        **asdict(cost),
        "memory_mb": memory,
        "messages_per_s": messages / seconds,
        "p50_ms": 1e3 * ages[len(ages) // 2],
        "p99_ms": 1e3 * ages[int(0.99 * (len(ages) - 1))],
        "dropped": lost,
        "yardstick": yardstick,
        "ratio": cost.core_share / yardstick["relay_core_share"],
    }


def memory(where: Place, seconds: float) -> dict[str, Any]:
    """Three devices with a long history, without and with a page."""
    return asyncio.run(_memory(where))


async def _memory(where: Place) -> dict[str, Any]:
    with (
        devices(DEVICES, RATE, HISTORY_S, HISTORY_SPEED) as speakers,
        where.server(*sources_of(speakers)) as server,
    ):
        before = memory_mb(server.process.pid)
        for speaker in speakers:
            speaker.go()
        sent = [(await asyncio.to_thread(one.sent))["devices"][0] for one in speakers]
        api = Api(server.url)
        whole = await api.received_all(sent, decoded=True)
        await asyncio.sleep(2)
        unwatched = memory_mb(server.process.pid)
        page = load_clients.Good()
        task = asyncio.create_task(page.run(server.url))
        await page.subscribed.wait()
        await asyncio.sleep(2)
        out = {
            "before_mb": before,
            "unwatched_mb": unwatched,
            "watched_mb": memory_mb(server.process.pid),
            "history_s": HISTORY_S,
            "whole": float(whole),
        }
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
    return out


# ── the holder of a shared port ──────────────────────────────────────────────────────────────────────────────────────


@contextlib.contextmanager
def drained(descriptor: int) -> Iterator[None]:
    """A driver that reads all there is."""

    def read() -> None:
        with contextlib.suppress(OSError):
            while os.read(descriptor, 65_536):
                pass

    threading.Thread(target=read, daemon=True).start()
    yield


@contextlib.contextmanager
def copier(port: str) -> Iterator[tuple[int, int]]:
    """The yardstick without socat: process of `cat`, and its driver's descriptor."""
    driver, slave = os.openpty()
    tty.setraw(slave)
    process = subprocess.Popen(["cat", port], stdout=slave)
    try:
        yield process.pid, driver
    finally:
        process.kill()
        process.wait()


def holder(where: Place, seconds: float) -> dict[str, Any]:
    """The holder, then the yardstick."""
    has_socat = shutil.which("socat") is not None
    results: dict[str, Any] = {"yardstick": "socat" if has_socat else "cat"}
    for name in ("", "yardstick_"):
        with contextlib.ExitStack() as stack:
            (speaker,) = stack.enter_context(devices(1, HOLDER_RATE, seconds + 2))
            with where.on_ours():
                port = speaker.terminals[0]
                if not name:
                    relay = held(port, where.folder)
                else:
                    relay = relayed(port, where.folder) if has_socat else copier(port)
                pid, driver = stack.enter_context(relay)
            os.sched_setaffinity(0, where.others)
            stack.enter_context(drained(driver))
            speaker.go()
            time.sleep(1)
            with measured(pid) as cost:
                time.sleep(seconds)
            results |= {
                f"{name}core_share": cost.core_share,
                f"{name}wakeups_per_s": cost.wakeups_per_s,
                f"{name}memory_mb": memory_mb(pid),
            }
    return results | {"ratio": results["core_share"] / results["yardstick_core_share"]}


# ── start and overload ───────────────────────────────────────────────────────────────────────────────────────────────


def start(where: Place, seconds: float) -> dict[str, Any]:
    """The first start ever: nothing compiled, an empty data folder."""
    saved = {name: os.environ.pop(name, None) for name in ("PYTHONDONTWRITEBYTECODE",)}
    try:
        return asyncio.run(_start(where, seconds))
    finally:
        os.environ.update({name: value for name, value in saved.items() if value is not None})


async def _start(where: Place, seconds: float) -> dict[str, Any]:
    with devices(1, RATE, seconds + 60) as speakers:
        speakers[0].go()
        began = time.monotonic()
        with where.server(*sources_of(speakers)) as server:
            with contextlib.suppress(urllib.error.HTTPError):  # 503 where the page is not built: served as quickly
                urllib.request.urlopen(server.url, timeout=60).read()
            page_s = time.monotonic() - began
            page = load_clients.Good()
            task = asyncio.create_task(page.run(server.url))
            while not page.messages:
                await asyncio.sleep(0.01)
            samples_s = time.monotonic() - began
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            with measured(server.process.pid) as cost:
                await asyncio.sleep(seconds)
    with where.on_ours():
        imports_s = await asyncio.to_thread(importing)
    return {"page_s": page_s, "samples_s": samples_s, "after": asdict(cost), "yardstick": {"imports_s": imports_s}}


def overload(where: Place, seconds: float) -> dict[str, Any]:
    """Three devices, and a fourth that is too fast for what is left of the core."""
    return asyncio.run(_overload(where, 2 * seconds))


async def _overload(where: Place, seconds: float) -> dict[str, Any]:
    length = SETTLE_S + seconds
    with devices(DEVICES, RATE, length) as speakers, devices(1, TOO_FAST, length) as fast:
        every = [*speakers, *fast]
        with where.server(*sources_of(every), arguments=("--record",)) as server:
            page, api = Page(), Api(server.url)
            task = asyncio.create_task(page.run(server.url))
            await page.subscribed.wait()
            for speaker in every:
                speaker.go()
            sent = [(await asyncio.to_thread(one.sent))["devices"][0] for one in every]
            await api.received_all(sent)
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
        received = received_in(sorted((where.folder / "data" / "recordings").glob("*.mcap")))
    ages = sorted(age for _, age in page.noted)
    return {
        "whole": float(is_whole(received, sent)),
        "told": float(page.untold() <= 1.0),
        "untold_s": page.untold(),
        "behind_max_s": max((behind for _, behind in page.reports), default=0.0),
        "p50_ms": 1e3 * ages[len(ages) // 2],
        "p99_ms": 1e3 * ages[int(0.99 * (len(ages) - 1))],
        "dropped": page.lost,
        "lost_reported": [event["text"] for event in page.events if event["kind"] in ("gap", "reject")],
    }
