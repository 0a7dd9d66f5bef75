"""Benchmark of the export of an hour to `.rrd` and of its display in the embedded viewer.

    python tests/bench/rrd.py [--minutes 60] [--save]

The recording is that of tests/bench/opening.py: an MTi at 1 kHz with counter, time, orientation, acceleration, rate of
turn and status. It is decoded first, which is not measured here.

    export     every sample into one file, in a process of its own; the yardstick, in the same run, is writing as many
               bytes and their zlib.adler32
    fill       a real Chromium without a GPU opens the recording under /rerun/, thinned as it is for everybody; from the
               last byte of it until the body is on the screen, and from the opening of the address

Budgets (2 cores, no GPU): export ≤ 30 s; fill ≤ 5 s from when the file is loaded.
"""

from __future__ import annotations

import io
import json
import resource
import subprocess
import sys
import tempfile
import time
import urllib.request
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from tests.bench.opening import make
from tests.bench.support.report import report

ATTEMPTS = 120
LOADED_MS = "performance.getEntriesByType('resource').find(one => one.name.includes('.rrd'))?.responseEnd ?? 0"


def export(store: Path, out: Path) -> dict[str, float]:
    """Work of the separate process."""
    from imuscope.recordings.columns.store import ColumnStore

    start = time.perf_counter()
    from imuscope.server.extensions.rerun.rrd.writer import write_rrd

    imported = time.perf_counter() - start
    columns = ColumnStore(store)
    start = time.perf_counter()
    write_rrd(columns, out)
    took = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    rows = sum(columns.rows(number) for number in columns.shapes)
    return {"import_s": imported, "export_s": took, "peak_mb": peak, "rows": rows, "file_mb": out.stat().st_size / 1e6}


def yardstick(out: Path) -> float:
    """Write as many bytes and sum them."""
    data = np.random.default_rng(1).integers(0, 256, 1 << 24, np.uint8).tobytes()
    start = time.perf_counter()
    with out.with_suffix(".yardstick").open("wb") as file:
        for _ in range(out.stat().st_size // len(data)):
            zlib.adler32(data)
            file.write(data)
    return time.perf_counter() - start


def fill(folder: Path) -> dict[str, float]:
    """Time until the body is visible."""
    from PIL import Image
    from playwright.sync_api import sync_playwright

    from tests.support import chromium
    from tests.support.server_process import ServerProcess

    with ServerProcess("udp://:0", data=folder, timeout_s=120) as server, sync_playwright() as playwright:
        urllib.request.urlopen(f"{server.url}/rerun/re_viewer.js", timeout=120).read()
        while json.load(urllib.request.urlopen(f"{server.url}/api/recordings/hour", timeout=60)).get("t0") is None:
            time.sleep(0.5)
        engine = playwright.chromium.launch(executable_path=chromium.required(), args=chromium.ARGUMENTS)
        page = engine.new_page(viewport={"width": 900, "height": 600})
        start = time.perf_counter()
        page.goto(f"{server.url}/rerun/?recording=hour&theme=light")
        for _ in range(ATTEMPTS):
            picture = Image.open(io.BytesIO(page.screenshot(timeout=120_000))).convert("RGB")
            if _is_filled(np.asarray(picture, np.int16)):
                break
            page.wait_for_timeout(500)  # each picture is drawn by the processor that the viewer needs
        shown = time.perf_counter() - start
        seen_ms = float(page.evaluate("performance.now()"))
        chromium.until(page, f"({LOADED_MS}) > 0", timeout_s=120)
        loaded_ms = float(page.evaluate(LOADED_MS))
        engine.close()
    # The body may be visible before the last byte has arrived: then no wait is needed.
    return {"fill_from_address_s": shown, "fill_from_loaded_s": max(0.0, seen_ms - loaded_ms) / 1000}


def _is_filled(pixels: np.ndarray[Any, Any]) -> bool:
    r, g, b = np.moveaxis(pixels[40:, :440], 2, 0)
    return int(((r > 110) & (r - b > 70) & (r > g) & (g > b)).sum()) > 30


def main() -> None:
    if "--export" in sys.argv:
        at = sys.argv.index("--export")
        print(json.dumps(export(Path(sys.argv[at + 1]), Path(sys.argv[at + 2]))))
        return
    minutes = float(sys.argv[sys.argv.index("--minutes") + 1]) if "--minutes" in sys.argv else 60.0
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "recordings").mkdir()
        path = folder / "recordings" / "hour.mcap"
        make(path, minutes)
        from imuscope.recordings.mcap.source import McapSource
        from imuscope.server.devices.decode.protocol_set import all_protocols
        from imuscope.server.library.decode import decode

        decode(McapSource(path), folder / "store", all_protocols())
        out = folder / "hour.rrd"
        command = [sys.executable, __file__, "--export", str(folder / "store"), str(out)]
        figures = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        measure = yardstick(out)
        report("rrd", {"minutes": minutes, **figures, "write_and_adler32_s": measure, **fill(folder)})


if __name__ == "__main__":
    main()
