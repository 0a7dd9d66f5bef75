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
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from imuscope.protocols.family.decode_options import Scope
from imuscope.protocols.family.plugins import ProtocolPlugin, each_usable, plugins_of
from imuscope.recordings.optional_packages import installation_of, lacks
from imuscope.server.services.parts import ServicePart, start
from imuscope.server.settings.extension_settings import settings_problems
from imuscope.server.wire.capabilities import AbsentExtension

if TYPE_CHECKING:
    from fastapi import APIRouter

    from imuscope.recordings.exporters import ExportRequest
    from imuscope.server.diagnostics.checks import Finding
    from imuscope.server.services.services import Services
    from imuscope.server.settings.config import Config

GROUP = "imuscope.extensions"
T = TypeVar("T")
log = logging.getLogger("imuscope.extensions")


@dataclass(frozen=True, slots=True)
class ExtensionCommand:
    """A command of the command line.

    Args:
        name: as it is typed: "calibrate".
        adds: "module:function" that adds its parser, and returns it.
        runs: "module:function" that runs it with the options, and returns the exit status. Both import nothing heavy.
        scope: which decode options it has (protocols/family/decode_options.py); "" for none.
        protocol_help: help of `--protocol`, with a scope.
        reads_file: whether it writes temporary files, which are removed when it is terminated.
        has_data: whether it has `--data`.
        epilog: "module:function" that returns the text below its help, and may import what it lists; "" for none.
    """

    name: str
    adds: str
    runs: str
    scope: Scope | Literal[""] = ""
    protocol_help: str = ""
    reads_file: bool = False
    has_data: bool = True
    epilog: str = ""

    def add(
        self, add_parser: Callable[..., argparse.ArgumentParser], *, with_help: bool = False
    ) -> argparse.ArgumentParser:
        """Add its parser, with the text below its help if that is to be printed."""
        parser: argparse.ArgumentParser = _named(self.adds)(add_parser)
        if with_help and self.epilog:
            parser.epilog = _named(self.epilog)()
            parser.formatter_class = argparse.RawDescriptionHelpFormatter
        return parser

    def run(self, options: argparse.Namespace) -> int | None:
        """Run it; returns the exit status."""
        status: int | None = _named(self.runs)(options)
        return status


@dataclass(frozen=True, slots=True)
class FileOutput:
    """A kind of file that `imuscope decode` writes besides the export formats.

    Args:
        suffix: of the file: ".html".
        title: in the list of outputs: what it is.
        writes: "module:function" that is called with an ExportRequest, the path, whether positions may be shown, and a
            function that takes the progress, 0..1; returns the files.
        hides_position: whether it can leave out everything that reveals where a recording was made.
    """

    suffix: str
    title: str
    writes: str
    hides_position: bool = False

    def write(
        self, request: ExportRequest, out: Path, step: Callable[[float], None], *, with_position: bool = True
    ) -> list[Path]:
        """Write it.

        Raises:
            RecordingError: it cannot be made of this recording.
        """
        written: list[Path] = _named(self.writes)(request, out, with_position, step)
        return written


@dataclass(frozen=True, slots=True)
class Extension:
    """One extension. Modules are named, not imported, so that it costs nothing until it is used.

    Args:
        name: of its entry point and its folder: "viser".
        title: display name.
        parts: module with a function `parts(services)` that yields its long-lived objects (server/services/parts.py);
            "" if it has none.
        page_parts: the same for objects that only requests use; they are made with the routes, at the first request.
        routes: modules with a `router`, in the order in which their routes are matched.
        places: paths of its routes outside /api and /ws, which need a token as these do: "/viser".
        read_only_posts: routes whose POST requests carry values and change nothing, so that a view token may send them:
            "/api/analysis/{name}".
        commands: of the command line.
        checks: "module:function" that is called with the configuration before a server is made, and raises ValueError
            with a sentence; "" for none.
        jobs: modules with jobs for the processes of analyses (server/extensions/analysis/jobs/worker.py).
        requires: names of other extensions that it imports.
        modules: of other packages, without which it is left out; extra: what brings them
            (recordings/optional_packages.py).
        package: name and version of the distribution that declares it; "" for imuscope's own. Set when it is loaded.
    """

    name: str
    title: str
    parts: str = ""
    page_parts: str = ""
    routes: tuple[str, ...] = ()
    places: tuple[str, ...] = ()
    read_only_posts: tuple[str, ...] = ()
    commands: tuple[ExtensionCommand, ...] = ()
    checks: str = ""
    jobs: tuple[str, ...] = ()
    outputs: tuple[FileOutput, ...] = ()
    page: str = ""
    diagnoses: str = ""
    problems: str = ""
    requires: tuple[str, ...] = ()
    modules: tuple[str, ...] = ()
    extra: str = ""
    package: str = ""

    @property
    def page_folder(self) -> Path | None:
        """The folder of its page's part; None if it has none."""
        if not self.page:
            return None
        package, _, inside = self.page.partition("/")
        place = find_spec(package)
        folders = (place.submodule_search_locations if place is not None else None) or ()
        return next((path for folder in folders if (path := Path(folder, inside)).is_dir()), None)

    def check(self, config: Config) -> None:
        """Check a configuration before a server is made.

        Raises:
            ValueError: it cannot be used; the text is for a user.
        """
        if self.checks:
            _named(self.checks)(config)

    def diagnose(self, config: Config) -> list[Finding]:
        """Findings for `imuscope doctor`."""
        return [*_named(self.diagnoses)(config)] if self.diagnoses else []

    def install(self, services: Services) -> None:
        """Add its parts to a server.

        Raises:
            ValueError: a route of another package can be used without a token.
        """
        services.access.routes.add(self.places, self.read_only_posts)
        if self.package:  # now, so that its problems are reported at the start
            self.routers(services)
        services.parts.add(self._made(self.parts, services))

    def make_page_parts(self, services: Services) -> list[ServicePart]:
        """Add its objects that only requests use to a server; returns them."""
        return services.parts.add(self._made(self.page_parts, services))

    @staticmethod
    def _made(module: str, services: Services) -> Iterable[ServicePart]:
        return import_module(module).parts(services) if module else ()

    def routers(self, services: Services) -> list[APIRouter]:
        """Its routes, which are imported for it.

        Raises:
            ValueError: a route of another package can be used without a token.
        """
        routers = [import_module(name).router for name in self.routes]
        for route in (route for router in routers for route in router.routes if self.package):
            if not services.access.routes.is_protected(route.path):
                raise ValueError(f"its route {route.path} needs no token; put it below /api, or name it in `places`")
        return routers


