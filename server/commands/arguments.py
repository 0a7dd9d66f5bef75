"""Argument parsers of the command line. Nothing is done here."""

import argparse
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn, TypeAlias

from imuscope.protocols.family.decode_options import DecodeOption, Scope
from imuscope.protocols.family.plugins import protocol_names
from imuscope.recordings.errors import near_miss
from imuscope.recordings.optional_packages import installation_of
from imuscope.server.commands.file_arguments import add_decode, add_files, add_format
from imuscope.server.commands.page_arguments import add_page_address
from imuscope.server.devices.decode.decode_options import declared_options
from imuscope.server.services.extension import absent_extensions, add_commands, extension_commands
from imuscope.server.settings import logging_setup
from imuscope.server.settings.config import default_data
from imuscope.server.settings.extension_settings import extension_settings
from imuscope.server.version import described

ABSENT = {command.name: one.extra for one in absent_extensions() for command in one.commands}
"""Commands of extensions whose packages are not installed, with the extra that has them."""
COMMANDS = (
    *("serve", "ports", "doctor", "inspect", "compose", "send", "commands", "rearm", "record", "replay"),
    *("decode", *extension_commands(), *ABSENT, "simulate", "completion"),
)
NAMES = "|".join(protocol_names())
ANY_OF = ", ".join(protocol_names())
SHELLS = ("bash", "zsh", "fish")
SENDING = """Without fields, a setting is read. With fields, it is written and read back, and the value that the device
stored (it may round rates) is printed. Commands that lose settings, stop output or cut the link are refused, with the
reason, unless --yes is given. `imuscope commands` lists commands and settings, `imuscope commands NAME` their
fields."""

CONFIG_HELP = """configuration file (TOML): the options above with _ for -, sources, and:
  view_token, control_token       tokens to use, at least 20 characters each
  allowed_hosts, allowed_origins  lists of host names and page origins that may use this server
  rollback_s                      time to confirm settings that could cut the link, s (default 20)
  history_s, memory_mb            limits of the sample history, whichever is reached first (default 600 s, 256 MB)
  bytes_mb                        of memory_mb, for the bytes of live links, at most a quarter of it (default 64 MB)
  recordings_quota_gb             disk quota; the oldest recordings that are not pinned are deleted (0: none)
  split_mb, split_min             size or duration at which a recording continues in a new file (0: never)
  sync_s                          longest time until a recording is on the disk itself, s (default 1; 0: left to the
                                  system): what a power cut loses
  record_head                     request the header of the vendor log format when a recording begins (default false),
                                  which pauses the device for about 90 ms
  upload_gb                       maximum size of an uploaded recording (default 16)
  [map] tiles, attribution        tile server for the map under the track
"""
ENVIRONMENT_HELP = """environment variables, used if the option is not given:
  IMUSCOPE_DATA                   --data
  IMUSCOPE_CONFIG                 --config
  IMUSCOPE_TOKEN                  --token
{secrets}  XDG_DATA_HOME                   default place of the data folder
"""
ENVIRONMENT = {"data": "IMUSCOPE_DATA", "config": "IMUSCOPE_CONFIG", "token": "IMUSCOPE_TOKEN"}
"""Option → variable that stands in for it; a secret decode option has one too (`variable_of`)."""
DECODE_SCOPES: Mapping[str, Scope] = {
    **dict.fromkeys(("serve", "send", "record", "decode"), "source"),
    **{"inspect": "inspect", "compose": "compose", "commands": "commands"},
    **{one.name: one.scope for one in extension_commands().values() if one.scope},
}
"""Commands with decode options, and which of them. None is accepted and then ignored."""
PROTOCOL_HELP = {
    "serve": "protocol of the sources (default: detected)",
    "inspect": f"{ANY_OF}, or auto (the default)",
    "compose": f"{ANY_OF} (default: found by the name of the message)",
    "commands": f"{ANY_OF} (default: all)",
    "decode": "protocol of a capture (default: detected)",
    **{one.name: one.protocol_help for one in extension_commands().values()},
}


class _Parser(argparse.ArgumentParser):
    """Report errors in one line, as all commands do. Options may stand anywhere among the arguments."""

    commands: "dict[str, _Parser]"

    def error(self, message: str) -> NoReturn:
        words = message.removeprefix("unrecognized arguments: ").split()
        if words and message.startswith("unrecognized arguments: -"):
            message += near_miss(words[0].partition("=")[0], self._option_string_actions)
        print(f"imuscope: {message}. See `{self.prog} --help`.", file=sys.stderr)
        raise SystemExit(1)

    def _check_value(self, action: argparse.Action, value: object) -> None:
        """Reject a value that is not a choice, and list the choices."""
        if action.choices is not None and value not in action.choices:
            known = ", ".join(map(str, action.choices))
            near = near_miss(str(value), map(str, action.choices))
            raise argparse.ArgumentError(action, f"invalid choice {value!r}{near}; valid choices: {known}")


