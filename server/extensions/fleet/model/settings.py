"""Settings of the fleet: three tables of the file."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from imuscope.server.extensions.fleet.model.fleet_settings import FleetServerSettings, FleetSettings
from imuscope.server.extensions.fleet.model.store_settings import STORE_FORMS, StoreSettings
from imuscope.server.settings.extension_settings import ExtensionSettings


@dataclass(frozen=True, slots=True)
class FleetTables(ExtensionSettings):
    """Settings of the fleet.

    Args:
        store: recordings of many robots, for queries.
        fleet: the fleet that this robot belongs to.
        fleet_server: the bus of `imuscope fleet`; `serve` does not use it.
    """

    config_help: ClassVar[str] = """\
  [store] url, query_s, query_mb  store of recordings, and limits of a question over HTTP (default 60 s, 1024 MB)
  [fleet] name, group, user, …    this robot in a fleet; see docs/fleet.md
"""
    store: StoreSettings = field(default_factory=StoreSettings)
    fleet: FleetSettings = field(default_factory=FleetSettings)
    fleet_server: FleetServerSettings = field(default_factory=FleetServerSettings)

    @classmethod
    def add_options(cls, command: argparse.ArgumentParser) -> None:
        command.add_argument(
            "--store", metavar="URL", help=f"store of recordings to answer questions about: {STORE_FORMS}"
        )
        command.add_argument(
            "--fleet", metavar="ADDRESS", help="join the fleet at tcp/HOST:PORT or tls/HOST:PORT (`imuscope fleet`)"
        )
        command.add_argument(
            "--fleet-name",
            metavar="NAME",
            help="name of this robot in its fleet and in the store, which no other robot may have (default: host name)",
        )

    @classmethod
    def from_options(cls, options: argparse.Namespace) -> Mapping[str, Any]:
        of_fleet = {"router": options.fleet, "name": options.fleet_name}
        return {
            "store": None if options.store is None else {"url": options.store},
            "fleet": {name: text for name, text in of_fleet.items() if text is not None} or None,
        }

    def check(self) -> None:
        if self.store.upload and not self.store.url:
            raise ValueError("store.upload needs store.url: the store to upload to.")
        if (self.store.keep_days or self.store.keep_gb) and not self.store.upload:
            raise ValueError(
                "store.keep_days and store.keep_gb need store.upload: only uploaded recordings are deleted."
            )
