"""Protocol families, found through the entry-point group `imuscope.protocols`.

    [project.entry-points."imuscope.protocols"]
    name = "package.module:FAMILY"              a imuscope.protocols.family.info.ProtocolInfo whose name is the same

The families that come with imuscope are declared in its own pyproject.toml in the same way. In a checkout whose
installation is older than that file, or that was never installed, they are read from the file.

Finding them imports none of them, so that names for help and completion cost nothing.
"""

import functools
import importlib.util
import logging
import pkgutil
import re
import tomllib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module, metadata
from pathlib import Path
from typing import Generic, Protocol, TypeVar

API_VERSION = 1
"""Version of the names in imuscope/plugin.py. It grows when one of them changes its meaning or is removed."""

GROUP = "imuscope.protocols"
PACKAGE = "imuscope"
ROOT = Path(__file__).resolve().parents[2]
log = logging.getLogger("imuscope.plugins")


class Named(Protocol):
    """An object that is declared under its name."""

    @property
    def name(self) -> str: ...


class Ordered(Named, Protocol):
    """A named object with a place in lists."""

    @property
    def order(self) -> int: ...


T = TypeVar("T", bound=Named)
Listed = TypeVar("Listed", bound=Ordered)


@dataclass(frozen=True, slots=True)
class ProtocolPlugin:
    """Location of a family, or of anything else declared by a package.

    Args:
        name: of the protocol.
        value: "module:attribute".
        package: name and version of the distribution that declares it; "" for imuscope's own.
        api: version of the plug-in API that it is written for.
    """

    name: str
    value: str
    package: str = ""
    api: int = API_VERSION

    def check(self) -> None:
        """Check that it is written for this version of the plug-in API.

        Raises:
            ValueError: it is not.
        """
        if self.api != API_VERSION:
            other = "imuscope" if self.api > API_VERSION else self.package.partition(" ")[0]
            raise ValueError(
                f"it is written for version {self.api} of the plug-in API, and this imuscope has version "
                f"{API_VERSION}. Install a newer {other}"
            )

    @property
    def module(self) -> str:
        return self.value.partition(":")[0]

    def load(self, kind: type[T]) -> T:
        """The declared object, which has a `name`.

        Raises:
            ValueError: it is written for another version, is of another kind, or has another name.
            Exception: whatever its module raises when it is imported.
        """
        self.check()
        value = getattr(import_module(self.module), self.value.partition(":")[2])
        if not isinstance(value, kind):
            raise ValueError(f"{self.value} is not {article(kind.__name__)}")
        if value.name != self.name:
            raise ValueError(f"it calls itself {value.name!r}")
        return value

    @property
    def is_there(self) -> bool:
        """False for one of imuscope's own whose folder was left out of the installation."""
        try:
            return bool(self.package) or importlib.util.find_spec(self.module) is not None
        except ModuleNotFoundError:
            return False

    def problem(self, kind: str, error: Exception) -> str:
        """A sentence about why it is unusable."""
        words = f"{type(error).__name__}: {error}" if not isinstance(error, ValueError) else str(error)
        return f"The {kind} {self.name!r} of {self.package} cannot be used: {words:.300}."


@functools.cache
def protocol_plugins() -> tuple[ProtocolPlugin, ...]:
    """All declared families: imuscope's own in their order, then others by name."""
    return (*plugins_of(GROUP),)


def plugins_of(group: str) -> list[ProtocolPlugin]:
    """All declarations of a group: imuscope's own in their order, then others by name."""
    own = [ProtocolPlugin(name, value) for name, value in _own_entries(group).items()]
    return [*own, *plugins_of_others(group)]


