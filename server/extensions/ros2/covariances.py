"""Standard deviations of what a device measures, for the covariances of its messages.

    [ros2_covariances]
    "/dev/ttyUSB0" = "datasheet"                    of the product, where it is known: the default
    imu = "turn=0.002 tilt=0.01"                    by hand; the others are those of the data sheet
    imu_2 = "/etc/imuscope/imu_2.yaml"              measured: `imuscope analyse … allan --format kalibr`
    imu_3 = "unknown"

By hand they are those of one sample, in SI units and rad. A data sheet and a measurement give densities: the variance
of a sample is then density² × rate / 2, and that of Allan's random walk, which is density / √2, walk² × rate.
"""

import contextlib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from imuscope.protocols.family.sensor_properties import SensorProperties

_ANGULAR, _LINEAR = ("angular_velocity", "turn"), ("linear_acceleration", "acceleration")
COVARIANCES: Mapping[str, Sequence[tuple[str, str]]] = {
    "imu/data": (("orientation", "tilt"), _ANGULAR, _LINEAR),
    "imu/data_raw": (_ANGULAR, _LINEAR),
    "imu/mag": (("magnetic_field", "field"),),
}
"""Covariances of messages by topic, and the quantities whose noise they are made of."""
QUANTITIES = ("turn", "acceleration", "field", "tilt", "heading", "position", "velocity")
NOT_KNOWN_HEADING = math.pi / math.sqrt(3)  # rad: any direction is as likely as any other
MEASURED = {"turn": "gyroscope", "acceleration": "accelerometer"}
MAX_FILE_BYTES = 1 << 16  # bytes of a file


@dataclass(frozen=True, slots=True)
class SensorNoise(SensorProperties):
    """Noise of one device.

    Args:
        sample: standard deviations of a sample by quantity, which outdo densities.
        marks_unknown: whether an unknown covariance begins with −1, so that robots leave the quantity out. Files have
            zeros, as the definition of the message says: readers of a bag take −1 for a quantity that is missing.
    """

    sample: Mapping[str, float] = field(default_factory=dict)
    marks_unknown: bool = True

    def deviation(self, quantity: str, rate: float = 0.0) -> float:
        """Standard deviation of a sample, in SI units and rad; 0 if it is not known.

        Args:
            rate: samples/s.
        """
        if quantity in self.sample:
            return self.sample[quantity]
        if quantity in ("tilt", "heading"):
            return self.tilt if quantity == "tilt" else self.heading
        density = {"turn": self.turn, "acceleration": self.acceleration, "field": self.field}.get(quantity, 0.0)
        return density * math.sqrt(rate / 2)

    def known(self, topic: str) -> list[str]:
        """The covariances of a topic that are known."""
        return [name for name, quantity in COVARIANCES.get(topic, ()) if self.deviation(quantity, 1.0)]


def noise_of(text: str, properties: SensorProperties) -> SensorNoise:
    """The noise of a device by its setting.

    Args:
        text: the setting; "" for the default.
        properties: of its product.

    Raises:
        ValueError: an invalid setting, or a file that cannot be read; the text is for a user.
    """
    sheet = SensorNoise(**asdict(properties))
    if text in ("", "datasheet"):
        return sheet
    if text == "unknown":
        return SensorNoise(properties.axes)
    if text.startswith("/"):
        measured = _measured(text)
        return replace(sheet, turn=measured.get("turn", 0.0), acceleration=measured.get("acceleration", 0.0))
    return replace(sheet, sample=dict(_deviation(one) for one in text.replace(",", " ").split()))


def _deviation(item: str) -> tuple[str, float]:
    name, _, value = item.partition("=")
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if name not in QUANTITIES or not 0 < number < 1e6:
        raise ValueError(
            f"{item!r:.60} is neither datasheet, unknown, the path of a file, nor a standard deviation such as "
            f"turn=0.002; there are {', '.join(QUANTITIES)}."
        )
    return name, number


def _measured(path: str) -> Mapping[str, float]:
    """Densities that `imuscope analyse` has written for Kalibr: name: value in each line."""
    try:
        with Path(path).open(encoding="utf-8", errors="replace") as file:
            text = file.read(MAX_FILE_BYTES)
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {(error.strerror or str(error)).lower()}.") from None
    densities = {}
    for quantity, sensor in MEASURED.items():
        if match := re.search(rf"^{sensor}_noise_density:\s*([0-9.eE+-]+)", text, re.M):
            with contextlib.suppress(ValueError):
                densities[quantity] = float(match[1]) * math.sqrt(2)
    if not densities or not all(0 < one < 1e6 for one in densities.values()):
        raise ValueError(f"{path} has no noise density; write it with `imuscope analyse FILE allan … --format kalibr`.")
    return densities
