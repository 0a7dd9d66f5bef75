"""The command line: `imuscope`, `imuscope serve`, `ports`, `doctor`, `inspect`, `compose`, `send`, `commands`, `rearm`,
`record`, `replay`, `decode`, `simulate`.

Exit status 0, or 1 with one clear line on standard error and no traceback. Nothing heavy is imported before it is
needed: `--help` and `--version` answer at once. The folder for compiled code is settled before numba is imported.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import logging
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from server.commands.arguments import COMMANDS, parse, parser
from server.commands.common import (
    UsageError,
    check_protocol,
    check_sources,
    no_file,
    placed,
    readable,
    reading_of,
    settled,
    warm,
    whole,
)
from server.config import ConfigError, load
from server.devices.decode_options import ReadingError, key_text, parse_source_options
from server.printable import printable


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if sys.stdout is None:  # closed by who called: what is printed has nowhere to go
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - until the end
    if not given or (given[0] not in COMMANDS and given[0] not in ("-h", "--help", "--version")):
        given.insert(0, "serve")
    logging.basicConfig(level=logging.WARNING, format="imuscope: %(levelname)s: %(message)s")
    try:
        options = parse(given)
        status = _RUN[options.command](options) or 0
        sys.stdout.flush()
        return status
    except (UsageError, ConfigError, ReadingError) as error:
        end = "" if str(error).endswith((".", "?")) else "."
        print(f"imuscope: {printable(str(error))}{end}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # `imuscope inspect … | head`
        _silence()
        return 0
    except OSError as error:
        if error.errno not in UNWRITABLE:
            raise
        _silence()
        print(f"imuscope: the output cannot be written: {(error.strerror or '').lower()}.", file=sys.stderr)
        return 1


UNWRITABLE = (errno.ENOSPC, errno.EIO, errno.EBADF, errno.EDQUOT)


def _silence() -> None:
    """What is still to be written goes nowhere: the interpreter would fail on it when it ends."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _ports(options: argparse.Namespace) -> None:
    warm(options.data)
    from server.links.ports import print_ports

    print_ports(sys.stdout)


def _doctor(options: argparse.Namespace) -> int:
    from server.commands import doctor
    from server.diagnostics.checks import Machine, look

    if options.udev_rule and options.systemd_unit:
        raise UsageError("--udev-rule and --systemd-unit print one file each; give one of the two")
    if (options.udev_rule or options.systemd_unit) and options.format == "json":
        raise UsageError("--format json is for findings, and a file is printed as it is; leave one out")
    if options.udev_rule or options.systemd_unit:
        sys.stdout.write(doctor.udev_rule() if options.udev_rule else doctor.systemd_unit())
        return 0
    config = load(options.config, data=options.data)
    return doctor.format_findings(look(Machine(config.data, config.port)), sys.stdout, as_json=options.format == "json")


def _inspect(options: argparse.Namespace) -> None:
    path = readable(options.file)
    warm(options.data)
    from server.commands.inspect import inspect_file

    said = reading_of(options, "auto", replay_check=not options.no_replay_check)
    how = {name: getattr(options, name) for name in ("direction", "format", "rejects", "device")}
    try:
        inspect_file(path, sys.stdout, said, notes=sys.stderr, **how)
    except (ValueError, OSError) as error:
        if isinstance(error, OSError) and (isinstance(error, BrokenPipeError) or error.errno in UNWRITABLE):
            raise
        raise UsageError(str(error)) from None


def _compose(options: argparse.Namespace) -> None:
    if (options.message is None) == (options.jsonl is None):
        raise UsageError("give a message, or --jsonl with a file")
    if options.jsonl not in (None, "-"):
        readable(options.jsonl)
    warm(options.data)
    from server.commands.compose import ComposeError, chosen, composers, frame_of, frames_of, known_of

    said = reading_of(options)
    spoken = composers(said.key, said.schema)
    try:
        if options.jsonl is None:
            protocol = "" if said.protocol == "auto" else said.protocol
            frame, _ = frame_of(
                chosen(spoken, options.message, protocol, options.pairs), options.message, options.pairs, known_of(said)
            )
            print(frame.hex())
            return
        with sys.stdin if options.jsonl == "-" else open(options.jsonl, encoding="utf-8") as lines:
            if said.protocol not in ("", "auto") and said.protocol not in spoken:
                raise UsageError(f"there is no protocol {said.protocol!r}; there are: {', '.join(spoken)}")
            for frame in frames_of(lines, spoken, "" if said.protocol == "auto" else said.protocol):
                sys.stdout.write(frame.hex() + "\n")
    except (ComposeError, UnicodeDecodeError) as error:
        raise UsageError(str(error)) from None


