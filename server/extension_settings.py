"""Door for settings that extensions bring: an entry point, so that the configuration knows no extension.

    [project.entry-points."imuscope.settings"]
    ros2 = "imuscope.server.extensions.ros2.settings:Ros2Settings"      a frozen dataclass of fields with defaults

Each field is a setting of the file, by its name; one that is itself a frozen dataclass is a table of the file. The type
of a field defines its allowed values (server/setting_types.py).
"""

from __future__ import annotations

import argparse
import functools
import logging
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from importlib import import_module
from typing import Any, ClassVar

from imuscope.protocols.plugins import plugins_of

GROUP = "imuscope.settings"
log = logging.getLogger("imuscope.extensions")


class ExtensionSettings:
    """Base of the settings of an extension.

    Attributes:
        config_help: lines on these settings for `imuscope serve --help`, as those of the heart.
    """

    __slots__ = ()
    config_help: ClassVar[str] = ""

    @classmethod
    def add_options(cls, command: argparse.ArgumentParser) -> None:
        """Add options to `imuscope serve`, whose default is None."""

    @classmethod
    def from_options(cls, options: argparse.Namespace) -> Mapping[str, Any]:
        """Settings that options give; one that is None is not given. Default: the options of the same names."""
        names = [one.name for one in fields(cls) if not is_dataclass(one.type)]  # type: ignore[arg-type]
        return {name: getattr(options, name) for name in names if hasattr(options, name)}

    @classmethod
    def complete(cls, settings: dict[str, Any]) -> None:
        """Add settings that follow from the given ones and from the environment.

        Raises:
            ValueError: the environment has an invalid value; the text is for a user.
        """

    def check(self) -> None:
        """Check how the settings fit together.

        Raises:
            ValueError: they do not; the text is for a user.
        """


@functools.cache
def extension_settings() -> tuple[type[ExtensionSettings], ...]:
    """The settings of all installed extensions. Those of another package that cannot be imported are left out.

    Raises:
        Exception: imuscope's own cannot be imported; a defect that must not be overlooked.
    """
    kinds: list[type[ExtensionSettings]] = []
    for plugin in plugins_of(GROUP):
        if not plugin.is_there:
            continue
        try:
            plugin.check()
            kind: Any = getattr(import_module(plugin.module), plugin.value.partition(":")[2])
            if not (isinstance(kind, type) and issubclass(kind, ExtensionSettings)):
                raise ValueError(f"{plugin.value} is not derived from ExtensionSettings")
            kind()  # all of its fields have defaults
            kinds.append(kind)
        except Exception as error:  # third-party code may raise anything
            if not plugin.package:
                raise
            log.warning("%s", plugin.problem("settings", error))
    return tuple(kinds)
