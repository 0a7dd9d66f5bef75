"""How is a recording handed on to Rerun? As one `.rrd` file; what is in it is told in recordings/rrd.

Rerun is imported when the first such file is written: that takes a second, which nobody else should wait for.
"""

from __future__ import annotations

from pathlib import Path

from recordings.exporters.request import ExportRequest, ExportStep


def write(wish: ExportRequest, out: Path, step: ExportStep) -> list[Path]:
    """Write the file; returns it."""
    from recordings.rrd.writer import write_rrd

    chosen = [info["id"] for info in wish.infos]
    write_rrd(
        wish.columns,
        out,
        t0=wish.t0,
        t1=wish.t1,
        channels=chosen,
        base=wish.base,
        progress=step,
        title=wish.title,
        payloads=wish.payloads,
    )
    return [out]
