"""All earlier findings, and a few new cases with each run; the long runs are in runs.json."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from tests.fuzz import cases
from tests.fuzz.cases import BrokenError, Case
from tests.fuzz.invariants import check
from tests.fuzz.search import CorpusSearch, minimised
from tests.fuzz.targets import TARGETS
from tests.support.each_row import each_row

BURST = 40  # cases: half a second; `python -m tests.fuzz` goes on
FINDINGS = [path for name in TARGETS for path in cases.findings(name)]


@each_row("path", FINDINGS, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_former_failures_pass(path: Path) -> None:
    assert path.read_text().startswith("# ")
    check(TARGETS[path.parent.name].speaker, cases.read(path), guessing=True)


@each_row("protocol", TARGETS)
def test_a_short_burst(protocol: str) -> None:
    search = CorpusSearch(protocol, seed=0, captures=False)
    for _ in range(BURST):
        results = search.step()
        if results is not None:
            small, broken = minimised(protocol, *results)
            pytest.fail(f"{broken}\ncuts {small.cuts}, settings {small.settings}\n{small.data.hex()}")
    assert search.frames > BURST
    assert {kind for kind, *_ in search.visited} >= {"batch", "reject", "note" if protocol == "idtp" else "text"}


@each_row("protocol", TARGETS)
def test_a_seed_repeats_its_cases(protocol: str) -> None:
    searches = [CorpusSearch(protocol, seed=3, captures=False) for _ in range(2)]
    for _ in range(12):
        assert len({str(search.step()) for search in searches}) == 1
        assert len({str(search.corpus[-1]) for search in searches}) == 1
        assert len({search.bytes for search in searches}) == 1


@each_row("protocol", TARGETS)
def test_every_protocol_has_run_for_ten_minutes(protocol: str) -> None:
    runs = json.loads((Path(__file__).parent / "runs.json").read_text())
    assert max(run["minutes"] for run in runs if run["protocol"] == protocol and run["compiled"]) >= 10


def test_a_finding_is_read_as_it_was_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cases, "FINDINGS", tmp_path)
    case = Case(bytes(range(256)), (3, 77), {"key": b"\x01\x02", "min_mode": 1})
    path = cases.write("idtp", case, "nothing, really", "chunks · seed 1 · case 2", "example")
    assert cases.read(path) == case
    assert list(cases.findings("idtp")) == [path]


def test_a_faulty_decoder_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """The check can fail: with an oracle that forgets a frame after a reject it does, and the case gets smaller."""
    search = CorpusSearch("isb", seed=5, captures=False)
    oracle = search.target.speaker.expected

    def forgetful(data: bytes) -> object:
        frames, rejects = oracle(data)
        return frames[:-1] if rejects else frames, rejects

    monkeypatch.setattr(type(search.target), "speaker", replace(search.target.speaker, expected=forgetful))
    results = next(filter(None, (search.step() for _ in range(200))))
    assert isinstance(results[1], BrokenError)
    small, broken = minimised("isb", *results, attempts=300)
    assert broken.kind == results[1].kind == "oracle"
    assert len(small.data) < len(results[0].data)