def _bus_id(text: str) -> str:
    if not text.isascii() or not text.isdigit() or not 0 < int(text) <= 255:
        raise argparse.ArgumentTypeError(f"{text!r:.40} is not a bus identifier; give a number from 1 to 255")
    return str(int(text))


_AddParser: TypeAlias = Callable[..., argparse.ArgumentParser]


@dataclass(frozen=True)
class _Registered:
    """Help texts that depend on the registries: links, protocols and exporters."""

    sources: str = ""  # forms of a source
    source_options: str = ""  # options of each form, in full
    outputs: str = ""  # suffixes that can be written
    environment: str = ENVIRONMENT_HELP.format(secrets="")
    details: str = ""  # further lines on decode options


def _registered() -> _Registered:
    from imuscope.server.commands import registered_help  # imports every registered part, which takes a moment

    secrets = [option for option in declared_options().values() if option.kind == "secret"]
    rows = (f"  {variable_of(one):<32}--{one.flag} (not visible in the process list)\n" for one in secrets)
    return _Registered(
        registered_help.source_list(),
        registered_help.source_help(),
        registered_help.output_list(),
        ENVIRONMENT_HELP.format(secrets="".join(rows)),
        "\n".join(option.details for option in declared_options().values() if option.details),
    )


def variable_of(secret: DecodeOption) -> str:
    """Environment variable that stands in for a secret decode option: IMUSCOPE_KEY."""
    return f"IMUSCOPE_{secret.name.upper()}"


def parse(words: Sequence[str]) -> argparse.Namespace:
    """The options of a command line whose first word is a command, --help or --version."""
    root = parser(with_help=not {"-h", "--help"}.isdisjoint(words), command=words[0])
    command = root.commands.get(words[0])
    if command is None:
        if extra := ABSENT.get(words[0]):
            root.error(f"{words[0]} needs packages that are not installed; add them: {installation_of(extra)}")
        return root.parse_args(list(words))
    rest = list(words[1:])
    actions = command._actions  # noqa: SLF001 - argparse has no list of them
    bare = {flag: one.const for one in actions if one.nargs == "?" and one.const for flag in one.option_strings}
    for at, word in enumerate(rest):  # the number of such an option may be left out, and then no source is one
        if word in bare and not (at + 1 < len(rest) and rest[at + 1].lstrip("-").isdigit()):
            rest[at] = f"{word}={bare[word]}"
    options = command.parse_intermixed_args(rest)
    options.words = rest
    options.command = words[0]
    variables = dict(ENVIRONMENT)
    if words[0] in DECODE_SCOPES or words[0] == "simulate":
        variables |= {one.name: variable_of(one) for one in declared_options().values() if one.kind == "secret"}
    for name, variable in variables.items():
        if getattr(options, name, 0) in (None, "") and os.environ.get(variable):
            value = os.environ[variable]
            setattr(options, name, Path(value) if name in ("data", "config") else value)
    return options


