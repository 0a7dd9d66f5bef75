"""Settings of the fleet: three tables of the file."""

import argparse
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar

from annotated_types import Interval, Unit

from imuscope.server.extensions.fleet.model.fleet_settings import FleetServerSettings, FleetSettings
from imuscope.server.settings.extension_settings import ExtensionSettings
from imuscope.server.settings.setting_types import empty_or, zero_or

STORE_FORMS = "a folder, file:///folder, s3://bucket/prefix, az://container/prefix or gs://bucket/prefix"
MIN_QUERY_MB, MAX_QUERY_MB = 64, 1 << 24
_HOURS = re.compile(r"([01]\d|2[0-3]):([0-5]\d)\s*-\s*([01]\d|2[0-3]):([0-5]\d)")


def hours_of(text: str) -> tuple[int, int] | None:
    """First and last minute of the day of a span such as "22:00-06:00"; None if it is not one."""
    match = _HOURS.fullmatch(text.strip())
    if match is None:
        return None
    first_h, first_min, last_h, last_min = map(int, match.groups())
    begin, end = first_h * 60 + first_min, last_h * 60 + last_min
    return None if begin == end else (begin, end)


@dataclass(frozen=True, slots=True)
class StoreSettings:
    """A store.

    Credentials come from the environment (server/extensions/fleet/store/store.py).

    Args:
        url: URL or path; "" for none.
        query_s, query_mb: longest time and most memory of a question over HTTP.
        upload: upload finished recordings of the library; the following are the rules for it.
        upload_tags, skip_tags: a recording needs one of the first, if there are any, and none of the others.
        upload_min_s: shortest recording that is uploaded.
        upload_max_mb: largest, 10⁶ bytes; 0 for no limit.
        upload_alarms_only: only those that an alarm has begun or marked.
        upload_hours: "22:00-06:00", local time in which an upload begins; "" for always.
        upload_kb_s: most that uploads send, 10³ bytes/s; 0 for no limit.
        keep_days: recordings move to the bin so many days after their upload; 0 for never.
        keep_gb: … or the oldest that were uploaded, while the library is larger, 10⁹ bytes; 0 for no limit.
        keep_tags: recordings with one of these stay.
    """

    url: str = ""
    query_s: Annotated[float, Interval(ge=1, le=86_400), Unit("s")] = 60.0
    query_mb: Annotated[int, Interval(ge=MIN_QUERY_MB, le=MAX_QUERY_MB), Unit("MB")] = 1024
    upload: bool = False
    upload_tags: tuple[str, ...] = ()
    skip_tags: tuple[str, ...] = ()
    upload_min_s: Annotated[float, Interval(ge=0, le=1e6), Unit("s")] = 0.0
    upload_max_mb: Annotated[float, zero_or(0.001, 1e9, "MB")] = 0.0
    upload_alarms_only: bool = False
    upload_hours: Annotated[str, empty_or(hours_of, "is not a span of time such as 22:00-06:00")] = ""
    upload_kb_s: Annotated[float, zero_or(10, 1e6, "kB/s")] = 0.0
    keep_days: Annotated[float, Interval(ge=0, le=36_500), Unit("days")] = 0.0
    keep_gb: Annotated[float, Interval(ge=0, le=1e6), Unit("GB")] = 0.0
    keep_tags: tuple[str, ...] = ()


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
        command.add_argument("--store", metavar="URL", help=f"store of recordings to query: {STORE_FORMS}")
        command.add_argument(
            "--fleet", metavar="ADDRESS", help="join the fleet at tcp/HOST:PORT or tls/HOST:PORT (`imuscope fleet`)"
        )
        command.add_argument(
            "--fleet-name",
            metavar="NAME",
            help="unique name of this robot in its fleet and in the store (default: host name)",
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
