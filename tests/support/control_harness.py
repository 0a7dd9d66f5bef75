"""The server without its HTTP side, in the test's own event loop: real simulators behind real pseudo-terminals."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from imuscope.protocols.commands.transactions import DeviceDriver
from imuscope.protocols.isb.driver import IsbDriver
from imuscope.protocols.isb.stream_discovery import ListeningTimes
from imuscope.protocols.xbus.driver import XbusDriver
from imuscope.protocols.xbus.requests import StateTimes
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.server.configuration import controllers
from imuscope.server.configuration.controllers import ControllerRegistry
from imuscope.server.configuration.device_controller import DeviceController, RunningJob
from imuscope.server.configuration.timings import ConfigurationTimings
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.devices.device.device_names import DeviceNames
from imuscope.server.devices.link.sessions import Sessions
from imuscope.server.links.base import LinkSettings, steady_clock
from imuscope.server.links.simulated_device import SimulatorOptions
from imuscope.server.links.simulated_line import LineFaults
from imuscope.server.links.simulator import SimulatorThread
from imuscope.server.links.source_url import open_link
from imuscope.server.streaming.telemetry import Telemetry
from imuscope.server.wire import Job
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import until

BRIEF = ListeningTimes(least_s=0.3, listen_s=0.5)  # the product's times are for streams of 1 Hz
BRIEFEST = ListeningTimes(least_s=0.1, listen_s=0.1)  # for tests that do not concern streams

PATIENT = 10.0  # times as long as the product waits for an answer: a simulator that has no processor is not silent

LATE = StateTimes(config_s=2 * PATIENT)  # where an MTi answers: its first answer ends the wait
SILENT = StateTimes(config_s=1.0, stream_s=1.0, answer_s=0.5)  # where an MTi cannot answer


class ControlHarness:
    """Telemetry, sessions and desks."""

    def __init__(self, data: Path, timings: ConfigurationTimings, listening: ListeningTimes, times: StateTimes) -> None:
        drivers: dict[str, DeviceDriver] = {"isb": IsbDriver(listening), "xbus": XbusDriver(times)}

        def driver_of(protocol: str) -> DeviceDriver | None:
            return drivers.get(protocol) or controllers.driver_of(protocol)

        now_ns = steady_clock()
        self.telemetry = Telemetry.create(lambda: now_ns() / 1e9)
        settings = LinkSettings(now_ns=now_ns)
        self.sessions = Sessions(self.telemetry.bus, open_link, all_protocols(), settings, names=DeviceNames(data))
        self.desks = ControllerRegistry(self.telemetry.bus, self.sessions, data, timings, drivers=driver_of)

    async def add(self, source: str) -> DeviceController:
        """Open a source and wait until it streams."""
        device = self.sessions.add(source).info.id
        desk = self.desks.get(device)
        try:
            await until(lambda: desk.member.info.status == "live", "it streams")
        except AssertionError as late:
            info = desk.member.info
            tries = "".join(f"\n  {one.what}: {one.outcome}" for one in info.attempts)
            raise AssertionError(f"{late}; {info.status}: {info.message} {info.hint}{tries}") from None
        return desk

    async def apply(self, desk: DeviceController, changes: dict[str, dict[str, object]], reason: str = "") -> Job:
        return await over(desk.add("Write", partial(self.desks.jobs.apply, changes=changes, reason=reason)))

    async def read(self, desk: DeviceController) -> Job:
        return await over(desk.add("Read", partial(self.desks.jobs.read, names=None, reason="")))


@asynccontextmanager
async def house(
    data: Path,
    rollback_s: float = 0.5,
    listening: ListeningTimes = BRIEF,
    times: StateTimes = LATE,
    **timings: Any,
) -> AsyncIterator[ControlHarness]:
    """A server's inside, closed as the server closes it.

    Args:
        listening: how long the streams of an IMX are listened to.
        times: how long an MTi is waited for.
        timings: further ones of ConfigurationTimings; a port is looked for ten times a second, and answers are waited
            for with patience, which those pass as 1 that have a device be silent.
    """
    brief = {"port_poll_s": 0.1, "patience": PATIENT, **timings}
    limits = ConfigurationTimings(rollback_s=rollback_s, **brief)
    made = ControlHarness(data, limits, listening, times)
    made.sessions.start()
    try:
        yield made
    finally:
        await made.sessions.close()


@asynccontextmanager
async def house_of(
    source: str, data: Path, *, is_read: bool = False, **options: Any
) -> AsyncIterator[tuple[ControlHarness, DeviceController]]:
    """A house with one device that streams.

    Args:
        is_read: its settings have been read.
        options: as of `house`.
    """
    async with house(data, **options) as here:
        desk = await here.add(source)
        if is_read:
            await here.read(desk)
        yield here, desk


def answers_from_now_on(desk: DeviceController) -> None:
    """Be patient with an MTi that was silent on purpose up to here."""
    assert isinstance(desk.driver, XbusDriver)
    desk.runner._patience = PATIENT
    desk.driver._times = replace(desk.driver._times, config_s=LATE.config_s)


async def over(task: RunningJob) -> Job:
    """The job when it is done."""
    await asyncio.wait_for(task.finished.wait(), PATIENCE_S)
    return task.job


@asynccontextmanager
async def bench(port: int = 0, *, measuring: bool = False, **faults: int) -> AsyncIterator[SimulatorThread]:
    """An MTi-630 on a pseudo-terminal that outlives the server's handle on it, connected to one of its host ports.

    Args:
        measuring: it streams at once; otherwise it starts for half a second first, during which a baud scan that
        begins with the right rate receives nothing there and tries all others.
    """
    baud = faults.pop("baud", 115_200)
    options = SimulatorOptions("xbus", faults=LineFaults(baud=baud, **faults))
    made = SimulatorThread(
        lambda start_ns: XbusSimulator(
            "MTi-630", start_ns=start_ns, rate=20, port=port, measuring=measuring, baud=baud
        ),
        options,
    )
    made.start()
    try:
        yield made
    finally:
        made.stop()


def outputs(rate: int, *identifiers: int) -> dict[str, object]:
    """An output configuration: time, and the given quantities at one rate."""
    accompanying = [{"data_identifier": one, "output_frequency": 0xFFFF} for one in (0x1020, 0x1060)]
    requests = [{"data_identifier": one, "output_frequency": rate} for one in identifiers or (0x2010, 0x4020)]
    return {"outputs": [*accompanying, *requests]}


def at_rate(values: dict[str, object], code: int) -> dict[str, object]:
    """A port configuration with another code for the rate of every port that has one."""
    words = values["words"]
    assert isinstance(words, list)
    return {"words": [(word & ~0xFF) | code if word else 0 for word in words]}
