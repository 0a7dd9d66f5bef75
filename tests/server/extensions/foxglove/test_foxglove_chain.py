"""A chain of two: one imuscope shows the devices of another, by its Foxglove server."""

from __future__ import annotations

import asyncio
from pathlib import Path

import numpy as np
import pytest

from imuscope.server.links.base import LinkError
from tests.server.links.message_sources import Watched, has, watched
from tests.support.server_process import ServerProcess

ACCELERATION = "/IDTP_device_102/Acceleration"


def port_of(server: ServerProcess) -> int:
    return int(server.url.rpartition(":")[2])


def test_devices_of_another_imuscope_have_their_quantities_units_and_attitude(tmp_path: Path) -> None:
    async def play(port: int) -> None:
        async with watched(f"foxglove://127.0.0.1:{port}") as made:
            rows = await has(made, 50, "Acceleration", ACCELERATION)
            assert np.linalg.norm(rows[2:], axis=0).mean() == pytest.approx(9.8, abs=2)
            assert abs(rows[0] - rows[1]).max() < 5  # its time of measurement, beside our time of arrival
            info = made.info("Acceleration")
            assert (info.kind, info.unit, [one.name for one in info.columns]) == ("vector", "m/s²", ["x", "y", "z"])
            await has(made, 10, "Quaternion", "/IDTP_device_102/Quaternion")
            assert (made.info("Quaternion").kind, made.info("Quaternion").frame) == ("quaternion", "ENU from body")
            assert made.session.health(made.telemetry.bus.now()).rejects == 0

    with ServerProcess("sim:idtp?rate=10", data=tmp_path, arguments=("--foxglove", "0")) as server:
        asyncio.run(play(port_of(server)))


def test_one_that_does_not_serve_the_protocol_states_it(tmp_path: Path) -> None:
    async def play(port: int) -> None:
        made = Watched(f"foxglove://127.0.0.1:{port}")
        with pytest.raises(LinkError, match=r"is not enabled on this server\. Start it with --foxglove"):
            await made.link.open()

    with ServerProcess("sim:idtp?rate=10", data=tmp_path) as server:
        asyncio.run(play(port_of(server)))
