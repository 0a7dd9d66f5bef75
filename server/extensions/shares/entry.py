"""Declaration of shared ports."""

from imuscope.server.services.extension import Extension, ExtensionCommand

EXTENSION = Extension(
    "shares",
    "Shared ports",
    parts="imuscope.server.extensions.shares.port_shares",
    routes=("imuscope.server.extensions.shares.routes",),
    diagnoses="imuscope.server.extensions.shares.hold:findings",
    checks="imuscope.server.extensions.shares.settings:check_sources",
    commands=(
        ExtensionCommand(
            "hold",
            "imuscope.server.extensions.shares.hold:add",
            "imuscope.server.extensions.shares.hold:run",
            has_data=False,
        ),
    ),
)
