"""The services of one server: all long-lived objects, created, started and closed in one place.

Routes receive them through one dependency (server/api/dependencies.py). Nothing is added or replaced later.
"""

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

from imuscope.recordings.library.library import Library
from imuscope.recordings.library.remembered_tables import TableMemory
from imuscope.server.access.auth import Access
from imuscope.server.configuration.controllers import ControllerRegistry
from imuscope.server.configuration.timings import ConfigurationTimings
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.decode.protocol_detection import ProtocolSet
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.devices.decode.protocol_set import protocols as installed_protocols
from imuscope.server.devices.decode.sequence_store import SequenceStore
from imuscope.server.devices.device.device_names import DeviceNames
from imuscope.server.devices.link.byte_memory import ByteMemory
from imuscope.server.devices.link.sessions import OpenLink, Sessions
from imuscope.server.diagnostics.metrics import Metrics
from imuscope.server.http import shutdown
from imuscope.server.http.page_files import Files
from imuscope.server.integrations.map_tiles import TileSource
from imuscope.server.library.catalogue import Catalogue
from imuscope.server.library.cleanup import DataFolderLock
from imuscope.server.library.column_cache import ColumnCache
from imuscope.server.library.compaction_worker import CompactionWorker
from imuscope.server.library.decoder_fingerprint import decoding_mark
from imuscope.server.library.export_jobs import ExportJobs
from imuscope.server.library.foreign_files import ForeignFiles
from imuscope.server.library.recorder import FOLDER, Recorder, plan_of
from imuscope.server.library.signal_definitions import SignalDefinitions
from imuscope.server.library.workspaces import WorkspaceStore
from imuscope.server.links.base import LinkSettings, steady_clock
from imuscope.server.links.simulated_device import default_sources
from imuscope.server.services.capability_list import list_capabilities
from imuscope.server.services.parts import Parts
from imuscope.server.settings.config import SIMULATORS, Config
from imuscope.server.streaming.event_logging import EventLogger
from imuscope.server.streaming.telemetry import Telemetry


@dataclass(frozen=True, slots=True)
class ViewerTimings:
    """Time limits, s.

    Args:
        stuck_s: a browser that accepts no byte for this long is disconnected.
        scene_idle_s: a scene in viser without viewers is kept for this long; the process ends with its last scene.
    """

    stuck_s: float = 5.0
    scene_idle_s: float = 15.0


@dataclass(frozen=True, slots=True)
class Services:
    """Parts of a running server.

    Args:
        reading: default decode options of sources and recordings.
        has_devices: False for a server of other robots, which has none of its own unless they are configured.
        brought: objects that a command made for its extension, which takes them over.
        parts: what extensions bring; complete before the server is started.
    """

    config: Config
    access: Access
    reading: DecodeOptions
    telemetry: Telemetry
    metrics: Metrics
    sessions: Sessions
    controllers: ControllerRegistry
    catalogue: Catalogue
    columns: ColumnCache
    recorder: Recorder
    exports: ExportJobs
    tiles: TileSource
    page_files: Files
    timings: ViewerTimings
    folder_lock: DataFolderLock
    workspaces: WorkspaceStore
    has_devices: bool = True
    brought: tuple[object, ...] = ()
    parts: Parts = field(default_factory=Parts)
    protocols: Callable[[], dict[str, str]] = installed_protocols

    @property
    def source_folders(self) -> list[Path]:
        """Folders whose files may be opened as sources over HTTP."""
        return [self.config.data / FOLDER, *map(Path, self.config.source_folders)]

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Start all services; close them concurrently at the end."""
        is_set = self.config.sources != SIMULATORS
        reading = self.reading if is_set else DecodeOptions()
        sources = self.config.sources if is_set else default_sources() if self.has_devices else ()
        await asyncio.to_thread(self.folder_lock.begin)
        self.catalogue.files.start()
        self.sessions.start()
        if self.config.record:  # before the first byte is received
            await self.recorder.begin(sources)
        for source in sources:
            await self.sessions.add_all(source, reading)
        if self.folder_lock.is_alone:  # otherwise another server may be carrying them out
            await self.controllers.resume()
        await self.recorder.resume()
        self.catalogue.start()
        await self.parts.start()
        yield
        await shutdown.close_all(
            shutdown.close_sequentially(self.parts.leave_recorder(), self.recorder.close()),
            {
                "an export": self.exports.close(),
                "the library": shutdown.close_sequentially(self.catalogue.close(), self.columns.close()),
                **{part.name: part.close() for part in self.parts if not part.sends},
                "a device": shutdown.close_sequentially(self.parts.close_senders(), self.sessions.close()),
            },
        )
        self.folder_lock.end()


def build_services(
    config: Config,
    access: Access,
    open_link: OpenLink,
    protocol_set: ProtocolSet | None,
    now_ns: Callable[[], int] | None,
    page_files: Files,
    timings: ViewerTimings,
    brought: tuple[object, ...] = (),
    *,
    has_devices: bool = True,
) -> Services:
    """Create the services without starting them. Arguments and errors as for `create_app`."""
    wall_ns = now_ns or time.time_ns
    now_ns = now_ns or steady_clock()
    reading = config.reading()
    byte_memory = ByteMemory(round(config.bytes_limit_mb * 1024 * 1024), config.history_s)
    telemetry = Telemetry.create(
        lambda: now_ns() / 1e9,
        history_s=config.history_s,
        budget=config.memory_mb * 1024 * 1024,
        reserved=lambda: byte_memory.nbytes,
        capabilities=list_capabilities(),
    )
    bus = telemetry.bus
    EventLogger(bus)
    sessions = Sessions(
        bus,
        open_link,
        protocol_set or all_protocols(),
        LinkSettings(now_ns=now_ns),
        sequences=SequenceStore(config.data),
        sample_interval=lambda: telemetry.clients.sample_interval,
        shedding=telemetry.shedding,
        byte_memory=byte_memory,
        names=DeviceNames(config.data),
    )
    controllers = ControllerRegistry(bus, sessions, config.data, ConfigurationTimings(rollback_s=config.rollback_s))
    library = Library(
        config.data / FOLDER, tables=TableMemory(config.data), decoder=decoding_mark, steady=time.monotonic
    )
    columns = ColumnCache(config.data, library.known_path, reading)
    catalogue = Catalogue(bus, telemetry.clients, library, columns, ForeignFiles())
    compactor = CompactionWorker(catalogue.finished)
    signals = SignalDefinitions(config.data)
    recorder = Recorder(bus, sessions, controllers, plan_of(config), compactor, wall_ns, byte_memory, signals)
    recorder.pinned_in_file, controllers.snapshots.read = catalogue.files.is_pinned, catalogue.files.snapshot
    return Services(
        config=config,
        access=access,
        reading=reading,
        telemetry=telemetry,
        metrics=Metrics(bus),
        sessions=sessions,
        controllers=controllers,
        catalogue=catalogue,
        columns=columns,
        recorder=recorder,
        exports=ExportJobs(bus, catalogue, columns, config.data),
        tiles=TileSource(config.map),
        page_files=page_files,
        timings=timings,
        folder_lock=DataFolderLock(config.data),
        workspaces=WorkspaceStore(config.data),
        has_devices=has_devices,
        brought=brought,
    )
