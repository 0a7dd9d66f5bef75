"""The life of a device, with a link and a clock that the test moves."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imuscope.protocols.events import Batch, Event, RejectedFrame, Reply
from imuscope.server.devices.decode import protocol_detection
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.devices.device import device_state
from imuscope.server.devices.link.session import GIVE_UP_S, Session
from imuscope.server.devices.link.sessions import Sessions
from imuscope.server.links.base import LinkError, LinkSettings, Progress
from imuscope.server.streaming.telemetry import Telemetry
from tests.protocols.protocol_cases import SPEAKERS
from tests.server.devices.session_harness import SessionHarness, playing, started
from tests.support.each_row import each_row
from tests.support.fakes import SPEECH, FakeClock, FakeDecoder, FakeLink, sample


async def test_samples_arrive_with_both_times() -> None:
    async with playing() as stage:
        assert stage.info.status == "connecting"
        await stage.send(*(sample(k, 100 + k) for k in range(20)))
        assert stage.info.status == "live"
        arrival, time, force = stage.channel("Force").ring.read()
        assert force.tolist() == list(range(100, 120))
        assert arrival[1] - arrival[0] == pytest.approx(0.01, abs=1e-6)
        assert abs(time - arrival).max() < 0.005


async def test_a_gap_names_where_it_was_lost() -> None:
    async with playing() as stage:
        await stage.send(*(sample(k) for k in range(10)))
        await stage.send(sample(13), every=0.04)
        (gap,) = stage.events("gap")
        assert gap.samples == 3
        assert gap.t1 - gap.t0 == pytest.approx(0.04, abs=0.005)
        assert gap.data == {"counter": "Count", "by": "unknown"}
        assert gap.text == "3 samples lost (40 ms): the cause is unknown; nothing damaged was received."
        await stage.send(b"????" + sample(15))
        assert stage.events("gap")[-1].data["by"] == "wire"
        health = stage.session.health(stage.clock())
        assert (health.gaps, health.lost, health.rejects) == (2, 4, 4)


async def test_many_gaps_are_summed_up_and_lose_no_count() -> None:
    async with playing() as stage:
        await stage.send(*(sample(k) for k in range(0, 250, 2)), every=0.001)
        await stage.settle(1.2)
        gaps = stage.events("gap")
        assert len(gaps) <= 12
        assert sum(gap.samples for gap in gaps) == 124
        assert stage.session.health(stage.clock()).lost == 124


async def test_noise_cannot_flood_the_log() -> None:
    async with playing() as stage:
        for k in range(30):
            await stage.send(b"?" * 1000 + sample(k))
            await stage.settle(0.1)
        await stage.settle(1.1)
        rejects = stage.events("reject")
        assert 2 <= len(rejects) <= 6
        assert sum(event.samples for event in rejects) == 30_000
        assert stage.session.health(stage.clock()).rejects == 30_000
        assert rejects[0].text.endswith("bad checksum.")
        assert rejects[0].t0 <= rejects[0].t1


async def test_a_dead_link_shows_at_once_and_comes_back() -> None:
    async with playing() as stage:
        await stage.send(*(sample(k) for k in range(5)))
        stage.link.refuses = [LinkError("gone", "/dev/ttyFAKE is gone.", "Plug it in.")]
        stage.link.die(LinkError("gone", "/dev/ttyFAKE is gone.", "Plug it in."))
        await stage.settle()
        device = stage.telemetry.bus.devices.latest["1"]
        assert (device.status, device.message, device.hint) == ("lost", "/dev/ttyFAKE is gone.", "Plug it in.")
        assert device.next_attempt == pytest.approx(stage.clock() + 0.5)
        ids = {one.info.id for one in stage.telemetry.store.all}
        for _ in range(2):  # once refused, then open
            stage.session.retry()
            await stage.settle()
        await stage.send(*(sample(k) for k in range(5)))
        assert stage.info.status == "live"
        assert {one.info.id for one in stage.telemetry.store.all} == ids  # the same channels go on
        assert [event.data["kind"] for event in stage.events("link")] == ["live", "gone", "back"]
        (gap,) = stage.events("gap")  # so that the page hatches the missed range
        assert gap.data["by"] == "link"
        assert 0.0 < gap.t1 - gap.t0 < 1.0


async def test_a_local_port_is_opened_at_the_tick_after_its_return(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It waited for the next attempt, up to ten seconds later."""
    monkeypatch.setattr("imuscope.server.devices.link.session.LOCAL_S", (1e6, 1e6))
    port = tmp_path / "ttyFAKE"

    class LocalLink(FakeLink):
        local_path = str(port)

        async def open(self, progress: Progress | None = None) -> None:
            if not port.exists():
                raise LinkError("not-found", "There is no port.", "Plug it in.")
            await super().open(progress)

    async with started(SessionHarness(link=LocalLink)) as stage:
        for times in (1, 2):
            await stage.settle(1.0)
            assert stage.link.opened == times - 1
            port.touch()
            await stage.settle(0.1)
            await stage.settle()
            assert stage.link.opened == times
            port.unlink()
            stage.link.die(LinkError("gone", "/dev/ttyFAKE is gone.", "Plug it in."))
            await stage.settle()


