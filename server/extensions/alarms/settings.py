"""Settings of alarms."""

from dataclasses import dataclass
from typing import ClassVar

from imuscope.server.settings.extension_settings import ExtensionSettings

FILE = "alarms.json"  # in the data folder


@dataclass(frozen=True, slots=True)
class AlarmSettings(ExtensionSettings):
    """Settings of alarms.

    Args:
        webhook_hosts: hosts that webhooks may reach although they are this machine or its link.
    """

    config_help: ClassVar[str] = (
        "  webhook_hosts                   hosts that webhooks may reach though they are this machine or its link\n"
    )
    webhook_hosts: tuple[str, ...] = ()
