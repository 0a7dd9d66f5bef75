"""Everything that the tables describe is recorded, opened, exported to every format and read back.

    tables ──> frames (every_message.py) ──> recording ──> columns ──> each format ──> its reader ──> numbers

One item that cannot be shown or exported must not cost the others: a data set with more values than columns once cost
the whole recording.
"""

import csv
import functools
import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader

from imuscope.protocols.events import Batch
from imuscope.protocols.xbus.data_identifiers import ITEMS
from imuscope.recordings.columns.store import ColumnStore
from imuscope.recordings.exporters import FORMATS, ExportRequest, export
from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.mcap.writer import McapWriter
from imuscope.server.devices.decode.decode_options import DecodeOptions, checked_options
from imuscope.server.devices.decode.protocol_set import all_protocols
from imuscope.server.library.decode import decode
from tests.recordings import every_message
from tests.recordings.recorded_drive import START
from tests.server.extensions.rerun.rrd_tables import entities
from tests.support.each_row import each_row

FAMILIES: Mapping[str, Callable[[], Iterator[every_message.Case]]] = {
    "xbus": every_message.xbus,
    "isb": every_message.isb,
    "idtp": every_message.idtp,
}
OWN_BYTES = {"xbus": "mtb", "isb": "raw"}  # formats with the bytes of one family
SERIES = ("csv", "parquet", "mcap", "rrd")
_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")
Columns = list[tuple[str, tuple[float, ...]]]  # name and finite numbers


@functools.cache
def cases(family: str) -> tuple[every_message.Case, ...]:
    return tuple(FAMILIES[family]())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("every_message")


def options(family: str) -> DecodeOptions:
    values = {"schema": every_message.SCHEMA} if family == "idtp" else {}
    return checked_options(family, values)


@functools.cache
def opened(family: str, folder: Path, *, has_others: bool = False) -> tuple[ColumnStore, Path]:
    """A recording with every frame, a frame in 10 ms, and its columns.

    Args:
        has_others: with frames of another size after them.
    """
    path = folder / f"{family}{'-others' * has_others}.mcap"
    writer = McapWriter(path, {"title": family})
    writer.device("1", {"source": "/dev/ttyUSB0", "link": "serial", "baud": 921600, "protocol": family})
    others = every_message.other_versions(family) if has_others else ()
    for number, (_, frame) in enumerate((*cases(family), *others), 1):
        writer.chunk("1", "rx", frame, START + number * 10_000_000)
    writer.close()
    return decode(open_file(path, family), path.with_suffix(".columns"), all_protocols(), options(family)), path


def brief(values: Any) -> tuple[float, ...]:
    """Finite numbers to six digits, ascending: formats order rows by another time."""
    every = np.asarray(values, np.float64).ravel()
    return tuple(sorted(float(f"{value:.6g}") for value in every[np.isfinite(every)].tolist()))


def stored(columns: ColumnStore) -> Columns:
    """Every column of every channel: its channel's name, its own, its numbers."""
    results: Columns = []
    for info in columns.manifest["channels"]:
        rows = columns.exact(info["id"], 0, columns.rows(info["id"]))
        names = [one["name"] for one in info["columns"]]
        assert len(names) == len(rows.columns)
        for name, values in zip(names, rows.columns, strict=True):
            results.append((name if name != "value" else info["name"], brief(values)))
    return results


# -- what is in a file, by readers of others ---------------------------------------------------------------------------


def csv_columns(files: list[Path]) -> Columns:
    results: Columns = []
    for path in files:
        with path.open(encoding="utf-8", newline="") as file:
            head, *rows = csv.reader(line for line in file if not line.startswith("#"))
        for at, name in enumerate(head):
            results.append((name, brief([float(row[at]) for row in rows if _NUMBER.fullmatch(row[at])])))
    return results


def parquet_columns(files: list[Path]) -> Columns:
    results: Columns = []
    for path in files:
        table = pq.read_table(path)
        for name, column in zip(table.column_names, table.columns, strict=True):
            if not pa.types.is_string(column.type) and not pa.types.is_binary(column.type):
                results.append((name, brief(column.drop_null().to_numpy(zero_copy_only=False))))
    return results


def mcap_columns(files: list[Path]) -> Columns:
    results: dict[tuple[str, str], list[float]] = {}
    (path,) = files
    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            body = json.loads(message.data) if channel.message_encoding == "json" else {}
            for name, value in numbers_in(body):
                results.setdefault((channel.topic, name), []).append(value)
    return [(f"{topic}.{name}", brief(values)) for (topic, name), values in results.items()]


