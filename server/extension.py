"""Door for extensions: what a server has beyond its heart, each in a folder of its own.

    [project.entry-points."imuscope.extensions"]
    viser = "imuscope.server.extensions.viser:EXTENSION"     an Extension whose name is the same

The heart is what one needs to see, record, replay and configure a sensor. An extension brings parts (built from the
services of the heart, started and closed with them), routes and commands. The heart imports none; a folder that is
removed, or a package that cannot be imported, leaves a server without it.
"""

from __future__ import annotations

import argparse
import functools
import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Literal

from imuscope.protocols.decode_options import Scope
from imuscope.protocols.plugins import ProtocolPlugin, plugins_of

if TYPE_CHECKING:
    from fastapi import APIRouter

    from imuscope.server.parts import ServicePart
    from imuscope.server.services import Services

GROUP = "imuscope.extensions"
log = logging.getLogger("imuscope.extensions")


@dataclass(frozen=True, slots=True)
class ExtensionCommand:
    """A command of the command line.

    Args:
        name: as it is typed: "calibrate".
        module: has `add(add_parser)`, which returns the parser, and `run(options)`, which returns the exit status; it
            imports nothing heavy.
        scope: which decode options it has (protocols/decode_options.py); "" for none.
        protocol_help: help of `--protocol`, with a scope.
        reads_file: whether it writes temporary files, which are removed when it is terminated.
    """

    name: str
    module: str
    scope: Scope | Literal[""] = ""
    protocol_help: str = ""
    reads_file: bool = False

    def add(self, add_parser: Callable[..., argparse.ArgumentParser]) -> argparse.ArgumentParser:
        """Add its parser."""
        parser: argparse.ArgumentParser = import_module(self.module).add(add_parser)
        return parser

    def run(self, options: argparse.Namespace) -> int | None:
        """Run it; returns the exit status."""
        status: int | None = import_module(self.module).run(options)
        return status


@dataclass(frozen=True, slots=True)
class Extension:
    """One extension. Modules are named, not imported, so that it costs nothing until it is used.

    Args:
        name: of its entry point and its folder: "viser".
        title: display name.
        parts: module with a function `parts(services)` that yields its long-lived objects (server/parts.py); "" if it
            has none.
        routes: modules with a `router`, in the order in which their routes are matched.
        commands: of the command line.
        jobs: modules with jobs for the processes of analyses (server/analysis_worker.py).
        requires: names of other extensions that it imports.
    """

    name: str
    title: str
    parts: str = ""
    routes: tuple[str, ...] = ()
    commands: tuple[ExtensionCommand, ...] = ()
    jobs: tuple[str, ...] = ()
    requires: tuple[str, ...] = ()

    def routers(self) -> list[APIRouter]:
        """Its routes."""
        return [import_module(name).router for name in self.routes]

    def build(self, services: Services) -> Iterator[ServicePart]:
        """Its parts, for a server with these services."""
        yield from import_module(self.parts).parts(services) if self.parts else ()


def extensions() -> tuple[Extension, ...]:
    """All installed extensions, in the order of their names."""
    return _installed()[0]


def extension_problems() -> tuple[str, ...]:
    """A sentence about each extension that is declared and unusable."""
    return _installed()[1]


@functools.cache
def _installed() -> tuple[tuple[Extension, ...], tuple[str, ...]]:
    return load_extensions(plugins_of(GROUP))


def load_extensions(plugins: Sequence[ProtocolPlugin]) -> tuple[tuple[Extension, ...], tuple[str, ...]]:
    """The usable extensions, and a sentence about each that is not.

    Raises:
        Exception: one of imuscope's own fails to load; a defect that must not be overlooked.
    """
    found: dict[str, Extension] = {}
    wrong: list[str] = []
    for plugin in plugins:
        if not plugin.is_there:
            continue
        try:
            extension = _loaded(plugin)
            if extension.name in found:
                raise ValueError(f"there is an extension {extension.name!r} already")
            found[extension.name] = extension
        except Exception as error:  # third-party code may raise anything
            if not plugin.package:
                raise
            wrong.append(plugin.problem("extension", error))
            log.debug("%s failed", plugin.value, exc_info=True)
    for extension in [*found.values()]:
        missing = [name for name in extension.requires if name not in found]
        if missing:
            del found[extension.name]
            wrong.append(f"The extension {extension.name!r} cannot be used: it needs {', '.join(missing)}.")
    return tuple(found[name] for name in sorted(found)), tuple(wrong)


def _loaded(plugin: ProtocolPlugin) -> Extension:
    plugin.check()
    module, _, attribute = plugin.value.partition(":")
    extension = getattr(import_module(module), attribute)
    if not isinstance(extension, Extension):
        raise ValueError(f"{plugin.value} is not an Extension")
    if extension.name != plugin.name:
        raise ValueError(f"it calls itself {extension.name!r}")
    return extension


def extension_commands() -> dict[str, ExtensionCommand]:
    """Commands of all extensions, by name."""
    return {command.name: command for extension in extensions() for command in extension.commands}
