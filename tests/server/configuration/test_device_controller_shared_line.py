"""Two MTi on one line, each read and changed separately under its bus identifier, behind a real port."""

import asyncio
import itertools
import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imuscope.protocols.commands.transactions import DeviceContext, NoReplyError
from imuscope.protocols.events import Batch, ClockStep, Event, RejectedFrame, Reply, SampleGap
from imuscope.protocols.xbus.decoder import XbusDecoder
from imuscope.protocols.xbus.driver import XbusDriver
from imuscope.protocols.xbus.frames import build
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.recordings.mcap.reader import McapReader
from imuscope.recordings.mcap.source import McapSource
from imuscope.recordings.mcap.writer import McapWriter
from imuscope.server.cli import main
from imuscope.server.configuration.budget import overload
from imuscope.server.configuration.change_plan import SHARED, plan_changes
from imuscope.server.configuration.device_controller import DeviceController
from imuscope.server.configuration.preview import fit, preview_setting
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.errors import DomainError
from imuscope.server.library.decode import decode
from imuscope.server.library.recorder import Recorder, RecordingOptions
from imuscope.server.links.base import LinkError
from imuscope.server.links.simulated_device import SharedLine, SimulatorOptions, make_device
from imuscope.server.links.source_url import SourceUrl, open_link
from tests.recordings.mcap_files import json_messages
from tests.server.configuration.shared_line import SOURCE, both
from tests.support.control_harness import house, outputs, over
from tests.support.each_row import each_row
from tests.support.transaction_player import PlayedWire, play
from tests.support.waiting import until

DRIVER = XbusDriver()


async def test_each_device_of_a_line_is_read_and_changed_by_itself(tmp_path: Path) -> None:
    """Regression: everything was sent to identifier 255, and requests for the second device went to the first."""
    async with house(tmp_path) as here:
        desks = await both(here)
        sent: list[bytes] = []
        desks[0].member.listeners.sent.add(lambda data, time: sent.append(data))
        assert {int(desk.context.device) for desk in desks} == {1, 2}
        for place, desk in enumerate(desks):
            job = await here.read(desk)
            assert job.state == "done", job.message
            job = await here.apply(desk, {"LocationID": {"location_id": 40 + place}})
            assert job.state == "done", job.message
        assert {data[1] for data in sent} == {1, 2}
        serials = {desk.member.info.serial_number for desk in desks}
        assert len(serials) == 2
        assert "" not in serials
        for place, desk in enumerate(desks):
            await here.read(desk)
            assert desk.values["LocationID"] == {"location_id": 40 + place}
            names = {entry.name for entry in desk.log.tail()}
            assert {"ReqDID", "DeviceID"} <= names
            assert all(
                bytes.fromhex(entry.hex[2:4])[0] == int(desk.context.device) for entry in desk.log.tail() if entry.hex
            )


async def test_two_jobs_on_one_line_take_turns(tmp_path: Path) -> None:
    async with house(tmp_path) as here:
        desks = await both(here)
        sent: list[int] = []
        desks[0].member.listeners.sent.add(lambda data, time: sent.append(data[1]))
        tasks = [desk.add("Read", partial(here.desks.jobs.read, names=None, reason="")) for desk in desks]
        jobs = [await over(task) for task in tasks]
        assert [job.state for job in jobs] == ["done", "done"]
        assert [bid for bid, _ in itertools.groupby(sent)] == [int(desk.context.device) for desk in desks]


async def test_a_device_that_is_configured_is_not_called_silent_for_it(tmp_path: Path) -> None:
    async with house(tmp_path) as here:
        desks = await both(here)
        texts: list[str] = []
        here.telemetry.bus.events.subscribe(lambda event: texts.append(f"{event.kind} {event.text}"))

        async def wait(task: Any) -> None:
            await asyncio.sleep(0)
            line = desks[0].member.link_session
            now = here.telemetry.bus.now()
            for tick in range(100):
                line.tick(now + 0.2 * tick)

        for desk in desks:
            await over(desk.add("Wait", wait))
            others = [one for one in desks if one is not desk]
            assert desk.member.info.status == "live"
            assert all(one.member.info.status == "lost" for one in others)
            await until(lambda: all(one.member.info.status == "live" for one in desks), "both are back")


