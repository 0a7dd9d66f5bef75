"""Run a fuzz target: `python -m tests.fuzz PROTOCOL [--minutes M | --cases N] [--seed S]`. See the package.

Other targets than protocols are what comes from outside: http, ws, files (external_inputs.py); they go by time.

What breaks an invariant is minimised and kept under findings/; the exit status is 1 then. With --keep-account the run
is noted in runs.json.
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import platform
import sys
import time
from collections.abc import Iterable
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from imuscope.protocols.native import kernels as compiled
from tests.fuzz.cases import write
from tests.fuzz.search import CorpusSearch, minimised
from tests.fuzz.targets import TARGETS

OUTSIDE = ("http", "ws", "files")  # as in external_inputs.py, which takes a while to load
RUNS = Path(__file__).parent / "runs.json"
HANG_S = 60  # no case takes a second; one that takes so long does not end
_MAX_FINDINGS = 12


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("protocol", choices=[*TARGETS, *OUTSIDE])
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--cases", type=int, default=0, help="stop after so many cases instead")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--without-captures", action="store_true", help="start from what is in the project alone")
    parser.add_argument("--keep-account", action="store_true", help="note the run in runs.json")
    options = parser.parse_args()
    if options.protocol in OUTSIDE:
        return _outside(options)
    search = CorpusSearch(options.protocol, options.seed, captures=not options.without_captures)
    begin = time.monotonic()
    shown = begin
    kinds: dict[str, int] = {}
    while (search.cases < options.cases) if options.cases else (time.monotonic() - begin < 60 * options.minutes):
        faulthandler.dump_traceback_later(HANG_S, exit=True)  # gives the place; the same seed reproduces it
        result = search.step()
        if result is not None:
            case, broken = result
            kinds[broken.kind] = kinds.get(broken.kind, 0) + 1
            if kinds[broken.kind] <= 3 and sum(kinds.values()) <= _MAX_FINDINGS:
                faulthandler.cancel_dump_traceback_later()
                small, broken = minimised(options.protocol, case, broken)
                about = f"{broken.kind} · seed {options.seed} · case {search.cases}"
                path = write(
                    options.protocol, small, str(broken)[:400], about, f"{broken.kind}_{options.seed}_{search.cases}"
                )
                print(f"\n{path}\n  {len(case.data)} → {len(small.data)} bytes: {str(broken)[:600]}", flush=True)
        if time.monotonic() - shown > 30:
            shown = time.monotonic()
            print(_state(search, shown - begin, sum(kinds.values())), flush=True)
    faulthandler.cancel_dump_traceback_later()
    seconds = time.monotonic() - begin
    print(_state(search, seconds, sum(kinds.values())))
    _note(
        options,
        seconds,
        ("numpy", "pynmeagps"),
        compiled=not compiled.DISABLED,
        cases=search.cases,
        bytes=search.bytes,
        frames=search.frames,
        corpus=len(search.corpus),
        features=len(search.visited),
        broken=kinds,
    )
    return 1 if kinds else 0


def _outside(source: argparse.Namespace) -> int:
    from tests.fuzz.external_inputs import ExternalRun

    begin = time.monotonic()
    run = ExternalRun(source.protocol, source.seed)
    run.run(60 * source.minutes)
    _note(
        source,
        time.monotonic() - begin,
        ("schemathesis", "hypothesis", "websockets"),
        cases=run.cases,
        broken=run.kinds,
    )
    return 1 if run.kinds else 0


def _state(search: CorpusSearch, seconds: float, broken: int) -> str:
    return (
        f"{seconds:6.0f} s  {search.cases} cases  {search.bytes / 1e6:.1f} MB  corpus {len(search.corpus)}  "
        f"features {len(search.visited)}  broken {broken}"
    )


def _note(source: argparse.Namespace, seconds: float, packages: Iterable[str], **figures: object) -> None:
    """Note a run in runs.json, if that is wanted."""
    if not source.keep_account:
        return
    run = {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "protocol": source.protocol,
        "seed": source.seed,
        "minutes": round(seconds / 60, 1),
        **figures,
        "versions": {"python": platform.python_version(), **{name: version(name) for name in packages}},
    }
    runs = [*(json.loads(RUNS.read_text()) if RUNS.exists() else []), run]
    RUNS.write_text("[\n" + ",\n".join(json.dumps(one) for one in runs) + "\n]\n")


if __name__ == "__main__":
    sys.exit(main())
