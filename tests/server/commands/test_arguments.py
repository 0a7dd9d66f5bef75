"""Commands, options and their values: positions, messages, and input through a pipe."""

import argparse
import errno
import functools
import json
import os
import re
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from imuscope.protocols.family.decode_options import DecodeOption
from imuscope.protocols.idtp.frames import SAFETY, SECURE, build
from imuscope.server import cli
from imuscope.server.commands import arguments
from imuscope.server.commands.completion import script
from imuscope.server.commands.several_files import run_each
from imuscope.server.devices.decode.decode_options import source_options
from imuscope.server.errors import UsageError
from imuscope.server.settings.config import setting_names
from tests.support.each_row import each_row
from tests.support.server_process import ROOT, ServerProcess, imuscope
from tests.support.waiting import block_until

KEY = bytes(range(16))


def frames(mode: int = SAFETY, count: int = 40) -> bytes:
    return b"".join(
        build(1, bytes(12), timestamp=k * 10_000, sequence=k, device=7, mode=mode, key=KEY) for k in range(count)
    )


COMMANDS = arguments.parser().commands
"""From the parser itself: a new command is held to all of this, too."""
FORMER = ["--channel"]  # of --signal


def arguments_of(command: argparse.ArgumentParser) -> tuple[list[str], list[list[str]]]:
    """Possible arguments of a command: up to three positional ones, and each of its options."""
    words: list[str] = []
    source: list[list[str]] = []
    left_out: set[argparse.Action] = set()
    for group in command._mutually_exclusive_groups:
        left_out |= set(group._group_actions[1:])
    for action in command._actions:
        if isinstance(action, argparse._HelpAction) or action in left_out:
            continue
        if action.dest == "shares" and not action.required:
            continue  # it belongs to the source before it
        if not action.option_strings:
            known = list(action.choices) if action.choices else ["a", "b", "c"]
            words += known[: 3 if action.nargs in ("*", "+") else 1]
        elif action.nargs == 0:
            source.append([action.option_strings[-1]])
        else:
            value = str(next(iter(action.choices))) if action.choices else "1"
            source.append([action.option_strings[-1], value])
    return words, source