def test_a_device_keeps_its_identity_after_an_outage_in_any_order(tmp_path: Path) -> None:
    """Regression: the first device received after each connection became the line's own; two devices swapped places and
    settings.
    """

    def data(bid: int, number: int) -> bytes:
        return build(0x36, bytes.fromhex(f"102002{number:04x}106004{100 * number:08x}"), bid)

    before, after = XbusDecoder(), XbusDecoder()
    after.addresses = before.addresses
    before.feed(b"".join(data(1, k) + data(2, 4 + k) for k in range(4)), 0)
    before.drain()
    assert before.addresses == {"": 1, "2": 2}
    after.feed(build(0x31, b"", 2) + data(2, 8) + data(1, 2) + build(0x31, b"", 1) + build(0x31, b"", 0xFF), 0)
    events = after.drain()
    assert not [event for event in events if isinstance(event, SampleGap | ClockStep | RejectedFrame)]
    assert [event.device for event in events if isinstance(event, Batch)] in (["2", ""], ["", "2"])
    assert [event.device for event in events if isinstance(event, Reply)] == ["2", "", ""]


@each_row("noise", [b"", build(0x3E, b"", 0xE0), build(0x36, bytes.fromhex("1020020001"), 0xE0)])
def test_noise_does_not_displace_a_device(noise: bytes) -> None:
    """Regression: a frame that was valid by chance at a wrong rate became the line's own device across connections, and
    the answers of the real one were ignored.
    """
    first, second = XbusDecoder(), XbusDecoder()
    first.feed(noise, 0)
    first.drain()
    second.addresses = first.addresses
    device = XbusSimulator(measuring=True)
    for decoder in (first, second):
        decoder.feed(device.advance(1_000_000_000) + build(0x31), 0)
        events = decoder.drain()
        assert {event.device for event in events if isinstance(event, Batch | Reply)} == {""}
        device = XbusSimulator(measuring=True)
    assert first.addresses == {"": 0xFF}


def test_wake_up_messages_belong_to_their_device() -> None:
    """Regression: the identity of the second device was used for the first, as neither had sent data yet."""
    decoder, line = XbusDecoder(), [XbusSimulator(seed=bid, bid=bid) for bid in (3, 4)]
    events: list[Event] = []
    for now in range(0, 1_200_000_000, 10_000_000):
        decoder.feed(b"".join(device.advance(now) for device in line), now)
        events += decoder.drain()
    replies = [(event.message.name, event.device) for event in events if isinstance(event, Reply)]
    assert replies == [("WakeUp", ""), ("WakeUp", "4"), ("Configuration", ""), ("Configuration", "4")]
    assert {event.device for event in events if isinstance(event, Batch)} == {"", "4"}


def test_a_fix_of_one_device_does_not_affect_another() -> None:
    """A receiver without a fix, beside one with: the time of its messages is arbitrary, and was taken for true."""

    def pvt(bid: int, fix: int, tick: int) -> bytes:
        item = bytearray(94)
        item[20] = fix
        return build(0x36, bytes.fromhex(f"106004{tick:08x}") + b"\x70\x10\x5e" + bytes(item), bid)

    def data(bid: int, tick: int) -> bytes:
        return build(0x36, bytes.fromhex(f"106004{tick:08x}0804020000"), bid)

    def velocity(bid: int, tick: int) -> bytes:  # a message of GNSS items without a fix status
        return build(0x36, bytes.fromhex(f"106004{tick:08x}702004") + bytes(4), bid)

    decoder = XbusDecoder()
    events: list[Event] = []
    for frame in (data(1, 1000), data(2, 1000), pvt(2, 0, 0), pvt(1, 3, 1001), velocity(2, 0), data(2, 1100)):
        decoder.feed(frame, 0)
        events += decoder.drain()
    assert not [event for event in events if isinstance(event, ClockStep)]


def test_the_frames_of_a_device_that_shares_its_line_name_it() -> None:
    for bid in (2, 254):
        known = DeviceContext("MTi-630", device=str(bid))
        frame = DRIVER.frame("SetLocationID", {"location_id": 5}, known)
        (same,) = DRIVER.setting_frames("LocationID", {"location_id": 5}, known)
        assert frame == same == build(0x84, b"\0\5", bid)
    assert DRIVER.frame("ReqDID", {}, DeviceContext("MTi-630")) == build(0x00)


