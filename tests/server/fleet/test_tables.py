"""The tables of a store are those that docs/fleet.md describes."""

from __future__ import annotations

import re
from pathlib import Path

import pyarrow as pa

from server.fleet.questions import QUESTIONS
from server.fleet.tables import TABLES
from tests.recordings.recorded_drive import drive
from tests.server.fleet.store_fixtures import Commands
from tests.server_process import ROOT

WORDS = {pa.string(): "text", pa.float64(): "real", pa.int64(): "integer", pa.date32(): "date"}


def test_the_document_has_every_table_and_column() -> None:
    text = (ROOT / "docs" / "fleet.md").read_text()
    for table in TABLES.values():
        part = text.split(f"\n### {table.name}\n", 1)[1].split("\n#", 1)[0]
        rows = re.findall(r"^\| `(\w+)` \| (\w+) \| (.+) \|$", part, re.MULTILINE)
        assert rows == [(one.name, WORDS.get(one.type, "time"), one.doc) for one in table.columns]
        assert f"Partitioned by {' and '.join(table.partitions)}." in part


def test_the_document_has_every_prepared_question() -> None:
    text = (ROOT / "docs" / "fleet.md").read_text()
    assert re.findall(r"^\| `--question ([\w-]+)` \| (.+) \|$", text, re.MULTILINE) == [
        (name, one.title.replace("|", "\\|")) for name, one in QUESTIONS.items()
    ]


def test_compacted_tables_answer_the_same_and_remember_what_was_uploaded(
    commands: Commands, store: Path, tmp_path: Path
) -> None:
    """The lines of docs/fleet.md that join small files, run as they stand there."""
    for n, seconds in enumerate((1.0, 1.5, 2.0)):
        drive(tmp_path / f"{n}.mcap", seconds=seconds)
        commands.upload(tmp_path / f"{n}.mcap", store)
    questions = (
        "SELECT * FROM recordings ORDER BY recording",
        "SELECT * FROM minutes ORDER BY ALL",
        "SELECT signal, count(*), min(value), max(value) FROM samples GROUP BY signal ORDER BY signal",
    )
    before = [commands.query(store, sql) for sql in questions]
    text = (ROOT / "docs" / "fleet.md").read_text()
    (code,) = [one for one in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "compact" in one]
    files = len(list((store / "tables").rglob("*.parquet")))
    exec(code.replace("/srv/drives", str(store)))
    assert len(list((store / "tables").rglob("*.parquet"))) > files  # old files stay for who reads them now
    assert [commands.query(store, sql) for sql in questions] == before
    assert "was uploaded before" in commands.upload(tmp_path / "1.mcap", store)
    assert [commands.query(store, sql) for sql in questions] == before
