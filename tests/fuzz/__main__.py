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
    given = parser.parse_args()
    if given.protocol in OUTSIDE:
        return _outside(given)
    search = CorpusSearch(given.protocol, given.seed, captures=not given.without_captures)
    begin = time.monotonic()
    shown = begin
    kinds: dict[str, int] = {}
    while (search.cases < given.cases) if given.cases else (time.monotonic() - begin < 60 * given.minutes):
        faulthandler.dump_traceback_later(HANG_S, exit=True)  # gives the place; the same seed reproduces it
        found = search.step()
        if found is not None:
            case, broken = found
            kinds[broken.kind] = kinds.get(broken.kind, 0) + 1
            if kinds[broken.kind] <= 3 and sum(kinds.values()) <= _MAX_FINDINGS:
                faulthandler.cancel_dump_traceback_later()
                small, broken = minimised(given.protocol, case, broken)
                about = f"{broken.kind} · seed {given.seed} · case {search.cases}"
                path = write(
                    given.protocol, small, str(broken)[:400], about, f"{broken.kind}_{given.seed}_{search.cases}"
                )
                print(f"\n{path}\n  {len(case.data)} → {len(small.data)} bytes: {str(broken)[:600]}", flush=True)
        if time.monotonic() - shown > 30:
            shown = time.monotonic()
            print(_state(search, shown - begin, sum(kinds.values())), flush=True)
    faulthandler.cancel_dump_traceback_later()
    seconds = time.monotonic() - begin
    print(_state(search, seconds, sum(kinds.values())))
    _note(
        given,
        seconds,
        ("numpy", "pynmeagps"),
        compiled=not compiled.DISABLED,
        cases=search.cases,
        bytes=search.bytes,
        frames=search.frames,
        corpus=len(search.corpus),
        features=len(search.seen),
        broken=kinds,
    )
    return 1 if kinds else 0


def _outside(given: argparse.Namespace) -> int:
    from tests.fuzz.external_inputs import ExternalRun

    begin = time.monotonic()
    run = ExternalRun(given.protocol, given.seed)
    run.run(60 * given.minutes)
    _note(
        given, time.monotonic() - begin, ("schemathesis", "hypothesis", "websockets"), cases=run.cases, broken=run.kinds
    )
    return 1 if run.kinds else 0


def _state(search: CorpusSearch, seconds: float, broken: int) -> str:
    return (
        f"{seconds:6.0f} s  {search.cases} cases  {search.bytes / 1e6:.1f} MB  corpus {len(search.corpus)}  "
        f"features {len(search.seen)}  broken {broken}"
    )


def _note(given: argparse.Namespace, seconds: float, packages: Iterable[str], **figures: object) -> None:
    """Note a run in runs.json, if that is wanted."""
    if not given.keep_account:
        return
    run = {
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "protocol": given.protocol,
        "seed": given.seed,
        "minutes": round(seconds / 60, 1),
        **figures,
        "versions": {"python": platform.python_version(), **{name: version(name) for name in packages}},
    }
    runs = [*(json.loads(RUNS.read_text()) if RUNS.exists() else []), run]
    RUNS.write_text("[\n" + ",\n".join(json.dumps(one) for one in runs) + "\n]\n")


if __name__ == "__main__":
    sys.exit(main())
