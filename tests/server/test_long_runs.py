"""Objects of devices, links and recordings that are gone: a server that runs for weeks must not keep them."""

import asyncio
import gc
import io
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import AsyncMock, Mock

import pytest

from imuscope.server import wire
from imuscope.server.devices.device.stream_diagnostics import StreamDiagnostics
from imuscope.server.devices.link.session import Session
from imuscope.server.devices.link.sessions import Sessions
from imuscope.server.integrations.viewer_client import ViewerClient
from imuscope.server.library import export_jobs
from imuscope.server.library.catalogue import Catalogue
from imuscope.server.library.column_cache import ColumnCache
from imuscope.server.library.export_jobs import ExportJobs, ExportWork
from imuscope.server.library.foreign_files import ForeignFiles
from imuscope.server.links.base import LinkSettings
from imuscope.server.links.message_link import MOST_COUNTED, MessageLink, TopicSource
from imuscope.server.links.source_url import SourceUrl
from imuscope.server.settings.config import Config
from imuscope.server.streaming.event_logging import EventLogger
from imuscope.server.streaming.telemetry import Telemetry
from tests.support import virtual_time
from tests.support.fakes import SPEECH, FakeLinks, sample
from tests.support.in_process_server import InProcessServer
from tests.support.read_library import ReadLibrary
from tests.support.recorder_harness import send


class IdleMessageLink(MessageLink):
    """Messages of nowhere."""

    async def open(self, progress: object = None) -> None:
        self.begin()


def living(kind: type) -> int:
    """How many objects of a type there are."""
    gc.collect()
    return sum(type(one) is kind for one in gc.get_objects())


def test_a_recording_of_weeks_keeps_nothing_of_devices_that_were_removed(tmp_path: Path, links: FakeLinks) -> None:
    """Every session stayed in memory until the recording ended, and in the metadata of all of its later files."""
    with InProcessServer(Config(sources=("/dev/one",), data=tmp_path), links.open) as running:
        recorder = running.services.recorder
        running.client.post("/api/recordings/start", json={})
        before = living(Session)
        for number in range(5):
            source = f"/dev/more{number}"
            device = running.client.post("/api/devices", json={"source": source}).json()["id"]
            send(running, links, source, sample(1))
            assert running.client.delete(f"/api/devices/{device}").status_code == 204
            links.pop(source)
        assert living(Session) <= before + 1  # the last one may just be closing
        assert len(running.call(lambda: recorder.current).recorded) == 6
        running.client.post("/api/recordings/stop", json={})