async def test_retries_wait_longer_each_time(monkeypatch: pytest.MonkeyPatch) -> None:
    waits: list[float | None] = []

    async def pause(self: Session, seconds: float | None) -> None:
        waits.append(seconds)
        if len(waits) >= 8:
            await asyncio.Event().wait()

    monkeypatch.setattr(Session, "_pause", pause)

    async def test(stage: SessionHarness) -> None:
        assert waits == [0.5, 1, 2, 4, 8, 10, 10, 10]
        assert stage.info.status == "denied"
        (event,) = stage.events("link")  # reported once, not at every retry
        assert event.level == "error"
        assert len(stage.telemetry.bus.devices.latest["1"].attempts) <= device_state.MAX_ATTEMPTS

    stage = SessionHarness()
    stage.link.refuses = [LinkError("denied", "No permission.", "Join the group dialout.") for _ in range(20)]
    stage.session.start()
    await stage.settle()
    await test(stage)
    await stage.session.close()


async def test_a_frame_of_which_the_rest_is_late_is_a_good_frame() -> None:
    """It was dropped after a quarter of a second, and the wire was blamed for it."""
    async with playing() as stage:
        for count in range(5):
            await stage.send(sample(2 * count), sample(2 * count + 1)[:2])
            await stage.settle(0.6)
            await stage.send(sample(2 * count + 1)[2:])
        health = stage.session.health(stage.clock())
        assert (health.rejects, health.lost, stage.events("gap")) == (0, 0, [])
        assert stage.channel("Count").ring.total == 10


