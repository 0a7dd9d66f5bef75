"""Analysis: figures of signals, live and recorded alike, computed signals, and the comparison of two recordings.

Analyses are pure functions over columns (`methods/`), found by a registry; each request runs in a process of its own.
"""

from imuscope.server.extension import Extension, ExtensionCommand

EXTENSION = Extension(
    "analysis",
    "Analysis",
    parts="imuscope.server.extensions.analysis.stored_signals",
    page_parts="imuscope.server.extensions.analysis.service",
    routes=(
        "imuscope.server.extensions.analysis.routes",
        "imuscope.server.extensions.analysis.comparison_routes",
        "imuscope.server.extensions.analysis.signal_routes",
    ),
    read_only_posts=("/api/analysis/{name}", "/api/comparison", "/api/comparison/settings"),
    commands=(
        ExtensionCommand(
            "analyse",
            "imuscope.server.extensions.analysis.command:add",
            "imuscope.server.extensions.analysis.command:run",
            scope="source",
            protocol_help="protocol of a capture (default: detected)",
            reads_file=True,
            epilog="imuscope.server.extensions.analysis.command:analysis_list",
        ),
    ),
    problems="imuscope.server.extensions.analysis.registry:problems",
)
