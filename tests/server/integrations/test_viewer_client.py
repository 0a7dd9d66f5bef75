"""Names under which a viewer's process announces devices."""

import io
from typing import Any

import pytest

from imuscope.server import wire
from imuscope.server.integrations import viewer_client
from imuscope.server.integrations.viewer_client import ViewerClient


def device(name: str, product: str = "", former_name: str = "") -> dict[str, Any]:
    return {"id": "1", "name": name, "product": product, "former_name": former_name}


def announced(client: ViewerClient, *devices: dict[str, Any]) -> list[str]:
    client._on_message({"op": "devices", "devices": list(devices)})
    return [one["name"] for one in client.announced]


@pytest.fixture
def client(monkeypatch: pytest.MonkeyPatch) -> ViewerClient:
    monkeypatch.setattr(viewer_client, "lower_priority", lambda by: None)
    return ViewerClient(io.BytesIO(), io.StringIO())


def test_a_product_learnt_later_renames_no_topic_of_a_viewer(
    client: ViewerClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A layout of Foxglove lost its topics when another program asked the device what it is."""
    monkeypatch.setattr(viewer_client, "NAME_S", 0.0)
    assert announced(client, device("Xbus")) == ["Xbus"]
    assert announced(client, device("MTi-630", "MTi-630-8A1G6")) == ["Xbus"]
    assert [one["name"] for one in client.devices] == ["MTi-630"]
    assert announced(client) == []
    assert announced(client, device("MTi-630", "MTi-630-8A1G6")) == ["MTi-630"]  # it was removed, and is new


def test_a_device_has_a_moment_to_be_identified(client: ViewerClient) -> None:
    assert announced(client, device("ttyUSB0")) == ["ttyUSB0"]
    assert announced(client, device("MTi-630", "MTi-630-8A1G6")) == ["MTi-630"]
    assert announced(client, device("MTi-300", "MTi-300")) == ["MTi-630"]  # it was identified: the name stays


def test_what_a_source_was_in_earlier_runs_names_it_before_it_is_identified(client: ViewerClient) -> None:
    assert announced(client, device("ttyUSB0", former_name="MTi-630")) == ["MTi-630"]
    info = wire.DeviceInfo("1", "ttyUSB0", "/dev/ttyUSB0", "serial", "live", former_name="MTi-630")
    assert info.lasting_name == "MTi-630"  # of recordings
