"""Clocks of a file or a live device: each with its unit, epoch, resolution, drift, jitter and steps.

recording ──> columns ──> figures.py ──> routes.py, print_clocks.py
"""

from imuscope.server.services.extension import Extension, ExtensionCommand

EXTENSION = Extension(
    "clocks",
    "Clocks",
    page_parts="imuscope.server.extensions.clocks.routes",
    routes=("imuscope.server.extensions.clocks.routes", "imuscope.server.extensions.clocks.file_readings"),
    commands=(
        ExtensionCommand(
            "time",
            "imuscope.server.extensions.clocks.command:add",
            "imuscope.server.extensions.clocks.command:run",
            scope="source",
            protocol_help="protocol of a capture (default: detected)",
            reads_file=True,
        ),
    ),
)
