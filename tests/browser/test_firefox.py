"""The page in Firefox, where one is installed: plots of three devices, a recording, and no word on the console.

Playwright brings a Firefox of its own; that of the distribution speaks WebDriver BiDi (w3.org/TR/webdriver-bidi).
"""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import ClientConnection, connect

from tests.conftest import READY
from tests.recordings.recorded_drive import drive
from tests.support.free_ports import free_port
from tests.support.server_process import ServerProcess, tied
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until

FIREFOX = shutil.which("firefox-esr") or shutil.which("firefox") or ""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not FIREFOX, reason="no Firefox is installed: apt install firefox-esr"),
]


class Firefox:
    """One page of a running Firefox."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self._numbers = count(1)
        self.console: list[str] = []  # errors and warnings
        self.request("session.new", capabilities={})
        self.request("session.subscribe", events=["log.entryAdded"])
        self._page = self.request("browsingContext.getTree")["contexts"][0]["context"]

    def request(self, method: str, **parameters: Any) -> Any:
        """The result of a command."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self._socket.recv(PATIENCE_S))
            if answer.get("method") == "log.entryAdded" and answer["params"]["level"] in ("error", "warn"):
                self.console.append(answer["params"]["text"])
            if answer.get("id") == number:
                assert answer["type"] == "success", answer
                return answer["result"]

    def open(self, url: str) -> None:
        """Load an address anew."""
        for address in ("about:blank", url):
            self.request("browsingContext.navigate", context=self._page, url=address, wait="complete")

    def holds(self, expression: str) -> bool:
        """Whether an expression is true in the page."""
        result = self.request(
            "script.evaluate", expression=f"Boolean({expression})", target={"context": self._page}, awaitPromise=True
        )
        return bool(result["result"]["value"])

    def wait_for(self, expression: str) -> None:
        """Wait until an expression is true."""
        block_until(lambda: self.holds(expression), expression)


@pytest.fixture
def firefox(tmp_path: Path) -> Iterator[Firefox]:
    port = free_port()
    words = [FIREFOX, "--headless", "--no-remote", "--profile", str(tmp_path), "--remote-debugging-port", str(port)]
    with subprocess.Popen(tied(words), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            assert any("WebDriver BiDi listening" in line for line in process.stderr), "it ended"
            with connect(f"ws://127.0.0.1:{port}/session", max_size=None) as socket:
                yield Firefox(socket)
        finally:
            process.kill()


def test_the_page_works_in_firefox(firefox: Firefox, tmp_path: Path) -> None:
    data = tmp_path / "data"
    (data / "recordings").mkdir(parents=True)
    drive(data / "recordings" / "drive.mcap", seconds=2.0)
    with ServerProcess("sim:xbus", "sim:isb", "sim:idtp", data=data) as server:
        for device in (1, 2, 3):
            firefox.open(f"{server.url}/#/?device={device}")
            firefox.wait_for(READY)
        firefox.open(f"{server.url}/#/configure")
        firefox.wait_for("document.body.innerText.includes('Read settings')")
        firefox.open(f"{server.url}/#/recordings/drive")
        firefox.wait_for("window.imuscopeReplay?.near.channels.value.some(channel => channel.ring.length > 20)")
    assert firefox.console == []
