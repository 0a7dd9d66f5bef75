"""The command line: `imuscope`, `imuscope serve`, `ports`, `doctor`, `inspect`, `compose`, `send`, `commands`, `rearm`,
`hold`, `record`, `replay`, `decode`, `time`, `analyse`, `simulate`, and those that extensions bring.

Exit status 0, or 1 with one clear line on standard error and no traceback. Heavy modules are imported only when needed,
so `--help` and `--version` answer at once.
"""

import argparse
import contextlib
import errno
import gc
import io
import logging
import os
import re
import shutil
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from imuscope.recordings.errors import ExplainedError
from imuscope.server.commands.arguments import COMMANDS, parse, parser
from imuscope.server.commands.common import (
    check_protocol,
    check_sources,
    checked_protocol,
    decode_options_of,
    file_to_decode,
    given_options,
    missing_file_text,
    normalized_sources,
    readable,
    seekable,
    size_of,
    warn_if_interpreted,
)
from imuscope.server.commands.several_files import run_each
from imuscope.server.devices.decode.decode_options import DecodeOptionError, parse_source_options, secret_text
from imuscope.server.errors import UsageError
from imuscope.server.services.extension import extension_commands
from imuscope.server.settings.config import ConfigError, load
from imuscope.server.system.end_signals import ending_by_exception
from imuscope.server.text.printable import json_text, printable


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if sys.stdout is None:  # closed by the caller: discard the output
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - until the end
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.encoding.lower() != "utf-8":
        sys.stdout.reconfigure(errors="backslashreplace")  # a terminal may lack a degree sign
    if words[:1] == ["help"] and not os.path.exists("help"):
        words = [*words[1:2], "--help"]
    if not words or (words[0] not in COMMANDS and words[0] not in ("-h", "--help", "-V", "--version")):
        words = ["serve", *(word for word in words if word != "serve")]  # also "--port 8081 serve …"
    collects = gc.isenabled()
    if words[0] == "serve":
        gc.disable()  # a tenth of the start, and hardly anything is garbage; http_server.run enables it
    logging.basicConfig(level=logging.WARNING, format="imuscope: %(levelname)s: %(message)s")
    try:
        options = parse(words)
        _check_order(words, options)
        own = extension_commands().get(options.command)
        reads_file = options.command in OF_FILES if own is None else own.reads_file
        with ending_by_exception() if reads_file else contextlib.nullcontext():
            if options.command not in ("serve", "doctor") and getattr(options, "data", None) is not None:
                load(data=options.data)  # an invalid folder is an error even of commands that hardly need it
            status = run_each(_RUN[options.command] if own is None else own.run, options)
        sys.stdout.flush()
        return status
    except (ExplainedError, ConfigError, DecodeOptionError) as error:
        text = error.text if isinstance(error, ExplainedError) else str(error)
        end = "" if text.endswith((".", "?")) else "."
        print(f"imuscope: {printable(text)}{end}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:  # `imuscope inspect … | head`
        _silence()
        return 0
    except ImportError as error:
        from imuscope.server.diagnostics.checks import foreign_import

        if not (text := foreign_import(error)):
            raise
        print(f"imuscope: {printable(text)}", file=sys.stderr)
        return 1
    except OSError as error:
        if error.errno not in UNWRITABLE:
            raise
        _silence()
        print(f"imuscope: the output cannot be written: {(error.strerror or '').lower()}.", file=sys.stderr)
        return 1
    finally:
        if collects:  # a start that failed has not enabled it
            gc.enable()


OF_FILES = ("inspect", "decode")

UNWRITABLE = (errno.ENOSPC, errno.EIO, errno.EBADF, errno.EDQUOT)


def _check_order(words: Sequence[str], options: argparse.Namespace) -> None:
    """UsageError for a command after its options, which would be taken for a source."""
    late = [source for source in getattr(options, "sources", ()) if source in COMMANDS and not os.path.exists(source)]
    if options.command == "serve" and words[1:2] and words[1].startswith("-") and late:
        raise UsageError(f"{late[0]} is a command; write it before its options: imuscope {late[0]} {words[1]} …")


def _silence() -> None:
    """Discard further output, which the interpreter would fail to write at exit."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _ports(options: argparse.Namespace) -> None:
    from imuscope.server.links.ports import print_ports

    print_ports(sys.stdout, as_json=options.format == "json")


def _doctor(options: argparse.Namespace) -> int:
    from imuscope.server.commands import doctor
    from imuscope.server.diagnostics.checks import Machine, run_checks

    if options.udev_rule and options.systemd_unit:
        raise UsageError("--udev-rule and --systemd-unit print one file each; give one of the two")
    if (options.udev_rule or options.systemd_unit) and options.format == "json":
        raise UsageError("--format json applies to findings, not to these files; leave one out")
    if options.udev_rule or options.systemd_unit:
        sys.stdout.write(doctor.udev_rule() if options.udev_rule else doctor.systemd_unit())
        return 0
    config = load(options.config, data=options.data)
    findings = [*run_checks(Machine(config.data, config.port)), *doctor.extension_findings(config)]
    return doctor.format_findings(findings, sys.stdout, as_json=options.format == "json")


def _inspect(options: argparse.Namespace) -> None:
    path = readable(str(options.file))
    warn_if_interpreted(size_of(path))
    from imuscope.server.commands.inspect import inspect_file

    decode_options = decode_options_of(options, "auto")
    how = {name: getattr(options, name) for name in ("direction", "rejects", "device")}
    try:
        inspect_file(path, sys.stdout, decode_options, notes=sys.stderr, text_format=options.format, **how)
    except OSError as error:
        if isinstance(error, BrokenPipeError) or error.errno in UNWRITABLE:
            raise
        raise UsageError(f"{path}: {(error.strerror or str(error)).lower()}") from None


def _compose(options: argparse.Namespace) -> None:
    if (options.message is None) == (options.jsonl is None):
        raise UsageError("give a message, or --jsonl with a file")
    if options.jsonl not in (None, "-"):
        readable(options.jsonl)
    from imuscope.server.commands.compose import composers, context_of, find_composer, frame_of, frames_of

    decode_options = decode_options_of(options)
    all_composers = composers(decode_options)
    protocol = "" if decode_options.protocol == "auto" else decode_options.protocol
    if options.jsonl is None:
        composer = find_composer(all_composers, options.message, protocol, options.pairs)
        known = context_of(composer.name, decode_options)
        frame, _ = frame_of(composer, options.message, options.pairs, known)
        print(frame.hex())
        return
    with sys.stdin if options.jsonl == "-" else open(options.jsonl, encoding="utf-8") as lines:
        if protocol and protocol not in all_composers:
            raise UsageError(f"unknown protocol {protocol!r}; available: {', '.join(all_composers)}")
        try:
            for frame in frames_of(lines, all_composers, protocol):
                sys.stdout.write(frame.hex() + "\n")
        except UnicodeDecodeError as error:
            raise UsageError(str(error)) from None


def _send(options: argparse.Namespace) -> None:
    import asyncio

    from imuscope.server.commands.send import SendRequest, send, until_signal

    source, decode_options = parse_source_options(options.source, decode_options_of(options))
    decode_options = checked_protocol(decode_options)
    request = SendRequest(source, options.message, options.pairs, options.yes, options.device or "")
    asyncio.run(until_signal(send(request, decode_options, sys.stdout, sys.stderr)))


def _commands(options: argparse.Namespace) -> None:
    decode_options = decode_options_of(options)
    check_protocol(decode_options.protocol)
    from imuscope.server.commands.commands import forms, manual
    from imuscope.server.wire.codec import to_json_safe

    if options.format == "json":
        print(json_text(to_json_safe(forms(decode_options, options.name))))
        return
    for line in manual(decode_options, options.name):
        print(line)


def _rearm(options: argparse.Namespace) -> None:
    from imuscope.server.commands.rearm import rearm

    token = secret_text(options.token, "token") if options.token else ""
    data = load(data=options.data).data
    print(rearm(options.device, options.server, token, data, as_json=options.format == "json"))


def _record(options: argparse.Namespace) -> None:
    if options.duration is not None and not options.duration > 0:
        raise UsageError(f"--duration {options.duration:g} is not a valid time, in seconds; it must be more than 0")
    data = load(data=options.data).data
    from imuscope.server.commands.record import RecordRequest, record

    reading = decode_options_of(options)
    named = normalized_sources(options.sources)
    sources = [parse_source_options(source, reading) for source in named]
    check_sources(named, reading)
    requests = tuple((source, checked_protocol(decode_options)) for source, decode_options in sources)
    request = RecordRequest(requests, options.output, options.duration, data)
    print(record(request, sys.stderr, as_json=options.format == "json"))


def _decode(options: argparse.Namespace) -> None:
    file, decode_options = file_to_decode(options)
    from imuscope.recordings.system.temporary_folder import TemporaryFolder
    from imuscope.server.commands.decode import DecodedPart, decode_file

    part = DecodedPart(
        options.begin,
        options.end,
        options.device,
        tuple(options.signal),
        not options.without_position,
        options.units,
    )
    streamed = re.fullmatch(r"-(\..+)?", str(options.output))
    with seekable(file) as path, TemporaryFolder() if streamed else contextlib.nullcontext() as folder:
        out = folder / f"output{streamed[1] or '.csv'}" if streamed and folder else options.output
        files = decode_file(path, out, decode_options, sys.stderr, part)
        if not folder and options.format == "json":
            print(json_text({"file": str(file), "written": [*map(str, files)]}))
        elif not folder:
            print(*files, sep="\n")
        elif len(files) != 1 or not files[0].is_file():
            raise UsageError("standard output takes one file, and this makes several; name a message with --signal")
        else:
            with files[0].open("rb") as made:
                shutil.copyfileobj(made, sys.stdout.buffer)


def _replay(options: argparse.Namespace) -> None:
    import asyncio

    if not Path(options.file).is_file():
        raise UsageError(missing_file_text(options.file))
    if not 0.01 <= options.speed <= 1000:
        raise UsageError(f"--speed {options.speed:g} is outside 0.01 … 1000")
    warn_if_interpreted(size_of(Path(options.file)))
    from imuscope.recordings.importers.open_file import open_file
    from imuscope.server.commands import replay
    from imuscope.server.settings import logging_setup

    for name in given_options(options):
        logging_setup.print_or_log(f"imuscope: --{name.replace('_', '-')} is not needed: the bytes are sent unchanged.")

    def sink() -> replay.Sink:
        if options.tcp is not None:
            return replay.TcpSink(*replay.address(options.tcp))
        return replay.UdpSink(*replay.address(options.udp)) if options.udp is not None else replay.PtySink()

    file = open_file(Path(options.file), options.protocol)
    part = (options.device, options.begin, options.end)
    clock = replay.replay_clock(file, *part, speed=options.speed, loop=options.loop)
    asyncio.run(replay.replay(clock, sink, sys.stdout))


def _completion(options: argparse.Namespace) -> None:
    from imuscope.server.commands.completion import script

    sys.stdout.write(script(parser().commands, options.shell))


def _serve(options: argparse.Namespace) -> None:
    from imuscope.server.commands.serve import serve

    serve(options)


def _simulate(options: argparse.Namespace) -> None:
    from imuscope.server.commands import replay, simulate

    device = simulate.options_of(options.device)
    place = replay.address(options.tcp) if options.tcp is not None else None
    decode_options = decode_options_of(options)
    for name in decode_options.values.keys() - simulate.options_of_family(device.protocol):
        raise UsageError(f"--{name.replace('_', '-')} is not an option of {device.protocol}")
    simulate.simulate(device, decode_options, options.pty, place, sys.stdout)


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
