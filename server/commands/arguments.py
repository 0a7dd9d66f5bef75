"""Which commands does the command line have, and which options has each? Nothing is done here."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from server import logging_setup
from server.config import default_data
from server.devices.decode_options import MODES, ROTATIONS, TIME_UNITS
from server.version import VERSION

COMMANDS = (
    *("serve", "ports", "doctor", "inspect", "compose", "send", "commands", "rearm", "record", "replay", "decode"),
    *("simulate", "completion"),
)
SHELLS = ("bash", "zsh", "fish")
FOXGLOVE_PORT = 8765
SOURCES = (
    "/dev/ttyUSB0, serial:///dev/ttyUSB0?baud=921600, tcp://host:port, tcp-listen://:port, udp://:port, a file, "
    "a pipe, - (standard input), twin:xbus|isb|idtp; `imuscope serve --help` has their options"
)
OUTPUTS = (
    "its suffix chooses: .csv, .parquet (a file per message), .mcap (decoded), .rrd (Rerun), "
    ".mtb, .raw, .bin (bytes as they came)"
)

SENDING = """A setting that is named without fields is read; with fields it is written and read back, and what the
device made of it (it rounds rates) is told. What loses settings, stops output or cuts the line is refused with its
consequence until --yes is given. `imuscope commands` lists what there is, `imuscope commands NAME` its fields."""


SOURCE_HELP = """sources, with their options after a question mark:
  /dev/ttyUSB0?baud=921600&bits=8&parity=none|even|odd&stop=1|2&flow=none|hardware
                                  a serial port; without baud its rate is found by listening
  tcp://host:port                 connect to a device server
  tcp-listen://[host]:port        wait for a device to connect
  udp://[host]:port               receive datagrams
  FILE?speed=4&loop=1             a capture at its own pace; of a recording also device=, from=, to=
  -, a pipe                       what comes through it, at once; a capture that is poured in at its own pace
  twin:xbus|isb|idtp?rate=400     a simulated device; also product=, mode=, clock=, baud=, drop=, corrupt=, drift_ppm=,
                                  jump_s=, reset_s=, unplug_s=, away_s=, burst_ms=, seed=, port=; bus_ids=1,2: several
                                  MTi on one line (server/links/simulator.py)
  any of them                     protocol=, key=, min_mode=, unverified=, time_unit=, rotation=: as the options below
"""
SCHEMA_HELP = """a schema describes a vendor's own payload types of IDTP, in TOML:
  [[message]]                     type = 0x80, name = "WheelSpeed", doc = "…"; then its fields, in order:
  [[message.field]]               name, type = i8…i64, u8…u64, f32, f64; count, axes, unit, scale, bias, decimals, doc
"""
CONFIG_HELP = """a configuration file has, in TOML, under the names of the options above (_ for -): host, port, data,
sources, protocol, key, min_mode, schema, unverified, time_unit, rotation, record, tls, tls_cert, tls_key,
foxglove, rerun_connect, log_format, log_level; and beside them:
  view_token, control_token       tokens of your own, at least 20 characters each
  allowed_hosts, allowed_origins  lists of names and of pages that may use this server
  trial_s                         seconds in which settings that could cut the line must be confirmed (20)
  history_s, memory_mb            how far back samples are remembered, whichever is less (600 s, 256 MB)
  recordings_quota_gb             beyond it the oldest recordings go that are not pinned (0: no quota)
  split_mb, split_min             a recording goes on in a new file at this size or age (0: never)
  record_head                     ask an Xsens device for its Configuration when a recording begins (true)
  upload_gb                       how large an uploaded recording may be (16)
  [map] tiles, attribution        a tile server for the map under the track
"""
ENVIRONMENT_HELP = """environment, where an option is left out:
  IMUSCOPE_DATA                   --data
  IMUSCOPE_CONFIG                 --config
  IMUSCOPE_KEY                    --key: @FILE, or hex, which then stands in no list of processes
  IMUSCOPE_TOKEN                  --token
  XDG_DATA_HOME, NUMBA_CACHE_DIR  where the folder for data, and compiled code, are by default
