"""Door for settings that extensions bring: an entry point, so that the configuration knows no extension.

    [project.entry-points."imuscope.settings"]
    ros2 = "imuscope.server.extensions.ros2.settings:Ros2Settings"      a frozen dataclass of fields with defaults

Each field is a setting of the file, by its name; one that is itself a frozen dataclass is a table of the file. The type
of a field defines its allowed values (server/settings/setting_types.py).
"""

import argparse
import functools
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from importlib import import_module
from typing import Any, ClassVar

from imuscope.protocols.family.plugins import ProtocolPlugin, each_usable, plugins_of

GROUP = "imuscope.settings"

SHIPPED: Mapping[str, Sequence[str]] = {
    "alarms": ("webhook_hosts",),
    "analysis": ("analysis_s", "analysis_mb"),
    "fleet": ("store", "fleet", "fleet_server"),
    "foxglove": ("foxglove",),
    "rerun": ("rerun_connect",),
    "ros2": (
        *("ros2", "ros2_domain", "ros2_router", "ros2_namespace", "ros2_reliability", "ros2_depth"),
        *("ros2_axes", "ros2_names", "ros2_frames", "ros2_covariances", "ros2_map_frame", "ros2_tf"),
        "ros2_contract",
    ),
    "shares": ("shares",),
}
"""Settings of imuscope's own extensions, for an error when one is not installed, and so cannot name them."""


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


def extension_settings() -> Sequence[type[ExtensionSettings]]:
    """The settings of all installed extensions that can be used."""
    return _installed()[0]


def settings_problems() -> list[str]:
    """A sentence about each package whose settings cannot be used."""
    return _installed()[1]


def shipped_owner(setting: str) -> str:
    """The extension of imuscope that a setting belongs to, installed or not; "" for none."""
    return next((name for name, settings in SHIPPED.items() if setting in settings), "")


@functools.cache
def _installed() -> tuple[list[type[ExtensionSettings]], list[str]]:
    kinds: list[type[ExtensionSettings]] = []

    def load(plugin: ProtocolPlugin) -> None:
        plugin.check()
        kind: Any = getattr(import_module(plugin.module), plugin.value.partition(":")[2])
        if not (isinstance(kind, type) and issubclass(kind, ExtensionSettings)):
            raise ValueError(f"{plugin.value} is not derived from ExtensionSettings")
        kind()  # all of its fields have defaults
        kinds.append(kind)

    return kinds, each_usable((plugin for plugin in plugins_of(GROUP) if plugin.is_there), "settings", load)
