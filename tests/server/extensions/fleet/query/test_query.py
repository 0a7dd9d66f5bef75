"""`imuscope query`: SQL over a store, in four formats, read-only and limited."""

import contextlib
import csv
import io
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pyarrow as pa
import pytest

from imuscope.server.extensions.fleet.store.tables import TABLES
from tests.server.extensions.fleet.store_fixtures import ENDLESS, Commands
from tests.support.each_row import each_row
from tests.support.server_process import ROOT
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until


@pytest.fixture(autouse=True)
def _folder_of_the_store(store: Path) -> None:
    """A question to a folder that does not exist is refused."""
    store.mkdir()


def test_an_empty_store_has_all_tables_without_rows(commands: Commands, store: Path) -> None:
    counts = " UNION ALL ".join(f"SELECT count(*) AS n FROM {table}" for table in TABLES)
    assert commands.query(store, counts) == [{"n": 0}] * len(TABLES)
    long = ["date", "time", "robot", "recording", "device", "message", "signal", "unit", "value"]
    for table, kind in TABLES.items():
        names = long if table == "samples" else [column.name for column in kind.columns]
        status, out, _ = commands.run("query", "--store", store, f"SELECT * FROM {table}", "--format", "csv")
        assert (status, out) == (0, ",".join(names) + "\n")
        assert commands.query(store, f"SELECT * FROM {table}") == []


def test_an_answer_in_each_format(commands: Commands, recording: Path, store: Path) -> None:
    commands.uploaded(recording, store)
    sql = "SELECT robot, started, lost, 'nan'::DOUBLE AS x, [1, 2] AS l, 9007199254740993 AS big FROM recordings"
    expected = {"robot": "otter", "started": "2025-10-09T08:53:20Z", "lost": 5, "x": None, "l": [1, 2]}
    assert commands.query(store, sql) == [{**expected, "big": 9007199254740993}]
    _, out, _ = commands.run("query", "--store", store, sql, "--format", "csv")
    (row,) = csv.DictReader(io.StringIO(out))
    assert row == {**{name: str(value) for name, value in expected.items()}, "x": "", "big": "9007199254740993"}
    _, out, _ = commands.run("query", "--store", store, sql)
    assert [line.split()[0] for line in out.splitlines()] == ["robot", "─────", "otter", "(1"]
    words = [sys.executable, "-m", "imuscope.server.cli", "query", "--store", str(store), sql, "--format", "arrow"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, check=True)
    assert pa.ipc.open_stream(done.stdout).read_all().column("lost").to_pylist() == [5]


def test_rows_of_the_tables_join_by_recording_and_device(commands: Commands, recording: Path, store: Path) -> None:
    commands.uploaded(recording, store)
    sql = """SELECT d.serial_number, l.samples, l.cause FROM losses l JOIN devices d USING (recording, device)
             JOIN recordings r USING (recording) WHERE r.date = DATE '2025-10-09' AND r.started < l.began"""
    assert commands.query(store, sql) == [{"serial_number": "0080800001", "samples": 5, "cause": "unknown"}]


@each_row("value", ["'inf'::DOUBLE", "'-inf'::DOUBLE", "'nan'::FLOAT", "NULL"])
def test_values_that_are_not_finite_are_null(value: str, commands: Commands, store: Path) -> None:
    assert commands.query(store, f"SELECT {value} AS x, [{value}] AS l") == [{"x": None, "l": [None]}]


def test_columns_of_one_name_are_distinguished(commands: Commands, store: Path) -> None:
    (row,) = commands.query(store, "SELECT 1 AS a, 2 AS a, 3 AS b")
    assert sorted(row.values()) == [1, 2, 3]


@each_row(
    ("sql", "words"),
    [
        ("SELEC 1", "syntax error"),
        ("SELECT x FROM recordings", "x"),
        ("SELECT * FROM nothing", "nothing"),
        ("", "empty"),
        ("SELECT 1; SELECT 2", "several statements"),
        ("DROP VIEW recordings", "read-only"),
        ("CREATE TABLE x AS SELECT 1", "read-only"),
        ("COPY (SELECT 1) TO 'x.csv'", "read-only"),
        ("ATTACH 'x.db'", "read-only"),
        ("SET memory_limit = '1TB'", "read-only"),
        ("INSTALL httpfs", "read-only"),
        ("SELECT * FROM read_csv('/etc/hostname')", "disabled"),
        ("SELECT * FROM '/etc/hostname'", ""),
        ("SELECT * FROM read_text('/etc/hostname')", "disabled"),
        ("SELECT * FROM glob('/etc/*')", "disabled"),
        (ENDLESS, "longer than 0.5 s"),
        ("SELECT list(range) FROM range(100000000)", "memory"),
    ],
)
def test_what_cannot_be_answered_is_one_line(sql: str, words: str, commands: Commands, store: Path) -> None:
    limits = ("--timeout", "0.5" if words.startswith("longer") else "0", "--memory", "64")
    assert words in commands.refused("query", "--store", store, sql, *limits)
    assert not any(store.iterdir())


def test_a_question_may_come_from_standard_input(
    commands: Commands, store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("SELECT 1 AS a"))
    assert commands.query(store, "-") == [{"a": 1}]


WORK_S = 0.3  # of one thread besides the first, which imports the modules and waits


def busiest_thread_s(pid: int) -> float:
    """Processor time of a process's busiest thread besides the first."""
    count = 0
    for path in Path(f"/proc/{pid}/task").glob("*/stat"):
        with contextlib.suppress(OSError):  # it has ended
            if path.parent.name != str(pid):
                count = max(count, sum(map(int, path.read_text().rsplit(")", 1)[1].split()[11:13])))
    return count / os.sysconf("SC_CLK_TCK")


def test_a_question_is_cancelled_by_an_interrupt(store: Path, tmp_path: Path) -> None:
    words = [sys.executable, "-m", "imuscope.server.cli", "query", "--store", str(store), ENDLESS]
    process = subprocess.Popen(
        words,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a job in the background ignores it
    )
    try:
        block_until(lambda: busiest_thread_s(process.pid) > WORK_S, "work on the question")
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=PATIENCE_S)
        assert (process.returncode, out) == (130, ""), err
        assert "Traceback" not in err
    finally:
        process.kill()
        process.communicate()


def test_a_table_for_people_is_cut(commands: Commands, store: Path) -> None:
    _, out, _ = commands.run("query", "--store", store, "SELECT range AS n, repeat('x', 100) AS t FROM range(1200)")
    lines = out.splitlines()
    assert len(lines) == 1000 + 3
    assert lines[-1] == "(the first 1000 rows; the other formats have all)"
    assert len(commands.query(store, "SELECT range FROM range(1200)")) == 1200
    assert lines[2].endswith("x…")


def test_json_is_read_by_a_strict_reader(commands: Commands, store: Path) -> None:
    sql = "SELECT 'a\"\n\u2028' AS s, DATE '2025-01-02' AS d, INTERVAL 2 SECOND AS i, 1.5::DECIMAL(4,2) AS c"
    sql += ", {'k': 1} AS o"
    _, out, _ = commands.run("query", "--store", store, sql, "--json")

    def fail(word: str) -> None:
        raise AssertionError(word)

    (row,) = json.loads(out, parse_constant=fail)
    assert row == {"s": 'a"\n\u2028', "d": "2025-01-02", "i": 2.0, "c": 1.5, "o": {"k": 1}}
