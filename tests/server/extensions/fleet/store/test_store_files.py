"""Files of a store as questions read them: with columns that some lack, in folders of any name, and no others."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
from deltalake import DeltaTable, write_deltalake

from imuscope.server.extensions.fleet.query.query import files_of
from imuscope.server.extensions.fleet.store.delta_dataset import dataset_of
from imuscope.server.extensions.fleet.store.delta_tables import open_table
from imuscope.server.extensions.fleet.store.store import StoreLocation, location
from imuscope.server.extensions.fleet.store.tables import DEVICES, RECORDINGS, SAMPLES, TABLES
from tests.server.extensions.fleet.store_fixtures import Commands, delta
from tests.support.each_row import each_row


def files_in(store: Path, table: str) -> list[Path]:
    """Parquet files of a table."""
    return sorted((store / "tables" / table).rglob("*.parquet"))


def without(store: Path, table: str, column: str) -> None:
    """Write a table again as an older version had it, without a column."""
    rows = delta(store, table).drop_columns([column])
    folder = store / "tables" / table
    write_deltalake(str(folder), rows, mode="overwrite", schema_mode="overwrite", partition_by=["date"])


def test_both_readers_give_the_same_rows(commands: Commands, recording: Path, store: Path) -> None:
    commands.uploaded(recording, store, "a")
    commands.upload(recording, store, "b")
    for table in ("recordings", "devices", "events", "losses", "minutes"):
        _assert_read_alike(table, commands, store)


def _assert_read_alike(table: str, commands: Commands, store: Path) -> None:
    place, kind = location(str(store)), TABLES[table]
    result = open_table(place, table)
    assert result is not None
    files = files_of(place, result, kind)
    assert files is not None
    assert not files.differ
    names = [column.name for column in kind.columns]
    rows = dataset_of(place, result, kind).to_table(columns=names)
    sql = f"SELECT * FROM {table} ORDER BY ALL"
    assert len(commands.query(store, sql)) == rows.num_rows > 0
    moved = store.rename(store.with_name("date=1"))  # which DuckDB would take for a partition
    assert files_of(StoreLocation(str(moved), moved), DeltaTable(str(moved / "tables" / table)), kind) is None
    again = commands.query(moved, sql)
    moved.rename(store)
    assert again == commands.query(store, sql)


def test_a_column_that_older_files_lack_is_null(commands: Commands, recording: Path, store: Path) -> None:
    commands.uploaded(recording, store, "old")
    for table, column in (("recordings", "host"), ("devices", "firmware")):
        without(store, table, column)
    assert commands.query(store, "SELECT host, firmware FROM recordings JOIN devices USING (recording)") == [
        {"host": None, "firmware": None}
    ]
    commands.upload(recording, store, "new")
    sql = "SELECT robot FROM {} WHERE {} IS NOT NULL"
    assert commands.query(store, sql.format("recordings", "host")) == [{"robot": "new"}]
    assert commands.query(store, sql.format("devices", "firmware")) == [{"robot": "new"}]
    assert commands.query(store, "SELECT robot FROM recordings WHERE host IS NULL") == [{"robot": "old"}]
    place = location(str(store))
    for kind in (RECORDINGS, DEVICES):
        result = open_table(place, kind.name)
        assert result is not None
        files = files_of(place, result, kind)
        assert files is not None
        assert files.differ


@each_row("name", ["robot=x", "it's & ü", "{1}"])
def test_a_folder_may_have_any_name(name: str, commands: Commands, recording: Path, tmp_path: Path) -> None:
    store = tmp_path / name
    commands.uploaded(recording, store, "otter 7 (ü)")
    sql = "SELECT r.robot, d.robot AS same FROM recordings r JOIN devices d USING (recording)"
    assert commands.query(store, sql) == [{"robot": "otter 7 (ü)", "same": "otter 7 (ü)"}]
    (rows,) = commands.query(store, "SELECT count(*) AS n FROM samples_wide WHERE robot = 'otter 7 (ü)'")
    assert rows == {"n": delta(store, "samples").num_rows}


def test_other_files_stay_closed(commands: Commands, recording: Path, store: Path) -> None:
    commands.uploaded(recording, store)
    stray = store / "tables" / "recordings" / "stray.parquet"
    stray.write_bytes(files_in(store, "recordings")[0].read_bytes())
    for path in (
        stray,
        store / "tables" / "*" / "*" / "*.parquet",
        stray.parent / "date=2025-10-09" / ".." / stray.name,
    ):
        message = commands.refused("query", "--store", store, f"SELECT * FROM read_parquet('{path}') r, recordings")
        assert "disabled" in message


STATEMENTS = """robot" AS "zq" FROM stored_recordings;
    COPY (SELECT content FROM read_text('{secret}')) TO '{copy}'; CREATE VIEW zz AS SELECT robot AS "y"""