def plugins_of_others(group: str) -> list[ProtocolPlugin]:
    """Declarations of other packages in a group, by name.

    A group has the version of the plug-in API at its end, from the second version on: `imuscope.protocols.2`.
    """
    others: dict[tuple[str, str], ProtocolPlugin] = {}
    of_group = re.compile(re.escape(group) + r"(?:\.(\d+))?")
    installed = metadata.entry_points()  # reads files of every package
    groups = [match for name in installed.groups if (match := of_group.fullmatch(name))]
    for match, entry in ((one, entry) for one in groups for entry in installed.select(group=one[0])):
        if entry.dist is not None and entry.dist.name == PACKAGE:
            continue
        package = f"{entry.dist.name} {entry.dist.version}" if entry.dist is not None else "unknown"
        others[entry.name, entry.value] = ProtocolPlugin(entry.name, entry.value, package, int(match[1] or 1))
    return [others[key] for key in sorted(others)]


class Registry(Generic[Listed]):
    """Objects of one kind, each registered by a module when it is imported.

    Args:
        kind: for messages: "exporter".
        package: the modules in its folder register some.
        group: entry-point group of further modules, of imuscope or of other packages.
    """

    def __init__(self, kind: str, package: str, group: str) -> None:
        self._kind, self._package, self._group = kind, package, group
        self._registered: dict[str, Listed] = {}
        self._problems: list[str] | None = None

    def register(self, one: Listed) -> None:
        """Add an object. ValueError: the name is taken."""
        if one.name in self._registered:
            raise ValueError(f"there is {article(self._kind)} {one.name!r} already")
        self._registered[one.name] = one

    def load(self) -> list[str]:
        """Import all modules that register objects, on first use. One of ours may be left out.

        Returns:
            a sentence about each package whose objects cannot be used.
        """
        if self._problems is None:
            for module in pkgutil.iter_modules(import_module(self._package).__path__):
                import_module(f"{self._package}.{module.name}")
            installed = (plugin for plugin in plugins_of(self._group) if plugin.is_there)
            self._problems = each_usable(installed, self._kind, _import)
        return self._problems

    def problems(self) -> list[str]:
        """Sentences that `load` returns, without an import if no other package declares any."""
        return self.load() if plugins_of_others(self._group) else []

    def all(self) -> dict[str, Listed]:
        """All objects by name, sorted by `order`."""
        self.load()
        return dict(sorted(self._registered.items(), key=lambda item: item[1].order))


def _import(plugin: ProtocolPlugin) -> None:
    plugin.check()
    import_module(plugin.module)


def article(noun: str) -> str:
    """The noun with "a" or "an" before it."""
    return f"{'an' if noun[0] in 'AEIOUaeiou' else 'a'} {noun}"


def each_usable(plugins: Iterable[ProtocolPlugin], kind: str, use: Callable[[ProtocolPlugin], object]) -> list[str]:
    """Use each declaration; returns a sentence about each that is unusable.

    Raises:
        Exception: one of imuscope's own fails; a defect that must not be overlooked.
    """
    problems: list[str] = []
    for plugin in plugins:
        try:
            use(plugin)
        except Exception as error:  # third-party code may raise anything
            if not plugin.package:
                raise
            problems.append(plugin.problem(kind, error))
            log.debug("%s failed", plugin.value, exc_info=True)
    return problems


def protocol_names() -> list[str]:
    """Names of all declared families, each once."""
    return list(dict.fromkeys(plugin.name for plugin in protocol_plugins()))


def _own_entries(group: str) -> dict[str, str]:
    """Name → value of what this program declares in a group, from pyproject.toml of the checkout, else as installed.

    Raises:
        RuntimeError: neither declares any, so nothing can be decoded.
    """
    project = ROOT / "pyproject.toml"
    if project.is_file():
        declared = tomllib.loads(project.read_text(encoding="utf-8"))["project"]
        if declared["name"] == PACKAGE:
            return dict(declared["entry-points"].get(group, {}))
    try:
        installed = metadata.distribution(PACKAGE).entry_points
    except metadata.PackageNotFoundError:
        installed = metadata.EntryPoints()
    if not installed.select(group=GROUP):
        text = f"The installation declares no {GROUP}. Install imuscope again: pip install --force-reinstall."
        raise RuntimeError(text)
    return {entry.name: entry.value for entry in installed.select(group=group)}
