"""Alarms whose file is being written when the server ends."""

import asyncio
import threading
from pathlib import Path
from typing import Any, cast

import pytest

from imuscope.server.extensions.alarms import service
from imuscope.server.extensions.alarms.alarm_file import AlarmFile
from imuscope.server.extensions.alarms.service import AlarmService
from imuscope.server.streaming.telemetry import Telemetry
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import until


async def test_the_last_state_is_stored_at_the_end_though_an_earlier_one_is_being_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The thread of a save that was cancelled wrote its older state last."""
    monkeypatch.setattr(service, "SAVE_EVERY", 1)
    begun: list[AlarmFile] = []
    written: list[AlarmFile] = []
    may_write = threading.Event()

    def slow(file: AlarmFile, path: Path) -> None:
        begun.append(file)
        if len(begun) == 1:
            may_write.wait(PATIENCE_S)
        written.append(file)

    monkeypatch.setattr(AlarmFile, "save", slow)
    telemetry = Telemetry.create(lambda: 1e9)
    alarms = AlarmService(telemetry.bus, telemetry.store, tmp_path, cast(Any, None))
    await alarms.start()
    alarms._is_dirty = True
    await until(lambda: begun, "it is being written")
    alarms._is_dirty = True
    closing = asyncio.create_task(alarms.close())
    await asyncio.sleep(0.1)  # the last state would overtake the earlier here
    may_write.set()
    await closing
    await until(lambda: len(written) == 2, "both are written")
    assert written[-1] is begun[-1]
    await alarms.close_trigger()