@pytest.fixture
def parser_built_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise each command line builds it anew, which takes most of the time."""
    monkeypatch.setattr(arguments, "parser", functools.cache(arguments.parser))


def meaning_of(words: list[str]) -> str:
    """Options of a command line, without the line itself."""
    return repr(sorted((name, value) for name, value in vars(arguments.parse(words)).items() if name != "words"))


@pytest.mark.usefixtures("parser_built_once")
@each_row("name", COMMANDS)
def test_options_may_stand_anywhere_among_the_arguments(name: str) -> None:
    words, source = arguments_of(COMMANDS[name])
    needed = [one for one in source if any(one[0] in a.option_strings and a.required for a in COMMANDS[name]._actions)]
    doors = [one for group in COMMANDS[name]._mutually_exclusive_groups if group.required for one in source
             if one[0] in group._group_actions[0].option_strings]  # fmt: skip
    for option in source:
        others = [
            word for one in needed + doors if one != option and (one in needed or option not in doors) for word in one
        ]
        same_product = {meaning_of([name, *others, *words[:at], *option, *words[at:]]) for at in range(len(words) + 1)}
        same_product |= {meaning_of([name, *words[:at], *option, *words[at:], *others])
                  for at in range(len(words) + 1)}  # fmt: skip
        assert len(same_product) == 1, option


@each_row("name", COMMANDS)
def test_every_option_is_explained_with_its_values(name: str) -> None:
    shown = COMMANDS[name].format_help()
    for action in [one for one in COMMANDS[name]._actions if one.option_strings != FORMER]:
        called = f"{name} {action.option_strings or action.dest}"
        assert action.help, called
        assert action.help != argparse.SUPPRESS, f"{called} is hidden"
        for one in action.option_strings:
            assert one in shown, called
        for value in action.choices or ():
            assert str(value) in shown, called


def test_every_command_is_listed_with_what_it_is_for() -> None:
    assert set(COMMANDS) == set(arguments.COMMANDS)
    shown = arguments.parser().format_help()
    for name in COMMANDS:
        assert re.search(rf"^    {name}\s+\S", shown, re.MULTILINE), name


def test_one_word_for_one_format_option() -> None:
    """The format of results is --format wherever a command has a choice; --log-format concerns the log."""
    words = {one for command in COMMANDS.values() for action in command._actions for one in action.option_strings}
    assert {one for one in words if "format" in one or "json" in one} == {
        "--format",
        "--json",
        "--jsonl",
        "--log-format",
    }
    for command in COMMANDS.values():
        short = [action for action in command._actions if "--json" in action.option_strings]
        assert all(action.dest == "format" and "--format" in (action.help or "") for action in short)


@pytest.mark.usefixtures("parser_built_once")
@each_row("name", COMMANDS)
def test_usage_errors_are_one_line_without_a_traceback(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    words, source = arguments_of(COMMANDS[name])
    wrong = [[name, *words, "--no-such-option"]]
    wrong += [[name, *words, option[0]] for option in source if len(option) > 1 and option[0] != "--foxglove"]
    for action in COMMANDS[name]._actions:
        if action.option_strings and (action.choices or action.type in (int, float)):
            wrong.append([name, *words, f"{action.option_strings[-1]}=wrong"])
    for line in wrong:
        with pytest.raises(SystemExit) as ended:
            arguments.parse(line)
        assert ended.value.code == 1, line
        printed = capsys.readouterr().err
        assert printed.count("\n") == 1, line
        assert printed.startswith("imuscope: "), line
        assert f"See `imuscope {name} --help`." in printed


WITHOUT_JSON = {
    "send": "prints JSON always",
    "compose": "prints a frame, and reads JSON",
    "completion": "prints a script",
    **dict.fromkeys(("serve", "fleet", "hold", "replay", "simulate"), "runs until it is stopped"),
}


def test_every_command_that_prints_a_result_has_json() -> None:
    has_json = {name for name, command in COMMANDS.items() if "--json" in command._option_string_actions}
    assert {*COMMANDS} - has_json == {*WITHOUT_JSON}


def test_a_signal_has_one_name_on_the_command_line() -> None:
    for name, command in COMMANDS.items():
        shown = [one for one in command._actions if one.option_strings == FORMER and one.help != argparse.SUPPRESS]
        assert not shown, name


def secrets() -> list[DecodeOption]:
    return [option for option in source_options() if option.kind == "secret"]


def test_the_guide_names_every_command_variable_and_setting() -> None:
    commands = (ROOT / "docs" / "guide" / "command-line.md").read_text()
    for name in COMMANDS:
        assert re.search(rf"imuscope {name}\b", commands), name
    settings = (ROOT / "docs" / "guide" / "settings.md").read_text()
    variables = [*arguments.ENVIRONMENT.values(), *map(arguments.variable_of, secrets())]
    for name in [*variables, *setting_names(), *(option.name for option in source_options())]:
        assert f"`{name}`" in settings or f"`[{name}]`" in settings, name


def test_options_may_stand_before_the_word_serve(monkeypatch: pytest.MonkeyPatch) -> None:
    """Regression: "serve" was then looked for as a file."""
    begun: list[Any] = []
    monkeypatch.setitem(cli._RUN, "serve", begun.append)
    assert cli.main(["--port", "8081", "serve", "sim:xbus"]) == 0
    [options] = begun
    assert (options.port, options.sources) == (8081, ["sim:xbus"])


def test_options_between_arguments_are_recognised() -> None:
    between = imuscope("compose", "Imu3Acc", "--key", "00", "acc_x=1")
    before = imuscope("compose", "--key", "00", "Imu3Acc", "acc_x=1")
    assert (between.returncode, between.stdout) == (0, before.stdout)


def test_older_spellings_are_accepted() -> None:
    assert arguments.parse(["inspect", "a", "--json"]).format == "jsonl"
    assert arguments.parse(["doctor", "--json"]).format == "json"


def test_the_environment_stands_in_for_options(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        arguments.parse(["serve", "--help"])
    words = capsys.readouterr().out
    for name in [*arguments.ENVIRONMENT.values(), *map(arguments.variable_of, secrets())]:
        monkeypatch.setenv(name, "there")
        assert name in words
    assert arguments.parse(["serve"]).key == "there"
    assert arguments.parse(["serve", "--key", "here"]).key == "here"
    assert arguments.parse(["serve"]).data == Path("there")
    assert arguments.parse(["rearm"]).token == "there"


@each_row("shell", arguments.SHELLS)
def test_completion_knows_every_command_and_option(shell: str) -> None:
    made = script(arguments.parser().commands, shell)
    for name in arguments.COMMANDS:
        assert name in made
    assert "min-mode" in made
    assert "lite safety secure" in made
    if shell == "bash":
        assert subprocess.run(["bash", "-n"], input=made, text=True, check=False).returncode == 0


def test_an_unwritable_output_is_one_line() -> None:
    code = [sys.executable, "-m", "imuscope.server.cli", "completion", "bash"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(code, cwd=ROOT, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr == "imuscope: the output cannot be written: no space left on device.\n"
    shut = " ".join(code) + " >&-"
    done = subprocess.run(shut, shell=True, cwd=ROOT, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@each_row(
    ("words", "message"),
    [
        ("serve udp://:1 udp://:1", "udp://:1 is given twice"),
        ("record nofile -o q.mcap", "file not found: nofile"),
        ("record sim:idtp -o nowhere/q.mcap", "Folder not found: nowhere. Name another with -o"),
        ("serv", "The nearest command is serve"),
        ("ports --data pyproject.toml", "is a file; name a folder with --data"),
        ("compose --jsonl pyproject.toml --protocol morse", "unknown protocol 'morse'"),
        # options without effect
        ("serve sim:idtp --key 00 --unverified", "leave one out"),
        ("inspect README.md --key 00 --unverified", "leave one out"),
        ("doctor --udev-rule --systemd-unit", "give one of the two"),
        ("doctor --udev-rule --format json", "leave one out"),
        ("simulate xbus --key 00 --tcp :0", "--key is not an option of xbus"),
        ("compose Imu3Acc --min-mode lite", "unrecognized arguments: --min-mode"),
        ("inspect README.md --rotation enu_from_body", "unrecognized arguments: --rotation"),
        ("commands --key 00", "unrecognized arguments: --key"),
    ],
)
def test_messages_name_the_cause(words: str, message: str) -> None:
    done = imuscope(*words.split())
    assert done.returncode == 1
    assert message in done.stderr
    assert "Traceback" not in done.stderr


def test_a_key_for_replay_is_reported_as_needless(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(frames())
    done = imuscope("replay", str(tmp_path / "a.bin"), "--udp", "127.0.0.1:9", "--speed", "1000", "--key", "00")
    assert done.returncode == 0
    assert "--key is not needed: the bytes are sent unchanged" in done.stderr


# -- files and pipes ---------------------------------------------------------------------------------------------------


NAMES = ["inspect", "decode", "record"]


def read_by(command: str, source: str, folder: Path, original: bytes = b"") -> str:
    """The frames that a command finds in a source, by its own words."""
    made = folder / f"{command}{len(list(folder.iterdir()))}.out"
    if command == "inspect":
        done = imuscope("inspect", source, "--format", "jsonl", stdin=original)
        assert done.returncode == 0, done.stderr
        return str(len(done.stdout.splitlines()))
    if command == "decode":
        done = imuscope("decode", source, "-o", str(made.with_suffix(".csv")), stdin=original)
        assert done.returncode == 0, done.stderr
        return str(len(Path(done.stdout.strip()).read_text().splitlines()) - 1)
    done = imuscope("record", source, "-o", str(made.with_suffix(".mcap")), stdin=original)
    assert done.returncode == 0, done.stderr
    return read_by("inspect", str(made.with_suffix(".mcap")), folder)


@each_row("command", NAMES)
def test_a_file_a_pipe_and_standard_input_are_read_alike(command: str, tmp_path: Path) -> None:
    """`record` opens its sources as `serve` does."""
    (tmp_path / "a.bin").write_bytes(frames())
    assert read_by(command, str(tmp_path / "a.bin"), tmp_path) == "40"
    assert read_by(command, "-", tmp_path, frames()) == "40"
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=lambda: pipe.write_bytes(frames()))
    writer.start()
    assert read_by(command, str(pipe), tmp_path) == "40"
    writer.join()


def test_serve_reads_a_pipe(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with ServerProcess(str(pipe), data=tmp_path) as server:
        pipe.write_bytes(frames())
        await_device(server.url, lambda one: one["protocol"] == "idtp" and one["status"] == "ended")


def await_device(url: str, expected: Callable[[dict[str, Any]], bool]) -> None:
    def device() -> dict[str, Any]:
        with urllib.request.urlopen(f"{url}/api/devices") as answer:
            (one,) = json.load(answer)
        return dict(one)

    block_until(lambda: expected(device()), lambda: str(device()))


def test_a_recording_comes_through_a_pipe_for_inspect(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(frames())
    made = tmp_path / "a.mcap"
    assert imuscope("record", f"{tmp_path / 'a.bin'}?speed=1000", "-o", str(made)).returncode == 0
    assert read_by("inspect", "-", tmp_path, made.read_bytes()) == "40"
    done = imuscope("inspect", "-", "--device", "x", stdin=frames())
    assert "no devices to choose from" in done.stderr


def test_jsonl_takes_the_protocol_that_is_named() -> None:
    line = json.dumps({"message": "GoToConfig", "fields": {}}).encode() + b"\n"
    done = imuscope("compose", "--jsonl", "-", "--protocol", "xbus", stdin=line)
    assert (done.returncode, done.stdout) == (0, "faff3000d1\n")
    done = imuscope("compose", "--jsonl", "-", stdin=line)
    assert done.returncode == 1
    assert "has no protocol" in done.stderr


def test_a_missing_key_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "secure.bin"
    path.write_bytes(frames(SECURE))
    done = imuscope("inspect", str(path))
    assert done.returncode == 1
    assert "40 frames are not accepted: a Secure frame, but no key to check it with (--key)" in done.stderr
    done = imuscope("decode", str(path), "-o", str(tmp_path / "x.csv"))
    assert done.returncode == 1
    assert "--key @FILE" in done.stderr
    done = imuscope("inspect", str(path), "--key", KEY.hex(), "--json")
    assert (done.returncode, len(done.stdout.splitlines())) == (0, 40)


def test_unsupported_or_empty_input_is_not_a_success(tmp_path: Path) -> None:
    path = tmp_path / "indt.bin"
    path.write_bytes(frames().replace(b"IDTP", b"INDT"))
    for more in ([], ["--protocol", "idtp"]):
        done = imuscope("inspect", str(path), *more)
        assert done.returncode == 1
        assert "INDT" in done.stderr
    path.write_bytes(b"")
    for more in ([], ["--protocol", "idtp"]):
        done = imuscope("inspect", str(path), *more)
        assert done.returncode == 1
        assert "is empty" in done.stderr


def test_inspect_finds_no_frames_in_recordings_and_noise(tmp_path: Path) -> None:
    """A recording is recognised as such; noise, in which a weak checksum occasionally finds a frame,
    has no protocol.
    """
    capture = tmp_path / "capture.bin"
    capture.write_bytes(frames())
    recording = tmp_path / "r.mcap"
    assert imuscope("record", f"{capture}?speed=1000", "-o", str(recording)).returncode == 0
    lines = [json.loads(line) for line in imuscope("inspect", str(recording), "--json").stdout.splitlines()]
    assert {line["protocol"] for line in lines} == {"idtp"}
    assert len(lines) == 40
    noise = tmp_path / "noise.bin"
    noise.write_bytes(b"\xfa\xff\x30\x00\xd1".join(bytes(range(256)) * 8 for _ in range(8)))
    done = imuscope("inspect", str(noise))
    assert done.returncode == 1
    assert "no known protocol" in done.stderr


def test_inspect_names_a_file_that_cannot_be_read(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (file := tmp_path / "a.bin").write_bytes(b"x")

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied", str(file))

    monkeypatch.setattr("imuscope.server.commands.inspect.inspect_file", refuse)
    with pytest.raises(UsageError, match=rf"^{file}: permission denied$"):
        run_each(cli._inspect, arguments.parse(["inspect", str(file)]))


def test_decode_takes_a_part(tmp_path: Path) -> None:
    capture = tmp_path / "capture.bin"
    two = [
        build(kind, bytes(12), timestamp=k * 10_000, sequence=k, device=7, mode=SAFETY)
        for k in range(200)
        for kind in (k % 2,)
    ]
    capture.write_bytes(b"".join(two))
    out = tmp_path / "x.csv"
    part = ("--from", "0.5", "--to", "1", "--signal", "Imu3Gyr")
    (made,) = imuscope("decode", str(capture), "-o", str(out), *part).stdout.split()
    assert "Imu3Gyr" in made
    assert 20 <= len(Path(made).read_text().splitlines()) <= 32
    for wrong, message in (
        (["--device", "9"], "has no device '9'"),
        (["--signal", "Imu3Gyrr"], "has no signal 'Imu3Gyrr'; nearest are: Imu3Gyr"),
        (["--channel", "Imu3Gyrr"], "has no signal"),  # its former name
        (["--from", "70"], "that range is empty"),
    ):
        done = imuscope("decode", str(capture), "-o", str(out), *wrong)
        assert done.returncode == 1
        assert message in done.stderr
