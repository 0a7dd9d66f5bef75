"""The Rerun viewer at /rerun/, and a stream to one on another machine."""

from imuscope.server.services.extension import Extension

EXTENSION = Extension(
    "rerun",
    "Rerun",
    modules=("rerun",),
    extra="viewers",
    parts="imuscope.server.extensions.rerun.service",
    routes=("imuscope.server.extensions.rerun.routes",),
    places=("/rerun",),
)
