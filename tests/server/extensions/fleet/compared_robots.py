"""Robots with known settings, for comparisons with a profile."""

from typing import Any

from imuscope.server.extensions.fleet.model.device_settings import DeviceSettings
from imuscope.server.extensions.fleet.model.reports import RobotDevice, RobotStatus
from imuscope.server.extensions.fleet.model.summaries import RobotSummary, summary_of

PRODUCT = "MTi-630-8A1G6"


def settings_at(rate: int, **other: Any) -> DeviceSettings:
    outputs = [{"data_identifier": 0x2010, "output_frequency": rate}]
    return DeviceSettings("xbus", PRODUCT, "1.12.0", {"OutputConfiguration": {"outputs": outputs}, **other})


def robot(name: str, settings: DeviceSettings | None, group: str = "otters") -> RobotSummary:
    digest = "" if settings is None else settings.digest
    figures = {"serial_number": "1", "firmware": "1.12.0", "protocol": "xbus"}
    device = RobotDevice("1", "MTi", "live", PRODUCT, **figures, rate=100, settings=digest)
    return summary_of(name, RobotStatus(group=group, devices=(device,)), 0)
