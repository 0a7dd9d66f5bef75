"""Which commands does the command line have, and which options has each? Nothing is done here."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import NoReturn

from server import logs
from server.config import default_data
from server.live.reading import MODES, ROTATIONS, TIME_UNITS
from server.version import VERSION

COMMANDS = (
    *("serve", "ports", "doctor", "inspect", "compose", "send", "commands", "rearm", "record", "replay", "decode"),
    "simulate",
)
SOURCES = "/dev/ttyUSB0, serial:///dev/ttyUSB0?baud=921600, tcp://host:port, udp://:port, a file, twin:xbus|isb|idtp"
OUTPUTS = (
    "its suffix chooses: .csv, .parquet (a file per message), .mcap (decoded), .mtb, .raw, .bin (bytes as they came)"
)

SENDING = """A setting that is named without fields is read; with fields it is written and read back, and what the
device made of it (it rounds rates) is told. What loses settings, stops output or cuts the line is refused with its
consequence until --yes is given. `imuscope commands` lists what there is, `imuscope commands NAME` its fields."""


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, as everything else here does."""

    def error(self, message: str) -> NoReturn:
        print(f"imuscope: {message}. See `{self.prog} --help`.", file=sys.stderr)
        raise SystemExit(1)


def parser() -> argparse.ArgumentParser:
    """All commands and options."""
    root = _Parser(
        prog="imuscope",
        description="A page that shows inertial sensors live. Without a source, twins of all device families stream.",
    )
    root.add_argument("--version", action="version", version=f"imuscope {VERSION}")
    commands = root.add_subparsers(dest="command", metavar="COMMAND")

    serve = commands.add_parser("serve", help="serve the page (what `imuscope` alone does)")
    serve.add_argument("sources", nargs="*", metavar="SOURCE", help=SOURCES)
    serve.add_argument("--host", help="address to listen on (127.0.0.1; any other needs a token, which is printed)")
    serve.add_argument("--port", type=int, help="port to listen on (8080; 0: any free one)")
    serve.add_argument("--tls", action="store_true", default=None, help="serve https, with a certificate made here")
    serve.add_argument("--tls-cert", metavar="FILE", help="… or with this one (PEM); its key is --tls-key")
    serve.add_argument("--tls-key", metavar="FILE", help="private key of --tls-cert (PEM, without a passphrase)")
    _add_reading(serve, "protocol of the sources (recognised when left out)")
    serve.add_argument("--record", action="store_true", default=None, help="record all devices from the start")
    serve.add_argument(
        "--foxglove",
        type=int,
        nargs="?",
        const=8765,
        metavar="PORT",
        help="speak the Foxglove protocol, on this port of this machine (8765) and at /foxglove of the page's",
    )
    serve.add_argument("--rerun-connect", metavar="URL", help="stream to a Rerun viewer: rerun+http://host:9876/proxy")
    serve.add_argument("--log-format", choices=logs.STYLES, help="of what happens, on standard error (text)")
    serve.add_argument("--log-level", choices=logs.LEVELS, help="the least that is told (info)")
    serve.add_argument("--config", type=Path, metavar="FILE", help="TOML file with settings, see server/config.py")
    _add_data(serve)

    ports = commands.add_parser("ports", help="serial ports, and what is heard on each")
    _add_data(ports)

    doctor = commands.add_parser("doctor", help="is this machine fit: ports, rights, disk, clock; and what to do")
    doctor.add_argument("--json", action="store_true", help="for programs")
    doctor.add_argument("--udev-rule", action="store_true", help="print the rule for /etc/udev/rules.d instead")
    doctor.add_argument("--systemd-unit", action="store_true", help="print the unit for /etc/systemd/system instead")
    doctor.add_argument("--config", type=Path, metavar="FILE", help="the server's settings, for its folder and port")
    _add_data(doctor)

    inspect = commands.add_parser("inspect", help="one line per frame of a file")
    inspect.add_argument("file", metavar="FILE", help="a raw capture")
    _add_reading(inspect, "xbus, isb, idtp, or auto (the default)")
    inspect.add_argument("--direction", choices=("rx", "tx"), default="rx", help="rx: sent by the device (the default)")
    inspect.add_argument("--format", choices=("table", "jsonl"), default="table")
    inspect.add_argument("--rejects", action="store_true", help="also show what failed its checks")
    inspect.add_argument("--no-replay-check", action="store_true", help="accept frames of any sequence number")
    _add_data(inspect)

    compose = commands.add_parser("compose", help="print a frame as hex")
    compose.add_argument("message", nargs="?", metavar="MESSAGE", help="a command, or any message that inspect names")
    compose.add_argument("pairs", nargs="*", metavar="FIELD=VALUE", help="400, 0x400F, a name, [1, 2], outputs.0.x=…")
    compose.add_argument("--jsonl", metavar="FILE", help='what inspect printed ("-": standard input), a frame a line')
    _add_reading(compose, "xbus, isb or idtp (found by the message's name when left out)")
    _add_data(compose)

    send = commands.add_parser("send", help="send one command and print the answer as JSON", epilog=SENDING)
    send.add_argument("source", metavar="SOURCE", help=SOURCES)
    send.add_argument("message", metavar="MESSAGE", help="a command, or the name of a setting")
    send.add_argument("pairs", nargs="*", metavar="FIELD=VALUE", help="as for compose")
    send.add_argument("--yes", action="store_true", help="send also what loses settings, stops output or cuts the line")
    _add_reading(send, "protocol of the source (recognised when left out)")
    _add_data(send)

    manual = commands.add_parser("commands", help="what devices can be told and asked, with ranges and sources")
    manual.add_argument("name", nargs="?", default="", metavar="NAME", help="one command or setting, in full")
    manual.add_argument("--protocol", default="", metavar="NAME", help="xbus, isb or idtp (all when left out)")
    _add_data(manual)

    rearm = commands.add_parser("rearm", help="accept a Secure device again whose sequence restarted")
    rearm.add_argument("device", nargs="?", default="", metavar="DEVICE", help="IDTP device id (all when left out)")
    rearm.add_argument("--server", default="http://127.0.0.1:8080", metavar="URL", help="the running server")
    rearm.add_argument("--token", default="", metavar="TOKEN", help="its control token, or @FILE that holds it")
    _add_data(rearm)

    record = commands.add_parser("record", help="record a source into a file, without a page")
    record.add_argument("source", metavar="SOURCE", help=SOURCES)
    record.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="of the recording, .mcap")
    record.add_argument("--duration", type=float, metavar="S", help="end after so many seconds of data")
    _add_reading(record, "protocol of the source (recognised when left out)")
    _add_data(record)

    replay = commands.add_parser("replay", help="send the bytes of a recording to another program, as they came")
    replay.add_argument("file", metavar="FILE", help="a recording, or a log or capture of any kind")
    place = replay.add_mutually_exclusive_group()
    place.add_argument("--tcp", metavar="[HOST]:PORT", help="listen there (127.0.0.1 without a host)")
    place.add_argument("--udp", metavar="HOST:PORT", help="send datagrams there")
    place.add_argument("--pty", action="store_true", help="be a serial port (the default)")
    replay.add_argument("--speed", type=float, default=1.0, metavar="N", help="2: twice as fast; 0.01 to 1000")
    replay.add_argument("--loop", action="store_true", help="begin again at the end, until it is stopped")
    replay.add_argument("--from", dest="begin", type=float, default=0.0, metavar="S", help="seconds from the beginning")
    replay.add_argument("--to", dest="end", type=float, metavar="S", help="seconds from the beginning")
    replay.add_argument("--device", default="", metavar="D", help="which one, where the recording has several")
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
    decode.add_argument("file", type=Path, metavar="FILE", help="a recording, a vendor's log, a raw capture")
    decode.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help=OUTPUTS)
    _add_reading(decode, "protocol of a capture (recognised when left out)")
    _add_data(decode)
    return root


def _add_reading(command: argparse.ArgumentParser, protocol: str) -> None:
    """What a person says about the bytes of a source or file; see server/live/reading.py."""
    command.add_argument("--protocol", metavar="NAME", help=protocol)
    command.add_argument("--key", metavar="KEY", help="for Secure frames of IDTP: hex, or @FILE that holds hex")
    command.add_argument(
        "--min-mode", choices=MODES, help="weakest mode of IDTP frames that is accepted (secure with a key, else lite)"
    )
    command.add_argument(
        "--time-unit", choices=TIME_UNITS, help="of the timestamps of IDTP (us, unless their arrival says otherwise)"
    )
    command.add_argument(
        "--rotation",
        choices=ROTATIONS,
        help="which way the quaternion of an IDTP device turns: body to ENU (the default), or ENU to body",
    )
    command.add_argument("--schema", metavar="FILE", help="descriptions of vendor types, see protocols/idtp/vendor.py")
    command.add_argument(
        "--unverified", action="store_true", default=None, help="without a key, show Secure frames, marked"
    )


def _add_data(command: argparse.ArgumentParser) -> None:
    command.add_argument("--data", type=Path, metavar="DIR", help=f"folder for data ({default_data()})")
