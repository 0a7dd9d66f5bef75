"""The dialog of shared ports in a real browser: a port is shared on a phone, a program comes, and is disconnected."""

from __future__ import annotations

import socket
from collections.abc import Callable
from pathlib import Path

from playwright.sync_api import Page

from tests.browser.page_checks import TARGETS, serious
from tests.chromium import until
from tests.free_ports import free_port
from tests.links.shared_port import DevicePort
from tests.server_process import ServerProcess
from tests.timeouts import PATIENCE_S

DIALOG = "document.querySelector('dialog[open]')?.innerText"


def test_a_port_is_shared_on_a_phone(
    serve: Callable[..., ServerProcess],
    open_page: Callable[..., Page],
    runtime: Path,
) -> None:
    port, number = DevicePort(), free_port()
    page = open_page(serve(f"{port.path}?baud=115200").url, width=390, height=844, touch=True)
    page.locator("[aria-controls=rail]:visible").first.click()
    page.get_by_role("button", name="Share port").click()
    until(page, f"{DIALOG}?.includes('The port is not shared.')")
    page.get_by_role("button", name="TCP").click()
    page.get_by_label("Address").fill(f"tcp://127.0.0.1:{number}")
    page.get_by_role("dialog").get_by_role("button", name="Share", exact=True).click()
    until(page, f"{DIALOG}?.includes('No program connected')")
    with socket.create_connection(("127.0.0.1", number), PATIENCE_S) as program:
        program.settimeout(PATIENCE_S)
        peer = f"127.0.0.1:{program.getsockname()[1]}"
        until(page, f"{DIALOG}?.includes({peer!r})")
        port.send(bytes(1500))
        until(page, f"{DIALOG}?.includes('1.5 kB')")
        assert serious(page, "document.querySelector('dialog[open]')") == []
        assert page.evaluate("document.scrollingElement.scrollWidth") <= 390
        small = [one for one in page.evaluate(TARGETS) if 'type="checkbox"' not in one]  # its label is the target
        assert not small, small
        assert len(program.recv(1500, socket.MSG_WAITALL)) == 1500
        page.get_by_role("button", name=f"Disconnect {peer}").click()
        assert program.recv(1) == b""
    page.get_by_role("button", name=f"End the share tcp://127.0.0.1:{number}").click()
    until(page, f"{DIALOG}?.includes('The port is not shared.')")
    port.unplug()
