"""Commands to a real simulator behind a real pseudo-terminal: one at a time, seen by everybody; it measures
afterwards.
"""

import asyncio
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from imuscope.protocols.commands.transactions import DeviceContext, ReopenLink, Send, Sleep, WaitFor, cancel
from imuscope.protocols.events import Event
from imuscope.protocols.xbus.driver import XbusDriver
from imuscope.server.configuration.change_plan import plan_changes
from imuscope.server.configuration.device_controller import MAX_WAITING, ControlError, DeviceController
from imuscope.server.configuration.transaction_runner import Runner
from imuscope.server.links.base import LinkError
from imuscope.server.wire import TrafficEntry
from tests.support.control_harness import bench, house, house_of, outputs, over
from tests.support.waiting import until

GO_TO_MEASUREMENT = "faff1000f1"


def sent(desk: DeviceController) -> list[TrafficEntry]:
    return [entry for entry in desk.log.tail(limit=2000) if entry.direction == "tx"]


async def test_a_rate_is_changed_and_measured(tmp_path: Path) -> None:
    async with house_of("sim:xbus?rate=100&baud=921600", tmp_path) as (here, desk):
        job = await here.apply(desk, {"OutputConfiguration": outputs(400)})
        assert (job.state, job.outcomes) == ("done", [])

        def rate() -> float:
            return desk.member.link_session.health(here.telemetry.bus.now()).rate

        await until(lambda: 380 < rate() < 420, "400 samples/s")
        assert desk.values["OutputConfiguration"] == outputs(400)
        assert desk.member.info.status == "live"


async def test_values_rounded_by_the_device_are_reported_per_field(tmp_path: Path) -> None:
    async with house_of("sim:xbus?rate=20", tmp_path) as (here, desk):
        job = await here.apply(desk, {"OutputConfiguration": outputs(130, 0x2010)})
        assert job.state == "done"
        assert [(one.path, one.requested, one.actual) for one in job.outcomes] == [
            ("outputs.2.output_frequency", "130 Hz", "100 Hz")
        ]


async def test_an_expected_refusal_is_not_a_warning(tmp_path: Path) -> None:
    """ReqDID to a measuring MTi was a yellow Error in the traffic log and in the events, at every read."""
    async with house_of("sim:xbus?rate=20", tmp_path, is_read=True) as (here, desk):
        answers = [entry for entry in desk.log.tail(limit=2000) if entry.name == "Error"]
        events = [one for one in here.telemetry.bus.events_since(0) if (one.data or {}).get("message") == "Error"]
        assert {one.level for one in [*answers, *events]} == {"info"}
        assert answers
        assert events
        desk.add("Send", partial(here.desks.jobs.raw, data=bytes.fromhex("faff1200ef")))  # ReqFWRev
        await until(
            lambda: [entry.name for entry in desk.log.tail() if entry.level == "warning"] == ["Error"],
            "a warning for the bytes of a user",
        )


async def test_unchanged_values_are_not_written(tmp_path: Path) -> None:
    async with house_of("sim:xbus?rate=20", tmp_path) as (here, desk):
        await here.apply(desk, {"LocationID": {"location_id": 7}})
        job = await here.apply(desk, {"LocationID": {"location_id": 7}})
        assert "Nothing to change" in job.message
        assert [entry.name for entry in sent(desk)].count("SetLocationID") == 1


async def test_two_users_send_commands_in_turn(tmp_path: Path) -> None:
    """Their exchanges never mix: between GoToConfig and GoToMeasurement there is one job's."""
    async with house_of("sim:xbus?rate=20", tmp_path) as (here, desk):
        first = desk.add("first", partial(here.desks.jobs.apply, changes={"LocationID": {"location_id": 1}}, reason=""))
        second = desk.add(
            "second", partial(here.desks.jobs.apply, changes={"LocationID": {"location_id": 2}}, reason="")
        )
        assert [job.title for job in desk.job_report.queue] == ["first", "second"]
        await until(lambda: desk.job_report.running is not None, "the first runs")
        running = desk.job_report.running
        assert running is not None
        assert running.title == "first"
        assert here.telemetry.bus.jobs.latest[desk.device].queue[0].title == "second"  # as sent to browsers
        jobs = [await over(first), await over(second)]
        assert [job.state for job in jobs] == ["done", "done"]
        ended = jobs[0].ended
        assert ended is not None
        assert jobs[1].started is not None
        assert jobs[1].started >= ended
        assert desk.values["LocationID"] == {"location_id": 2}


async def test_a_job_that_is_stopped_leaves_the_device_measuring(tmp_path: Path) -> None:
    async with house_of("sim:xbus?baud=9600&rate=5", tmp_path) as (here, desk):
        task = desk.add("Read", partial(here.desks.jobs.read, names=None, reason=""))
        await until(lambda: desk.state == "Config", "the device is in Config")
        await desk.drop(task.job.id)
        assert task.job.state == "stopped"
        assert sent(desk)[-1].hex == GO_TO_MEASUREMENT
        await until(lambda: desk.state == "Measurement", "it measures again")
        job = await here.read(desk)  # the queue continues
        assert job.state == "done"