"""
ENVIRONMENT = {"data": "IMUSCOPE_DATA", "config": "IMUSCOPE_CONFIG", "key": "IMUSCOPE_KEY", "token": "IMUSCOPE_TOKEN"}
"""Option → variable that stands in for it."""


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, as everything else here does. Options may stand anywhere among the arguments."""

    commands: dict[str, _Parser]

    def error(self, message: str) -> NoReturn:
        print(f"imuscope: {message}. See `{self.prog} --help`.", file=sys.stderr)
        raise SystemExit(1)

    def _check_value(self, action: argparse.Action, value: object) -> None:
        """A value that is none of the choices: the names of all of them."""
        if action.choices is not None and value not in action.choices:
            known = ", ".join(map(str, action.choices))
            raise argparse.ArgumentError(action, f"invalid choice: {value!r}; there are: {known}")


def _bus_id(text: str) -> str:
    """A bus identifier, 1 to 255."""
    if not text.isascii() or not text.isdigit() or not 0 < int(text) <= 255:
        raise argparse.ArgumentTypeError(f"{text!r:.40} is no bus identifier; give a number from 1 to 255")
    return str(int(text))


def parse(given: Sequence[str]) -> argparse.Namespace:
    """The options of a command line whose first word is a command, --help or --version."""
    root = parser()
    command = root.commands.get(given[0])
    if command is None:
        return root.parse_args(list(given))
    rest = list(given[1:])
    for at, word in enumerate(rest):  # its port may be left out, and then no source is one
        if word == "--foxglove" and not (at + 1 < len(rest) and rest[at + 1].lstrip("-").isdigit()):
            rest[at] = f"--foxglove={FOXGLOVE_PORT}"
    options = command.parse_intermixed_args(rest)
    options.command = given[0]
    for name, variable in ENVIRONMENT.items():
        if (given[0], name) == ("replay", "key"):
            continue  # it needs none, and would say so each time
        if getattr(options, name, 0) in (None, "") and os.environ.get(variable):
            value = os.environ[variable]
            setattr(options, name, Path(value) if name in ("data", "config") else value)
    return options


