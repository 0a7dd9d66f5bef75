"""3D scene of the devices, by viser, at /viser/."""

from imuscope.server.services.extension import Extension

EXTENSION = Extension(
    "viser",
    "3D scene (viser)",
    modules=("viser", "msgspec"),
    extra="viewers",
    page_parts="imuscope.server.extensions.viser.service",
    routes=("imuscope.server.extensions.viser.routes",),
    places=("/viser",),
)
