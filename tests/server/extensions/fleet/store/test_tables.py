"""The tables of a store are those that docs/fleet.md describes."""

from __future__ import annotations

import json
import re

import pyarrow as pa

from imuscope.server.extensions.fleet.query.prepared_queries import QUESTIONS
from imuscope.server.extensions.fleet.store.tables import TABLES
from tests.support.each_row import each_row
from tests.support.server_process import ROOT

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


@each_row("section", ["Many recordings", "Scale"])
def test_every_table_of_figures_has_a_benchmark_and_its_result(section: str) -> None:
    """A claim on paper, and one that no benchmark measured, were among them."""
    text = (ROOT / "docs" / "fleet.md").read_text()
    body = re.split(
        r"^#+ ", re.split(rf"^#+ {section}\n", text, maxsplit=1, flags=re.MULTILINE)[1], maxsplit=1, flags=re.MULTILINE
    )[0]
    tables = len(re.findall(r"^\|[-|]+\|$", body, re.MULTILINE))
    named = re.findall(r"tests[./]bench[./](\w+)", body)
    assert len(named) == len(set(named)) == tables > 0
    for name in named:
        assert (ROOT / "tests" / "bench" / f"{name}.py").is_file()
        assert (ROOT / "tests" / "bench" / "results" / f"{name.replace('_', '-')}.json").is_file()


def test_the_delay_of_live_pages_is_the_measured_one() -> None:
    text = (ROOT / "docs" / "fleet.md").read_text()
    document = json.loads((ROOT / "tests" / "bench" / "results" / "fleet-streams.json").read_text())
    assert (document["robots"], document["browsers"], document["rate_hz"], document["missing"]) == (50, 20, 1000, 0)
    assert document["p99_ms"] <= document["budget"]["p99_ms"] == 150
    assert f"| from the robot to the browser, p99 | {document['p99_ms']:.0f} ms |" in text
