"""The command line: `imuscope`, `imuscope serve`, `imuscope ports`, `imuscope inspect`.

Exit status 0, or 1 with one clear line on standard error and no traceback. Nothing heavy is imported before it is
needed: `--help` and `--version` answer at once. The folder for compiled code is settled before numba is imported.
"""

from __future__ import annotations

import argparse
import logging
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from server.compiled import prepare_cache
from server.config import Config, ConfigError, default_data, load
from server.version import VERSION

COMMANDS = ("serve", "ports", "inspect")
MODES = ("lite", "safety", "secure")
SOURCES = "/dev/ttyUSB0, serial:///dev/ttyUSB0?baud=921600, tcp://host:port, udp://:port, a file, twin:xbus, …"


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
        description="A page that shows inertial sensors live. Without a source, a twin of an Xsens MTi streams.",
    )
    root.add_argument("--version", action="version", version=f"imuscope {VERSION}")
    commands = root.add_subparsers(dest="command", metavar="COMMAND")

    serve = commands.add_parser("serve", help="serve the page (what `imuscope` alone does)")
    serve.add_argument("sources", nargs="*", metavar="SOURCE", help=SOURCES)
    serve.add_argument("--host", help="address to listen on (127.0.0.1; any other needs a token, which is printed)")
    serve.add_argument("--port", type=int, help="port to listen on (8080; 0: any free one)")
    serve.add_argument("--protocol", help="protocol of the sources (recognised when left out)")
    serve.add_argument("--config", type=Path, metavar="FILE", help="TOML file with settings, see server/config.py")
    _add_data(serve)

    ports = commands.add_parser("ports", help="serial ports, and what is heard on each")
    _add_data(ports)

    inspect = commands.add_parser("inspect", help="one line per frame of a file")
    inspect.add_argument("file", metavar="FILE", help="a raw capture")
    inspect.add_argument("--protocol", default="auto", help="xbus, isb, idtp, or auto (the default)")
    inspect.add_argument("--direction", choices=("rx", "tx"), default="rx", help="rx: sent by the device (the default)")
    inspect.add_argument("--format", choices=("table", "jsonl"), default="table")
    inspect.add_argument("--rejects", action="store_true", help="also show what failed its checks")
    inspect.add_argument("--key", metavar="KEY", help="for Secure frames of IDTP: hex, or @FILE that holds hex")
    inspect.add_argument(
        "--min-mode",
        choices=MODES,
        help="weakest mode of IDTP frames that is accepted (secure with a key, else lite)",
    )
    inspect.add_argument("--no-replay-check", action="store_true", help="accept frames of any sequence number")
    _add_data(inspect)
    return root


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
            case "inspect":
                _inspect(options)
    except (UsageError, ConfigError) as error:
        print(f"imuscope: {error}", file=sys.stderr)
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
        protocol=options.protocol,
        sources=options.sources or None,
    )
    _compile(config.data)
    from server import serving, speech
    from server.app import create_app
    from server.auth import Access
    from server.links import LinkError, open_link
    from server.links.file import FileLink

    known = speech.protocols()
    if config.protocol and config.protocol not in known:
        raise UsageError(f"there is no protocol {config.protocol!r}; there are: {', '.join(known)}.")
    for source in config.sources:
        try:
            link = open_link(source)
        except LinkError as error:
            raise UsageError(str(error)) from None
        if isinstance(link, FileLink) and not link.path.is_file():
            # A port may be plugged in later; a file that is not there now is a slip of the fingers.
            raise UsageError(_no_file(str(link.path)) + " See `imuscope --help` for commands and sources.")
    try:
        listener = serving.listen(config.host, config.port)
    except OSError as error:
        hint = "Give another with --port, or 0 for any free one."
        raise UsageError(f"cannot listen on {config.host}:{config.port}: {error.strerror}. {hint}") from None
    access = Access(config)
    url = _url(config, listener.getsockname()[1])

    def ready() -> None:
        print(f"imuscope {VERSION} ({time.monotonic() - started:.1f} s)", file=sys.stderr)
        if access.control_token and not config.is_loopback:
            print(
                f"to look:    {url}?token={access.view_token}\nto control: {url}?token={access.control_token}",
                flush=True,
            )
        else:
            print(url, flush=True)
        if not config.sources:
            print("No source given: showing a twin of an Xsens MTi. See `imuscope serve --help`.", file=sys.stderr)

    try:
        serving.run(create_app(config, access), listener, ready)
    except RuntimeError as error:
        raise UsageError(str(error)) from None


def _url(config: Config, port: int) -> str:
    """An address that a person can open: 0.0.0.0 is no place to go, the machine's name is."""
    import platform

    host = platform.node() if config.host in ("0.0.0.0", "::", "") else config.host
    return f"http://{f'[{host}]' if ':' in host else host}:{port}/"


def _compile(data: Path) -> None:
    """Import what is compiled, and say so when that takes a while."""
    first, words = prepare_cache(data)
    for sentence in words:
        print(f"imuscope: {sentence}", file=sys.stderr, flush=True)
    if first:
        print(
            "imuscope: compiling the decoders; this is done once and takes some seconds.", file=sys.stderr, flush=True
        )
    from protocols import jit, registry

    registry.warm()
    if jit.uncached and not words:
        print("imuscope: compiled code could not be kept; it is compiled again next time.", file=sys.stderr, flush=True)


def _ports(options: argparse.Namespace) -> None:
    _compile(load(data=options.data).data)
    from server.ports import print_ports

    print_ports(sys.stdout)


def _inspect(options: argparse.Namespace) -> None:
    path = Path(options.file)
    if not path.is_file():
        raise UsageError(_no_file(options.file))
    _compile(load(data=options.data).data)
    from server.inspect import inspect_file

    how = {name: getattr(options, name) for name in ("protocol", "direction", "format", "rejects")}
    how["replay_check"] = not options.no_replay_check
    if options.key is not None:
        how["key"] = _key(options.key)
    if options.min_mode is not None:
        how["min_mode"] = MODES.index(options.min_mode)
    try:
        inspect_file(path, sys.stdout, **how)
    except (ValueError, OSError) as error:
        if isinstance(error, BrokenPipeError):
            raise
        raise UsageError(str(error)) from None


def _no_file(path: str) -> str:
    return f"{path} is a folder; name one capture in it." if Path(path).is_dir() else f"there is no file {path}."


def _key(given: str) -> bytes:
    """A key from the command line."""
    text = given
    if given.startswith("@"):
        try:
            text = Path(given[1:]).read_text(encoding="ascii")
        except OSError as error:
            raise UsageError(f"the key cannot be read from {given[1:]}: {error.strerror}.") from None
        except UnicodeDecodeError:
            raise UsageError(f"{given[1:]} holds no key: it must hold hex digits.") from None
    try:
        key = bytes.fromhex(text)
    except ValueError:
        key = b""
    if not key:
        place = given if given.startswith("@") else "--key"
        raise UsageError(f"{place} holds no key: it must be an even number of hex digits.")
    return key


if __name__ == "__main__":
    raise SystemExit(main())
