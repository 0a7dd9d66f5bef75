"""Use of the page of a robot whose driver has the device, and a device that keeps what it is sent."""

from __future__ import annotations

import json

from websockets.typing import Subprotocol

from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.server.links.simulator import SimulatorThread
from imuscope.server.wire import SUBPROTOCOL
from tests.support.server_process import ServerProcess
from tests.support.timeouts import connect, http_client


class ListeningDevice(XbusSimulator):
    """An MTi that keeps what it is sent."""

    received = b""

    def receive(self, data: bytes, now_ns: int) -> bytes:
        self.received += data
        return super().receive(data, now_ns)


def received_by(device: SimulatorThread) -> bytes:
    """All that a ListeningDevice was sent."""
    assert isinstance(device.device, ListeningDevice)
    return device.device.received


def open_a_page(server: ServerProcess) -> None:
    """Ask for what a page asks for when it is opened on Configure."""
    with http_client(base_url=server.url) as http:
        for place in ("devices", "devices/1/forms", "devices/1/values", "devices/1/shares", "recordings", "ports"):
            assert http.get(f"/api/{place}").status_code in (200, 404, 409)
    with connect(f"{server.url.replace('http', 'ws')}/ws", subprotocols=[Subprotocol(SUBPROTOCOL)]) as page:
        assert json.loads(page.recv())["op"] == "hello"


def record(server: ServerProcess) -> None:
    """Start a recording, and stop it."""
    with http_client(base_url=server.url) as http:
        http.post("/api/recordings/stop", json={})
        assert http.post("/api/recordings/start", json={}).is_success
        assert http.post("/api/recordings/stop", json={}).is_success
