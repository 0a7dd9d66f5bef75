"""Report of a benchmark, with machine, date and versions.

One JSON line on standard output; with `--save` the same, indented, in tests/bench/results/NAME.json, together with what
a reader needs to judge it: the kind of machine, the date, the versions of what was measured.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).parents[1] / "results"
PACKAGES = ("numpy", "uvicorn", "websockets", "fastapi")


def percentile(values: Sequence[float], share: float) -> float:
    """The smallest value that at least `share` (0..1) of the values do not exceed."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, max(0, round(share * len(ordered) + 0.5) - 1))] if ordered else float("nan")


def machine() -> dict[str, Any]:
    """The kind of machine, without its name."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("model name"):
                model = line.split(":", 1)[1].strip()
    system = f"{platform.system()} {platform.machine()}"
    load = os.getloadavg()[1]  # other load: over 5 minutes, so that a short run does not count itself twice
    return {"cpu": model, "cores": os.cpu_count(), "system": system, "gpu": None, "load_5_min": round(load, 1)}


def versions(extra: Mapping[str, str] | None = None) -> dict[str, str]:
    """Versions of what takes part."""
    results = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            results[name] = version(name)
        except PackageNotFoundError:
            continue
    return {**results, **(extra or {})}


def options_of(description: str, **more: Any) -> argparse.ArgumentParser:
    """The command line of a benchmark, with `--save`."""
    parser = argparse.ArgumentParser(description=description, **more)
    parser.add_argument("--save", action="store_true", help="keep the result in tests/bench/results")
    return parser


def status_of(stored: Mapping[str, bool]) -> int:
    """Exit status of a benchmark: 1 if a promise was not kept, each of which is printed."""
    if broken := [promise for promise, ok in stored.items() if not ok]:
        print(json.dumps(broken), file=sys.stderr)
    return int(bool(broken))


def report(name: str, figures: Mapping[str, Any], *, extra_versions: Mapping[str, str] | None = None) -> None:
    """Print one JSON line; store it if the command line has `--save`."""
    rounded = _rounded({"bench": name, **figures})
    print(json.dumps(rounded), flush=True)
    if "--save" in sys.argv:
        RESULTS.mkdir(exist_ok=True)
        entries = {
            **rounded,
            "date": datetime.now(UTC).date().isoformat(),
            "machine": machine(),
            "versions": versions(extra_versions),
        }
        (RESULTS / f"{name}.json").write_text(json.dumps(entries, indent=2, ensure_ascii=False) + "\n")


def _rounded(value: Any) -> Any:
    """Four significant digits are more than a noisy machine can promise."""
    if isinstance(value, float):
        return float(f"{value:.4g}")
    if isinstance(value, Mapping):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_rounded(item) for item in value]
    return value
