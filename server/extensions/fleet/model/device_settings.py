"""Settings of a device as a fleet compares them: a document, and a digest that names its content.

    values that a user can write ──> DeviceSettings ──> digest: in every status
                                            └──> encoded: the answer of a robot to a request for the settings

What reports itself (temperatures, counters, serial numbers) is left out, so that devices with the same settings have
the same digest, and a fleet server needs the values of a thousand equal robots once. Values from the bus are trusted as
little as all else there: `decode_settings` raises ReportError and nothing else, and a digest is calculated again.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from imuscope.protocols.commands.transactions import DeviceContext, DeviceDriver, Values
from imuscope.protocols.schema.fields import Field
from imuscope.server.configuration.api_models import Difference
from imuscope.server.configuration.settings_diff import ComparedValues, compare
from imuscope.server.extensions.fleet.model.reports import Name, ReportError

MAX_SETTINGS = 65_536  # bytes


@dataclass(frozen=True)
class DeviceSettings:
    """Writable settings of a device, with the product and firmware that define their meaning.

    They are also the message on the bus; `values` are wire values by setting and field.
    """

    protocol: Name
    product: Name
    firmware: Name
    values: Annotated[Mapping[Name, Mapping[Name, Any]], Meta(max_length=500)]

    @cached_property
    def digest(self) -> str:
        """Name of the content: the first 128 bits of its SHA-256, hexadecimal."""
        text = json.dumps([self.protocol, self.product, self.firmware, self.values], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:32]

    @property
    def context(self) -> DeviceContext:
        """The device as drivers know it."""
        return DeviceContext(product=self.product, firmware=self.firmware)


def writable_settings(driver: DeviceDriver, known: DeviceContext, values: Mapping[str, Values]) -> dict[str, Values]:
    """The writable subset of the settings that were read, without those of a single sensor."""
    writable: dict[str, Values] = {}
    for row in driver.settings(known):
        fields = _writable(row.fields, values.get(row.name, {})) if row.write and not row.per_sensor else {}
        if fields:
            writable[row.name] = fields
    return writable


def _writable(fields: Sequence[Field], values: Any) -> Any:
    """Values without those that the device reports by itself; also in records and in lists of them."""
    if isinstance(values, list | tuple):
        return [_writable(fields, one) for one in values]
    if not isinstance(values, Mapping):
        return values
    known = {one.name: one for one in fields if not one.read_only and not one.momentary}
    return {
        name: _writable(known[name].fields, value) if known[name].fields else value
        for name, value in values.items()
        if name in known
    }


def encode_settings(settings: DeviceSettings) -> bytes:
    """Settings as bytes; empty if they are too many, or contain what a message cannot."""
    try:
        data = msgspec.msgpack.encode(_in_dictionaries(settings))
        is_read = decode_settings(data).digest == settings.digest
    except (TypeError, ValueError, OverflowError):
        return b""
    return data if is_read else b""


def _in_dictionaries(settings: DeviceSettings) -> DeviceSettings:
    """The same settings in dictionaries, which alone can be sent and stored."""
    return replace(settings, values={name: dict(fields) for name, fields in settings.values.items()})


def decode_settings(data: bytes) -> DeviceSettings:
    """The settings in these bytes.

    Raises:
        ReportError: they are invalid.
    """
    if len(data) > MAX_SETTINGS:
        raise ReportError(f"The settings have {len(data)} bytes; at most {MAX_SETTINGS} are allowed.")
    try:
        settings = msgspec.msgpack.decode(data, type=DeviceSettings)
        json.dumps(settings.values, allow_nan=False)
        assert settings.digest
    except (msgspec.DecodeError, ValueError, TypeError, OverflowError, RecursionError) as error:
        raise ReportError(f"The settings are not valid: {error!s:.200}.") from None
    return settings


def difference(driver: DeviceDriver, profile: DeviceSettings, robot: DeviceSettings) -> Difference:
    """A robot's settings (left) and those of the profile (right).

    Raises:
        ReportError: the values cannot be compared: a robot reported what no device has.
    """
    here, there = (
        ComparedValues(title, writable_settings(driver, robot.context, one.values), from_device=True)
        for title, one in (("Robot", robot), ("Profile", profile))
    )
    try:
        return compare(driver, robot.context, here, there)
    except Exception as error:  # values from the bus can have any shape below the names
        raise ReportError(f"The settings cannot be compared: {type(error).__name__}.") from None
