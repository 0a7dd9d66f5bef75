"""Holders of one port that begin at once, and a port that is lost while its server waits to send."""

import fcntl
import os
import socket
import threading
from pathlib import Path

import pytest

from imuscope.server.extensions.shares.holder.event_loop import EventLoop
from imuscope.server.extensions.shares.holder.process import Holder
from imuscope.server.extensions.shares.holder.server_session import ServerSide
from imuscope.server.extensions.shares.holder.settings import HolderSettings
from imuscope.server.extensions.shares.holder.shares import ShareError
from tests.server.extensions.shares.shared_port import DevicePort
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until


def test_of_two_holders_that_begin_at_once_one_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both found the socket of a holder that was killed; the later one removed that of the other, which held the port
    and could not be found any more.
    """
    path = str(tmp_path / "port.sock")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as killed:
        killed.bind(path)
    remove, lock, begun, ahead, one_listens = os.unlink, fcntl.flock, set[int](), list[int](), threading.Event()

    def flock(folder: int, how: int) -> None:
        begun.add(threading.get_ident())
        lock(folder, how)
        ahead.append(threading.get_ident())

    def unlink(place: str) -> None:
        begun.add(threading.get_ident())
        ahead.append(threading.get_ident())
        block_until(lambda: len(begun) == 2, "both have begun")
        if threading.get_ident() != ahead[0]:
            assert one_listens.wait(PATIENCE_S)
        remove(place)

    monkeypatch.setattr(os, "unlink", unlink)
    monkeypatch.setattr(fcntl, "flock", flock)
    loop = EventLoop()
    sides = [
        ServerSide(path, {}, loop, on_message=lambda kind, body: None, on_gone=lambda: None, state=dict) for _ in "ab"
    ]
    refused: list[ShareError] = []

    def listen(side: ServerSide) -> None:
        try:
            side.listen()
        except ShareError as error:
            refused.append(error)
        one_listens.set()

    threads = [threading.Thread(target=listen, args=(side,)) for side in sides]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE_S)
    monkeypatch.undo()
    assert [str(error)[:14] for error in refused] == ["another holder"]
    for side in sides:
        side.close()
    loop.close()
    assert not os.path.exists(path)


def test_the_cause_of_a_lost_port_stays_though_more_was_to_be_sent(port: DevicePort, tmp_path: Path) -> None:
    """The second write that waited found no port, and the page said "Bad file descriptor"."""
    source = {"kind": "serial", "place": port.path, "baud": 115_200}
    holder = Holder(HolderSettings(source, str(tmp_path / "port.sock"), ()))
    holder._open_port()
    now = 0.0
    for number in (1, 2):
        holder.server.wait(number, b"message", now)
    port.unplug()
    holder._tick(now)
    state = holder.state(now)
    assert (state["open"], state["error"]) == (False, "Input/output error")
    holder._close()
