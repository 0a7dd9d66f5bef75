"""The command line: `imuscope`, `imuscope serve`, `ports`, `doctor`, `inspect`, `compose`, `send`, `commands`,
`record`, `replay`, `decode`.

Exit status 0, or 1 with one clear line on standard error and no traceback. Nothing heavy is imported before it is
needed: `--help` and `--version` answer at once. The folder for compiled code is settled before numba is imported.
"""

from __future__ import annotations

import argparse
import logging
import os
import sys
import time
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

from server import logs
from server.compiled import prepare_cache
from server.config import Config, ConfigError, default_data, load
from server.live.reading import MODES, Reading, ReadingError, key_text, reading, schema_text, taken_from
from server.version import VERSION

COMMANDS = ("serve", "ports", "doctor", "inspect", "compose", "send", "commands", "record", "replay", "decode")
SOURCES = "/dev/ttyUSB0, serial:///dev/ttyUSB0?baud=921600, tcp://host:port, udp://:port, a file, twin:xbus|isb|idtp"
OUTPUTS = (
    "its suffix chooses: .csv, .parquet (a file per message), .mcap (decoded), .mtb, .raw, .bin (bytes as they came)"
)

SENDING = """A setting that is named without fields is read; with fields it is written and read back, and what the
device made of it (it rounds rates) is told. What loses settings, stops output or cuts the line is refused with its
consequence until --yes is given. `imuscope commands` lists what there is, `imuscope commands NAME` its fields."""


class UsageError(Exception):
    """Something that the user can put right: printed as one line."""


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
    command.add_argument("--schema", metavar="FILE", help="descriptions of vendor types, see protocols/idtp/vendor.py")
    command.add_argument(
        "--unverified", action="store_true", default=None, help="without a key, show Secure frames, marked"
    )


