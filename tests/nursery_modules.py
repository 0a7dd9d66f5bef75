"""Modules that the nursery of the tests (tests/fork_server.py) imports before it forks, and names of what it forks."""

from __future__ import annotations

LEARNT = (
    *("server.app", "server.commands.serve", "server.links.simulator", "protocols.simulator.trajectory"),
    *("uvicorn.loops.auto", "uvicorn.protocols.http.auto", "uvicorn.lifespan.on", "anyio._backends._asyncio"),
)
WORKERS = (
    *("server.decode_worker", "server.library.export_worker", "server.library.export_sizes", "server.evidence.worker"),
    *("server.fleet.query_worker", "server.fleet.upload_worker", "server.analysis_worker"),
)
"""Modules that a server runs in processes of their own, for seconds: their start would take most of the time. Not
recordings.compaction, which imports little and may have little memory.
"""
VIEWERS = {
    "server.integrations.foxglove_worker": (),
    "server.integrations.rerun_worker": (),
    "server.integrations.ros2_worker": ("zenoh",),
    "server.integrations.rrd_stream_worker": ("recordings.rrd.writer",),
    "server.integrations.viser_worker": ("server.integrations.scene",),
}
"""Processes that feed viewers of others, and what they import late. Their libraries take a second each to import, which
the nursery does when the first one is asked for.
"""


def worker_name(module: str, asked_by: int) -> str:
    """Name of the process of a forked worker: what it runs, as far as there is room (comm, proc(5)), and for whom."""
    return f"{module.rpartition('.')[2][:7]}:{asked_by}"[:15]
