"""Worker processes of the library: reports, failures and shutdown."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from imuscope.recordings.errors import RecordingError
from imuscope.server.system.workers import Worker
from tests.support.each_row import each_row

ECHO = "import json, sys; print(json.dumps({'asked': json.load(sys.stdin), 'words': sys.argv[1:]}))"
CUT_SHORT = """import os; print('{"progress": 0.5}\\n{"prog', end="", flush=True); os._exit(3)"""
REFUSES = """import sys; sys.stdin.read(); print('{"message": "It is damaged.", "hint": "Copy it again."}')"""
WAITS = """import signal, sys
signal.signal(signal.SIGTERM, lambda *_: sys.exit(7))
print('{"is_ready": true}', flush=True)
sys.stdin.read()"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], str]:
    """Make a module that a worker can run; its name."""
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))

    def made(source: str) -> str:
        (tmp_path / "worker_of_a_test.py").write_text(source)
        return "worker_of_a_test"

    return made


async def test_it_answers_requests(module: Callable[[str], str]) -> None:
    worker = await Worker.start(module(ECHO))
    worker.request({"path": "ä.mcap"})
    assert [report async for report in worker] == [{"asked": {"path": "ä.mcap"}, "words": []}]
    assert await worker.wait() == 0
    assert not worker.is_running


async def test_an_unfinished_line_is_not_reported(module: Callable[[str], str]) -> None:
    worker = await Worker.start(module(CUT_SHORT), "a word")
    assert [report async for report in worker] == [{"progress": 0.5}]
    assert await worker.wait() == 3


async def test_a_message_and_a_hint_are_its_failure(module: Callable[[str], str]) -> None:
    worker = await Worker.start(module(REFUSES))
    worker.request({})
    with pytest.raises(RecordingError, match=r"It is damaged\.") as failed:
        await anext(worker)
    assert failed.value.hint == "Copy it again."
    await worker.end()


@each_row(("patience_s", "status"), [(10.0, 7), (0.0, -signal.SIGKILL)])
async def test_it_ends_with_time_to_clean_up_or_at_once(
    module: Callable[[str], str], patience_s: float, status: int
) -> None:
    worker = await Worker.start(module(WAITS))
    assert await anext(worker) == {"is_ready": True}
    await worker.end(patience_s)
    assert await worker.wait() == status


async def test_an_unused_one_ends_when_dismissed(module: Callable[[str], str]) -> None:
    worker = await Worker.start(module(WAITS))
    worker.dismiss()
    assert await worker.wait() == 0