def test_a_device_under_its_identifier_accepts_nothing_else() -> None:
    wire = PlayedWire(XbusSimulator(bid=7, measuring=True), "xbus")
    with pytest.raises(NoReplyError):
        play(DRIVER.within(DRIVER.read("LocationID", DeviceContext()), DeviceContext()), wire)
    known = DeviceContext(device="7")
    assert play(DRIVER.within(DRIVER.read("LocationID", known), known), wire) == {"location_id": 0}
    report = play(DRIVER.identify(known), wire)
    assert (report.product, report.device) == ("MTi-630-8A1G6", "7")
    wire.sent.clear()
    play(DRIVER.store_and_restart(known), wire)
    assert play(DRIVER.is_alive(known), wire)
    wire.pass_time(1.0)
    play(DRIVER.within(DRIVER.run("ResetOrientation.Stored", {"code": 4}, known), known), wire)
    assert {send.frame[1] for send in wire.sent} <= {7}


@each_row("ids", ["0", "255", "1,1", "1,2,3,4,5", "a", "1,,2", ""])
def test_invalid_identifiers_are_refused(ids: str) -> None:
    with pytest.raises(LinkError, match="bus_ids"):
        open_link(f"sim:xbus?bus_ids={ids}&rate=20")


def test_every_device_of_a_simulated_line_has_its_own_counter() -> None:
    line = make_device(SimulatorOptions.of(SourceUrl.parse(SOURCE)), 0)
    assert isinstance(line, SharedLine)
    decoder = XbusDecoder()
    events: list[Event] = []
    for now in range(0, 3_000_000_000, 10_000_000):
        decoder.feed(line.advance(now), now)
        events += decoder.drain()
    assert not [event for event in events if isinstance(event, SampleGap | ClockStep | RejectedFrame)]
    for device in ("", "2"):
        numbers = [
            batch.columns["PacketCounter"] for batch in events if isinstance(batch, Batch) and batch.device == device
        ]
        assert set(np.diff(np.concatenate(numbers).astype(np.int64))) == {1}


def test_a_script_names_one_device_of_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["send", SOURCE, "ReqDID"]) == 1
    assert "the line is shared by the bus identifiers 1, 2; choose one with --device" in capsys.readouterr().err
    messages = []
    for device in ("1", "2"):
        assert main(["send", SOURCE, "ReqDID", "--device", device]) == 0
        messages.append(json.loads(capsys.readouterr().out)["fields"]["device_id"])
    assert len(set(messages)) == 2


@each_row("device", ["0", "256", "x"])
def test_an_invalid_bus_identifier_is_refused(device: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["send", SOURCE, "ReqDID", "--device", device])
    assert "is not a bus identifier; give a number from 1 to 255" in capsys.readouterr().err


async def test_another_rate_on_a_shared_line_needs_confirmation(tmp_path: Path) -> None:
    """The link follows the changed device and no longer receives the others."""
    async with house(tmp_path) as here:
        for desk in await both(here):
            await here.read(desk)
            words = [word & ~0xFF | 0x80 for word in desk.values["PortConfig"]["words"][:2]]
            wish = plan_changes(desk, {"PortConfig": {"words": [*words, 0]}})
            assert SHARED in [danger.consequence for danger in wish.risks]


def uart_at_921600(desk: DeviceController) -> dict[str, dict[str, object]]:
    host, uart, gnss = desk.values["PortConfig"]["words"]
    return {"PortConfig": {"words": [host, uart & ~0xFF | 0x80, gnss]}}