def parser() -> _Parser:
    """All commands and options."""
    root = _Parser(
        prog="imuscope",
        description="A page that shows inertial sensors live. Without a source, twins of all device families stream.",
        epilog=ENVIRONMENT_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    root.add_argument("--version", action="version", version=f"imuscope {VERSION}")
    commands = root.add_subparsers(dest="command", metavar="COMMAND")

    serve = commands.add_parser(
        "serve",
        help="serve the page (what `imuscope` alone does)",
        epilog="\n".join((SOURCE_HELP, SCHEMA_HELP, CONFIG_HELP, ENVIRONMENT_HELP)),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    serve.add_argument("sources", nargs="*", metavar="SOURCE", help=SOURCES)
    serve.add_argument("--host", help="address to listen on (127.0.0.1; any other needs a token, which is printed)")
    serve.add_argument("--port", type=int, help="port to listen on (8080; 0: any free one)")
    serve.add_argument("--tls", action="store_true", default=None, help="serve https, with a certificate made here")
    serve.add_argument("--tls-cert", metavar="FILE", help="use this certificate (PEM); its key is --tls-key")
    serve.add_argument("--tls-key", metavar="FILE", help="private key of --tls-cert (PEM, without a passphrase)")
    _add_reading(serve, "protocol of the sources (recognised when left out)")
    serve.add_argument("--record", action="store_true", default=None, help="record all devices from the start")
    serve.add_argument(
        "--foxglove",
        type=int,
        nargs="?",
        const=FOXGLOVE_PORT,
        metavar="PORT",
        help="speak the Foxglove protocol, on this port of this machine (8765) and at /foxglove of the page's",
    )
    serve.add_argument("--rerun-connect", metavar="URL", help="stream to a Rerun viewer: rerun+http://host:9876/proxy")
    serve.add_argument("--log-format", choices=logging_setup.STYLES, help="log format, on standard error (text)")
    serve.add_argument("--log-level", choices=logging_setup.LEVELS, help="lowest level logged (info)")
    serve.add_argument("--config", type=Path, metavar="FILE", help="TOML file with settings, see below")
    _add_data(serve)

    ports = commands.add_parser("ports", help="serial ports, and what is heard on each")
    _add_data(ports)

    doctor = commands.add_parser("doctor", help="is this machine fit: ports, rights, disk, clock; and what to do")
    _add_format(doctor, ("table", "json"), "table for people, json for programs")
    doctor.add_argument("--udev-rule", action="store_true", help="print the rule for /etc/udev/rules.d instead")
    doctor.add_argument("--systemd-unit", action="store_true", help="print the unit for /etc/systemd/system instead")
    doctor.add_argument("--config", type=Path, metavar="FILE", help="the server's settings, for its folder and port")
    _add_data(doctor)

    inspect = commands.add_parser("inspect", help="one line per frame of a file")
    inspect.add_argument("file", metavar="FILE", help='a capture, a recording, a vendor\'s log; "-": standard input')
    _add_reading(inspect, "xbus, isb, idtp, or auto (the default)", FRAMES)
    inspect.add_argument(
        "--direction",
        choices=("rx", "tx"),
        default="rx",
        help="of a recording: rx: sent by the device (the default), tx: to it",
    )
    _add_format(inspect, ("table", "jsonl"), "table for people (the default), jsonl: one JSON object a line")
    inspect.add_argument("--device", default="", metavar="D", help="which one of a recording, where it has several")
    inspect.add_argument("--rejects", action="store_true", help="also show what failed its checks")
    inspect.add_argument("--no-replay-check", action="store_true", help="accept frames of any sequence number")
    _add_data(inspect)

    compose = commands.add_parser("compose", help="print a frame as hex")
    compose.add_argument("message", nargs="?", metavar="MESSAGE", help="a command, or any message that inspect names")
    compose.add_argument("pairs", nargs="*", metavar="FIELD=VALUE", help="400, 0x400F, a name, [1, 2], outputs.0.x=…")
    compose.add_argument("--jsonl", metavar="FILE", help='what inspect printed ("-": standard input), a frame a line')
    _add_reading(compose, "xbus, isb or idtp (found by the message's name when left out)", TABLES)
    _add_data(compose)

    send = commands.add_parser("send", help="send one command and print the answer as JSON", epilog=SENDING)
    send.add_argument("source", metavar="SOURCE", help=SOURCES)
    send.add_argument("message", metavar="MESSAGE", help="a command, or the name of a setting")
    send.add_argument("pairs", nargs="*", metavar="FIELD=VALUE", help="as for compose")
    send.add_argument("--yes", action="store_true", help="send also what loses settings, stops output or cuts the line")
    send.add_argument(
        "--device", type=_bus_id, metavar="ID", help="bus identifier of an Xbus device that shares its line"
    )
    _add_reading(send, "protocol of the source (recognised when left out)")
    _add_data(send)

    manual = commands.add_parser("commands", help="what devices can be told and asked, with ranges and sources")
    manual.add_argument("name", nargs="?", default="", metavar="NAME", help="one command or setting, in full")
    _add_reading(manual, "xbus, isb or idtp (all when left out)", ("protocol", "schema"))
    _add_data(manual)

    rearm = commands.add_parser("rearm", help="accept a Secure device again whose sequence restarted")
    rearm.add_argument("device", nargs="?", default="", metavar="DEVICE", help="IDTP device id (all when left out)")
    rearm.add_argument("--server", default="http://127.0.0.1:8080", metavar="URL", help="the running server")
    rearm.add_argument("--token", default="", metavar="TOKEN", help="its control token, or @FILE that holds it")
    _add_data(rearm)

    record = commands.add_parser("record", help="record a source into a file, without a page")
    record.add_argument("sources", nargs="+", metavar="SOURCE", help=SOURCES)
    record.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="recording to write (.mcap)")
    record.add_argument("--duration", type=float, metavar="S", help="end after so many seconds of data")
    _add_reading(record, "protocol of the source (recognised when left out)")
    _add_data(record)

    replay = commands.add_parser("replay", help="send the bytes of a recording to another program, as they came")
    replay.add_argument("file", metavar="FILE", help="a recording, or a log or capture of any kind")
    place = replay.add_mutually_exclusive_group()
    place.add_argument("--tcp", metavar="[HOST]:PORT", help="listen there (127.0.0.1 without a host)")
    place.add_argument("--udp", metavar="HOST:PORT", help="send datagrams there")
    place.add_argument("--pty", action="store_true", help="offer a pseudo-terminal (the default)")
    replay.add_argument("--speed", type=float, default=1.0, metavar="N", help="2: twice as fast; 0.01 to 1000")
    replay.add_argument("--loop", action="store_true", help="begin again at the end, until it is stopped")
    replay.add_argument("--from", dest="begin", type=float, default=0.0, metavar="S", help="seconds from the beginning")
    replay.add_argument("--to", dest="end", type=float, metavar="S", help="seconds from the beginning")
    replay.add_argument("--device", default="", metavar="D", help="device to replay, if there are several")
    replay.add_argument("--key", metavar="KEY", help="not needed, and said so: the bytes are sent as they came")
    replay.add_argument("--protocol", default="", metavar="NAME", help="of a capture (recognised when left out)")
    _add_data(replay)

    simulate = commands.add_parser("simulate", help="a simulated device for other programs")
    simulate.add_argument("device", metavar="FAMILY[?OPTIONS]", help="xbus?product=MTi-680G, isb, idtp?mode=lite, …")
    door = simulate.add_mutually_exclusive_group(required=True)
    door.add_argument("--pty", type=Path, metavar="PATH", help="be a serial port, found at this path")
    door.add_argument("--tcp", metavar="[HOST]:PORT", help="listen there (127.0.0.1 without a host)")
    simulate.add_argument("--key", metavar="KEY", help="for Secure frames of IDTP: @FILE that holds hex, or hex")
    _add_data(simulate)

    decode = commands.add_parser("decode", help="turn a recording, log or capture into files of other programs")
    decode.add_argument(
        "file", type=Path, metavar="FILE", help='a recording, a vendor\'s log, a raw capture; "-": standard input'
    )
    decode.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help=OUTPUTS)
    decode.add_argument("--from", dest="begin", type=float, default=0.0, metavar="S", help="seconds from the beginning")
    decode.add_argument("--to", dest="end", type=float, metavar="S", help="seconds from the beginning")
    decode.add_argument("--device", default="", metavar="D", help="device to decode (all where the format holds all)")
    decode.add_argument("--channel", action="append", metavar="NAME", help="only this one; may be given several times")
    _add_reading(decode, "protocol of a capture (recognised when left out)")
    _add_data(decode)

    completion = commands.add_parser(
        "completion",
        help="print what a shell needs to complete commands and options",
        epilog="bash: source <(imuscope completion bash); zsh: imuscope completion zsh > ~/.zfunc/_imuscope; "
        "fish: imuscope completion fish > ~/.config/fish/completions/imuscope.fish",
    )
    completion.add_argument("shell", choices=SHELLS, metavar="SHELL", help=", ".join(SHELLS))
    root.commands = dict(commands.choices)
    return root


