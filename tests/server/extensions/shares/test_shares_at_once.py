"""Requests about the shares of one port that come at once."""

from __future__ import annotations

import asyncio
import os
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from imuscope.server.devices.link.session import Session
from imuscope.server.errors import DomainError
from imuscope.server.extensions.shares import port_shares
from imuscope.server.extensions.shares.port_shares import PortShares
from imuscope.server.extensions.shares.shared_port_link import SharedPortLink
from imuscope.server.links.base import LinkError
from imuscope.server.system.open_files import Program
from tests.server.extensions.shares.shared_port import DevicePort, opened
from tests.support.control_harness import ControlHarness, house
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import until

pytestmark = pytest.mark.usefixtures("runtime")


@asynccontextmanager
async def sharing(folder: Path) -> AsyncIterator[tuple[ControlHarness, PortShares, Session]]:
    port = DevicePort()
    async with house(folder) as here:
        shares = PortShares(here.telemetry.bus, here.sessions, here.desks, {})
        session = here.sessions.add(f"{port.path}?baud=115200")
        await until(lambda: session.info.is_open, "it is open")
        yield here, shares, session


async def test_two_shares_that_are_added_at_once_are_both_offered(tmp_path: Path) -> None:
    """Each put a link of its own in place of the one before, and two tasks read the port."""
    async with sharing(tmp_path) as (_, shares, session):
        names = [f"{shares.folder}/{name}" for name in ("one", "two")]
        await asyncio.gather(*(shares.add(session, name) for name in names))
        link = session.access.link
        assert isinstance(link, SharedPortLink)
        assert sorted(one.text for one in link.shares) == names
        await until(lambda: sorted(one["text"] for one in link.state["shares"]) == names, "the holder offers both")
        await asyncio.gather(*(shares.remove(session, name) for name in names))
        assert session.access.link is link.inner
        await until(lambda: session.info.is_open, "it is open")


async def test_a_share_of_a_device_that_is_removed_in_the_meantime_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The request waited for a link that was never opened, until its client had enough."""
    opens = asyncio.Event()

    async def slow(link: SharedPortLink, progress: object = None) -> None:
        opens.set()
        await asyncio.Event().wait()

    monkeypatch.setattr(SharedPortLink, "open", slow)
    async with sharing(tmp_path) as (here, shares, session):
        adding = asyncio.create_task(shares.add(session, f"{shares.folder}/one"))
        await opens.wait()
        await here.sessions.remove(session.info.id)
        await until(adding.done, "it is refused")
        with pytest.raises((DomainError, LinkError)):
            await adding


async def test_a_port_that_is_shared_again_and_again_keeps_nothing_of_earlier_shares(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each link to a holder stayed in memory until the device was removed, with what its clients had sent."""

    async def refused(link: SharedPortLink, progress: object = None) -> None:
        raise LinkError("refused", "No holder can be started.", "Try again.")

    async with sharing(tmp_path) as (_, shares, session):
        before = len(session.listeners._closing)
        for _ in range(2):
            await shares.add(session, f"{shares.folder}/one")
            shares._partial[session.info.id, 1] = b"half a frame"
            await shares.remove(session, f"{shares.folder}/one")
            await until(lambda: session.info.is_open, "it is open")
        monkeypatch.setattr(SharedPortLink, "open", refused)
        with pytest.raises(DomainError, match="No holder"):
            await shares.add(session, f"{shares.folder}/one")
        assert len(session.listeners._closing) == before
        assert not shares._following
        assert not shares._partial


async def test_a_program_that_comes_and_leaves_is_reported_in_that_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It had left before its name was found, and the last line of the log said that it was connected."""
    visited = threading.Event()

    def found_late(terminal: str) -> list[Program]:
        assert visited.wait(PATIENCE_S)
        return [Program(1, "driver")]

    monkeypatch.setattr(port_shares, "programs_with", found_late)
    async with sharing(tmp_path) as (here, shares, session):
        messages: list[str] = []
        here.telemetry.bus.events.subscribe(lambda event: messages.append(event.text))
        await shares.add(session, f"{shares.folder}/one")
        link = session.access.link
        assert isinstance(link, SharedPortLink)
        driver = opened(Path(shares.folder, "one"))
        await until(lambda: link.state["clients"], "it is there")
        os.close(driver)
        await until(lambda: not link.state["clients"], "it has left")
        visited.set()
        await until(lambda: sum("shared port" in text for text in messages) == 2, "both are told")
        assert [text for text in messages if "shared port" in text] == [
            "driver (process 1) is connected to the shared port and may write.",
            "driver (process 1) left the shared port.",
        ]
        await shares.remove(session, f"{shares.folder}/one")