def test_the_result_of_the_last_export_goes_after_a_day(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It stayed on the disk of the robot until the next export."""

    async def written(self: ExportJobs, job: Any, title: str) -> list[Path]:
        job.folder.mkdir(parents=True)
        (file := job.folder / "drive.csv").write_bytes(b"1")
        return [file]

    async def opened(recording: str) -> None:
        return

    monkeypatch.setattr(ExportJobs, "_run", written)
    catalogue: Any = SimpleNamespace(info=lambda recording: SimpleNamespace(recording=False, title="drive"))
    columns: Any = SimpleNamespace(opened=opened, store_of=lambda recording: tmp_path)

    async def main() -> None:
        jobs = ExportJobs(Telemetry.create(lambda: 0.0).bus, catalogue, columns, tmp_path)
        job = jobs.add_work("a", ExportWork("csv", "", "", {}, "drive", ".csv"))
        task = jobs._jobs[job.id].task
        assert task is not None
        await task
        await asyncio.sleep(export_jobs.KEPT_S - 10)
        assert jobs.file(job.id).is_file()
        await asyncio.sleep(20)
        assert not jobs.jobs
        assert not list((tmp_path / "exports").iterdir())

    virtual_time.run(main())


def test_messages_of_a_node_that_was_started_a_thousand_times_are_received() -> None:
    """Each start took a channel with a definition, which is repeated every two seconds, until none was left."""
    source = "foxglove://127.0.0.1:8765/imu"
    link = IdleMessageLink(source, LinkSettings(now_ns=lambda: 0), TopicSource.parse(SourceUrl.parse(source), 8765))
    about = ("/imu", "cdr", "sensor_msgs/msg/Imu", "ros2msg", b"float64 x")
    numbers = [link.channel(*about, publisher=f"run {run}") or link.channel(*about) for run in range(2000)]
    assert 0 not in numbers
    assert len(set(numbers)) == MOST_COUNTED + 1


def test_files_that_are_gone_are_not_remembered_as_examined(tmp_path: Path) -> None:
    clients: Any = SimpleNamespace(shedding=SimpleNamespace(draws_pictures=True))
    bus, library = Telemetry.create(lambda: 0.0).bus, ReadLibrary(tmp_path)
    catalogue = Catalogue(bus, clients, library, ColumnCache(tmp_path, library.path), ForeignFiles())
    catalogue._listed = math.inf
    catalogue._tried = {(tmp_path / "gone.mcap", 1, 2.0, "")}
    asyncio.run(catalogue._read_unread([]))
    assert not catalogue._tried


def test_a_view_keeps_nothing_of_channels_that_are_gone() -> None:
    """A process for ROS 2 or Foxglove, which runs as long as the server, kept the layout of every channel."""
    client = ViewerClient(io.BytesIO(), io.StringIO(), nice=0)
    for number in range(50):
        client._on_message({"op": "devices", "devices": [{"id": str(number), "name": "a"}]})
        columns = [{"dtype": "f4"}]
        client._on_message({"op": "channels", "channels": [{"id": number, "device": str(number), "columns": columns}]})
    client._on_message({"op": "devices", "devices": []})
    assert not client.channels
    assert len(client._dtypes) == 1  # its last samples may be on their way


def test_the_log_keeps_nothing_of_devices_that_were_removed() -> None:
    bus = Telemetry.create(lambda: 0.0).bus
    logger = EventLogger(bus)
    for number in range(20):
        bus.set_device(wire.DeviceInfo(str(number), "a", "sim:xbus", "simulator", "live"))
        bus.jobs.publish(wire.DeviceJobs(str(number), "idle"))
        bus.remove_device(str(number))
    assert not logger._devices
    assert not logger._jobs


def test_a_notice_on_a_sequence_goes_although_its_words_have_changed() -> None:
    """With several Secure devices on a line the notices of restarts added up, and were shown for ever."""
    diagnostics = StreamDiagnostics(Mock(), lambda data: {}, str)
    for number in range(10):
        diagnostics.restarted({"1": f"Device 1 sends {number}."})
        diagnostics.restarted({"1": f"Device 1 sends {number + 1}.", "2": "Device 2 sends 5."})
        diagnostics.restarted({})
    assert not diagnostics.notices


async def test_a_link_is_closed_although_something_fails_before(tmp_path: Path, links: FakeLinks) -> None:
    """It could not be removed any more, and went on reading its port."""
    sink = Telemetry.create(lambda: 0.0).bus
    settings = LinkSettings(now_ns=lambda: 0)
    sessions = Sessions(sink, links.open, SPEECH, settings)
    session = sessions.add("/dev/one")

    async def fails() -> None:
        raise OSError("no space left")

    session.listeners.before_close(fails)
    closed = AsyncMock()
    links["/dev/one"].close = closed  # type: ignore[method-assign]
    await sessions.remove(session.info.id)
    closed.assert_awaited()
    assert not sink.devices.latest


async def test_the_library_is_not_listed_again_while_nothing_changes(tmp_path: Path) -> None:
    """Each check read a file of every recording: with thousands of them it took a large part of a core."""
    clients: Any = SimpleNamespace(shedding=SimpleNamespace(draws_pictures=False), browsers=1)
    library = ReadLibrary(tmp_path)
    catalogue = Catalogue(
        Telemetry.create(lambda: 0.0).bus, clients, library, ColumnCache(tmp_path, library.path), ForeignFiles()
    )
    library.all = Mock(side_effect=library.all)  # type: ignore[method-assign]
    for _ in range(5):
        await catalogue._refresh()
    assert library.all.call_count == 1
    (tmp_path / "a.csv").write_text("t,x\n0,1\n")
    await catalogue._refresh()
    assert library.all.call_count == 2
    catalogue.changed()
    await catalogue._refresh()
    assert library.all.call_count == 3
    await catalogue.close()
