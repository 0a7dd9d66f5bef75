"""Checks that a write reaches the sensor it was made for.

A request that names its device by the key of a sensor ("xbus-0080800006") is for that sensor only, on whichever port it
is. Jobs that read the device before they write compare the serial number; others ask the user while the number is
not confirmed, because reading it would interrupt the measurement.
"""

from datetime import UTC, datetime

from imuscope.protocols.commands.transactions import DeviceContext, DeviceDriver, Risk
from imuscope.server.configuration.device_controller import DeviceController, JobError


def sensor_of(controller: DeviceController, name: str) -> str:
    """The serial number that a request names; "" if it names the device by its id."""
    info = controller.member.info
    return info.serial_number if info.serial_number and name == info.key and name != info.id else ""


def is_same(driver: DeviceDriver, expected: str, actual: str) -> bool:
    """Whether a serial number is the wanted one, or one that may be; numbers that are not known agree with any."""
    return not expected or not actual or expected in (actual, *driver.formerly(actual))


def check_sensor(controller: DeviceController, expected: str, actual: DeviceContext) -> None:
    """Raise JobError if another sensor than the wanted one was read."""
    if not is_same(controller.driver, expected, actual.serial_number):
        raise JobError(
            f"Another sensor is at this port: {actual.serial_number}, not {expected}. Nothing was written.",
            f"Connect {expected}, or make the change for {actual.serial_number}.",
        )


def doubts(controller: DeviceController, expected: str) -> list[Risk]:
    """The risk that a command reaches another sensor, if that cannot be excluded without interrupting it."""
    info = controller.member.info
    if not expected or info.unconfirmed_since is None:
        return []
    since = datetime.fromtimestamp(info.unconfirmed_since, UTC)
    words = (
        f"The link was lost until {since:%H:%M:%S} UTC; since then it is not known whether this is still {expected}."
    )
    return [Risk("", words)]