def test_a_job_that_is_stopped_on_its_way_to_config_leaves_the_device_measuring() -> None:
    """Regression: the device had received GoToConfig, the host not yet its answer, and GoToMeasurement was not sent."""
    driver = XbusDriver()
    dialogue = driver.within(driver.read("LocationID", DeviceContext()), DeviceContext())
    act = next(dialogue)
    while not (isinstance(act, Send) and act.what == "GoToConfig"):
        act = dialogue.send(None)
    assert [act.frame.hex() for act in cancel(dialogue)] == [GO_TO_MEASUREMENT]


async def test_a_server_that_ends_leaves_the_device_measuring(tmp_path: Path) -> None:
    desk: DeviceController
    async with house_of("sim:xbus?baud=9600&rate=5", tmp_path) as (here, desk):
        desk.add("Read", partial(here.desks.jobs.read, names=None, reason=""))
        await until(lambda: desk.state == "Config", "the device is in Config")
    assert sent(desk)[-1].hex == GO_TO_MEASUREMENT


async def test_a_waiting_job_is_cancelled_and_an_unknown_one_reported(tmp_path: Path) -> None:
    async with house_of("sim:xbus?rate=20", tmp_path) as (here, desk):
        tasks = [desk.add(str(n), partial(here.desks.jobs.read, names=["LocationID"], reason="")) for n in range(3)]
        await desk.drop(tasks[2].job.id)
        assert tasks[2].job.state == "stopped"
        with pytest.raises(ControlError, match="Job 99 is not queued"):
            await desk.drop(99)
        await over(tasks[1])


async def test_a_full_queue_is_reported(tmp_path: Path) -> None:
    async with house_of("sim:xbus?rate=20", tmp_path) as (here, desk):
        work = partial(here.desks.jobs.read, names=["LocationID"], reason="")
        for _ in range(MAX_WAITING):
            desk.add("Read", work)
        with pytest.raises(ControlError, match="is full"):
            desk.add("Read", work)


async def test_silence_while_configuring_is_not_called_lost(tmp_path: Path) -> None:
    """Regression: a device that does not measure because it is being configured was shown as lost."""
    async with house_of("sim:xbus?baud=9600&rate=20", tmp_path) as (here, desk):
        visited: set[str] = set()
        task = desk.add("Read", partial(here.desks.jobs.read, names=None, reason=""))
        while not task.finished.is_set():
            visited.add(desk.member.info.status)
            await asyncio.sleep(0.02)
        assert visited == {"live"}


async def test_the_exchange_is_logged_in_both_directions(tmp_path: Path) -> None:
    async with house_of("sim:xbus?rate=20", tmp_path) as (here, desk):
        await here.apply(desk, {"LocationID": {"location_id": 3}})
        entries = desk.log.tail(limit=500)
        at = next(place for place, one in enumerate(entries) if one.name == "SetLocationID")
        request, answered = entries[at], entries[at + 1]
        assert (request.direction, request.hex, request.text) == ("tx", "faff8402000378", "location_id 3")
        assert (answered.direction, answered.name) == ("rx", "SetLocationIDAck")
        assert answered.hex.startswith("faff85")
        assert answered.ms is not None
        assert 0 <= answered.ms < 500
        assert [one.seq for one in entries] == sorted(one.seq for one in entries)
        messages = [event for event in here.telemetry.log if event.kind == "command"]
        assert "SetLocationID" in [event.data["message"] for event in messages]


async def test_a_device_that_only_sends_samples_is_measuring(tmp_path: Path) -> None:
    async with bench(measuring=True) as there, house(tmp_path) as here:
        desk = await here.add(f"serial://{there.slave}?baud=115200")
        await until(lambda: desk.state == "Measurement", "its state is known without a reply")


async def test_a_stubborn_device_is_not_reset_by_a_read(tmp_path: Path) -> None:
    async with house_of("sim:xbus?stubborn=1&rate=20", tmp_path) as (here, desk):
        job = await here.read(desk)
        assert job.state == "failed"
        assert "run the command Reset if that is what you want" in job.message
        assert "Reset" not in [entry.name for entry in sent(desk)]


# ── the runner alone ─────────────────────────────────────────────────────────────────────────────────────────────────


class ControlWire:
    """A channel that the test holds."""

    def __init__(self) -> None:
        self.sent: list[bytes] = []
        self.linked: list[int | None] = []
        self.refuses = self.is_busy = False
        self.written_ns: int | None = None
        self._receive: Any = None

    async def send(self, data: bytes) -> int | None:
        self.sent.append(data)
        if self.is_busy:
            raise LinkError("busy", "The client a driver is configuring the device.")
        return self.written_ns

    async def reopen(self, baud: int | None) -> None:
        if self.refuses:
            raise LinkError("refused", "No such rate.")
        self.linked.append(baud)

    def listen(self, callback: Any) -> Any:
        self._receive = callback
        return lambda: None

    def decode(self) -> None:
        return

    def deliver(self, word: Any) -> None:
        self._receive(word)


