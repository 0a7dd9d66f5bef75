"""Live devices for viewers of the Foxglove WebSocket protocol, on a port of its own and at /foxglove."""

from imuscope.server.services.extension import Extension

EXTENSION = Extension(
    "foxglove",
    "Foxglove",
    modules=("foxglove",),
    extra="viewers",
    parts="imuscope.server.extensions.foxglove.service",
    routes=("imuscope.server.extensions.foxglove.routes",),
    places=("/foxglove",),
)