def _add_format(command: argparse.ArgumentParser, known: tuple[str, str], words: str) -> None:
    """How results are printed; --json is short for the form for programs."""
    command.add_argument("--format", choices=known, default=known[0], help=words)
    words = f"short for --format {known[1]}"
    command.add_argument("--json", dest="format", action="store_const", const=known[1], help=words)


_READING: Mapping[str, Mapping[str, Any]] = {
    "protocol": {"metavar": "NAME"},
    "key": {"metavar": "KEY", "help": "for Secure frames of IDTP: @FILE that holds hex, or hex"},
    "min-mode": {
        "choices": MODES,
        "help": "weakest mode of IDTP frames that is accepted (secure with a key, else lite)",
    },
    "time-unit": {
        "choices": TIME_UNITS,
        "help": "of the timestamps of IDTP (us, unless their arrival says otherwise)",
    },
    "rotation": {
        "choices": ROTATIONS,
        "help": "which way the quaternion of an IDTP device turns: body to ENU (the default), or ENU to body",
    },
    "schema": {"metavar": "FILE", "help": "descriptions of vendor types of IDTP (TOML)"},
    "unverified": {
        "action": "store_true",
        "default": None,
        "help": "without a key, show Secure frames, marked",
    },
}
"""What a person says about the bytes of a source or file; see server/devices/decode_options.py."""
FRAMES = ("protocol", "key", "min-mode", "schema", "unverified")  # what a list of frames as they are depends on
TABLES = ("protocol", "key", "schema")  # what making a frame depends on


def _add_reading(command: argparse.ArgumentParser, protocol: str, names: Iterable[str] = _READING) -> None:
    """Those options that the command acts upon: none is taken and then ignored."""
    for name in names:
        command.add_argument(f"--{name}", **{"help": protocol, **_READING[name]})


def _add_data(command: argparse.ArgumentParser) -> None:
    command.add_argument("--data", type=Path, metavar="DIR", help=f"folder for data ({default_data()})")
