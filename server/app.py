"""The server, put together: configuration in, ASGI application out. Nothing is decided here."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

from fastapi import FastAPI
from starlette.types import ASGIApp

from server import shutdown
from server.api import (
    commands,
    configure,
    corrections,
    description,
    devices,
    errors,
    exports,
    forms,
    foxglove,
    map_tiles,
    ports,
    recorder,
    recording_data,
    recordings,
    replay,
    rerun,
    snapshots,
    static_files,
    status,
    unicode_guard,
    viser,
    websocket,
)
from server.auth import Access, Guard
from server.config import Config
from server.configuration.controllers import ControllerRegistry
from server.configuration.correction_manager import CorrectionManager
from server.devices import protocol_set as default_speech
from server.devices.decode_options import DecodeOptions
from server.devices.protocol_detection import ProtocolSet
from server.devices.sequence_store import SequenceStore
from server.devices.sessions import OpenLink, Sessions
from server.integrations.foxglove import Foxglove
from server.integrations.rerun import Rerun
from server.integrations.viser import Viser
from server.library.catalogue import Catalogue
from server.library.cleanup import DataFolderLock
from server.library.column_cache import ColumnCache
from server.library.compaction_worker import CompactionWorker
from server.library.export_jobs import Exports
from server.library.recorder import FOLDER, Recorder, plan_of
from server.links import open_link
from server.links.base import LinkSettings, steady_clock
from server.metrics import Metrics
from server.rate_limit import RateLimiter
from server.security_headers import Heads
from server.streaming.event_logging import EventLogger
from server.streaming.hub import Hub
from server.version import VERSION

DEFAULT_SOURCES = ("twin:xbus", "twin:isb", "twin:idtp")


def create_app(
    config: Config,
    access: Access,
    *,
    open_link: OpenLink = open_link,
    speech: ProtocolSet | None = None,
    now_ns: Callable[[], int] | None = None,
) -> ASGIApp:
    """The application, guarded.

    Args:
        open_link, speech, now_ns: links, protocols and clock; tests pass their own.
    Raises:
        ReadingError: the configuration says something about its sources that cannot be used.
    """
    wall_ns = now_ns or time.time_ns
    now_ns = now_ns or steady_clock()
    reading = config.reading()
    hub = Hub(lambda: now_ns() / 1e9, history_s=config.history_s, budget=config.memory_mb * 1024 * 1024)
    links = LinkSettings(now_ns=now_ns)
    numbers = SequenceStore(config.data)
    sessions = Sessions(hub, open_link, speech or default_speech.speech(), links, sequences=numbers)

    desks = ControllerRegistry(hub, sessions, config.data, config.trial_s)
    packer = CompactionWorker(lambda path: catalogue.finished(path))
    tape = Recorder(hub, sessions, desks, plan_of(config), packer, wall_ns)
    catalogue = Catalogue(hub, config.data)
    shelf = catalogue.shelf = ColumnCache(config.data, catalogue.path, reading)

    tenancy = DataFolderLock(config.data)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        await asyncio.to_thread(tenancy.begin)
        sessions.start()
        if config.record:  # before there is a byte
            await tape.begin(config.sources or DEFAULT_SOURCES)
        for source in config.sources or DEFAULT_SOURCES:
            sessions.add_all(source, reading if config.sources else DecodeOptions())
        if tenancy.is_alone:  # else they are another server's, which may be carrying them out
            await desks.resume()
        await tape.resume()
        catalogue.start()
        app.state.foxglove.start()
        await app.state.rerun.start()
        yield
        await shutdown.close_all(
            tape.close(),
            {
                "an export": app.state.exports.close(),
                "the library": shutdown.close_sequentially(catalogue.close(), shelf.close()),
                "viser": app.state.viser.close(),
                "Rerun": app.state.rerun.close(),
                "Foxglove": app.state.foxglove.close(),
                "a device": shutdown.close_sequentially(app.state.corrections.close(), sessions.close()),
            },
        )
        tenancy.end()

    app = FastAPI(
        title="imuscope",
        version=VERSION,
        summary="Live view of inertial sensors. Samples come over the WebSocket at /ws (see server/wire.py).",
        lifespan=lifespan,
        docs_url=None,  # these two pages load scripts from other hosts
        redoc_url=None,
        responses=errors.responses(401, 403, 411, 413, 415, 429, 500),  # what every route can answer
    )
    app.state.hub = hub
    app.state.metrics = Metrics(hub)
    app.state.journal = EventLogger(hub)
    app.state.sessions = sessions
    app.state.desks = desks
    app.state.corrections = CorrectionManager(sessions)
    app.state.recorder = tape
    app.state.viser = Viser(hub)
    app.state.rerun = Rerun(hub, config.rerun_connect)
    app.state.foxglove = Foxglove(hub, config.foxglove, access)
    app.state.library = catalogue
    app.state.shelf = shelf
    app.state.exports = Exports(hub, catalogue, shelf, config.data)
    app.state.protocols = default_speech.protocols
    app.state.files = static_files.Files()
    app.state.data = config.data
    app.state.source_folders = [config.data / FOLDER, *map(Path, config.source_folders)]
    app.state.scan_lock = asyncio.Lock()
    app.state.tiles = map_tiles.TileSource(config.map)
    app.state.history_pace = asyncio.Lock()
    errors.install(app)
    app.add_middleware(unicode_guard.UnicodeGuard)
    app.add_middleware(RateLimiter)
    app.add_middleware(Heads)
    for module in (
        devices,
        configure,
        forms,
        commands,
        snapshots,
        corrections,
        recorder,
        replay,
        exports,
        recordings,
        recording_data,
        ports,
        status,
        map_tiles,
        websocket,
        foxglove,
        viser,
        rerun,
        static_files,
    ):  # the page last: it takes every path that is left
        app.include_router(module.router)
    description.install(app)
    return Guard(app, access)
