"""Analysis: figures of signals, live and recorded alike, computed signals, and the comparison of two recordings.

Analyses are pure functions over columns (`methods/`), found by a registry; each request runs in a process of its own.
"""

from imuscope.server.services.extension import Extension, ExtensionCommand

EXTENSION = Extension(
    "analysis",
    "Analysis",
    parts="imuscope.server.extensions.analysis.expressions.stored_signals",
    page_parts="imuscope.server.extensions.analysis.jobs.service",
    routes=(
        "imuscope.server.extensions.analysis.jobs.routes",
        "imuscope.server.extensions.analysis.jobs.comparison_routes",
        "imuscope.server.extensions.analysis.expressions.signal_routes",
    ),
    read_only_posts=("/api/analysis/{name}", "/api/comparison", "/api/comparison/settings"),
    commands=(
        ExtensionCommand(
            "analyse",
            "imuscope.server.extensions.analysis.jobs.command:add",
            "imuscope.server.extensions.analysis.jobs.command:run",
            scope="source",
            protocol_help="protocol of a capture (default: detected)",
            reads_file=True,
            epilog="imuscope.server.extensions.analysis.jobs.command:analysis_list",
        ),
    ),
    problems="imuscope.server.extensions.analysis.noise.registry:problems",
)
