"""The terminal of a share, between two programs that open it one after the other."""

from __future__ import annotations

import contextlib
import fcntl
import itertools
import os
import tempfile
import termios
from collections.abc import Iterator
from pathlib import Path

import pytest

from imuscope.server.extensions.shares.holder.share_kinds import PtyShare
from imuscope.server.extensions.shares.holder.shares import ShareAddress
from tests.server.extensions.shares.shared_port import DevicePort, opened
from tests.support.each_row import each_row

POWERLESS = 65534


@contextlib.contextmanager
def a_share(*, privileged: bool) -> Iterator[PtyShare]:
    """A share of a user with or without rights of the system's administrator, as far as those of the test go."""
    changes = os.geteuid() == 0 and not privileged
    if changes:
        os.seteuid(POWERLESS)
    try:
        with tempfile.TemporaryDirectory() as folder:
            share = PtyShare(ShareAddress.parse(str(Path(folder) / "imu0")), itertools.count(1).__next__)
            share.open()
            try:
                yield share
            finally:
                share.close()
    finally:
        if changes:
            os.seteuid(0)


def used_once(share: PtyShare, *, exclusively: bool) -> None:
    """A program opens the terminal, does not read what comes, and closes it."""
    program = opened(Path(share.address.path))
    if exclusively:
        fcntl.ioctl(program, termios.TIOCEXCL)
    client, _ = share.update()
    assert client is not None
    client.put(b"left unread", None)
    os.close(program)
    assert share.update() == (None, client)
    share.clean()


@each_row("privileged", [True, False])
@each_row("exclusively", [True, False])
def test_the_next_program_finds_a_new_terminal(privileged: bool, exclusively: bool) -> None:
    """Drivers ask for exclusive use (TIOCEXCL), which a pseudo-terminal keeps when its last program closes it."""
    with a_share(privileged=privileged) as share:
        for _ in range(3):
            used_once(share, exclusively=exclusively)
        program = opened(Path(share.address.path))
        client, _ = share.update()
        assert client is not None
        client.put(b"new", None)
        assert os.read(program, 20) == b"new"
        second = opened(Path(share.address.path))  # as no program asked for exclusive use now
        os.close(second)
        os.close(program)


def test_a_terminal_that_was_opened_again_is_left_alone() -> None:
    with a_share(privileged=True) as share:
        program = opened(Path(share.address.path))
        client, _ = share.update()
        assert client is not None
        client.put(b"first", None)
        share.clean()
        assert os.read(program, 20) == b"first"
        os.close(program)


def test_a_terminal_that_cannot_be_replaced_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    with a_share(privileged=False) as share:
        terminal = os.readlink(share.address.path)

        def fail() -> tuple[int, int]:
            raise OSError("no terminals are left")

        monkeypatch.setattr(os, "openpty", fail)
        used_once(share, exclusively=True)
        assert os.readlink(share.address.path) == terminal
        assert share.update() == (None, None)


def test_a_terminal_has_no_modem_lines_and_no_uart(port: DevicePort) -> None:
    """As the guide says: a driver that needs them takes a share of TCP."""
    terminal = opened(Path(port.path))
    for request in (termios.TIOCMGET, termios.TIOCMBIS, termios.TIOCGSERIAL, termios.TIOCSSERIAL):
        with pytest.raises(OSError, match="Inappropriate ioctl"):
            fcntl.ioctl(terminal, request, bytes(80))
    fcntl.ioctl(terminal, termios.TIOCEXCL)
    termios.tcsendbreak(terminal, 0)
    os.close(terminal)
