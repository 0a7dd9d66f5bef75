"""Fixtures of shared ports."""

from collections.abc import Iterator

import pytest

from tests.server.extensions.shares.shared_port import DevicePort


@pytest.fixture
def port() -> Iterator[DevicePort]:
    made = DevicePort()
    yield made
    made.unplug()
