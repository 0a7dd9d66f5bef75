"""Modules that the nursery of the tests (fork_server.py) imports before it forks, and names of what it forks."""

from __future__ import annotations

from importlib.util import find_spec


def _is_there(module: str) -> bool:
    """Whether the extension of a module is there: the heart is tested without any."""
    return find_spec(module.rpartition(".")[0]) is not None


LEARNT = (
    *(
        "imuscope.server.app.build",
        "imuscope.server.commands.serve",
        "imuscope.server.links.simulator",
        "imuscope.protocols.simulator.trajectory",
        "imuscope.protocols.xbus.simulator.device",
    ),
    *("uvicorn.loops.auto", "uvicorn.protocols.http.auto", "uvicorn.lifespan.on", "anyio._backends._asyncio"),
    "encodings.idna",  # of a name that is looked up
)
WORKERS = (
    *(
        "imuscope.server.library.decode_worker",
        "imuscope.server.library.export_worker",
        "imuscope.server.library.export_sizes",
        "imuscope.server.library.file_worker",
        "imuscope.server.library.played_file_worker",
    ),
    *filter(
        _is_there,
        (
            "imuscope.server.extensions.clocks.worker",
            "imuscope.server.extensions.evidence.worker",
            "imuscope.server.extensions.fleet.query.query_worker",
            "imuscope.server.extensions.fleet.upload.upload_worker",
        ),
    ),
)
"""Modules that a server runs in processes of their own, for seconds: their start would take most of the time. Not
imuscope.recordings.mcap.compaction, which imports little and may have little memory.
"""
_HEAVY: dict[str, tuple[str, ...]] = {
    "imuscope.server.extensions.analysis.jobs.worker": ("scipy.fft", "scipy.ndimage", "scipy.signal"),
    "imuscope.server.extensions.foxglove.worker": (),
    "imuscope.server.extensions.rerun.worker": (),
    "imuscope.server.extensions.ros2.worker": ("zenoh",),
    "imuscope.server.extensions.rerun.stream_worker": ("imuscope.server.extensions.rerun.rrd.writer",),
    "imuscope.server.extensions.viser.worker": ("imuscope.server.extensions.viser.scene",),
}
HEAVY = {module: late for module, late in _HEAVY.items() if _is_there(module)}
"""Processes of large libraries, most of them of viewers of others, and what they import late. These take a second each
to import, which the nursery does when the first one is asked for.
"""


def worker_name(module: str, requested_by: int) -> str:
    """Name of the process of a forked worker: what it runs, as far as there is room (comm, proc(5)), and for whom."""
    return f"{module.removesuffix('.worker').rpartition('.')[2][:7]}:{requested_by}"[:15]
