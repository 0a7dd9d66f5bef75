"""All routes of the heart, in the order in which they are matched."""

from __future__ import annotations

from imuscope.server.api import (
    capabilities,
    commands,
    configure,
    devices,
    exports,
    extension_pages,
    forms,
    map_tiles,
    packets,
    ports,
    recorder,
    recording_data,
    recordings,
    reference,
    replay,
    snapshots,
    status,
    websocket,
    workspaces,
)

ROUTERS = tuple(
    module.router
    for module in (
        devices,
        configure,
        forms,
        commands,
        snapshots,
        packets,
        recorder,
        replay,
        exports,
        recordings,
        recording_data,
        workspaces,
        ports,
        status,
        capabilities,
        map_tiles,
        websocket,
        reference,
        extension_pages,
    )
)
"""Before those of extensions. The page comes last: it matches every remaining path.

They are added directly: `include_router` would build every route and its validators again for each application, at the
first request, which would take a second longer.
"""
