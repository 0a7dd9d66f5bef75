"""`imuscope record`: a file with the received data, ended by time, by hand or by the source; no file without data."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from imuscope.recordings.importers.open_file import open_file
from imuscope.recordings.mcap.own_recordings import is_uncompacted
from imuscope.recordings.mcap.reader import McapReader
from imuscope.server.commands.record import amount
from tests.bench.support.tcp_device import TcpDevice
from tests.support.each_row import each_row
from tests.support.recorder_harness import chunks
from tests.support.server_process import begun, imuscope
from tests.support.source_files import ROOT
from tests.support.timeouts import PATIENCE_S
from tests.support.waiting import block_until


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One data folder, as the first start in it compiles."""
    return tmp_path_factory.mktemp("data")


STOPPED_WHILE_PACKING = """
import os, signal, sys
from imuscope.recordings.mcap import compaction
from imuscope.server.cli import main

def stopped(*arguments, **more):
    os.kill(os.getpid(), signal.SIGTERM)

compaction.write_compacted = stopped
sys.exit(main(sys.argv[1:]))
"""


def test_stopped_while_it_is_packed_the_recording_is_there_and_nothing_beside_it(tmp_path: Path, data: Path) -> None:
    """A copy of its size was left in the user's folder, under a hidden name."""
    path = tmp_path / "drive.mcap"
    with TcpDevice(500) as line:
        options = ["record", line.source, "-o", str(path), "--duration", "0.3", "--data", str(data)]
        command = [sys.executable, "-c", STOPPED_WHILE_PACKING, *options]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 128 + signal.SIGTERM, done.stderr
    assert list(tmp_path.iterdir()) == [path]
    assert is_uncompacted(path)


def test_data_received_in_time_is_in_the_file(tmp_path: Path, data: Path) -> None:
    path = tmp_path / "drive.mcap"
    with TcpDevice(500) as line:
        done = imuscope("record", line.source, "-o", str(path), "--duration", "1", "--data", str(data))
        assert done.returncode == 0, done.stderr
        results = chunks(path, "rx/1")
        assert line.sent.startswith(results)
    assert len(results) > 10_000
    assert done.stdout.startswith(f"{path}: ")
    assert " of Xsens" in done.stdout
    assert "\r" not in done.stderr  # no changing line without a terminal
    assert not is_uncompacted(path)
    source = open_file(path)
    assert source.devices["1"].protocol == "xbus"
    with McapReader(path) as recording:
        assert not recording.damage


@each_row("number", [signal.SIGINT, signal.SIGTERM])
def test_ended_by_hand_the_file_is_whole(tmp_path: Path, data: Path, number: signal.Signals) -> None:
    path = tmp_path / "drive.mcap"
    with TcpDevice(500) as line:
        process = begun("record", line.source, "-o", str(path), "--data", str(data), apart=True)

        def is_flowing() -> bool:
            assert process.poll() is None
            return path.exists() and path.stat().st_size > 20_000

        block_until(is_flowing, "something is recorded")
        process.send_signal(number)
        message, problem = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0, problem
        assert line.sent.startswith(chunks(path, "rx/1"))
    assert message.startswith(str(path))
    with McapReader(path) as recording:
        assert recording.whole
        assert recording.chunks


# Runs what follows it with standard input as the terminal that controls it.
ON_TERMINAL = """
import fcntl, os, signal, sys, termios
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # ignored where the tests run under nohup
os.setsid()
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execvp(sys.argv[1], sys.argv[1:])
"""


@each_row("stays", [False, True])
def test_when_its_terminal_is_gone_the_file_is_whole(tmp_path: Path, data: Path, *, stays: bool) -> None:
    """The ssh connection broke: the recording was cut off. Under `nohup` it goes on."""
    path = tmp_path / "drive.mcap"
    master, terminal = os.openpty()
    with TcpDevice(500) as line, contextlib.ExitStack() as stack:
        words = [sys.executable, "-m", "imuscope", "record", line.source, "-o", str(path), "--data", str(data)]
        words = [sys.executable, "-c", ON_TERMINAL, *["nohup"] * stays, *words]
        process = subprocess.Popen(words, cwd=tmp_path, stdin=terminal, stdout=terminal, stderr=terminal)
        stack.callback(process.kill)
        os.close(terminal)
        block_until(lambda: path.exists() and path.stat().st_size > 20_000, "something is recorded")
        os.close(master)
        if stays:
            size = path.stat().st_size
            block_until(lambda: path.stat().st_size > size + 20_000, "it goes on")
            process.terminate()
        process.wait(PATIENCE_S)
    with McapReader(path) as recording:
        assert recording.whole
        assert recording.chunks


def test_a_file_that_is_played_ends_the_recording(tmp_path: Path, data: Path) -> None:
    capture = tmp_path / "capture.bin"
    with TcpDevice(2000) as line:
        imuscope("record", line.source, "-o", str(tmp_path / "first.mcap"), "--duration", "0.5", "--data", str(data))
    capture.write_bytes(chunks(tmp_path / "first.mcap", "rx/1"))
    done = imuscope("record", f"{capture}?speed=10", "-o", str(tmp_path / "second.mcap"), "--data", str(data))
    assert done.returncode == 0, done.stderr
    assert chunks(tmp_path / "second.mcap", "rx/1") == capture.read_bytes()


def test_a_failed_recording_is_one_line_and_leaves_nothing(tmp_path: Path, data: Path) -> None:
    there = tmp_path / "there.mcap"
    there.write_bytes(b"somebody's")
    empty = tmp_path / "empty.bin"
    empty.touch()
    wrong = [
        (("sim:isb", "-o", str(there)), "a file of that name already"),
        (("sim:isb", "-o", str(tmp_path / "a.bin")), ".mcap"),
        (("sim:nothing", "-o", str(tmp_path / "a.mcap")), "Unknown simulator"),
        (("sim:isb", "-o", str(tmp_path / "none" / "a.mcap")), "Folder not found"),
        ((str(empty), "-o", str(tmp_path / "a.mcap"), "--protocol", "xbus"), "nothing was recorded"),
        (("sim:isb", "-o", str(tmp_path / "a.mcap"), "--duration", "0"), "is not a valid time"),
    ]
    for arguments, words in wrong:
        done = imuscope("record", *arguments, "--data", str(data))
        assert done.returncode == 1
        lines = [line for line in done.stderr.splitlines() if "compiling" not in line]
        assert len(lines) == 1
        assert words in lines[0]
    assert [path.name for path in tmp_path.glob("*.mcap")] == ["there.mcap"]
    assert there.read_bytes() == b"somebody's"


def test_amounts_are_readable() -> None:
    assert [amount(size) for size in (0, 912, 1240, 1_240_000, 5_000_000_000)] == [
        "0 B",
        "912 B",
        "1.24 kB",
        "1.24 MB",
        "5.00 GB",
    ]