def _add_data(command: argparse.ArgumentParser) -> None:
    command.add_argument("--data", type=Path, metavar="DIR", help=f"folder for data ({default_data()})")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if not given or (given[0] not in COMMANDS and given[0] not in ("-h", "--help", "--version")):
        given.insert(0, "serve")
    options = parser().parse_args(given)
    logging.basicConfig(level=logging.WARNING, format="imuscope: %(levelname)s: %(message)s")
    try:
        match options.command:
            case "serve":
                _serve(options)
            case "ports":
                _ports(options)
            case "doctor":
                return _doctor(options)
            case "inspect":
                _inspect(options)
            case "compose":
                _compose(options)
            case "send":
                _send(options)
            case "commands":
                _commands(options)
            case "record":
                _record(options)
            case "replay":
                _replay(options)
            case "decode":
                _decode(options)
    except (UsageError, ConfigError, ReadingError) as error:
        end = "" if str(error).endswith((".", "?")) else "."
        print(f"imuscope: {error}{end}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # `imuscope inspect … | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    return 0


def _serve(options: argparse.Namespace) -> None:
    started = time.monotonic()
    config = load(
        options.config,
        host=options.host,
        port=options.port,
        data=options.data,
        protocol="" if options.protocol == "auto" else options.protocol,
        key=None if options.key is None else key_text(options.key),
        min_mode=options.min_mode,
        schema=options.schema,
        unverified=options.unverified,
        sources=options.sources or None,
        tls=options.tls,
        tls_cert=options.tls_cert,
        tls_key=options.tls_key,
        record=options.record,
        foxglove=options.foxglove,
        rerun_connect=options.rerun_connect,
        log_format=options.log_format,
        log_level=options.log_level,
    )
    from server import serving
    from server.auth import Access

    given, access = config.reading(), Access(config)
    keys = (access.view_token, access.control_token, config.key, given.key.hex() if given.key else "")
    logs.install(config.log_format, config.log_level, logs.secrets_of(*keys))
    keeper = serving.keeper_of(config)
    _compile(config.data)
    from server.app import create_app
    from server.links import LinkError, open_link
    from server.links.file import FileLink
    from server.live import speech

    known = speech.protocols()
    for source in config.sources:
        try:
            place, own = taken_from(source, given)
            link = open_link(place)
        except LinkError as error:
            raise UsageError(str(error)) from None
        _known(own.protocol, known)
        if isinstance(link, FileLink) and not link.path.is_file():
            # A port may be plugged in later; a file that is not there now is a slip of the fingers.
            raise UsageError(_no_file(str(link.path)) + " See `imuscope --help` for commands and sources.")
    _known(given.protocol, known)
    try:
        listener = serving.listen(config.host, config.port)
    except OSError as error:
        hint = "Give another with --port, or 0 for any free one."
        raise UsageError(f"cannot listen on {config.host}:{config.port}: {error.strerror}. {hint}") from None
    url = _url(config, listener.getsockname()[1])

    def ready() -> None:
        logs.say(f"imuscope {VERSION} ({time.monotonic() - started:.1f} s)")
        if access.control_token and not config.is_loopback:
            print(
                f"to look:    {url}?token={access.view_token}\nto control: {url}?token={access.control_token}",
                flush=True,
            )
        else:
            print(url, flush=True)
        if keeper is not None:
            print(f"SHA-256 of its certificate: {keeper.tls.fingerprint}", flush=True)
        if not config.sources:
            words = "No source given: showing twins of an Xsens MTi, an Inertial Sense IMX and an IDTP device."
            logs.say(f"{words} See `imuscope serve --help`.")

    try:
        serving.run(create_app(config, access), listener, ready, keeper)
    except RuntimeError as error:
        raise UsageError(str(error)) from None


def _known(protocol: str, known: Collection[str]) -> None:
    if protocol and protocol not in known:
        raise UsageError(f"there is no protocol {protocol!r}; there are: {', '.join(known)}.")


def _url(config: Config, port: int) -> str:
    """An address that a person can open: 0.0.0.0 is no place to go, the machine's name is."""
    import platform

    host = platform.node() if config.host in ("0.0.0.0", "::", "") else config.host
    return f"{config.scheme}://{f'[{host}]' if ':' in host else host}:{port}/"


def _compile(data: Path) -> None:
    """Import what is compiled, and say so when that takes a while."""
    first, words = prepare_cache(data)
    for sentence in words:
        logs.say(f"imuscope: {sentence}")
    if first:
        logs.say("imuscope: compiling the decoders; this is done once and takes some seconds.")
    from protocols import jit, registry

    registry.warm()
    if jit.uncached and not words:
        logs.say("imuscope: compiled code could not be kept; it is compiled again next time.")


def _ports(options: argparse.Namespace) -> None:
    _compile(load(data=options.data).data)
    from server.links.ports import print_ports

    print_ports(sys.stdout)


def _doctor(options: argparse.Namespace) -> int:
    from server.commands import doctor
    from server.host.checks import Machine, look

    if options.udev_rule or options.systemd_unit:
        sys.stdout.write(doctor.udev_rule() if options.udev_rule else doctor.systemd_unit())
        return 0
    config = load(options.config, data=options.data)
    return doctor.told(look(Machine(config.data, config.port)), sys.stdout, as_json=options.json)


def _inspect(options: argparse.Namespace) -> None:
    path = Path(options.file)
    if not path.is_file():
        raise UsageError(_no_file(options.file))
    _compile(load(data=options.data).data)
    from server.commands.inspect import inspect_file

    said = _said(options, "auto", replay_check=not options.no_replay_check)
    how = {name: getattr(options, name) for name in ("direction", "format", "rejects")}
    try:
        inspect_file(path, sys.stdout, said, notes=sys.stderr, **how)
    except (ValueError, OSError) as error:
        if isinstance(error, BrokenPipeError):
            raise
        raise UsageError(str(error)) from None


def _said(options: argparse.Namespace, protocol: str = "", *, replay_check: bool = True) -> Reading:
    """What the options say about reading."""
    return reading(
        options.protocol or protocol,
        key_text(options.key) if options.key is not None else "",
        options.min_mode or "",
        bool(options.unverified),
        schema_text(options.schema) if options.schema else "",
        replay_check,
    )


def _compose(options: argparse.Namespace) -> None:
    if (options.message is None) == (options.jsonl is None):
        raise UsageError("give a message, or --jsonl with a file")
    if options.jsonl not in (None, "-") and not Path(options.jsonl).is_file():
        raise UsageError(_no_file(options.jsonl))
    _compile(load(data=options.data).data)
    from server.commands.compose import ComposeError, chosen, frame_of, frames_of, known_of, tongues

    said = _said(options)
    spoken = tongues(said.key, said.schema)
    try:
        if options.jsonl is None:
            protocol = "" if said.protocol == "auto" else said.protocol
            frame, _ = frame_of(
                chosen(spoken, options.message, protocol), options.message, options.pairs, known_of(said)
            )
            print(frame.hex())
            return
        with sys.stdin if options.jsonl == "-" else open(options.jsonl, encoding="utf-8") as lines:
            for frame in frames_of(lines, spoken):
                sys.stdout.write(frame.hex() + "\n")
    except (ComposeError, UnicodeDecodeError) as error:
        raise UsageError(str(error)) from None


def _send(options: argparse.Namespace) -> None:
    import asyncio

    _compile(load(data=options.data).data)
    from server.commands.compose import ComposeError
    from server.commands.sending import SendError, Wish, send

    source, said = taken_from(options.source, _said(options))
    _known(said.protocol, ("auto", *_protocols()))
    said = replace(said, protocol="" if said.protocol == "auto" else said.protocol)
    wish = Wish(source, options.message, options.pairs, options.yes)
    try:
        asyncio.run(send(wish, said, sys.stdout, sys.stderr))
    except (ComposeError, SendError) as error:
        raise UsageError(str(error)) from None


def _commands(options: argparse.Namespace) -> None:
    _known(options.protocol, ("auto", *_protocols()))
    _compile(load(data=options.data).data)
    from server.commands.compose import ComposeError
    from server.commands.manual import manual

    try:
        for line in manual(options.protocol, options.name):
            print(line)
    except ComposeError as error:
        raise UsageError(str(error)) from None


def _record(options: argparse.Namespace) -> None:
    if options.duration is not None and not options.duration > 0:
        raise UsageError(f"--duration {options.duration:g} is no time")
    data = load(data=options.data).data
    _compile(data)
    from server.commands.record import RecordError, Wish, record
    from server.links.base import LinkError

    source, said = taken_from(options.source, _said(options))
    _known(said.protocol, ("auto", *_protocols()))
    said = replace(said, protocol="" if said.protocol == "auto" else said.protocol)
    try:
        print(record(Wish(source, said, options.output, options.duration, data), sys.stderr))
    except (RecordError, LinkError) as error:
        raise UsageError(str(error)) from None


def _decode(options: argparse.Namespace) -> None:
    if not options.file.is_file():
        raise UsageError(_no_file(str(options.file)))
    said = _said(options)
    _compile(load(data=options.data).data)
    from server.commands.decode import DecodeError, decode_file

    _known(said.protocol, ("auto", *_protocols()))
    said = replace(said, protocol="" if said.protocol == "auto" else said.protocol)
    try:
        for path in decode_file(options.file, options.output, said, sys.stderr):
            print(path)
    except DecodeError as error:
        raise UsageError(str(error)) from None


def _replay(options: argparse.Namespace) -> None:
    import asyncio

    if not Path(options.file).is_file():
        raise UsageError(_no_file(options.file))
    if not 0.01 <= options.speed <= 1000:
        raise UsageError(f"--speed {options.speed:g} is outside 0.01 … 1000")
    _compile(load(data=options.data).data)
    from server.commands import replaying

    def sink() -> replaying.Sink:
        if options.tcp is not None:
            return replaying.TcpSink(*replaying.address(options.tcp))
        return replaying.UdpSink(*replaying.address(options.udp)) if options.udp is not None else replaying.PtySink()

    how = (options.protocol, options.speed, options.loop, options.begin, options.end, options.device)
    try:
        asyncio.run(replaying.replay(replaying.Wish(Path(options.file), sink, *how), sys.stdout))
    except replaying.ReplayError as error:
        raise UsageError(str(error)) from None


def _protocols() -> Collection[str]:
    from server.live import speech

    return speech.protocols()


def _no_file(path: str) -> str:
    return f"{path} is a folder; name one capture in it." if Path(path).is_dir() else f"there is no file {path}."


if __name__ == "__main__":
    raise SystemExit(main())
