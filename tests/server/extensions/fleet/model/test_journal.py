"""The journal of a robot on disk: whatever ends or damages it, the robot goes on, and little or nothing is lost."""

from __future__ import annotations

import errno
import logging
import os
import random
import signal
import sqlite3
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from imuscope.server.extensions.fleet.model import journal as module
from imuscope.server.extensions.fleet.model import journal_files
from imuscope.server.extensions.fleet.model.journal import FOLDER, Journal
from imuscope.server.extensions.fleet.model.journal_files import JOIN_ABOVE, JournalFiles, StoredRun
from imuscope.server.extensions.fleet.model.reports import RobotEvent, RobotStatus, decode_journal
from tests.support.free_ports import free_port
from tests.support.server_process import ROOT, ServerProcess, tied
from tests.support.timeouts import get
from tests.support.waiting import block_until

LIMIT = 10**6

REPORTS_FOR_EVER = """
import sys, time
from pathlib import Path
from imuscope.server.extensions.fleet.model import journal as module
from imuscope.server.extensions.fleet.model.journal import Journal
from imuscope.server.extensions.fleet.model.reports import RobotEvent
module.WRITE_S = 0.05
journal = Journal(folder=Path(sys.argv[1]))
journal.start()
print(journal.boot, flush=True)
while True:
    journal.add_event(RobotEvent(1.0, "marker", "info", "x" * 100))
    journal.report(1.0, None)
    time.sleep(0.001)
"""


