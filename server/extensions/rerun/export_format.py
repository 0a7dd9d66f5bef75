"""RRD: one file for the Rerun viewer; server/extensions/rerun/rrd describes its contents.

Rerun is imported when the first such file is written: that takes a second, which other users should not wait for.
"""

from pathlib import Path

from imuscope.recordings.exporters.registry import ExportFormat, register_exporter
from imuscope.recordings.exporters.request import ExportRequest, ExportStep


def write(request: ExportRequest, out: Path, step: ExportStep) -> list[Path]:
    """Write the file; returns it."""
    from imuscope.server.extensions.rerun.rrd.writer import write_rrd

    chosen = [info["id"] for info in request.infos]
    write_rrd(
        request.columns,
        out,
        t0=request.t0,
        t1=request.t1,
        channels=chosen,
        base=request.base,
        progress=step,
        title=request.title,
        payloads=request.payloads,
    )
    return [out]


register_exporter(
    ExportFormat(
        "rrd",
        "Rerun",
        ".rrd",
        write,
        order=40,
        label="RRD",
        words="for the Rerun viewer",
        per_byte=4.4,
        modules=("rerun",),
        extra="viewers",
    )
)
