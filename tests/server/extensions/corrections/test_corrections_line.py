"""Corrections for one of two devices that share a line."""

from __future__ import annotations

import asyncio
from pathlib import Path

from imuscope.protocols.events import Reply
from imuscope.server.configuration.device_controller import DeviceController
from imuscope.server.extensions.corrections.routes import CorrectionManager
from tests.server.configuration.shared_line import SOURCE, both
from tests.server.extensions.corrections.correction_messages import NUMBERS, STREAM
from tests.support.control_harness import house
from tests.support.waiting import until


async def test_corrections_go_to_the_device_of_a_line_that_they_are_for(tmp_path: Path) -> None:
    async with house(tmp_path) as here:
        first, further = await both(here, f"{SOURCE}&product=MTi-680G")
        for desk in (first, further):
            assert (await here.read(desk)).state == "done"
        sent: list[bytes] = []
        first.member.listeners.sent.add(lambda data, time: sent.append(data))
        received: list[tuple[DeviceController, str]] = []
        for desk in (first, further):
            desk.member.listen(
                lambda event, desk=desk: isinstance(event, Reply) and received.append((desk, event.message.name))
            )
        corrections = CorrectionManager(here.sessions)
        assert corrections.accepts(further.member)
        tasks = len(asyncio.all_tasks())
        base = await asyncio.start_server(_corrections, "127.0.0.1", 0)
        source = f"tcp://127.0.0.1:{base.sockets[0].getsockname()[1]}"
        await corrections.begin(further.member, source, further.log.streamed)
        await until(lambda: len(received) == len(sent) == len(NUMBERS), "each is acknowledged")
        assert corrections.state(further.member).refused == 0
        assert {(data[1], data[2]) for data in sent} == {(int(further.context.device), 0xE2)}
        assert set(received) == {(further, "ForwardGnssDataAck")}
        assert any("Corrections from" in entry.text for entry in further.log.tail())
        assert not any("Corrections from" in entry.text for entry in first.log.tail())
        await corrections.close()
        base.close()
        await until(lambda: len(asyncio.all_tasks()) <= tasks, "it has ended")


async def _corrections(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    writer.write(STREAM)
    await reader.read()  # until the other side goes
    writer.close()
