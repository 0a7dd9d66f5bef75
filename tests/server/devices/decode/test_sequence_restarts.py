"""Secure devices over lost connections and new starts of the server, and the unit of timestamps."""

import asyncio
import json
import socket
import stat
from collections.abc import Iterator
from contextlib import AbstractAsyncContextManager
from pathlib import Path

import pytest

from imuscope.protocols.idtp.frames import LITE, SAFETY, SECURE, build
from imuscope.server.cli import main
from imuscope.server.devices.decode import protocol_set
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.decode.sequence_store import MAX_DEVICES, SequenceStore, is_newer
from imuscope.server.links.base import LinkError
from imuscope.server.settings.config import Config
from tests.server.devices.session_harness import SessionHarness, started
from tests.support.decode_options import decode_options
from tests.support.each_row import each_row
from tests.support.fakes import FakeFile, FakeLink, FakeLinks
from tests.support.in_process_server import InProcessServer
from tests.support.waiting import until

KEY = bytes(range(32))
SECURELY = decode_options("idtp", key=KEY)


class RestartHarness(SessionHarness):
    """A session with the real IDTP decoder; time passes with the frames that are sent."""

    def __init__(self, reading: DecodeOptions, store: SequenceStore | None, link: type[FakeLink]) -> None:
        super().__init__(protocol_set.all_protocols(), reading, link=link, store=store)

    async def send(self, *frames: bytes, every: float = 0.01) -> None:
        """Frames at their rate, each decoded on arrival; of those that arrive at once, a hundred together."""
        together = 1 if every else 100
        for count, frame in enumerate(frames, 1):
            self.clock.move(every)
            await self.receive(frame)
            if count % together == 0 or count == len(frames):
                self.session.access.decode()
                self.session.tick(self.clock())
        await self.settle()

    async def reconnect(self) -> None:
        opened = self.link.opened
        self.link.die(LinkError("gone", "It is gone."))
        while self.link.opened == opened:
            self.session.retry()
            await asyncio.sleep(0.001)
        await self.settle()

    @property
    def samples(self) -> int:
        return sum(meter.total for meter in self.session._stats.messages.values())

    @property
    def refused(self) -> dict[str, int]:
        return dict(self.session._stats.rejects_by)


def playing(
    reading: DecodeOptions = SECURELY, store: SequenceStore | None = None, link: type[FakeLink] = FakeLink
) -> AbstractAsyncContextManager[RestartHarness]:
    return started(RestartHarness(reading, store, link))


def frame(sequence: int, mode: int = SECURE, *, device: int = 102, stamp: int | None = None) -> bytes:
    stamp = sequence * 10_000 if stamp is None else stamp
    return build(1, bytes(12), timestamp=stamp & 0xFFFFFFFF, sequence=sequence, device=device, mode=mode, key=KEY)


def captured(first: int = 0, count: int = 50) -> list[bytes]:
    return [frame(first + k) for k in range(count)]


async def test_captured_frames_are_rejected_after_a_reconnect() -> None:
    async with playing() as stage:
        await stage.send(*captured())
        assert stage.samples == 50
        for _ in range(2):
            await stage.reconnect()
            await stage.send(*captured())
        assert stage.samples == 50
        assert stage.refused == {"stale": 100}
        await stage.send(*captured(50, 10))
        assert stage.samples == 60


async def test_captured_frames_are_rejected_after_a_server_restart(tmp_path: Path) -> None:
    store = SequenceStore(tmp_path)
    async with playing(store=store) as stage:
        await stage.send(*captured(7))
    store.save()
    async with playing(store=SequenceStore(tmp_path)) as stage:
        await stage.send(*captured(7), *captured(57, 5))
        assert (stage.samples, stage.refused) == (5, {"stale": 50})
    path = tmp_path / "secure-sequences.json"
    assert KEY.hex() not in path.read_text()
    assert stat.S_IMODE(path.stat().st_mode) & 0o022 == 0


def test_another_key_is_another_device(tmp_path: Path) -> None:
    store = SequenceStore(tmp_path)
    store.update(KEY, {102: 500})
    store.save()
    assert SequenceStore(tmp_path).restore(KEY) == {102: 500}
    assert SequenceStore(tmp_path).restore(bytes(32)) == {}


async def test_a_replay_is_not_a_replay_attack(tmp_path: Path) -> None:
    """A recording of Secure frames is accepted each time it is played, and stores no state."""
    store = SequenceStore(tmp_path)
    async with playing(store=store, link=FakeFile) as stage:
        await stage.send(*captured())
        await stage.reconnect()
        await stage.send(*captured())
        assert stage.samples == 100
    store.save()
    assert not (tmp_path / "secure-sequences.json").exists()


