"""The command line: quick answers, one clear line per error, cache of compiled code."""

import gc
import json
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from imuscope.protocols.framing.checksums import check_sum8
from imuscope.protocols.isb.frames import get_data, stop
from imuscope.server.cli import main
from tests.support.each_row import each_row
from tests.support.server_process import ROOT, ServerProcess, begun, imuscope
from tests.support.timeouts import PATIENCE_S, http_client
from tests.support.waiting import block_until


def test_version_and_help_are_answered() -> None:
    assert imuscope("--version", fresh=True).stdout.startswith("imuscope ")
    assert "inspect" in imuscope("--help").stdout
    assert "SOURCE" in imuscope("serve", "--help").stdout


def test_the_version_imports_no_command() -> None:
    """It took 0.9 s of a processor."""
    code = "import sys, imuscope.__main__ as cli; sys.argv = ['imuscope', '-V']; cli.main(); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    version, modules = done.stdout.splitlines()
    assert version.startswith("imuscope ")
    assert not {"argparse", "pydantic", "imuscope.server.cli"} & set(modules.split())


@each_row(
    ("arguments", "words"),
    [
        (("help", "decode"), "usage: imuscope decode"),
        (("help",), "usage: imuscope"),
        (("decode", "a.csv", "-o", "b.csv", "--devise", "1"), "--devise 1 (did you mean '--device'?)"),
        (("calibrate", "a.csv", "gyroscop"), "'gyroscop' (did you mean 'gyroscope'?)"),
        (
            ("query", "--store", "no-such-folder", "select 1"),
            "no-such-folder does not exist; give the folder of a store",
        ),
    ],
)
def test_misspelt_words_are_answered_with_the_nearest(
    arguments: tuple[str, ...], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        status = main(arguments)
    except SystemExit as end:
        status = int(end.code or 0)
    printed = capsys.readouterr()
    assert words in printed.out + printed.err
    assert status == (0 if arguments[0] == "help" else 1)


def test_heavy_parts_are_not_imported_for_help() -> None:
    code = "import sys, imuscope.server.cli; print(sorted({'fastapi', 'numpy'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout.strip() == "[]"


def test_a_start_that_fails_leaves_garbage_collection_on(capsys: pytest.CaptureFixture[str]) -> None:
    """For a program that calls it: `serve` starts without."""
    assert main(["serve", "nothing://x"]) == 1
    assert "nothing://x" in capsys.readouterr().err
    assert gc.isenabled()


def test_text_that_the_terminal_lacks_is_written_in_ascii(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    frame = bytes.fromhex("fa ff 36 07 10 60 04 00 00 00 01")
    log = tmp_path / "time.bin"
    log.write_bytes((frame + bytes([check_sum8(frame[1:])])) * 20)
    done = imuscope("inspect", str(log), fresh=True)
    assert done.returncode == 0, done.stderr
    assert "SampleTimeFine 1 \\xd7 0.1 ms" in done.stdout


@each_row(
    ("arguments", "words"),
    [
        (("serve", "nothing://x"), "nothing://x"),
        (
            ("--protocol", "xbus", "inspect", "a.bin"),
            "inspect is a command; write it before its options: imuscope inspect --protocol",
        ),
        (("serve", "--protocol", "morse"), "unknown protocol 'morse'"),
        (("serve", "sim:xbus?protocol=morse"), "unknown protocol 'morse'"),
        (("serve", "--key", "0g"), "a key must be an even number of hex digits"),
        (("serve", "sim:idtp?key=0g"), "a key must be an even number of hex digits"),
        (("serve", "--key", "@none.key"), "the key cannot be read from none.key"),
        (("serve", "--min-mode", "strong"), "invalid choice 'strong'"),
        (("serve", "--schema", "none.toml"), "the schema cannot be read from none.toml"),
        (("inspect", "pyproject.toml", "--key", "0g"), "a key must be an even number of hex digits"),
        (("serve", "--port", "70000"), "port 70000 is outside"),
        (("serve", "--config", "none.toml"), "none.toml cannot be read"),
        (("serve", "--host", "203.0.113.1"), "cannot listen on 203.0.113.1:8080"),
        (("inspect", "none.bin"), "file not found: none.bin"),
        (("inspect", "tests"), "tests is a folder"),
        (("inspect",), "the following arguments are required: FILE"),
        (("inpsect", "none.bin"), "file not found: inpsect. See `imuscope --help`"),
        (("serve", "--port", "abc"), "invalid int value: 'abc'"),
    ],
)
def test_errors_are_one_line(arguments: tuple[str, ...], words: str, tmp_path: Path) -> None:
    done = imuscope(*arguments, "--data", str(tmp_path))
    assert done.returncode == 1
    lines = [line for line in done.stderr.splitlines() if "compiling" not in line]
    assert len(lines) == 1, done.stderr
    assert words in lines[0]
    assert done.stdout == ""


def test_a_port_in_use_is_one_line(tmp_path: Path) -> None:
    with socket.socket() as busy:
        busy.bind(("127.0.0.1", 0))
        busy.listen()
        done = imuscope("serve", "--port", str(busy.getsockname()[1]), "--data", str(tmp_path))
    assert done.returncode == 1
    assert "Give another with --port" in done.stderr
    assert "Traceback" not in done.stderr


def test_without_a_source_simulators_of_three_families_stream(tmp_path: Path) -> None:
    with ServerProcess(data=tmp_path, fresh=True) as server, http_client(base_url=server.url) as client:

        def live() -> dict[str, dict[str, Any]]:
            devices = client.get("/api/devices").json()
            return {one["protocol"]: one for one in devices if one["status"] == "live" and one["serial_number"]}

        block_until(lambda: len(live()) == 3, lambda: server.log)
        results = live()
        names = {protocol: one["name"] for protocol, one in results.items()}
        assert names == {"xbus": "MTi-630", "isb": "IMX-5", "idtp": "IDTP device 102"}
        assert results["idtp"]["protection"] == "Safety, CRC-32"
        assert "No source given" in server.log


def test_a_key_on_the_command_line_verifies_and_is_printed_nowhere(tmp_path: Path) -> None:
    key = "00112233445566778899aabbccddeeff"
    (tmp_path / "robot.key").write_text(key + "\n")
    arguments = ("--key", f"@{tmp_path / 'robot.key'}")
    with (
        ServerProcess("sim:idtp?mode=secure&rate=10", data=tmp_path, arguments=arguments) as server,
        http_client(base_url=server.url) as client,
    ):
        protection = block_until(lambda: client.get("/api/devices").json()[0]["protection"], "its frames are verified")
        assert protection == "Secure, verified"
        assert key not in client.get("/api/devices").text + server.log


def test_inspect_lists_what_a_host_sent(tmp_path: Path) -> None:
    (tmp_path / "host.bin").write_bytes(get_data(1, period=0) + stop())
    done = imuscope("inspect", str(tmp_path / "host.bin"), "--direction", "tx", "--format", "jsonl")
    assert json.loads(done.stdout.splitlines()[0])["message"] == "GET_DATA"


@each_row("how", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_it_ends_cleanly(how: signal.Signals, tmp_path: Path) -> None:
    with ServerProcess("udp://127.0.0.1:0", data=tmp_path) as server:
        server.process.send_signal(how)
        assert server.process.wait(PATIENCE_S) == 0
        assert "Traceback" not in server.log


def test_beyond_loopback_the_address_carries_a_token(tmp_path: Path) -> None:
    words = ("serve", "udp://127.0.0.1:0", "--host", "0.0.0.0", "--port", "0", "--data", str(tmp_path))
    process = begun(*words, apart=True)
    assert process.stdout is not None
    lines = [process.stdout.readline(), process.stdout.readline()]
    process.terminate()
    process.communicate(timeout=PATIENCE_S)
    assert lines[0].startswith("to view:")
    assert lines[1].startswith("to control:")
    assert all("?token=" in line for line in lines)
    assert process.returncode == 0