class Ear:
    """Recorded log entries."""

    def __init__(self) -> None:
        self.notes: list[str] = []
        self.written: list[tuple[bytes, int | None]] = []

    def sent(self, frame: bytes, what: str, written_ns: int | None) -> None:
        self.written.append((frame, written_ns))

    def matched(self, event: Event, *, may_refuse: bool = False) -> None: ...

    def add_note(self, text: str, *, error: bool = False) -> None:
        self.notes.append(text)


async def test_an_answer_that_comes_before_it_is_waited_for_is_not_lost() -> None:
    wire = ControlWire()

    def request() -> Any:
        yield Send(b"?")
        wire.deliver("answer")
        return (yield WaitFor(lambda event: event, 1))

    assert await Runner(wire, Ear()).run(request()) == "answer"


async def test_a_request_is_logged_when_it_is_written_and_not_if_it_is_refused() -> None:
    """It was logged before it waited for another program, also when it never reached the device."""
    wire, ear = ControlWire(), Ear()

    def request() -> Any:
        yield Send(b"?")

    wire.written_ns = 42
    await Runner(wire, ear).run(request())
    wire.is_busy = True
    with pytest.raises(LinkError):
        await Runner(wire, ear).run(request())
    assert ear.written == [(b"?", 42)]
    assert ear.notes == ["A request was not sent: The client a driver is configuring the device."]


async def test_a_late_answer_is_not_taken_for_that_of_the_next_request() -> None:
    wire = ControlWire()

    def request() -> Any:
        yield Send(b"1")
        yield Sleep(0)
        wire.deliver("late")
        yield Send(b"2")
        return (yield WaitFor(lambda event: event, 0.01))

    assert await Runner(wire, Ear()).run(request()) is None


async def test_an_unavailable_rate_is_reported_and_logged() -> None:
    wire, ear = ControlWire(), Ear()
    wire.refuses = True

    def request() -> Any:
        return (yield ReopenLink(921_600))

    assert await Runner(wire, ear).run(request()) is False
    assert ear.notes == ["The link could not be opened at 921 600 Bd: No such rate."]


async def test_a_cancelled_runner_sends_its_final_messages() -> None:
    wire = ControlWire()

    def request() -> Any:
        try:
            yield WaitFor(lambda event: None, 60)
        finally:
            yield Send(b"measure")

    task = asyncio.create_task(Runner(wire, Ear()).run(request()))
    await asyncio.sleep(0.01)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    assert task.cancelled()
    assert wire.sent == [b"measure"]


# ── the other families ───────────────────────────────────────────────────────────────────────────────────────────────


async def test_a_single_field_of_an_inertial_sense_device_is_written_alone(tmp_path: Path) -> None:
    """Only the bytes of this field are sent, so that no other value can be set back."""
    async with house_of("sim:isb?rate=20", tmp_path, is_read=True) as (here, desk):
        before = dict(desk.values["DID_FLASH_CONFIG"])
        job = await here.apply(desk, {"DID_FLASH_CONFIG": {"gnssCn0Minimum": 21, "dynamicModel": 8}})
        assert (job.state, job.outcomes) == ("done", [])
        now = dict(desk.values["DID_FLASH_CONFIG"])
        messages = ("checksum", "key")
        changed = {name for name in now if now[name] != before[name] and name not in messages}
        assert changed == {"gnssCn0Minimum", "dynamicModel"}
        frames = [bytes.fromhex(entry.hex) for entry in sent(desk) if entry.name.startswith("SET_DID_FLASH_CONFIG")]
        assert frames
        assert all(len(frame) < 20 for frame in frames)
        pause = "imuscope had restarted the device (“Write”)."
        await until(lambda: any(pause in event.text for event in here.telemetry.log), "the pause is told")


async def test_a_value_that_changes_beside_the_written_one_is_reported_before_and_after(tmp_path: Path) -> None:
    """A navigation period of 5 ms made the sampling period 5 ms, too, without a word."""
    async with house_of("sim:isb?rate=100", tmp_path, is_read=True) as (here, desk):
        changes = {"DID_FLASH_CONFIG": {"startupNavDtMs": 5}}
        messages = [risk.consequence for risk in plan_changes(desk, changes).risks]
        assert any("sampling period of 10 ms" in text and "shortens it to 5 ms" in text for text in messages)
        job = await here.apply(desk, changes)
        assert (job.state, job.outcomes) == ("done", [])
        also = job.message.partition("Also changed: ")[2]
        assert "10 ms → 5 ms" in also
        job = await here.apply(desk, {"DID_FLASH_CONFIG": {"gnssCn0Minimum": 21}})
        assert "Also changed" not in job.message


async def test_an_idtp_device_takes_a_frame_and_has_no_settings(tmp_path: Path) -> None:
    async with house_of("sim:idtp?rate=20", tmp_path) as (here, desk):
        assert desk.rows == {}
        job = await over(desk.add("Send", partial(here.desks.jobs.raw, data=b"\x00\x01")))
        assert job.state == "done"
