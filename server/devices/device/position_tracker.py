"""The newest position that a device reports, in any protocol.

A GGA sentence with a fix has latitude, longitude, height and satellites; a protocol defines its own messages with
positions (DeviceTraits.position).
"""

import math
from typing import Any

from imuscope.protocols.events import Batch, Event, Text
from imuscope.protocols.family.info import PositionFix
from imuscope.protocols.registry.families import position_of


class PositionTracker:
    """Receives every event of a device; `place` is None until the first position, and then complete."""

    def __init__(self) -> None:
        self.place: PositionFix | None = None

    def update(self, event: Event, protocol: str) -> None:
        """Process an event; cheap for those without a position."""
        if isinstance(event, Batch):
            if position := position_of(protocol, event):
                self._set_position(position.latitude, position.longitude, position.height, position.satellites)
        elif isinstance(event, Text) and event.protocol == "nmea" and event.name.endswith("GGA"):
            fields = event.fields
            if fields.get("quality"):
                self._set_position(fields.get("lat"), fields.get("lon"), fields.get("alt"), fields.get("numSV"))

    def _set_position(self, latitude: Any, longitude: Any, height: Any, satellites: Any) -> None:
        if not (_is_number(latitude) and _is_number(longitude)) or not (latitude or longitude):
            return
        old = self.place or PositionFix(0.0, 0.0, 0.0, 10)
        self.place = PositionFix(
            float(latitude),
            float(longitude),
            float(height) if _is_number(height) else old.height,
            int(satellites) if _is_number(satellites) else old.satellites,
        )


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and math.isfinite(value)
