"""Mounting of a sensor as its devices store it: a rotation from the sensor's axes to those of the vehicle."""

from collections.abc import Callable
from dataclasses import dataclass

from imuscope.protocols.arrays import Floats
from imuscope.protocols.commands.transactions import Values


@dataclass(frozen=True, slots=True)
class MountingSetting:
    """The setting of a family that takes a mounting rotation.

    Args:
        setting: its name.
        field: one of its fields, without which a product does not have it.
        values: of the setting, from the matrix (3, 3) that turns vectors as the device sends them into the vehicle, and
            from its present values. A device that sends vectors already turned by the setting adds the two.
        note: sentence on its effect.
    """

    setting: str
    field: str
    values: Callable[[Floats, Values], Values]
    note: str