NAMES = ("a b", 'a"b', "Added", "", "a\nb", "--", ";", "%s", "ü", "recording")


def add_columns(store: Path, table: str, *names: str) -> None:
    """Write columns of these names, as any robot may, which may write to the store."""
    some = delta(store, table).slice(0, 1)
    for name in names:
        if name not in some.column_names:
            some = some.append_column(pa.field(name, pa.string()), pa.array(["v"]))
    write_deltalake(str(store / "tables" / table), some, mode="append", schema_mode="merge")


def test_the_name_of_a_column_is_no_statement(commands: Commands, recording: Path, store: Path, tmp_path: Path) -> None:
    """It was: whoever asked a question read and wrote files for the robot that had chosen the name."""
    (tmp_path / "secret").write_text("hidden")
    name = STATEMENTS.format(secret=tmp_path / "secret", copy=tmp_path / "copy.csv")
    for table in ("recordings", "devices", "samples"):
        commands.uploaded(recording, tmp_path / table)
        add_columns(tmp_path / table, table, name.replace("\n", " "), name)
        commands.query(tmp_path / table, "SELECT * FROM recordings JOIN devices USING (recording)")
        commands.query(tmp_path / table, "SELECT * FROM samples")
    assert not (tmp_path / "copy.csv").exists()


def test_columns_of_odd_names_cost_only_themselves(commands: Commands, recording: Path, store: Path) -> None:
    commands.uploaded(recording, store)
    for table in ("recordings", "samples"):
        add_columns(store, table, *NAMES)
    assert commands.query(store, "SELECT count(*) AS n FROM recordings") == [{"n": 2}]
    (row,) = commands.query(store, "SELECT * FROM recordings ORDER BY ALL LIMIT 1")
    assert {column.name for column in RECORDINGS.columns} <= set(row)
    assert commands.query(store, "SELECT count(*) > 600 AS many FROM samples") == [{"many": True}]


def test_a_file_that_is_gone_or_cut_is_named_in_one_line(commands: Commands, recording: Path, store: Path) -> None:
    commands.uploaded(recording, store)
    for table in ("recordings", "samples"):
        (path,) = files_in(store, table)
        content = path.read_bytes()
        path.write_bytes(content[:10])
        assert path.name in commands.refused("query", "--store", store, f"SELECT * FROM {table}")
        path.unlink()
        assert path.name in commands.refused("query", "--store", store, f"SELECT * FROM {table}")
        path.write_bytes(content)


def test_a_table_with_deletion_vectors_is_refused(commands: Commands, recording: Path, store: Path) -> None:
    commands.uploaded(recording, store)
    folder = store / "tables" / "recordings"
    table = DeltaTable(str(folder))
    table.alter.set_table_properties({"delta.enableDeletionVectors": "true"})
    assert "deletionVectors" in commands.refused("query", "--store", store, "SELECT * FROM recordings")


def test_an_unfinished_upload_is_left_out_by_both_readers(commands: Commands, recording: Path, store: Path) -> None:
    commands.uploaded(recording, store)
    for kind in (DEVICES, SAMPLES):
        rows = delta(store, kind.name)
        at = rows.schema.get_field_index("recording")
        other = rows.set_column(at, rows.schema.field(at), pa.array(["other"] * rows.num_rows))
        write_deltalake(str(store / "tables" / kind.name), other, mode="append")
    assert commands.query(store, "SELECT count(*) AS n FROM devices") == [{"n": 1}]
    assert commands.query(store, "SELECT count(*) AS n FROM samples_wide WHERE recording = 'other'") == [{"n": 0}]


@each_row("name", ["a[b", "a]b", "a^b", "a|b", "a\\b", "a%20b", "a%5Bb"])
def test_a_folder_whose_name_means_another_is_refused(
    name: str, commands: Commands, recording: Path, tmp_path: Path
) -> None:
    folder = tmp_path / name
    for words in (("upload", recording, "--robot", "otter"), ("query", "SELECT 1")):
        assert "the path of a store cannot have" in commands.refused(*words, "--store", folder)
    assert not folder.exists()


@each_row("name", ["a*b?{b}", "a b=b#", "100% a%zz é'\"<&>;"])
def test_a_folder_of_any_other_name_is_a_store(name: str, commands: Commands, recording: Path, tmp_path: Path) -> None:
    commands.upload(recording, tmp_path / name)
    sql = "SELECT count(*) > 0 AS found FROM minutes, recordings, (SELECT max(time) FROM samples_wide)"
    assert commands.query(tmp_path / name, sql) == [{"found": True}]