class _PrintVersion(argparse.Action):
    """--version: the commit is read from git only when it is to be printed."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(described())
        parser.exit()


def parser(*, with_help: bool = True, command: str = "") -> _Parser:
    """All commands and options.

    Args:
        with_help: whether help is complete; the registered objects take a moment to import.
        command: the one whose decode options are needed, because the protocol families take a moment too; "" for all.
    """
    about = _registered() if with_help else _Registered()
    root = _Parser(
        prog="imuscope",
        description="Serve a page that shows inertial sensors live: simulators of every family if no source is given.",
        epilog=about.environment,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    root.add_argument("-V", "--version", action=_PrintVersion, nargs=0, help="show version and commit, and exit")
    commands = root.add_subparsers(dest="command", metavar="COMMAND")
    _add_serve(commands.add_parser, about)
    _add_ports(commands.add_parser)
    _add_doctor(commands.add_parser)
    _add_inspect(commands.add_parser)
    _add_compose(commands.add_parser)
    _add_send(commands.add_parser, about)
    _add_commands(commands.add_parser)
    _add_rearm(commands.add_parser)
    _add_record(commands.add_parser, about)
    _add_replay(commands.add_parser)
    _add_simulate(commands.add_parser)
    _add_data(add_decode(commands.add_parser, about.outputs))
    for made in add_commands(commands.add_parser, command if command in COMMANDS else "", with_help=with_help):
        _add_data(made)
    _add_completion(commands.add_parser)
    root.commands = dict(commands.choices)
    for name in root.commands if not command else [command] if command in root.commands else ():
        _add_decode_options(root.commands[name], name)
    return root


def _add_serve(add_parser: _AddParser, about: _Registered) -> None:
    config_help = CONFIG_HELP + "".join(kind.config_help for kind in extension_settings())
    command = add_parser(
        "serve",
        help="serve the page (the default command)",
        epilog="\n".join(filter(None, (about.source_options, about.details, config_help, about.environment))),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.add_argument("sources", nargs="*", metavar="SOURCE", help=about.sources)
    add_page_address(command)
    command.add_argument("--record", action="store_true", default=None, help="record all devices from the start")
    for kind in extension_settings():
        kind.add_options(command)
    command.add_argument(
        "--log-format", choices=logging_setup.STYLES, help="format of the log on standard error (default text)"
    )
    command.add_argument("--log-level", choices=logging_setup.LEVELS, help="lowest level logged (default info)")
    command.add_argument("--config", type=Path, metavar="FILE", help="TOML file with settings; see below")
    _add_data(command)


def _add_ports(add_parser: _AddParser) -> None:
    command = add_parser("ports", help="list serial ports and the protocol detected on each")
    add_format(command)
    _add_data(command)


def _add_doctor(add_parser: _AddParser) -> None:
    command = add_parser("doctor", help="check this machine (ports, permissions, disk, clock) and suggest fixes")
    add_format(command)
    command.add_argument("--udev-rule", action="store_true", help="print a rule for /etc/udev/rules.d instead")
    command.add_argument("--systemd-unit", action="store_true", help="print a unit for /etc/systemd/system instead")
    command.add_argument(
        "--config", type=Path, metavar="FILE", help="settings of the server, for its data folder and port"
    )
    _add_data(command)


def _add_inspect(add_parser: _AddParser) -> None:
    command = add_parser("inspect", help="list the frames of a file, one per line")
    add_files(command, has_titles=True)
    command.add_argument(
        "--direction",
        choices=("rx", "tx"),
        default="rx",
        help="direction in a recording: rx, sent by the device (default); tx, sent to it",
    )
    add_format(command, ("table", "jsonl"), "table for people (the default), jsonl: one JSON object a line")
    command.add_argument("--device", default="", metavar="D", help="device to list, if a recording has several")
    command.add_argument("--rejects", action="store_true", help="also list rejected frames")
    _add_data(command)


def _add_compose(add_parser: _AddParser) -> None:
    command = add_parser("compose", help="print a frame as hexadecimal")
    command.add_argument(
        "message", nargs="?", metavar="MESSAGE", help="command, or any message name that inspect prints"
    )
    command.add_argument(
        "pairs",
        nargs="*",
        metavar="FIELD=VALUE",
        help="field values: 400, 0x400F, a name, [1, 2]; nested fields as outputs.0.x=…",
    )
    command.add_argument(
        "--jsonl", metavar="FILE", help='output of inspect --json, one frame per line ("-" reads standard input)'
    )
    _add_data(command)


def _add_send(add_parser: _AddParser, about: _Registered) -> None:
    command = add_parser("send", help="send one command and print the answer as JSON", epilog=SENDING)
    command.add_argument("source", metavar="SOURCE", help=about.sources)
    command.add_argument("message", metavar="MESSAGE", help="command, or name of a setting")
    command.add_argument("pairs", nargs="*", metavar="FIELD=VALUE", help="as for compose")
    command.add_argument(
        "--yes", action="store_true", help="allow commands that lose settings, stop output or cut the link"
    )
    command.add_argument(
        "--device", type=_bus_id, metavar="ID", help="bus identifier of the device, if several share the line"
    )
    _add_data(command)


def _add_commands(add_parser: _AddParser) -> None:
    command = add_parser("commands", help="list commands and settings of the devices, with ranges and sources")
    command.add_argument("name", nargs="?", default="", metavar="NAME", help="command or setting to describe in full")
    add_format(command)
    _add_data(command)


def _add_rearm(add_parser: _AddParser) -> None:
    command = add_parser("rearm", help="accept a Secure device again after its sequence restarted")
    command.add_argument("device", nargs="?", default="", metavar="DEVICE", help="device ID (default: all)")
    command.add_argument("--server", default="http://127.0.0.1:8080", metavar="URL", help="URL of the running server")
    command.add_argument(
        "--token", default="", metavar="TOKEN", help="control token of the server, or @FILE containing it"
    )
    add_format(command)
    _add_data(command)


def _add_record(add_parser: _AddParser, about: _Registered) -> None:
    command = add_parser("record", help="record sources into a file without serving a page")
    command.add_argument("sources", nargs="+", metavar="SOURCE", help=about.sources)
    command.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="recording to write (.mcap)")
    command.add_argument("--duration", type=float, metavar="S", help="stop after this many seconds of data")
    add_format(command)
    _add_data(command)


def _add_replay(add_parser: _AddParser) -> None:
    command = add_parser("replay", help="send the bytes of a recording to another program with their original timing")
    command.add_argument("file", metavar="FILE", help="recording, vendor log or capture")
    place = command.add_mutually_exclusive_group()
    place.add_argument("--tcp", metavar="[HOST]:PORT", help="listen on this TCP address (default host 127.0.0.1)")
    place.add_argument("--udp", metavar="HOST:PORT", help="send datagrams to this address")
    place.add_argument("--pty", action="store_true", help="create a pseudo-terminal (default)")
    command.add_argument(
        "--speed", type=float, default=1.0, metavar="N", help="playback speed, 0.01 to 1000 (default 1)"
    )
    command.add_argument("--loop", action="store_true", help="repeat until stopped")
    command.add_argument(
        "--from", dest="begin", type=float, default=0.0, metavar="S", help="start, in seconds from the beginning"
    )
    command.add_argument("--to", dest="end", type=float, metavar="S", help="end, in seconds from the beginning")
    command.add_argument("--device", default="", metavar="D", help="device to replay, if there are several")
    command.add_argument("--protocol", default="", metavar="NAME", help="protocol of a capture (default: detected)")
    _add_data(command)


def _add_simulate(add_parser: _AddParser) -> None:
    command = add_parser("simulate", help="simulate a device for other programs")
    command.add_argument("device", metavar="FAMILY[?OPTIONS]", help=f"{NAMES}, with the options of sim: sources")
    target = command.add_mutually_exclusive_group(required=True)
    target.add_argument("--pty", type=Path, metavar="PATH", help="create a pseudo-terminal with a link at this path")
    target.add_argument("--tcp", metavar="[HOST]:PORT", help="listen on this TCP address (default host 127.0.0.1)")
    _add_data(command)


def _add_completion(add_parser: _AddParser) -> None:
    command = add_parser(
        "completion",
        help="print a completion script for a shell",
        epilog="bash: source <(imuscope completion bash); zsh: imuscope completion zsh > ~/.zfunc/_imuscope; "
        "fish: imuscope completion fish > ~/.config/fish/completions/imuscope.fish",
    )
    command.add_argument("shell", choices=SHELLS, metavar="SHELL", help=", ".join(SHELLS))


def _add_decode_options(command: argparse.ArgumentParser, name: str) -> None:
    if name not in (*DECODE_SCOPES, "simulate", "replay"):
        return
    group = command.add_argument_group("decode options")
    scope = DECODE_SCOPES.get(name)
    if scope is not None:
        words = PROTOCOL_HELP.get(name, "protocol of the source (default: detected)")
        group.add_argument("--protocol", metavar="NAME", help=words)
    for option in declared_options().values():
        if scope in option.scopes:
            _add_decode_option(group, option)
        elif scope is None and option.kind == "secret":
            words = "not needed: bytes are sent unchanged" if name == "replay" else _with_file(option)
            group.add_argument(f"--{option.flag}", metavar=option.name.upper(), help=words)


def _add_decode_option(group: argparse._ArgumentGroup, option: DecodeOption) -> None:
    flag, words = f"--{option.flag}", option.help.replace("%", "%%")
    match option.kind:
        case "flag":
            group.add_argument(flag, action="store_true", default=None, help=words)
        case "choice":
            group.add_argument(flag, choices=option.values, help=words)
        case "secret":
            group.add_argument(flag, metavar=option.name.upper(), help=_with_file(option))
        case "file":
            group.add_argument(flag, metavar="FILE", help=words)
        case "text":
            group.add_argument(flag, metavar=option.name.upper(), help=words)


def _with_file(option: DecodeOption) -> str:
    return f"{option.help.replace('%', '%%')}; or @FILE containing it"


def _add_data(command: argparse.ArgumentParser) -> None:
    command.add_argument("--data", type=Path, metavar="DIR", help=f"data folder (default {default_data()})")
