"""A port that is opened before its device sends data, as in every benchmark."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from websockets.typing import Subprotocol

from imuscope.server import wire
from tests.bench.serial_device import Feed
from tests.server_process import ServerProcess
from tests.timeouts import PATIENCE_S, connect, get
from tests.waiting import block_until

RATE, SECONDS = 500, 2


def test_a_port_that_is_silent_at_first_loses_nothing_when_it_speaks(serve: Callable[..., ServerProcess]) -> None:
    """The benchmarks of the stream got no samples. It was not this; it is held, for it is what they rest on."""
    with Feed(RATE, SECONDS) as feed:
        url = serve(f"serial://{feed.terminal}?baud=2000000").url

        def silent() -> dict[str, Any] | None:
            (device,) = get(f"{url}/api/devices").json()
            return device if "0 B so far" in device["message"] else None

        device = block_until(silent, "told that nothing came")
        assert (device["status"], device["protocol"]) == ("connecting", ""), "and nothing is guessed"
        with connect(url.replace("http", "ws") + "/ws", subprotocols=[Subprotocol(wire.SUBPROTOCOL)]) as socket:
            feed.go()
            health: dict[str, Any] = {"messages": []}
            while _count(health) < RATE * SECONDS:
                text = json.loads(socket.recv(timeout=PATIENCE_S))
                if text["op"] == "health" and text["devices"]:
                    (health,) = text["devices"]
        assert (_count(health), health["gaps"], health["rejects"]) == (RATE * SECONDS, 0, 0)


def _count(health: dict[str, Any]) -> int:
    return sum(message["count"] for message in health["messages"] if message["name"] == "MTData2")
