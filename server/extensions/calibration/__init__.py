"""Calibration of inertial sensors and magnetometers from their own samples: fits, live sessions, exports."""

from imuscope.server.services.extension import Extension, ExtensionCommand

EXTENSION = Extension(
    "calibration",
    "Calibration",
    page_parts="imuscope.server.extensions.calibration.session",
    routes=("imuscope.server.extensions.calibration.routes",),
    read_only_posts=("/api/calibration/{kind}",),
    commands=(
        ExtensionCommand(
            "calibrate",
            "imuscope.server.extensions.calibration.command:add",
            "imuscope.server.extensions.calibration.command:run",
            scope="source",
            protocol_help="protocol of a capture (default: detected)",
            reads_file=True,
        ),
    ),
    jobs=("imuscope.server.extensions.calibration.stretch",),
    requires=("analysis",),
)
