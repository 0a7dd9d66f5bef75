"""Settings of this robot's devices, as last read or written, for its fleet: in memory and in a file.

Reading settings interrupts most sensors, so a robot never does it for its fleet: what a user reads or writes in
Configure is remembered, also over a restart of the server. A change made by other means is seen at the
next reading.
"""

import json
import logging
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from imuscope.protocols.commands.transactions import Values
from imuscope.recordings.system import atomic_write
from imuscope.server.configuration.device_controller import ControlError, DeviceController
from imuscope.server.extensions.fleet.model.device_settings import DeviceSettings, encode_settings, writable_settings
from imuscope.server.extensions.fleet.model.reports import RobotDevice

log = logging.getLogger("imuscope.fleet")

FILE = "settings.json"
MAX_FILE = 4 * 1024 * 1024
MAX_DEVICES = 200


@dataclass(frozen=True, slots=True)
class KnownDeviceSettings:
    """Settings of one device.

    Args:
        data: as they are sent.
        digest: "" if they cannot be sent.
        rate: messages/s that they configure; None if unknown.
        read: unix s.
    """

    data: bytes
    digest: str
    rate: float | None
    read: float


class KnownSettings:
    """Settings by device. To be used in the event loop; `answer` from any thread.

    Args:
        folder: of the fleet within the data folder.
        controller_of: the controller of a device; KeyError if there is none.
    """

    def __init__(self, folder: Path, controller_of: Callable[[str], DeviceController]) -> None:
        self._path = folder / FILE
        self._controller_of = controller_of
        self._stored: dict[str, dict[str, Any]] | None = None  # protocol and serial number → values and time
        self._known: dict[str, tuple[object, KnownDeviceSettings]] = {}  # device → what it was made of

    def with_settings(self, devices: tuple[RobotDevice, ...]) -> tuple[RobotDevice, ...]:
        """Devices with the digest of their settings and the rate that these configure."""
        for gone in self._known.keys() - {one.id for one in devices}:
            del self._known[gone]
        return tuple(self._with_settings(one) for one in devices)

    def _with_settings(self, device: RobotDevice) -> RobotDevice:
        try:
            known = self._settings_of(device)
        except (KeyError, ControlError):
            return device
        if known is None:
            return device
        return replace(
            device, settings=known.digest, settings_read=known.read if known.digest else None, expected_rate=known.rate
        )

    def answer(self, device: str) -> bytes:
        """Settings of a device as bytes; empty if they are unknown."""
        _, known = self._known.get(device, (None, None))
        return b"" if known is None else known.data

    def _settings_of(self, device: RobotDevice) -> KnownDeviceSettings | None:
        controller = self._controller_of(device.id)
        driver, known = controller.driver, controller.context
        if not known.serial_number:
            return None
        name = f"{controller.member.info.protocol} {known.serial_number}"
        stored = self._load().get(name)
        source = (controller.values, controller.read_at, known.product, known.firmware)
        before = self._known.get(device.id)
        if before is not None and before[0] == source:
            return before[1]
        values: Mapping[str, Values] = controller.values
        if values and controller.serial_number == known.serial_number:
            values, read = {**(stored or {}).get("values", {}), **values}, controller.read_at
            values = {one: fields for one, fields in values.items() if one not in controller.missing}
            self._save(name, {"values": {one: dict(fields) for one, fields in values.items()}, "read": read})
        elif stored is not None:
            values, read = stored["values"], stored["read"]
        else:
            return None
        protocol = controller.member.info.protocol
        settings = DeviceSettings(protocol, known.product, known.firmware, writable_settings(driver, known, values))
        data = encode_settings(settings)
        rate = None
        with suppress(Exception):  # values of a file that was edited
            rate = driver.message_rate(values, known)
        entry = KnownDeviceSettings(data, settings.digest if data else "", rate, read)
        self._known[device.id] = source, entry
        return entry

    def _load(self) -> dict[str, dict[str, Any]]:
        if self._stored is None:
            self._stored = {}
            with suppress(OSError, ValueError, RecursionError):  # without it, settings are unknown until they are read
                if self._path.stat().st_size <= MAX_FILE:
                    stored = json.loads(self._path.read_text())
                    rows = stored.items() if isinstance(stored, dict) else ()
                    self._stored = {name: one for name, one in rows if _is_entry(one)}
        return self._stored

    def _save(self, name: str, entry: dict[str, Any]) -> None:
        stored = self._load()
        if stored.get(name) == entry:
            return
        stored.pop(name, None)
        stored[name] = entry
        while len(stored) > MAX_DEVICES:
            del stored[next(iter(stored))]
        try:
            atomic_write.write_atomic(self._path, json.dumps(stored))
        except (OSError, TypeError, ValueError) as error:
            log.warning("The settings of devices cannot be kept for the fleet: %s.", error)


def _is_entry(one: object) -> bool:
    if not isinstance(one, dict) or not isinstance(one.get("read"), int | float):
        return False
    values = one.get("values")
    return isinstance(values, dict) and all(isinstance(fields, dict) for fields in values.values())
