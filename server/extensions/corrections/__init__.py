"""GNSS corrections (RTCM 3) for devices: from a caster (NTRIP), a network address or a file."""

from imuscope.server.services.extension import Extension

EXTENSION = Extension(
    "corrections",
    "GNSS corrections",
    page_parts="imuscope.server.extensions.corrections.routes",
    routes=("imuscope.server.extensions.corrections.routes",),
)
