"""Device identity learned from its own messages, without interrupting a measurement."""

from __future__ import annotations

from imuscope.protocols.events import Reply
from imuscope.protocols.xbus.decoder import XbusDecoder
from imuscope.protocols.xbus.device_info import identity as xbus_identity
from imuscope.protocols.xbus.enums import STATUS_BITS
from imuscope.protocols.xbus.simulator.device import XbusSimulator
from imuscope.server.devices.device.device_state import DeviceState
from imuscope.server.devices.device.ingest import DeviceIdentity
from imuscope.server.streaming.telemetry import Telemetry
from imuscope.server.wire import DeviceInfo
from tests.support.each_row import each_row


def replies_of(product: str) -> list[Reply]:
    decoder = XbusDecoder()
    decoder.feed(XbusSimulator(product).advance(1_500_000_000), 0)
    return [event for event in decoder.drain() if isinstance(event, Reply)]


@each_row("product", ["MTi-630", "MTi-680G"])
def test_a_600_has_its_product_code_in_configuration(product: str) -> None:
    identity = DeviceIdentity(xbus_identity)
    assert sum(identity.update(reply) for reply in replies_of(product)) > 0
    assert identity.product.startswith(product)
    assert identity.serial_number != ""


def test_a_600_without_a_code_is_at_least_of_its_series() -> None:
    [configuration] = [reply for reply in replies_of("MTi-630") if reply.message.name == "Configuration"]
    silent = Reply(configuration.message, {**configuration.values, "reserved_host": bytes(32)}, 0, 118, 0)
    identity = DeviceIdentity(xbus_identity)
    identity.update(silent)
    assert identity.product == "MTi-600 series"


@each_row(
    ("product", "absent", "present"),
    [
        ("MTi-610-8A1G6", {"FilterValid", "FilterMode", "RtkStatus", "NoRotationUpdateStatus"}, {"Selftest"}),
        ("MTi-630-8A1G6", {"GnssFix", "FilterMode", "RtkStatus"}, {"FilterValid", "NoRotationUpdateStatus"}),
        ("MTi-670-8A1G6", {"RtkStatus"}, {"FilterValid", "FilterMode"}),
        ("MTi-680G-8A1G6", set(), {"RtkStatus", "FilterValid"}),
        ("", set(), {"FilterValid"}),
    ],
)
def test_a_product_is_not_faulted_for_a_filter_that_it_does_not_have(
    product: str, absent: set[str], present: set[str]
) -> None:
    """An IMU showed a permanent red "Filter valid: not set"."""
    portrait = DeviceState(
        Telemetry.create(lambda: 0.0).bus, DeviceInfo("1", "d", "test", "file", "live", protocol="xbus"), str
    )
    portrait.set(product=product)
    assert absent <= set(portrait.info.absent)
    assert not present & set(portrait.info.absent)
    assert set(portrait.info.absent) <= {bits.name for bits in STATUS_BITS}