@pytest.fixture(autouse=True)
def written_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reports are not collected for a second before they are written."""
    monkeypatch.setattr(module, "WRITE_S", 0.01)


def happens(journal: Journal, text: str) -> None:
    journal.add_event(RobotEvent(1.0, "marker", "info", text))
    journal.report(1.0, RobotStatus(version=text))


def stored(folder: Path) -> dict[str, list[int]]:
    """Numbers of the reports on disk, by run, oldest run first."""
    return {run.boot: [number for number, _ in run.reports] for run in JournalFiles(folder, LIMIT).load()}


def started(folder: Path, limit: int = LIMIT) -> Journal:
    journal = Journal(limit, folder)
    journal.start()
    journal.wait_loaded()
    return journal


def texts(journal: Journal, boot: str = "", after: int = 0) -> list[str]:
    """What a fleet server that has nothing would store."""
    results: list[str] = []
    while True:
        answer = decode_journal(journal.answer(boot, after, 400, earlier=True))
        results += [event.text for report in answer.reports for event in report.events]
        boot, after = answer.boot, max(after if answer.boot == boot else 0, *(one.number for one in answer.reports), 0)
        if after >= answer.last:
            if not answer.following:
                return results
            boot, after = answer.following, 0


def test_killed_at_any_moment_what_was_written_is_there(tmp_path: Path) -> None:
    chance = random.Random(16)
    boots: list[str] = []
    for _ in range(3):
        command = tied([sys.executable, "-c", REPORTS_FOR_EVER, str(tmp_path)])
        with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            boots.append(process.stdout.readline().strip())
            at_least = chance.randrange(1, 300)
            block_until(lambda: len(stored(tmp_path).get(boots[-1], [])) >= at_least, "reports are on disk")  # noqa: B023
            process.send_signal(signal.SIGKILL)
        results = stored(tmp_path)
        assert list(results) == boots
        assert len(results[boots[-1]]) >= at_least
        assert all(numbers == list(range(1, len(numbers) + 1)) for numbers in results.values())


def test_a_robot_that_restarts_has_its_earlier_runs(tmp_path: Path) -> None:
    for run in range(3):
        journal = started(tmp_path)
        for number in range(3):
            happens(journal, f"{run}.{number}")
        journal.close()
    journal = started(tmp_path)
    happens(journal, "3.0")
    assert texts(journal) == [f"{run}.{number}" for run in range(3) for number in range(3)] + ["3.0"]
    journal.close()


def test_what_the_fleet_server_has_on_its_disk_is_removed(tmp_path: Path) -> None:
    first = started(tmp_path)
    happens(first, "a")
    happens(first, "b")
    first.close()
    second = started(tmp_path)
    happens(second, "c")
    second.answer(first.boot, 1, earlier=True, stored=f"{first.boot}.1")
    assert texts(second) == ["b", "c"]
    second.answer(second.boot, 1, earlier=True, stored=f"{second.boot}.1")
    block_until(lambda: first.boot not in stored(tmp_path), "the file of the earlier run is removed")
    assert texts(second) == ["c"]
    second.close()


def test_a_robot_to_which_nothing_happens_writes_nothing(tmp_path: Path) -> None:
    journal = started(tmp_path)
    for number in range(100):
        journal.report(1.0, RobotStatus(version=str(number)))
    journal.close()
    assert list(tmp_path.iterdir()) == []


def test_the_files_are_bounded(tmp_path: Path) -> None:
    journal = started(tmp_path, limit=20_000)
    for number in range(600):
        happens(journal, f"{number:050}")
        if number % 20 == 0:
            block_until(lambda: not journal._unwritten, "they are written")
    journal.close()
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= 20_000
    again = started(tmp_path, limit=20_000)
    results = texts(again)
    assert results == [f"{number:050}" for number in range(600 - len(results), 600)]
    assert len(results) > 50
    again.close()


def test_many_restarts_make_few_files(tmp_path: Path) -> None:
    for number in range(JOIN_ABOVE + 3):
        files = JournalFiles(tmp_path, LIMIT)
        files.load()
        journal = Journal()
        happens(journal, str(number))
        files.append(journal.boot, journal._runs[0].reports, 0)
        files.close()
    assert len(list(tmp_path.iterdir())) < JOIN_ABOVE
    journal = started(tmp_path)
    assert texts(journal) == [str(number) for number in range(JOIN_ABOVE + 3)]
    journal.close()


def test_files_that_were_joined_when_the_robot_was_killed_count_once(tmp_path: Path) -> None:
    files = JournalFiles(tmp_path, LIMIT)
    for boot in ("a" * 16, "b" * 16):
        journal = Journal()
        journal.boot = boot
        happens(journal, boot)
        files.append(boot, journal._runs[0].reports, 0)
    files.close()
    old = sorted(tmp_path.iterdir())[0]
    copy = old.read_bytes()
    again = JournalFiles(tmp_path, LIMIT)
    again._join(again.load())
    old.write_bytes(copy)
    assert stored(tmp_path) == {"a" * 16: [1], "b" * 16: [1]}


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40, deadline=None)
@given(
    cut=st.floats(0, 1), flips=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(1, 255)), max_size=3)
)
def test_a_damaged_file_gives_what_is_before_the_damage(
    cut: float, flips: list[tuple[float, int]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("journal")
    journal = Journal()
    for number in range(1, 11):
        happens(journal, str(number))
    files = JournalFiles(folder, LIMIT)
    files.append(journal.boot, journal._runs[0].reports, 0)
    files.close()
    path = next(folder.iterdir())
    data = bytearray(path.read_bytes())
    whole = bytes(data)
    for place, value in flips:
        data[int(place * len(data))] ^= value
    del data[int(cut * len(data)) :]
    path.write_bytes(bytes(data))
    results: list[StoredRun] = JournalFiles(folder, LIMIT).load()
    numbers = [number for run in results for number, _ in run.reports]
    assert numbers == list(range(1, len(numbers) + 1))
    if bytes(data) == whole:
        assert len(numbers) == 10
    again = started(folder)
    happens(again, "after")
    assert texts(again)[-1] == "after"
    again.close()
    assert again.boot in stored(folder)


def test_a_full_disk_is_reported_once_and_written_to_when_there_is_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(module, "RETRY_S", 0.01)
    attempts: Counter[str] = Counter()

    def full(handle: int, data: bytes) -> None:
        attempts["write"] += 1
        os.write(handle, data[: len(data) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    whole = journal_files._write
    monkeypatch.setattr(journal_files, "_write", full)
    with caplog.at_level(logging.WARNING, "imuscope.fleet"):
        journal = started(tmp_path)
        for number in range(5):
            happens(journal, str(number))
        block_until(lambda: attempts["write"] > 3, "the disk was tried again")
        assert texts(journal) == ["0", "1", "2", "3", "4"]
        assert [record.getMessage() for record in caplog.records if "No space left" in record.getMessage()] == [
            f"The journal for the fleet cannot be written to {tmp_path}: No space left on device. "
            "It is kept in memory until then."
        ]
        monkeypatch.setattr(journal_files, "_write", whole)
        block_until(lambda: stored(tmp_path) == {journal.boot: [1, 2, 3, 4, 5]}, "they are on disk")
    journal.close()


def test_a_robot_that_was_killed_while_its_line_was_away_loses_nothing(tmp_path: Path) -> None:
    bus = f"tcp/127.0.0.1:{free_port()}"
    config = tmp_path / "robot.toml"
    config.write_text(f'[fleet]\nrouter = "{bus}"\nname = "otter-7"\n')
    folder = tmp_path / "robot" / FOLDER

    def robot() -> ServerProcess:
        return ServerProcess("sim:xbus?rate=5", data=tmp_path / "robot", arguments=("--config", str(config)))

    runs: dict[str, list[int]] = {}
    for count in (1, 2):
        with robot() as server:
            block_until(lambda: len(stored(folder)) == count, "events of this run are on disk")  # noqa: B023
            os.kill(server.process.pid, signal.SIGKILL)
            server.process.wait()
        runs = stored(folder)
    database = tmp_path / "fleet" / "fleet" / "fleet.sqlite"

    def received() -> dict[str, list[int]]:
        file = sqlite3.connect(database)
        rows = file.execute("SELECT DISTINCT boot, number FROM events WHERE number > 0 ORDER BY id").fetchall()
        file.close()
        results: dict[str, list[int]] = {}
        for boot, number in rows:
            results.setdefault(boot, []).append(number)
        return results

    with ServerProcess(data=tmp_path / "fleet", arguments=("--listen", bus), command="fleet") as server, robot():
        block_until(lambda: len(received()) == 3, "the events of all runs are stored")
        assert {boot: numbers for boot, numbers in received().items() if boot in runs} == runs
        assert list(received())[:2] == list(runs)
        assert get(f"{server.url}/api/fleet/robots").json()["robots"][0]["state"] == "live"
        os.kill(server.process.pid, signal.SIGKILL)
        server.process.wait()
    with ServerProcess(data=tmp_path / "fleet", arguments=("--listen", bus), command="fleet"), robot():
        block_until(lambda: len(received()) >= 4, "the next run has joined")
    file = sqlite3.connect(database)
    rows = file.execute("SELECT boot, number, time, text FROM events WHERE number > 0").fetchall()
    file.close()
    assert [row for row, times in Counter(rows).items() if times > 1] == []


def test_a_file_that_was_cut_anywhere_gives_what_is_whole(tmp_path: Path) -> None:
    journal = Journal()
    for number in range(1, 4):
        happens(journal, str(number))
    files = JournalFiles(tmp_path / "whole", LIMIT)
    files.append(journal.boot, journal._runs[0].reports, 0)
    files.close()
    [path] = (tmp_path / "whole").iterdir()
    data, result = path.read_bytes(), []
    for end in range(len(data)):
        path.write_bytes(data[:end])
        result.append(sum(len(run.reports) for run in JournalFiles(tmp_path / "whole", LIMIT).load()))
    assert result == sorted(result)
    assert set(result) == {0, 1, 2}
