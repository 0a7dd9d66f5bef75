"""Requests about the corrections of one device that come at once."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any, cast

import pytest

from imuscope.server.extensions.corrections import routes
from imuscope.server.extensions.corrections.routes import CorrectionManager
from imuscope.server.extensions.corrections.stream import Corrections


class SlowForwarder:
    """A stream whose connection takes a while to be closed."""

    all: list[SlowForwarder]
    may_close: asyncio.Event

    def __init__(self, *_: object) -> None:
        self.is_closed = False
        self.all.append(self)

    def state(self) -> Corrections:
        return Corrections(source="")

    async def close(self) -> None:
        await self.may_close.wait()
        self.is_closed = True


async def test_of_streams_that_are_set_at_once_one_is_forwarded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both were sent to the device, and one could not be ended any more."""
    SlowForwarder.all, SlowForwarder.may_close = [], asyncio.Event()
    monkeypatch.setattr(routes, "CorrectionForwarder", SlowForwarder)
    session = cast(Any, SimpleNamespace(info=SimpleNamespace(id="1")))
    corrections = CorrectionManager(cast(Any, None))
    await corrections.begin(session, "tcp://base:1")
    changes = [asyncio.create_task(corrections.begin(session, f"tcp://base:{port}")) for port in (2, 3)]
    await asyncio.sleep(0)
    SlowForwarder.may_close.set()
    await asyncio.gather(*changes)
    assert [one.is_closed for one in SlowForwarder.all] == [True, True, False]
    assert corrections._streams == {"1": SlowForwarder.all[2]}
    await corrections.close()
    assert all(one.is_closed for one in SlowForwarder.all)


async def test_the_stream_of_a_device_that_was_removed_is_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    """It kept the device in memory, with all that had been decoded of it."""
    SlowForwarder.all, SlowForwarder.may_close = [], asyncio.Event()
    SlowForwarder.may_close.set()
    monkeypatch.setattr(routes, "CorrectionForwarder", SlowForwarder)
    sessions = SimpleNamespace(infos=[])
    corrections = CorrectionManager(cast(Any, sessions))
    for device in ("1", "2", "3"):
        session = cast(Any, SimpleNamespace(info=SimpleNamespace(id=device)))
        sessions.infos = [session.info]
        await corrections.begin(session, "tcp://base:1")
    assert list(corrections._streams) == ["3"]
    assert [one.is_closed for one in SlowForwarder.all] == [True, True, False]
