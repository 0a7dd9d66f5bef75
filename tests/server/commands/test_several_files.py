"""Several files of one command: the output of each as if it were alone, in the order given."""

import json
from pathlib import Path

import pytest

from imuscope.protocols.idtp.simulator import IdtpSimulator
from imuscope.server.cli import main
from tests.support.each_row import each_row


@pytest.fixture
def tables(tmp_path: Path) -> list[str]:
    for name, factor in (("a", 1), ("b", 2)):
        rows = (f"{1.5e9 + k / 10:.1f},{factor * k % 7}" for k in range(50))
        (tmp_path / f"{name}.csv").write_text("\n".join(["time (s),x", *rows]))
    return [str(tmp_path / "a.csv"), str(tmp_path / "b.csv")]


def printed(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    capsys.readouterr()
    assert main(words) == 0, capsys.readouterr().err
    return capsys.readouterr().out


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert main(words) == 1
    return capsys.readouterr().err


def test_frames_of_several_files_are_listed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, seconds in (("a", 1), ("b", 2)):
        (tmp_path / f"{name}.bin").write_bytes(IdtpSimulator().advance(seconds * 100_000_000))
    files = [str(tmp_path / "a.bin"), str(tmp_path / "b.bin")]
    for words in (["--json"], ["--json", "--rejects"]):
        alone = [printed(capsys, "inspect", file, *words) for file in files]
        assert printed(capsys, "inspect", *files, *words) == "".join(alone)
    alone = [f"{file}:\n{printed(capsys, 'inspect', file)}" for file in files]
    assert printed(capsys, "inspect", *files) == "".join(alone)


@each_row("words", [("analyse", "statistics"), ("time",)])
def test_json_of_each_is_a_line_as_of_one(
    words: tuple[str, ...], tables: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    command, *rest = words
    alone = [printed(capsys, command, table, *rest, "--json") for table in tables]
    both = printed(capsys, command, *tables, *rest, "--json")
    assert both == "".join(alone)
    assert [json.loads(line) for line in both.splitlines()] == [*map(json.loads, alone)]
    alone = [printed(capsys, command, table, *rest) for table in tables]
    titled = "".join(f"{table}:\n{text}" for table, text in zip(tables, alone, strict=True))
    assert printed(capsys, command, *tables, *rest) == titled


def test_several_files_are_decoded_to_a_name_each(tables: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    out = str(Path(tables[0]).with_name("of-{name}.parquet"))
    files = printed(capsys, "decode", *tables, "-o", out).split()
    assert [Path(file).name.startswith(f"of-{name}") for file, name in zip(files, "ab", strict=True)] == [True, True]
    lines = printed(capsys, "decode", *tables, "-o", out, "--json").splitlines()
    assert [json.loads(line) for line in lines] == [
        {"file": table, "written": [file]} for table, file in zip(tables, files, strict=True)
    ]


def test_several_files_are_not_written_over_each_other(tables: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    for out in ("all.csv", "-"):
        assert "2 files would be written to" in (error := refused(capsys, "decode", *tables, "-o", out))
        assert "write {name} in OUT" in error
    assert "two of the files have one name" in refused(capsys, "decode", tables[0], tables[0], "-o", "{name}.csv")


def test_a_file_that_fails_ends_the_run(tables: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert "file not found: none.csv" in refused(capsys, "time", "none.csv", *tables)