@each_row("keep", [False, True])
async def test_the_rate_of_a_further_device_is_rolled_back_unless_confirmed(keep: bool, tmp_path: Path) -> None:
    """Regression: at its new rate the others are noise without a recognised protocol; its answers were ignored, and it
    was lost at an unknown rate.
    """
    async with house(tmp_path, rollback_s=60.0) as here:
        first, desk = await both(here, f"{SOURCE}&port=uart")
        await here.read(desk)
        task = desk.add("Ports", partial(here.desks.jobs.apply, changes=uart_at_921600(desk), reason=""))
        await until(lambda: desk.pending_rollback is not None or task.finished.is_set(), "it begins")
        await until(
            lambda: (desk.pending_rollback and desk.pending_rollback.state == "pending") or task.finished.is_set(),
            "it asks",
        )
        assert not task.finished.is_set(), task.job.message
        assert {one.member.access.baud for one in (first, desk)} == {921_600}
        (record,) = here.desks.rollbacks.all()
        assert (record.device, record.address) == (desk.context.device, int(desk.context.device))
        desk.decide(keep=keep)
        job = await over(task)
        assert job.state == ("done" if keep else "failed"), job.message
        assert desk.pending_rollback is not None
        assert desk.pending_rollback.state == ("confirmed" if keep else "rolled-back")
        assert {one.member.access.baud for one in (first, desk)} == {921_600 if keep else 115_200}
        await until(lambda: desk.member.info.status == "live", "it is heard again")
        if keep:
            await until(lambda: first.member.info.status == "lost", "the other speaks at another rate")
            assert "others on its link continue" in first.member.info.message
        else:
            await until(lambda: first.member.info.status == "live", "the other is heard again")
            assert (await here.read(first)).state == "done"


async def test_the_budget_of_a_line_counts_all_of_its_devices(tmp_path: Path) -> None:
    """Regression: each device was granted the full capacity of the line."""
    async with house(tmp_path) as here:
        desks = await both(here)
        for desk in desks:
            await here.read(desk)
        first, further = desks
        wish = outputs(100, 0x2010, 0x4020, 0x8020)
        assert not overload(first.present, {"OutputConfiguration": wish})
        job = await here.apply(further, {"OutputConfiguration": wish})
        assert job.state == "done", job.message
        words = {"OutputConfiguration": wish}
        assert "of the link (115 200 Bd)" in overload(first.present, words)
        with pytest.raises(DomainError, match="of the link"):
            plan_changes(first, words)
        load = preview_setting(first.present, "OutputConfiguration", wish).load
        assert load is not None
        assert load.parts[-1].title == further.member.info.name
        assert load.total == pytest.approx(sum(part.bytes_per_s for part in load.parts))
        fitting = fit(first.present, "OutputConfiguration", wish, None)
        assert not overload(first.present, {"OutputConfiguration": fitting.values})


async def test_a_recording_holds_the_settings_of_every_device_of_a_line(tmp_path: Path) -> None:
    async with house(tmp_path / "data") as here:
        desks = await both(here)
        await here.read(desks[0])
        tape = Recorder(
            here.telemetry.bus,
            here.sessions,
            here.desks,
            RecordingOptions(tmp_path / "recordings", request_header=False),
            None,
        )
        state = await tape.start()
        await here.read(desks[1])
        await tape.stop()
        with McapReader(tmp_path / "recordings" / f"{state.id}.mcap") as recording:
            for desk in desks:
                _, body = list(json_messages(recording, f"snapshot/{desk.device}"))[-1]
                assert body["serial_number"] == desk.context.serial_number
                assert body["address"] == int(desk.context.device)


def test_recorded_settings_are_of_the_device_with_their_address(tmp_path: Path) -> None:
    """The first device in a file may differ from the first live one, and must not get its settings."""
    path = tmp_path / "a.mcap"
    writer = McapWriter(path, {})
    writer.device("1", {"protocol": "xbus", "source": "/dev/ttyUSB0"})
    for bid in (1, 2):
        body = {"values": {"LocationID": {"location_id": bid}}, "address": bid}
        writer.snapshot("1" if bid == 1 else "1.2", body, 1)
    for k in range(8):
        for bid in (2, 1):
            frame = build(0x36, bytes.fromhex(f"102002{k:04x}106004{100 * k:08x}"), bid)
            writer.chunk("1", "rx", frame, 1_760_000_000_000_000_000 + k * 10_000_000)
    writer.close()
    store = decode(McapSource(path), tmp_path / "store", all_protocols())
    details = {
        device: body["values"]["LocationID"]["location_id"] for device, body in store.manifest["snapshots"].items()
    }
    assert details == {"1": 2, "1.1": 1}