def _send(options: argparse.Namespace) -> None:
    import asyncio

    warm(options.data)
    from server.commands.compose import ComposeError
    from server.commands.send import SendError, SendRequest, send

    source, said = parse_source_options(options.source, reading_of(options))
    said = settled(said)
    wish = SendRequest(source, options.message, options.pairs, options.yes, options.device or "")
    try:
        asyncio.run(send(wish, said, sys.stdout, sys.stderr))
    except (ComposeError, SendError) as error:
        raise UsageError(str(error)) from None


def _commands(options: argparse.Namespace) -> None:
    said = reading_of(options)
    check_protocol(said.protocol)
    warm(options.data)
    from server.commands.commands import manual
    from server.commands.compose import ComposeError

    try:
        for line in manual(said.protocol, options.name, said.schema):
            print(line)
    except ComposeError as error:
        raise UsageError(str(error)) from None


def _rearm(options: argparse.Namespace) -> None:
    from server.commands.rearm import RearmError, RearmRequest, rearm

    token = key_text(options.token) if options.token else ""
    data = load(data=options.data).data
    try:
        print(printable(rearm(RearmRequest(options.device, options.server, token, data))))
    except RearmError as error:
        raise UsageError(str(error)) from None


def _record(options: argparse.Namespace) -> None:
    if options.duration is not None and not options.duration > 0:
        raise UsageError(f"--duration {options.duration:g} is not a valid time, in seconds; it must be more than 0")
    data = warm(options.data)
    from server.commands.record import RecordError, RecordRequest, record
    from server.links.base import LinkError

    given = reading_of(options)
    named = placed(options.sources)
    sources = [parse_source_options(source, given) for source in named]
    check_sources(named, given)
    wished = tuple((source, settled(said)) for source, said in sources)
    try:
        print(record(RecordRequest(wished, options.output, options.duration, data), sys.stderr))
    except (RecordError, LinkError) as error:
        raise UsageError(str(error)) from None


def _decode(options: argparse.Namespace) -> None:
    file = readable(str(options.file))
    said = reading_of(options)
    warm(options.data)
    from server.commands.decode import DecodedPart, DecodeError, decode_file

    said = settled(said)
    part = DecodedPart(options.begin, options.end, options.device, tuple(options.channel or ()))
    try:
        with whole(file) as path:
            for made in decode_file(path, options.output, said, sys.stderr, part):
                print(made)
    except DecodeError as error:
        raise UsageError(str(error)) from None


def _replay(options: argparse.Namespace) -> None:
    import asyncio

    if not Path(options.file).is_file():
        raise UsageError(no_file(options.file))
    if not 0.01 <= options.speed <= 1000:
        raise UsageError(f"--speed {options.speed:g} is outside 0.01 … 1000")
    warm(options.data)
    from server import logging_setup
    from server.commands import replay

    if options.key is not None:
        logging_setup.print_or_log("imuscope: --key is not needed: the bytes are sent as they came.")

    def sink() -> replay.Sink:
        if options.tcp is not None:
            return replay.TcpSink(*replay.address(options.tcp))
        return replay.UdpSink(*replay.address(options.udp)) if options.udp is not None else replay.PtySink()

    how = (options.protocol, options.speed, options.loop, options.begin, options.end, options.device)
    try:
        asyncio.run(replay.replay(replay.ReplayRequest(Path(options.file), sink, *how), sys.stdout))
    except replay.ReplayError as error:
        raise UsageError(str(error)) from None


def _completion(options: argparse.Namespace) -> None:
    from server.commands.completion import script

    sys.stdout.write(script(parser().commands, options.shell))


def _serve(options: argparse.Namespace) -> None:
    from server.commands.serve import serve

    serve(options)


def _simulate(options: argparse.Namespace) -> None:
    warm(options.data)
    from server.commands import replay, simulate
    from server.devices.decode_options import key_text, reading

    try:
        device = simulate.options_of(options.device)
        place = replay.address(options.tcp) if options.tcp is not None else None
        key = reading(key=key_text(options.key)).key if options.key is not None else None
        if key is not None and device.protocol != "idtp":
            raise UsageError(f"--key is for Secure frames of IDTP; {device.protocol} has none")
        simulate.simulate(device, key, options.pty, place, sys.stdout)
    except (simulate.SimulateError, replay.ReplayError) as error:
        raise UsageError(str(error)) from None


_RUN: Mapping[str, Callable[[argparse.Namespace], int | None]] = {
    "serve": _serve,
    "ports": _ports,
    "doctor": _doctor,
    "inspect": _inspect,
    "compose": _compose,
    "send": _send,
    "commands": _commands,
    "rearm": _rearm,
    "record": _record,
    "replay": _replay,
    "decode": _decode,
    "simulate": _simulate,
    "completion": _completion,
}


if __name__ == "__main__":
    raise SystemExit(main())