async def test_a_restarted_secure_device_is_reported() -> None:
    """The message names the restart instead of a wrong rate, and an operator can re-arm the device."""
    async with playing() as stage:
        await stage.send(*captured(1000))
        assert stage.info.status == "live"
        await stage.send(*captured(0, 250))
        assert stage.samples == 50
        assert stage.info.status == "lost"
        assert "Sequence restarted: 102" in stage.info.message
        assert "number 249 after 1049" in stage.info.message or "after 1049" in stage.info.message
        assert "re-arm" in stage.info.hint
        assert "rate" not in stage.info.message + stage.info.hint
        assert (stage.info.rearm, stage.session.infos[0].required_action) == (["102"], "rearm")
        age = stage.clock() - stage.session.health(stage.clock()).last_arrival
        assert age == pytest.approx(2.5, abs=0.2)  # of the last sample, not of the last byte
        stage.session.rearm("102")
        await stage.send(*captured(250, 20))
        assert stage.samples == 70
        assert (stage.info.status, stage.info.rearm, stage.info.required_action) == ("live", [], "")
        assert not any("restarted" in notice for notice in stage.info.notices)


async def test_a_replay_beside_the_device_itself_is_no_restart() -> None:
    async with playing() as stage:
        for k in range(60):
            await stage.send(frame(1000 + k), frame(k))
        assert stage.info.rearm == []
        assert stage.info.status == "live"


async def test_a_restarted_safety_device_is_not_reported_as_a_wrong_rate() -> None:
    async with playing(DecodeOptions("idtp")) as stage:
        await stage.send(*(frame(1000 + k, SAFETY) for k in range(20)))
        await stage.send(*(frame(k, SAFETY) for k in range(250)))
        assert "old sequence numbers" in stage.info.message
        assert "rate" not in stage.info.message + stage.info.hint
        await stage.send(*(frame(250 + k, SAFETY) for k in range(100)))
        assert stage.info.status == "live"


async def test_refused_frames_are_not_reported_as_damaged() -> None:
    """With a device that mixes modes, frames refused by a setting count neither as lost nor as damaged."""
    async with playing(DecodeOptions("idtp")) as stage:
        for k in range(0, 60, 3):
            await stage.send(frame(k, LITE), frame(k + 1, SECURE), frame(k + 2, LITE))
        assert stage.refused == {"no_key": 20}
        assert stage.session._stats.lost == 0
        assert not [event for event in stage.telemetry.log if event.kind == "gap"]
        await stage.send(frame(60, SECURE), frame(63, LITE))
        (gap,) = [event for event in stage.telemetry.log if event.kind == "gap"]
        assert gap.samples == 2
        assert "damaged frame" not in gap.text


async def test_a_forged_jump_is_not_counted_as_lost_samples() -> None:
    async with playing(DecodeOptions("idtp")) as stage:
        await stage.send(*(frame(k, SAFETY) for k in range(10)))
        await stage.send(frame(1 << 30, SAFETY), frame((1 << 30) + 1, SAFETY))
        assert stage.session._stats.lost == 0
        assert any("jumped ahead by 10737418" in event.text for event in stage.telemetry.log)


async def test_a_missing_key_is_requested() -> None:
    async with playing(DecodeOptions("idtp")) as stage:
        await stage.send(*captured())
        assert (stage.info.status, stage.info.required_action) == ("connecting", "key")
        await stage.session.read_as(SECURELY)
        await stage.send(*captured(50))
        assert (stage.info.status, stage.info.required_action) == ("live", "")


@pytest.fixture
def secured(tmp_path: Path) -> Iterator[tuple[InProcessServer, FakeLink]]:
    """A server with a Secure device that restarted, and waits to be re-armed."""
    links = FakeLinks()

    config = Config(sources=("/dev/one",), protocol="idtp", decode_options={"key": KEY.hex()}, data=tmp_path)
    with InProcessServer(config, links.open, protocol_set.all_protocols()) as running:
        for sequence in (1000, 0):
            running.call(links["/dev/one"].send, b"".join(captured(sequence)))
        asyncio.run(
            until(
                lambda: running.services.telemetry.bus.devices.latest["1"].rearm == ["102"],
                "the server says that it waits",
            )
        )
        yield running, links["/dev/one"]


def samples_of(running: InProcessServer) -> int:
    return sum(meter.total for meter in running.services.sessions.get("1")._stats.messages.values())