def _named(place: str) -> Callable[..., Any]:
    module, _, name = place.partition(":")
    function: Callable[..., Any] = getattr(import_module(module), name)
    return function


def extensions() -> tuple[Extension, ...]:
    """All installed extensions, each after those that it requires, otherwise in the order of their names."""
    return _installed()[0]


def absent_extensions() -> tuple[Extension, ...]:
    """Extensions whose packages are not installed, by name."""
    return _installed()[2]


def extension_problems() -> tuple[str, ...]:
    """A sentence about each extension that is declared and unusable."""
    declaring = [one for one in extensions() if one.problems]
    of_plugins = [problem for one in declaring for problem in attempt(one, _named(one.problems)) or ()]
    return (*_installed()[1], *settings_problems(), *of_plugins)


def file_outputs() -> dict[str, FileOutput]:
    """Kinds of files that extensions write, by suffix."""
    return {output.suffix: output for one in extensions() for output in one.outputs}


@functools.cache
def _installed() -> tuple[tuple[Extension, ...], list[str], tuple[Extension, ...]]:
    return load_extensions(plugins_of(GROUP))


def attempt(extension: Extension, use: Callable[[], T]) -> T | None:
    """Use an extension. One of another package that fails is left out and listed among the problems: it stops nothing.

    Raises:
        Exception: one of imuscope's own fails; a defect that must not be overlooked.
    """
    try:
        return use()
    except Exception as error:  # third-party code may raise anything
        if not extension.package:
            raise
        problem = ProtocolPlugin(extension.name, "", extension.package).problem("extension", error)
        if problem not in _installed()[1]:
            _installed()[1].append(problem)
        log.debug("%s failed", extension.name, exc_info=True)
        return None


def load_extensions(
    plugins: Sequence[ProtocolPlugin],
) -> tuple[tuple[Extension, ...], list[str], tuple[Extension, ...]]:
    """The usable extensions, a sentence about each that is not, and those whose packages are not installed.

    Raises:
        Exception: one of imuscope's own fails to load; a defect that must not be overlooked.
    """
    extensions: dict[str, Extension] = {}

    def load(plugin: ProtocolPlugin) -> None:
        extension = replace(plugin.load(Extension), package=plugin.package)
        if extension.name in extensions:
            raise ValueError(f"there is an extension {extension.name!r} already")
        extensions[extension.name] = extension

    wrong = each_usable((plugin for plugin in plugins if plugin.is_there), "extension", load)
    absent = tuple(extensions.pop(name) for name in sorted(extensions) if lacks(*extensions[name].modules))
    ordered: dict[str, Extension] = {}
    waiting = [extensions[name] for name in sorted(extensions)]
    while ready := [one for one in waiting if all(name in ordered for name in one.requires)]:
        ordered |= {one.name: one for one in ready}
        waiting = [one for one in waiting if one.name not in ordered]
    for one in waiting:
        missing = ", ".join(name for name in one.requires if name not in ordered)
        wrong.append(f"The extension {one.name!r} cannot be used without {missing}. Install that, too.")
    return tuple(ordered.values()), wrong, absent


def install_extensions(services: Services) -> None:
    """Add the parts of all extensions to a server that is not started."""
    services.telemetry.clients.capabilities.absent = [
        AbsentExtension(one.name, one.title, installation_of(one.extra)) for one in absent_extensions()
    ]
    for extension in extensions():
        attempt(extension, functools.partial(extension.install, services))


async def start_page_parts(services: Services) -> None:
    """Make and start the objects that only requests use, of all extensions."""
    for extension in extensions():
        await start(attempt(extension, functools.partial(extension.make_page_parts, services)) or ())


def extension_routers(services: Services) -> list[APIRouter]:
    routers: list[APIRouter] = []
    for extension in extensions():
        routers += attempt(extension, functools.partial(extension.routers, services)) or ()
    return routers


def add_commands(
    add_parser: Callable[..., argparse.ArgumentParser], only: str = "", *, with_help: bool = False
) -> Iterator[argparse.ArgumentParser]:
    """Add the commands of all extensions; yields the parsers of those that have `--data`.

    Args:
        only: the one command that is needed: imuscope's own others are left out, those of other packages are tried.
    """
    for extension in extensions():
        for command in (one for one in extension.commands if only in ("", one.name) or extension.package):
            parser = attempt(extension, functools.partial(command.add, add_parser, with_help=with_help))
            if parser is not None and command.has_data:
                yield parser


def extension_commands() -> dict[str, ExtensionCommand]:
    return {command.name: command for extension in extensions() for command in extension.commands}
