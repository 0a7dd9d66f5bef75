"""Commands, options and their values: where they may stand, what is said, what is read through a pipe."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from protocols.idtp.frames import SAFETY, SECURE, build
from server.cli import main
from server.commands import options
from server.commands.completion import script
from tests.process import ROOT

KEY = bytes(range(16))


def frames(mode: int = SAFETY, count: int = 40) -> bytes:
    return b"".join(
        build(1, bytes(12), timestamp=k * 10_000, sequence=k, device=7, mode=mode, key=KEY) for k in range(count)
    )


def test_an_option_between_arguments_was_not_recognised(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compose", "Imu3Acc", "--key", "00", "acc_x=1"]) == 0
    between = capsys.readouterr().out
    assert main(["compose", "--key", "00", "Imu3Acc", "acc_x=1"]) == 0
    assert capsys.readouterr().out == between


@pytest.mark.parametrize(
    "words",
    [
        "serve a --host 0.0.0.0 b --port 1 c",
        "serve --foxglove a b",
        "ports --data d",
        "doctor --format json --data d",
        "inspect --rejects a --format jsonl --device 2",
        "compose --protocol xbus a --key 00 b=1 c=2",
        "send a --yes b --key 00 c=1",
        "commands --protocol xbus a --key 00",
        "rearm --server http://a 102 --token b",
        "record a -o b.mcap c --duration 3",
        "replay --tcp :1 a --loop --device 2 --key 00",
        "decode -o a.csv b --device 2 --from 1 --to 2 --channel c --channel d",
        "completion zsh",
    ],
)
def test_every_command_takes_options_anywhere(words: str) -> None:
    assert {one.split()[0] for one in [words]} <= set(options.COMMANDS)
    found = options.parse(words.split())
    if found.command == "serve":
        assert found.sources == (["a", "b", "c"] if "--port" in words else ["a", "b"])
    if found.command == "record":
        assert found.sources == ["a", "c"]
    if found.command == "decode":
        assert (found.begin, found.end, found.channel) == (1.0, 2.0, ["c", "d"])


def test_every_option_is_explained_and_every_command_listed() -> None:
    commands = options.parser().commands
    assert set(commands) == set(options.COMMANDS)
    for name, command in commands.items():
        for action in command._actions:
            assert action.help, f"{name} {action.option_strings or action.dest}"


def test_older_spellings_still_do() -> None:
    assert options.parse(["inspect", "a", "--json"]).format == "jsonl"
    assert options.parse(["doctor", "--json"]).format == "json"


def test_the_environment_stands_in_for_options(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in options.ENVIRONMENT.values():
        monkeypatch.setenv(name, "there")
        assert name in options.ENVIRONMENT_HELP
    assert options.parse(["serve"]).key == "there"
    assert options.parse(["serve", "--key", "here"]).key == "here"
    assert options.parse(["serve"]).data == Path("there")
    assert options.parse(["rearm"]).token == "there"


@pytest.mark.parametrize("shell", options.SHELLS)
def test_completion_knows_every_command_and_option(shell: str) -> None:
    made = script(options.parser().commands, shell)
    for name in options.COMMANDS:
        assert name in made
    assert "min-mode" in made
    assert "lite safety secure" in made
    if shell == "bash":
        assert subprocess.run(["bash", "-n"], input=made, text=True, check=False).returncode == 0


def test_nowhere_to_write_was_a_traceback() -> None:
    code = [sys.executable, "-m", "server.cli", "completion", "bash"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(code, cwd=ROOT, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr == "imuscope: the output cannot be written: no space left on device.\n"
    shut = " ".join(code) + " >&-"
    done = subprocess.run(shut, shell=True, cwd=ROOT, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("serve udp://:1 udp://:1", "udp://:1 is given twice"),
        ("record nofile -o q.mcap", "there is no file nofile"),
        ("record twin:idtp -o nowhere/q.mcap", "no folder nowhere; name another with -o"),
        ("record twin:idtp -o q.mcap --duration 0", "is not a valid time"),
        ("serv", "The nearest command is serve"),
        ("ports --data pyproject.toml", "is a file; name a folder with --data"),
        ("serve --host 203.0.113.1", "Give an address of this machine with --host"),
        ("compose --jsonl pyproject.toml --protocol morse", "there is no protocol 'morse'"),
    ],
)
def test_what_is_said_names_the_cause(words: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words.split()) == 1
    error = capsys.readouterr().err
    assert said in error
    assert "Traceback" not in error


# -- files and pipes ---------------------------------------------------------------------------------------------------


def test_inspect_reads_a_pipe(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=lambda: pipe.write_bytes(frames()))
    writer.start()
    assert main(["inspect", str(pipe), "--json"]) == 0
    writer.join()
    assert len(capsys.readouterr().out.splitlines()) == 40


def test_jsonl_takes_the_protocol_that_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    line = {"message": "GoToConfig", "fields": {}}
    monkeypatch.setattr("sys.stdin", io.StringIO(json.dumps(line) + "\n"))
    assert main(["compose", "--jsonl", "-", "--protocol", "xbus"]) == 0
    assert capsys.readouterr().out == "faff3000d1\n"
    monkeypatch.setattr("sys.stdin", io.StringIO(json.dumps(line) + "\n"))
    assert main(["compose", "--jsonl", "-"]) == 1
    assert "names no protocol" in capsys.readouterr().err


def test_a_missing_key_was_not_mentioned(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "secure.bin"
    path.write_bytes(frames(SECURE))
    assert main(["inspect", str(path)]) == 1
    assert "40 frames are not accepted: a Secure frame, and no key to check it with (--key)" in capsys.readouterr().err
    assert main(["decode", str(path), "-o", str(tmp_path / "x.csv")]) == 1
    assert "--key @FILE" in capsys.readouterr().err
    assert main(["inspect", str(path), "--key", KEY.hex(), "--json"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 40


def test_a_successor_or_nothing_is_no_success(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "indt.bin"
    path.write_bytes(frames().replace(b"IDTP", b"INDT"))
    for more in ([], ["--protocol", "idtp"]):
        assert main(["inspect", str(path), *more]) == 1
        assert "INDT" in capsys.readouterr().err
    path.write_bytes(b"")
    for more in ([], ["--protocol", "idtp"]):
        assert main(["inspect", str(path), *more]) == 1
        assert "is empty" in capsys.readouterr().err


def test_inspect_saw_phantom_frames_in_recordings_and_noise(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A recording is read as what it is; noise, in which a weak checksum finds a frame now and then, is nothing."""
    capture = tmp_path / "capture.bin"
    capture.write_bytes(frames())
    recording = tmp_path / "r.mcap"
    assert main(["record", f"{capture}?speed=1000", "-o", str(recording)]) == 0
    capsys.readouterr()
    assert main(["inspect", str(recording), "--json"]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {line["protocol"] for line in lines} == {"idtp"}
    assert len(lines) == 40
    noise = tmp_path / "noise.bin"
    noise.write_bytes(b"\xfa\xff\x30\x00\xd1".join(bytes(range(256)) * 8 for _ in range(8)))
    assert main(["inspect", str(noise)]) == 1
    assert "nothing known" in capsys.readouterr().err


def test_decode_takes_a_part(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capture = tmp_path / "capture.bin"
    two = [
        build(kind, bytes(12), timestamp=k * 10_000, sequence=k, device=7, mode=SAFETY)
        for k in range(200)
        for kind in (k % 2,)
    ]
    capture.write_bytes(b"".join(two))
    out = tmp_path / "x.csv"
    assert main(["decode", str(capture), "-o", str(out), "--from", "0.5", "--to", "1", "--channel", "Imu3Gyr"]) == 0
    (made,) = capsys.readouterr().out.split()
    assert "Imu3Gyr" in made
    assert 20 <= len(Path(made).read_text().splitlines()) <= 32
    for wrong, said in (
        (["--device", "9"], "holds no device '9'"),
        (["--channel", "Imu3Gyrr"], "nearest are: Imu3Gyr"),
        (["--from", "70"], "nothing lies in that range"),
    ):
        assert main(["decode", str(capture), "-o", str(out), *wrong]) == 1
        assert said in capsys.readouterr().err