def numbers_in(body: Any, name: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(body, Mapping):
        for key, value in body.items():
            yield from numbers_in(value, name if key == "rows" else key)
    elif isinstance(body, list):
        for value in body:
            yield from numbers_in(value, name)
    elif isinstance(body, (int, float)):
        yield name, float(body)


def rrd_columns(files: list[Path]) -> Columns:
    (path,) = files
    results: Columns = []
    for entity, batches in entities(path).items():
        for name in {name for batch in batches for name in batch.schema.names if "Scalars" in name}:
            lists = [
                list(row or ()) for batch in batches if name in batch.schema.names for row in batch[name].to_pylist()
            ]
            for at in range(max(map(len, lists), default=0)):
                results.append((entity, brief([row[at] for row in lists if at < len(row)])))
            results.append((entity, brief([value for row in lists for value in row])))  # a table: rows of one time
    return results


READERS: Mapping[str, Callable[[list[Path]], Columns]] = {
    "csv": csv_columns,
    "parquet": parquet_columns,
    "mcap": mcap_columns,
    "rrd": rrd_columns,
}

# -- the tests ---------------------------------------------------------------------------------------------------------


@each_row("family", list(FAMILIES))
def test_every_message_is_decoded_without_a_reject(family: str, folder: Path) -> None:
    columns, _ = opened(family, folder)
    assert [event for event in columns.manifest["events"] if event["kind"] in ("reject", "gap")] == []
    decoder = all_protocols().decoder(family, options(family), "serial")
    for name, frame in cases(family):
        decoder.feed(frame, 0)
        assert decoder.drain(), name


@each_row("family", list(FAMILIES))
def test_every_quantity_has_a_channel(family: str, folder: Path) -> None:
    columns, _ = opened(family, folder)
    manifest = columns.manifest
    names = {info["name"] for info in (*manifest["channels"], *manifest["payloads"])}
    if family == "xbus":
        assert {row.name for row in ITEMS} <= names
    decoder = all_protocols().decoder(family, options(family), "serial")
    decoder.feed(b"".join(frame for _, frame in cases(family)), 0)
    shown = [event for event in decoder.drain(stalled=True) if isinstance(event, Batch)]
    assert shown
    messages = {info["message"] for info in (*manifest["channels"], *manifest["payloads"])}
    for batch in shown:
        numeric = [one for one in batch.message.fields if one.fields or one.dtype not in ("ascii", "bytes")]
        assert not numeric or batch.message.name in messages, batch.message.name


def _last(name: str) -> str:
    """The last part of a heading, without its unit."""
    return re.sub(r" [(].*$", "", name).rpartition(".")[2]


@each_row("export_format", SERIES)
@each_row("family", list(FAMILIES))
def test_every_number_is_read_back_from_every_format(family: str, export_format: str, folder: Path) -> None:
    """Also of what frames of another size gave."""
    columns, path = opened(family, folder, has_others=True)
    files = export(
        export_format, ExportRequest(columns, path), folder / f"{family}-{export_format}{FORMATS[export_format].suffix}"
    )
    every = READERS[export_format](files)
    together: dict[str, tuple[float, ...]] = {}  # a message of several firmwares is in several files
    for name, values in every:
        together[name] = (*together.get(name, ()), *values)
    back = {values for _, values in every} | {brief(values) for values in together.values()}
    joined: dict[str, list[Counter[float]]] = {}  # layouts of a message that stand in one column
    for name, values in every:
        joined.setdefault(_last(name), []).append(Counter(values))
    missing = [
        name
        for name, values in stored(columns)
        if values and values not in back and not any(Counter(values) <= one for one in joined.get(_last(name), ()))
    ]
    assert missing == []


@each_row("export_format", ("csv", "parquet"))
@each_row("family", list(FAMILIES))
def test_no_layout_of_a_message_begins_columns_of_its_own(family: str, export_format: str, folder: Path) -> None:
    """Absence is a value: a second layout, a part of a data set and a second rotation were columns "#2"."""
    columns, path = opened(family, folder)
    suffix = FORMATS[export_format].suffix
    files = export(export_format, ExportRequest(columns, path), folder / f"{family}-{export_format}-again{suffix}")
    assert [name for name, _ in READERS[export_format](files) if " #" in name] == []


@each_row("export_format", sorted(name for name, one in FORMATS.items() if one.needs_source or name == "csv-aligned"))
@each_row("family", list(FAMILIES))
def test_every_other_format_has_all(family: str, export_format: str, folder: Path) -> None:
    """Aligned lines have a heading for each column; formats of bytes have the frames themselves."""
    if export_format in OWN_BYTES.values() and OWN_BYTES.get(family) != export_format:
        return  # of another family
    columns, path = opened(family, folder)
    (made,) = export(
        export_format, ExportRequest(columns, path), folder / f"{family}-{export_format}{FORMATS[export_format].suffix}"
    )
    if export_format == "csv-aligned":
        headings = [name for name, _ in csv_columns([made])]
        assert len(headings) == len(set(headings))
        tables = [info for info in columns.manifest["channels"] if info["kind"] == "table"]
        assert len(headings) - 2 >= len(stored(columns)) - sum(len(info["columns"]) for info in tables)
        (rule,) = [line for line in made.read_text().splitlines() if line.startswith("# A line for each sample")]
        assert all(info["name"] in rule for info in tables)
        return
    assert made.read_bytes().endswith(cases(family)[-1][1]) or export_format == "raw"
    again = decode(
        open_file(made, family), folder / f"{family}-{export_format}.columns", all_protocols(), options(family)
    )
    assert sorted(stored(again)) == sorted(stored(columns))


@each_row("family", list(FAMILIES))
def test_a_message_of_another_version_costs_no_other(family: str, folder: Path) -> None:
    """Between frames of another size, all that is known has the numbers that it has without them."""
    columns, _ = opened(family, folder, has_others=True)
    names = {info["name"] for info in columns.manifest["channels"]}
    assert {info["name"] for info in opened(family, folder)[0].manifest["channels"]} <= names
