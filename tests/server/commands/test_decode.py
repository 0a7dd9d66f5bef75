"""`imuscope decode`: the named files exist with the contents of the recording; errors are one line."""

import csv
import io
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from imuscope.protocols.xbus.frames import build
from imuscope.server.cli import main
from imuscope.server.commands.decode import Bar
from tests.recordings.readers.vendor_logs import LOGS, NAME, needs_logs
from tests.recordings.recorded_drive import drive
from tests.support.each_row import each_row

CONFIGURATION = bytes.fromhex("FAFF0D76")  # its first bytes: 118 of payload


@needs_logs
def test_a_log_becomes_a_file_per_message(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["decode", str(LOGS / f"{NAME}.raw"), "-o", str(tmp_path / "run.csv")]) == 0
    printed = capsys.readouterr()
    files = sorted(tmp_path.iterdir())
    assert sorted(printed.out.split()) == [str(file) for file in files]
    assert [file.name for file in files] == ["run_DID_GPS1_POS.csv", "run_DID_IMU.csv", "run_DID_INS_1.csv"]
    with files[1].open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 4000
    assert float(rows[0]["I.acc.z (m/s²)"]) == pytest.approx(-9.80665, abs=1e-6)


def test_one_file_goes_to_standard_output(tmp_path: Path, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    table = tmp_path / "a.csv"
    table.write_text("time (s),x\n" + "".join(f"{1.5e9 + k / 10:.1f},{k}\n" for k in range(20)))
    assert main(["decode", str(table), "-o", str(tmp_path / "b.csv")]) == 0
    [named] = tmp_path.glob("b*.csv")
    capfdbinary.readouterr()
    assert main(["decode", str(table), "-o", "-"]) == 0
    assert capfdbinary.readouterr().out == named.read_bytes()
    assert main(["decode", str(table), "--output=-.parquet"]) == 0
    assert pq.read_table(io.BytesIO(capfdbinary.readouterr().out)).num_rows == 20


@needs_logs
def test_several_files_are_refused_on_standard_output(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["decode", str(LOGS / f"{NAME}.raw"), "-o", "-"]) == 1
    assert "name a message with --signal" in capsys.readouterr().err


@pytest.fixture
def usual_signals() -> Iterator[None]:
    """Signals as a terminal starts a program with them: under `nohup` SIGHUP is ignored."""
    before = {number: signal.signal(number, signal.SIG_DFL) for number in (signal.SIGTERM, signal.SIGHUP)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("usual_signals")
@each_row("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_terminated_decode_leaves_no_folder_behind(
    number: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder .decode-… stayed beside the user's files."""
    drive(tmp_path / "a.mcap", seconds=1.0)
    folders = list[Path]()

    def terminated(*_: object) -> None:
        folders.extend(tmp_path.glob(".decode-*"))
        os.kill(os.getpid(), number)

    monkeypatch.setattr("imuscope.server.commands.decode.open_file", terminated)
    with pytest.raises(SystemExit) as ended:
        main(["decode", str(tmp_path / "a.mcap"), "-o", str(tmp_path / "run.csv")])
    assert ended.value.code == 128 + number
    assert len(folders) == 1
    assert not folders[0].exists()
    assert signal.getsignal(number) == signal.SIG_DFL


@each_row("suffix", [".parquet", ".mcap", ".mtb", ".bin"])
def test_the_suffix_chooses(suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "out").mkdir()
    path = drive(tmp_path / "a.mcap", seconds=1.0)
    assert main(["decode", str(tmp_path / "a.mcap"), "-o", str(tmp_path / "out" / f"run{suffix}")]) == 0
    (made,) = (tmp_path / "out").iterdir()
    assert capsys.readouterr().out.split() == [str(made)]
    if suffix == ".parquet":
        assert made.name == "run_MTData2.parquet"
        assert pq.read_table(made).num_rows == 50
    if suffix == ".bin":
        assert made.read_bytes() == path
    if suffix == ".mtb":
        at = path.index(CONFIGURATION)
        head = path[at : at + 123]
        assert made.read_bytes() == head + path[:at] + path[at + 123 :]


def test_devices_that_share_a_line_have_a_file_each(tmp_path: Path) -> None:
    """Regression: samples of bus identifiers 1 and 2 were in one CSV, without a column to distinguish them."""
    items = "102002{:04x}106004{:08x}"
    data = b"".join(
        build(0x36, bytes.fromhex(items.format(start + k, 100 * (start + k))), bid)
        for k in range(100)
        for bid, start in ((1, 0), (2, 30_000))
    )
    (tmp_path / "two.bin").write_bytes(data)
    (tmp_path / "out").mkdir()
    assert main(["decode", str(tmp_path / "two.bin"), "-o", str(tmp_path / "out" / "run.csv")]) == 0
    results = []
    for path in sorted((tmp_path / "out").iterdir()):
        with path.open() as file:
            results.append([int(row["PacketCounter"]) for row in csv.DictReader(file)])
    assert sorted(results) == [list(range(100)), list(range(30_000, 30_100))]


def test_invalid_arguments_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "noise.bin").write_bytes(b"\x55" * 5000)
    drive(tmp_path / "a.mcap", seconds=0.2)
    before = sorted(tmp_path.iterdir())
    for name, out in (
        ("none.mcap", "run.csv"),
        ("noise.bin", "run.csv"),
        ("a.mcap", "run.xlsx"),
        ("a.mcap", "none/run.csv"),
        ("a.mcap", "a.mcap"),
        ("a.mcap", "run.raw"),
    ):
        assert main(["decode", str(tmp_path / name), "-o", str(tmp_path / out)]) == 1, (name, out)
        printed = capsys.readouterr()
        assert printed.out == ""
        assert printed.err.startswith("imuscope: ")
        assert printed.err.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == before


def test_a_bar_is_drawn_on_a_terminal_alone_and_only_when_it_takes_a_while() -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    for out, late, drawn in ((io.StringIO(), True, False), (Terminal(), False, False), (Terminal(), True, True)):
        bar = Bar(out)
        if late:
            bar._next = 0.0
        bar.show(0.5)
        assert ("50%" in out.getvalue()) == drawn
        bar.clear()
        assert out.getvalue().endswith("\r") == drawn
