"""Robots with known settings, for comparisons with a profile."""

from __future__ import annotations

from typing import Any

from imuscope.server.extensions.fleet.device_settings import DeviceSettings
from imuscope.server.extensions.fleet.summaries import RobotDevice, RobotSummary

PRODUCT = "MTi-630-8A1G6"


def settings_at(rate: int, **other: Any) -> DeviceSettings:
    outputs = [{"data_identifier": 0x2010, "output_frequency": rate}]
    return DeviceSettings("xbus", PRODUCT, "1.12.0", {"OutputConfiguration": {"outputs": outputs}, **other})


def robot(name: str, settings: DeviceSettings | None, group: str = "otters") -> RobotSummary:
    figures = {"rate": 100, "lost": 0, "loss": None, "fix": "", "status": "live", "protocol": "xbus"}
    device = RobotDevice.model_validate(
        {
            **{"id": "1", "name": "MTi", "product": PRODUCT, "serial_number": "1", "firmware": "1.12.0", **figures},
            **dict.fromkeys(("expected_rate", "temperature", "clock_ppm", "clock_uncertainty_ms")),
            "settings": "" if settings is None else settings.digest,
        }
    )
    return RobotSummary.model_validate(
        {
            **{"name": name, "group": group, "state": "live", "since": 0, "latency_ms": None, "version": ""},
            **{
                "address": "",
                "pages": "off",
                "recording": False,
                "disk_free_bytes": None,
                "settings": "unknown",
                "drifted": 0,
            },
            **{"alarms": [], "devices": [device]},
        }
    )
