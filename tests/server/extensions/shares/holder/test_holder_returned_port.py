"""A port that returns: it is opened by what stands at its path, with pauses between attempts that never end here."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from imuscope.server.extensions.shares.holder import process
from imuscope.server.extensions.shares.holder.process import Holder
from imuscope.server.extensions.shares.holder.settings import HolderSettings
from imuscope.server.extensions.shares.holder.shares import ShareAddress
from imuscope.server.links.base import LinkError
from imuscope.server.system.terminals import standing_at
from tests.server.extensions.shares.shared_port import DevicePort, link_to, opened, read_exactly
from tests.support.waiting import block_until

NEVER_S = 1e6


@contextmanager
def held(place: Path, share: Path, folder: Path) -> Iterator[Holder]:
    """A holder in a thread."""
    source = {"kind": "serial", "place": str(place), "baud": 115_200}
    holder = Holder(HolderSettings(source, str(folder / "socket"), (ShareAddress.parse(str(share)),), stay=True))
    ready = threading.Event()
    thread = threading.Thread(target=holder.run, args=(ready.set, print))
    thread.start()
    ready.wait()
    yield holder
    holder.end()
    thread.join()


def test_a_returned_port_is_shared_again_without_waiting_for_the_next_attempt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The pause grew with each attempt, so the driver of a robot had to wait for up to ten seconds."""
    monkeypatch.setattr(process, "LOCAL_S", (NEVER_S, NEVER_S))
    place, share = tmp_path / "ttyIMU", tmp_path / "imu0"
    with held(place, share, tmp_path) as holder:
        assert not holder.port.is_open
        for number in (b"1", b"2"):
            port = DevicePort()
            place.symlink_to(port.path)
            block_until(share.is_symlink, "the port has come, and is shared")
            driver = opened(share)
            block_until(lambda: holder.sharing.clients, "the driver is noticed")
            port.send(number)
            assert read_exactly(driver, 1) == number
            place.unlink()
            port.unplug()
            block_until(lambda: not share.is_symlink(), "the port is gone")
            os.close(driver)


def test_a_port_whose_permissions_come_after_it_is_another_one_to_examine(tmp_path: Path) -> None:
    """The system makes a port first, and then gives it to the group of port users."""
    place = tmp_path / "ttyUSB0"
    assert standing_at(str(place)) is None
    place.touch(mode=0o600)
    before = standing_at(str(place))
    place.chmod(0o660)
    assert standing_at(str(place)) not in (None, before)
    assert standing_at("") is None


async def test_a_port_that_is_not_there_yet_has_its_holder_ready(port: DevicePort, tmp_path: Path) -> None:
    """The holder began with the port, so its start was on the way to the driver."""
    path, port.path = port.path, str(tmp_path / "ttyIMU")
    link = link_to(port, str(tmp_path / "imu0"))
    with pytest.raises(LinkError, match="no port"):
        await link.open()
    assert link.holder_pid
    Path(port.path).symlink_to(path)
    block_until((tmp_path / "imu0").is_symlink, "the holder has opened the port, and shares it")
    await link.open()
    await link.request("end")
    await link.close()