@pytest.mark.parametrize("door", ["api", "command", "command for all"])
def test_a_restarted_device_can_be_rearmed(
    secured: tuple[InProcessServer, FakeLink], door: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Regression: the decoder could do it, but no route or command called it."""
    running, link = secured
    if door == "api":
        assert running.client.post("/api/devices/1/rearm", json={"sender": "102"}).json()["rearm"] == []
    else:
        assert main(["rearm", *(["102"] if door == "command" else []), "--server", running.url]) == 0
        assert "re-armed on 1 link" in capsys.readouterr().out
    before = samples_of(running)
    running.call(link.send, b"".join(captured(50, 20)))
    asyncio.run(until(lambda: samples_of(running) == before + 20, "it is heard again"))


def test_a_device_is_rearmed_where_no_server_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    store = SequenceStore(tmp_path)
    store.update(KEY, {102: 500, 103: 7})
    store.save()
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))  # bound but not listening: refused
        server = f"http://127.0.0.1:{held.getsockname()[1]}"
        assert main(["rearm", "102", "--server", server, "--data", str(tmp_path)]) == 0
    assert "was deleted" in capsys.readouterr().out
    assert SequenceStore(tmp_path).restore(KEY) == {103: 7}


# -- the unit of timestamps --------------------------------------------------------------------------------------------


@each_row(("unit", "ticks", "every"), [("ms", 10, 0.01), ("ns", 10_000_000, 0.01), ("s", 0.2, 0.2)])
async def test_timestamp_units_are_detected(unit: str, ticks: float, every: float) -> None:
    """A sender in another unit: it is noticed within some seconds, with the reason, and read rightly from then on."""
    async with playing(DecodeOptions("idtp")) as stage:
        await stage.send(*(frame(k, SAFETY, stamp=round(1000 + k * ticks)) for k in range(250)), every=every)
        assert stage.info.decode_options == {"time_unit": unit}
        (notice,) = stage.info.notices
        assert notice.startswith(f"Timestamps are read with time_unit={unit}: they advance by")
        channel = next(iter(stage.telemetry.store.all))
        time = channel.ring.read()[1]
        assert time[-1] - time[-101] == pytest.approx(100 * every, abs=0.02 if unit != "s" else 1.1)


async def test_a_configured_unit_is_kept_and_the_contradiction_reported() -> None:
    async with playing(decode_options("idtp", time_unit="us")) as stage:
        await stage.send(*(frame(k, SAFETY, stamp=1000 + k * 10) for k in range(150)))
        assert stage.info.decode_options == {"time_unit": "us"}
        (notice,) = stage.info.notices
        assert "contradict their arrival" in notice
        assert "time_unit=ms" in notice


async def test_a_backlog_does_not_determine_the_timestamp_unit() -> None:
    """A minute of data delayed by a link arrives at once, and then the device continues as usual."""
    async with playing(DecodeOptions("idtp")) as stage:
        await stage.send(*(frame(k, SAFETY) for k in range(6000)), every=0.0)
        await stage.send(*(frame(6000 + k, SAFETY) for k in range(200)))
        assert stage.info.decode_options == {}
        assert stage.info.notices == []


# -- the store ---------------------------------------------------------------------------------------------------------


def test_the_store_is_bounded_and_survives_damage(tmp_path: Path) -> None:
    store = SequenceStore(tmp_path)
    store.update(KEY, {device: device for device in range(MAX_DEVICES + 100)})
    store.save()
    path = tmp_path / "secure-sequences.json"
    assert sum(len(one) for one in json.loads(path.read_text()).values()) == MAX_DEVICES
    for rubbish in ("", "null", "[1]", '{"a": 1}', '{"a": {"x": [1, 2]}}', '{"a": {"1": [-1, 2]}}', "{" * 100_000):
        path.write_text(rubbish)
        assert SequenceStore(tmp_path).restore(KEY) == {}


def test_two_processes_keep_the_newer_number(tmp_path: Path) -> None:
    one, two = SequenceStore(tmp_path), SequenceStore(tmp_path)
    one.update(KEY, {1: 500, 2: 7})
    one.save()
    two.update(KEY, {1: 400, 3: 9})
    two.save()
    assert SequenceStore(tmp_path).restore(KEY) == {1: 500, 2: 7, 3: 9}
    assert two.forget(KEY, 1) == 1
    assert SequenceStore(tmp_path).restore(KEY) == {2: 7, 3: 9}
    assert is_newer(3, 0xFFFFFFFE)
    assert not is_newer(5, 5)


def test_a_full_disk_loses_no_stored_sequence_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path, text: str) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("imuscope.server.devices.decode.sequence_store.atomic_write.write_atomic", refuse)
    store = SequenceStore(tmp_path)
    store.update(KEY, {1: 5})
    store.save()
    assert store.restore(KEY) == {1: 5}
