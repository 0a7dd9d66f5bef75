"""hiroz, a native Rust ROS 2 over Zenoh, as a node that publishes what we show."""

from __future__ import annotations

import asyncio
import subprocess
from pathlib import Path

import numpy as np

from tests.interop.running import DiffersError, owned
from tests.server.extensions.ros2.zenoh_router import running_router
from tests.server.links.message_sources import watched
from tests.support.free_ports import free_port
from tests.support.waiting import until

RATE, SECONDS = 1000, 60.0
TOPIC, TYPE = "/imu/data", "sensor_msgs/msg/Imu"


def hiroz_source(folder: Path, scratch: Path) -> str:
    """A minute at 1 kHz from hiroz: every message once and in order, values and stamps as it made them."""
    program = owned("hiroz_host", "tests/interop/hiroz_host, built there by `cargo build --release`")
    return asyncio.run(_watch(program))


async def _watch(program: str) -> str:
    port = free_port()
    with running_router(port):
        async with watched(f"ros2://127.0.0.1:{port}{TOPIC}?type={TYPE}") as made:
            await until(lambda: made.session.info.is_open, "the router is reached")
            talk = [program, "talk", f"tcp/127.0.0.1:{port}", "0", str(SECONDS), str(RATE), TOPIC]
            with subprocess.Popen(talk, stdout=subprocess.DEVNULL) as process:
                await until(lambda: made.count("angular_velocity", TOPIC) > 10, "its messages are shown")
                notices = made.notices
                while process.poll() is None:
                    made.session.access.decode()
                    await asyncio.sleep(0.01)
            await until(lambda: not made.link.backlog, "all is decoded")
            health = made.session.health(made.telemetry.bus.now())
            arrival, time, *covariance = made.rows("orientation_covariance", TOPIC)
            number = covariance[8]
            expected = round(RATE * SECONDS)
            _expect(not notices, f"it says {notices}")
            _expect((health.lost, health.rejects) == (0, 0), f"{health.lost} lost, {health.rejects} rejected")
            _expect(bool((np.diff(number) == 1).all()), "the numbers have gaps")
            _expect(abs(len(number) - expected) < RATE, f"{len(number)} messages, not about {expected}")
            _expect(not np.isnan(time).any(), "a stamp was not used")
            ages = np.percentile((arrival - time) * 1e3, [50, 99])
            shown = {"orientation", "angular_velocity", "linear_acceleration"}
            _expect(shown <= made.titles, f"it shows {made.titles}")
            return f"{len(number)} messages, none lost, ages {ages[0]:.2f} ms, at most {ages[1]:.1f} ms for 99 %"


def _expect(holds: bool, words: str) -> None:
    if not holds:
        raise DiffersError(words)
