"""Who a device is, learned from what it says by itself: nobody interrupts a measurement to ask."""

from __future__ import annotations

import pytest

from protocols.events import Reply
from protocols.xbus.decoder import XbusDecoder
from protocols.xbus.device import XbusDevice
from protocols.xbus.identity import identity as xbus_identity
from server.live.intake import Identity


def said_by(product: str) -> list[Reply]:
    decoder = XbusDecoder()
    decoder.feed(XbusDevice(product).advance(1_500_000_000), 0)
    return [event for event in decoder.drain() if isinstance(event, Reply)]


@pytest.mark.parametrize("product", ["MTi-630", "MTi-680G"])
def test_a_600_tells_its_product_code_in_configuration(product: str) -> None:
    identity = Identity(xbus_identity)
    assert sum(identity.learn(reply) for reply in said_by(product)) > 0
    assert identity.product.startswith(product)
    assert identity.serial_number != ""


def test_a_600_without_a_code_is_at_least_of_its_series() -> None:
    [configuration] = [reply for reply in said_by("MTi-630") if reply.message.name == "Configuration"]
    silent = Reply(configuration.message, {**configuration.values, "reserved_host": bytes(32)}, 0, 118, 0)
    identity = Identity(xbus_identity)
    identity.learn(silent)
    assert identity.product == "MTi-600 series"
