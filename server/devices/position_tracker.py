"""Where is this device? The newest place that its events tell, whatever its protocol.

NMEA         GGA, with a fix          latitude, longitude, height, satellites
Inertial Sense  DID_GPS1_POS, INS 1   lla, once the week is known
Xsens        LatLon, AltitudeEllipsoid, GnssPvtData
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from protocols.events import Batch, Event, Text

GNSS_SETS = ("DID_GPS1_POS", "DID_INS_1", "DID_INS_2")


@dataclass(frozen=True, slots=True)
class Position:
    """A place on the ellipsoid: degrees, north and east positive; height in m."""

    latitude: float
    longitude: float
    height: float = 0.0
    satellites: int = 10


class PositionTracker:
    """Told every event of a device; `place` is None until one says where it is."""

    def __init__(self) -> None:
        self.place: Position | None = None

    def hear(self, event: Event) -> None:
        """Take an event; cheap for those that say nothing."""
        if isinstance(event, Batch):
            self._batch(event)
        elif isinstance(event, Text) and event.protocol == "nmea" and event.name.endswith("GGA"):
            fields = event.fields
            if fields.get("quality"):
                self._at(fields.get("lat"), fields.get("lon"), fields.get("alt"), fields.get("numSV"))

    def _batch(self, batch: Batch) -> None:
        columns = batch.columns
        name = batch.message.name
        if name in GNSS_SETS and "lla" in columns and "week" in columns and columns["week"][-1] > 0:
            latitude, longitude, height = columns["lla"][-1].tolist()
            satellites = int(columns["satsUsed"][-1]) if "satsUsed" in columns else None
            self._at(latitude, longitude, height, satellites)
        elif "LatLon" in columns:
            latitude, longitude = columns["LatLon"][-1].tolist()
            height = float(columns["AltitudeEllipsoid"][-1]) if "AltitudeEllipsoid" in columns else None
            self._at(latitude, longitude, height, None)

    def _at(self, latitude: Any, longitude: Any, height: Any, satellites: Any) -> None:
        if not (_is_number(latitude) and _is_number(longitude)) or not (latitude or longitude):
            return
        here = Position(float(latitude), float(longitude))
        old = self.place or here
        here = replace(here, height=float(height) if _is_number(height) else old.height)
        self.place = replace(here, satellites=int(satellites) if _is_number(satellites) else old.satellites)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and math.isfinite(value)