@each_row("family", ["xbus", "isb", "idtp"])
def test_halves_of_a_frame_of_any_family_may_come_half_a_second_apart(family: str) -> None:
    frames = [frame for frame in SPEAKERS[family].everything() if len(frame) > 6][:25]

    async def delivered(within: float, between: float) -> tuple[int, dict[str, int], int]:
        stage = SessionHarness(all_protocols(), DecodeOptions(family))
        stage.session.start()
        await stage.settle()
        for frame in frames:
            await stage.settle(between)
            await stage.send(frame[: len(frame) // 2])
            await stage.settle(within)
            await stage.send(frame[len(frame) // 2 :])
        await stage.settle()
        health = stage.session.health(stage.clock())
        rows = sum(one.ring.total for one in stage.telemetry.store.all)
        await stage.session.close()
        return health.rejects, {one.name: one.count for one in health.messages}, rows

    whole = asyncio.run(delivered(0.0, 0.5))
    assert sum(whole[1].values()) >= 10
    assert asyncio.run(delivered(0.5, 0.0)) == whole


async def test_an_incomplete_frame_is_given_up_when_no_link_could_still_bring_its_rest() -> None:
    async with playing() as stage:
        await stage.send(sample(0), b"F")
        await stage.settle(GIVE_UP_S - 1)
        assert stage.session.health(stage.clock()).rejects == 0
        await stage.settle(2)
        assert stage.session.health(stage.clock()).rejects == 1


async def test_messages_behind_a_beginning_that_is_none_are_not_kept_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    """They prove that it is none: here a beginning that claims eight bytes."""
    monkeypatch.setattr(FakeDecoder, "claims", {b"L": 8})

    async with playing() as stage:
        await stage.send(sample(0), b"L" + sample(1))
        assert stage.channel("Count").ring.total == 1
        await stage.settle(0.6)
        assert stage.channel("Count").ring.total == 2
        assert stage.session.health(stage.clock()).rejects == 1


async def test_an_ended_file_waits_for_a_retry() -> None:
    async with playing() as stage:
        await stage.send(sample(0), b"F")
        stage.link.die(LinkError("ended", "The file has finished.", "Retry plays it again."))
        await stage.settle()
        device = stage.telemetry.bus.devices.latest["1"]
        assert (device.status, device.next_attempt) == ("ended", None)
        assert stage.session.health(stage.clock()).rejects == 1  # incomplete data at the end are counted
        stage.session.retry()
        await stage.send(sample(0))
        assert stage.info.status == "live"
        assert stage.link.opened == 2


async def test_the_protocol_is_guessed_and_no_byte_is_lost_by_it() -> None:
    async with playing(protocol="") as stage:
        await stage.send(*(sample(k) for k in range(10)))
        assert stage.info.status == "connecting"
        stage.clock.move(protocol_detection.GUESS_S)
        await stage.send(sample(10))
        device = stage.telemetry.bus.devices.latest["1"]
        assert (device.status, device.protocol, device.name) == ("live", "fake", "Fake sensor")
        assert stage.channel("Count").ring.total == 11


async def test_a_silent_port_costs_nothing_and_is_live_with_its_first_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """While no bytes arrive, nothing is detected, decoded or reported repeatedly; when they do, there is no delay."""
    async with playing(protocol="") as stage:
        guessed: list[int] = []
        messages: list[object] = []
        guess = SPEECH.guess
        monkeypatch.setattr(
            stage.session._pipeline,
            "_protocols",
            replace(SPEECH, guess=lambda data: guessed.append(len(data)) or guess(data)),
        )
        await stage.settle(1.0)
        device = stage.telemetry.bus.devices.latest["1"]
        assert (device.status, device.protocol) == ("connecting", "")
        assert device.message.endswith("is open, 0 B so far.")
        monkeypatch.setattr(stage.telemetry.bus, "set_device", messages.append)
        monkeypatch.setattr(stage.session._scheduler, "request", lambda: messages.append("decode"))
        await stage.settle(60.0)
        assert (guessed, messages, stage.link.opened) == ([], [], 1)
        monkeypatch.undo()
        await stage.send(*(sample(k % 250) for k in range(protocol_detection.GUESS_BYTES // 4)), every=0.0005)
        assert stage.info.status == "live"
        assert stage.channel("Count").ring.total == protocol_detection.GUESS_BYTES // 4


async def test_unknown_bytes_are_described() -> None:
    async with playing(protocol="") as stage:
        for _ in range(40):
            await stage.send(b"hello world " * 100)
        device = stage.telemetry.bus.devices.latest["1"]
        assert device.status == "connecting"
        assert "do not match a known protocol" in device.message
        assert device.hint
        assert stage.session._pipeline.detector.size <= protocol_detection.UNKNOWN_BYTES + 1200


async def test_a_reply_identifies_the_device() -> None:
    async with playing() as stage:
        await stage.send(b"W", sample(0))
        device = stage.telemetry.bus.devices.latest["1"]
        assert (device.product, device.serial_number, device.name) == ("MTi-630", "03800001", "MTi-630")
        (reply,) = stage.events("reply")
        assert reply.data["values"]["product_code"] == "MTi-630"


async def test_a_clock_step_is_an_event() -> None:
    async with playing() as stage:
        await stage.send(sample(100), sample(101), sample(0), sample(1))
        (step,) = stage.events("clock")
        assert step.text == "The device's clock started again from zero."
        _, time, _ = stage.channel("Force").ring.read()
        assert step.time == time[2], "a page breaks its lines at the first sample after the step, not somewhere near"


@each_row("protocol", ["fake", ""])
async def test_a_restart_of_a_looped_file_is_reported_once_and_is_no_jump_or_loss(protocol: str) -> None:
    """Regression: each restart of the file was reported as a clock jump of -880 ms and as lost samples."""
    async with playing(protocol=protocol) as stage:
        for turn in range(3):
            for k in range(100, 140):
                stage.clock.move(0.01)
                stage.link.send(sample(k), restart=turn > 0 and k == 100)
            await stage.settle()
            await stage.settle(1.1)
        await stage.settle(1.1)
        report = stage.events("clock")
        assert [event.text for event in report] == ["ttyFAKE starts again."] * 2
        assert {event.level for event in report} == {"info"}
        _, time, force = stage.channel("Force").ring.read()
        assert len(force) == 120
        assert (np.diff(time) > 0).all()
        for turn, event in enumerate(report, 1):
            assert time[40 * turn - 1] < event.time < time[40 * turn], "a page breaks its lines between the turns"
        health = stage.session.health(stage.clock())
        assert (health.gaps, health.lost, stage.events("gap")) == (0, 0, [])


async def test_a_device_that_sends_only_sentences_is_live() -> None:
    """It stood as "connecting, no byte yet", beside a plot of its heading."""
    async with playing() as stage:
        await stage.send(b"$", b"$")
        assert stage.info.status == "live"
        (heading,) = [column for column in stage.channel("HCHDM").info.columns if column.name == "value"]
        assert (heading.unit, heading.period) == ("°", 360)


async def test_a_device_that_sends_only_sentences_is_named_after_them() -> None:
    """Any port with NMEA on it was called an Xsens MTi."""
    async with playing() as stage:
        await stage.send(b"$", b"$")
        assert stage.telemetry.bus.devices.latest["1"].name == "NMEA 0183 device"
        (link,) = stage.events("link")
        assert link.text == "NMEA 0183 device is sending."
        await stage.send(sample(0))  # it was one after all
        assert stage.telemetry.bus.devices.latest["1"].name == "Fake sensor"
        await stage.send(b"$", b"W")
        assert stage.telemetry.bus.devices.latest["1"].name == "MTi-630"
        await stage.send(b"$")
        assert stage.telemetry.bus.devices.latest["1"].name == "MTi-630"


async def test_a_broken_decoder_is_reported_and_replaced(caplog: pytest.LogCaptureFixture) -> None:
    async with playing() as stage:
        await stage.send(sample(0), b"!", sample(1))
        (fault,) = stage.events("device")
        assert fault.level == "error"
        await stage.send(sample(2))
        assert stage.channel("Count").ring.read()[2].tolist()[-1] == 2
    assert "a decoder that breaks" in caplog.text


async def test_health_is_of_the_last_second() -> None:
    async with playing() as stage:
        await stage.send(*(sample(k) for k in range(250)), every=0.005)
        health = stage.session.health(stage.clock())
        assert health.rate == pytest.approx(200, abs=5)
        assert health.bytes_per_s == pytest.approx(800, abs=20)
        assert (health.bytes, health.capacity) == (1000, 11_520.0)
        assert [(message.name, message.count) for message in health.messages] == [("Sample", 250)]
        stage.clock.move(2.0)
        health = stage.session.health(stage.clock())
        assert (health.rate, health.bytes_per_s) == (0, 0)


async def test_a_step_of_the_wall_clock_is_an_event_and_moves_no_sample() -> None:
    clock = FakeClock()
    telemetry = Telemetry.create(clock)
    wall = [clock.ns]
    settings = LinkSettings(now_ns=clock.now_ns)
    sessions = Sessions(telemetry.bus, FakeLink, SPEECH, settings, wall_ns=lambda: wall[0])
    sessions.tick()
    wall[0] += 3_600_000_000_000
    sessions.tick()
    sessions.tick()
    (event,) = telemetry.log
    assert event.text.startswith("This host's clock was set ahead by 3 600 s")
    assert telemetry.bus.now() == clock()
    await sessions.close()


async def test_one_source_is_opened_once() -> None:
    clock = FakeClock()
    sessions = Sessions(Telemetry.create(clock).bus, FakeLink, SPEECH, LinkSettings(now_ns=clock.now_ns))
    first = sessions.add("/dev/ttyFAKE", DecodeOptions("fake"))
    with pytest.raises(LinkError, match="already open"):
        sessions.add("/dev/ttyFAKE")
    await sessions.remove(first.info.id)
    assert sessions.add("/dev/ttyFAKE", DecodeOptions("fake")).info.id == "2"  # ids are never used again
    await sessions.close()


async def test_received_and_sent_bytes_reach_listeners() -> None:
    """On these three hooks stand device commands and recordings: each chunk once, each event once, both directions."""
    async with playing() as stage:
        chunks: list[tuple[bytes, int, str]] = []
        events: list[Event] = []
        sent: list[tuple[bytes, int]] = []
        session, link = stage.session, stage.link
        offs = [
            session.listeners.chunks(lambda came, way: chunks.extend((one.data, one.arrival_ns, way) for one in came)),
            session.listeners.listen(events.append),
            session.listeners.sent.add(lambda data, time: sent.append((data, time))),
        ]
        await stage.send(sample(0), sample(1) + b"?", b"W")
        link.listens = True
        await session.access.send(b"hello")
        assert [(data, direction) for data, _, direction in chunks] == [
            *((sample(0), "rx"), (sample(1) + b"?", "rx"), (b"W", "rx"), (b"hello", "tx"))
        ]
        times = [time for _, time, _ in chunks]
        assert times == sorted(times)
        assert times[-1] == stage.clock.ns
        assert sent == [(b"hello", stage.clock.ns)]
        assert link.sent == [b"hello"]
        assert [type(event) for event in events] == [Batch, Batch, RejectedFrame, Reply]
        link.listens = False
        with pytest.raises(LinkError):
            await session.access.send(b"lost")
        assert len(sent) == 1, "what was not sent is not told"
        link.die(LinkError("gone", "gone"))
        await stage.settle()
        session.retry()
        await stage.send(sample(2))
        assert isinstance(events[-1], Batch), "it goes on over a reconnection"
        for off in offs:
            off()
            off()
        await stage.send(sample(3))
        assert (len(chunks), len(events)) == (5, 5)


async def test_a_failing_listener_does_not_affect_others(caplog: pytest.LogCaptureFixture) -> None:
    async with playing() as stage:
        received: list[object] = []

        def broken(*news: object) -> None:
            raise RuntimeError("a listener that breaks")

        stage.session.listeners.listen(broken)
        stage.session.listeners.chunks(broken)
        stage.session.listeners.listen(received.append)
        await stage.send(sample(0), sample(1))
        assert len(received) == 2
        assert stage.info.status == "live"
        assert stage.events("device") == []
    assert caplog.text.count("RuntimeError: a listener that breaks") == 4  # two listeners, for each of two chunks


async def test_concurrent_senders_do_not_mix_their_bytes() -> None:
    async with playing() as stage:

        async def slow(data: bytes) -> None:
            for byte in data:
                await asyncio.sleep(0)
                stage.link.sent.append(bytes([byte]))

        stage.link.write = slow  # type: ignore[method-assign]
        await asyncio.gather(stage.session.access.send(b"aaaa"), stage.session.access.send(b"bbbb"))
        assert b"".join(stage.link.sent) == b"aaaabbbb"
