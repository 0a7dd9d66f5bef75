"""A session of a source of messages, with its telemetry, and a Foxglove server by Foxglove's own SDK."""

import asyncio
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from contextlib import asynccontextmanager, contextmanager
from typing import Any

import foxglove
import numpy as np

from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.devices.link.session import Session
from imuscope.server.links.base import LinkSettings, steady_clock
from imuscope.server.links.source_url import open_link
from imuscope.server.streaming.telemetry import Telemetry
from tests.server.links import rosbags_messages as ros
from tests.support.waiting import until


class SdkServer:
    """A server of Foxglove's SDK with channels of CDR."""

    def __init__(self, port: int, topics: Mapping[str, str]) -> None:
        self._context = foxglove.Context()
        self._server = foxglove.start_server(
            name="robot", port=port, context=self._context, message_backlog_size=1 << 16
        )
        self.port = port
        self._channels = {topic: self.channel(topic, name) for topic, name in topics.items()}

    def channel(self, topic: str, name: str, encoding: str = "cdr", data: bytes | None = None) -> foxglove.Channel:
        kind = {"cdr": "ros2msg", "json": "jsonschema"}.get(encoding, encoding)
        schema = foxglove.Schema(name=name, encoding=kind, data=ros.definition(name) if data is None else data)
        return foxglove.Channel(topic, schema=schema, message_encoding=encoding, context=self._context)

    def log(self, topic: str, data: bytes, time_ns: int | None = None) -> None:
        self._channels[topic].log(data, log_time=time.time_ns() if time_ns is None else time_ns)

    @property
    def is_subscribed(self) -> bool:
        """Whether what is logged on each channel is sent to somebody."""
        return all(channel.has_sinks() for channel in self._channels.values())

    def stop(self) -> None:
        self._server.stop()


@contextmanager
def sdk_server(port: int, topics: Mapping[str, str]) -> Iterator[SdkServer]:
    server = SdkServer(port, topics)
    try:
        yield server
    finally:
        server.stop()


@contextmanager
def sending(send: Callable[[int], None], rate: float = 100.0) -> Iterator[None]:
    """Call `send` with 0, 1, 2 … at a rate, in a thread, until the block ends."""
    stopped = threading.Event()

    def run() -> None:
        n, next_at = 0, time.monotonic()
        while not stopped.wait(max(0.0, next_at - time.monotonic())):
            send(n)
            n, next_at = n + 1, next_at + 1 / rate

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        stopped.set()
        thread.join()


class Watched:
    """One source, as the server has it."""

    def __init__(self, source: str) -> None:
        now_ns = steady_clock()
        self.telemetry = Telemetry.create(lambda: now_ns() / 1e9)
        self.link = open_link(source, LinkSettings(now_ns=now_ns))
        self.session = Session("1", self.link, self.telemetry.bus, all_protocols())

    def rows(self, title: str, topic: str) -> list[np.ndarray]:
        """Arrival, time and columns of a quantity so far."""
        self.session.access.decode()
        results = [one for one in self.telemetry.store.all if (one.info.title, one.info.message) == (title, topic)]
        return [] if not results else results[0].ring.read()

    def count(self, title: str, topic: str) -> int:
        rows = self.rows(title, topic)
        return len(rows[0]) if rows else 0

    def info(self, title: str) -> Any:
        return next(one.info for one in self.telemetry.store.all if one.info.title == title)

    @property
    def titles(self) -> set[str]:
        self.session.access.decode()
        return {one.info.title for one in self.telemetry.store.all}

    @property
    def status(self) -> str:
        """Status after the checks that a server makes ten times a second."""
        self.session.tick(self.telemetry.bus.now())
        return self.session.info.status

    @property
    def notices(self) -> str:
        self.session.tick(self.telemetry.bus.now())
        return " ".join(self.session.info.notices)


@asynccontextmanager
async def watched(source: str) -> AsyncIterator[Watched]:
    made = Watched(source)
    made.session.start()
    try:
        yield made
    finally:
        await made.session.close()


async def has(made: Watched, count: int, title: str, topic: str) -> list[np.ndarray]:
    """Wait for so many samples of a quantity."""
    await until(lambda: made.count(title, topic) >= count, f"{count} samples of {title} of {topic}")
    return made.rows(title, topic)


def run(test: Callable[[], Any]) -> None:
    asyncio.run(test())
