"""The tables of a store are those that docs/fleet.md describes."""

from __future__ import annotations

import re

import pyarrow as pa

from server.fleet.questions import QUESTIONS
from server.fleet.tables import TABLES
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
