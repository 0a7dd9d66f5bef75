"""Mapping from channels to Rerun entities. Pure; does not need Rerun.

A device's attitude is the first of these: its quaternion, its rotation matrix, its Euler angles; an attitude against
the earth's axes (ECEF) is not shown, because it does not define up. Its position is the first of: latitude and
longitude of a solution, metres north, east and down of its own local frame. Every channel is also a curve, under a name
that carries the unit.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from imuscope.recordings.file_names import device_names

Info = Mapping[str, Any]  # a channel as in the manifest of a store: server/wire/ ChannelInfo
WORLD, MAP = "world", "map"
FRAMES = ("ENU", "NED", "NWU")
_LATITUDE, _LONGITUDE = re.compile("^lat", re.I), re.compile("^lon", re.I)
_HEIGHT = re.compile("^(alt|height$|h_?ell)", re.I)
_NOT_ITS_OWN = re.compile("base|reference", re.I)

Path = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Curve:
    """Columns of a channel that share an entity: those of one unit; of a record each separately.

    Args:
        columns: positions in the channel.
    """

    path: Path
    columns: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Attitude:
    """The channel of a device's attitude, and its frame."""

    channel: int
    kind: Literal["quaternion", "matrix", "euler"]
    frame: str
    path: Path


@dataclass(frozen=True, slots=True)
class PositionEntity:
    """The channel of a device's position.

    Args:
        kind: "place": columns are latitude, longitude and height (° and m); "local": north, east, down (m).
        columns: positions in the channel; of a place without a height the third is −1.
        height: the channel of the height (m) if this one has none; 0: none.
        on_map: entity of the same on a map; () for a local one, which has no place on the earth.
    """

    channel: int
    kind: Literal["place", "local"]
    columns: tuple[int, int, int]
    height: int
    path: Path
    on_map: Path = ()


@dataclass(frozen=True, slots=True)
class DeviceEntity:
    """One device: its name among the entities, and its entities."""

    id: str
    name: str
    title: str
    curves: Mapping[int, tuple[Curve, ...]]
    attitude: Attitude | None
    position: PositionEntity | None


def devices_of(devices: Sequence[Mapping[str, Any]], channels: Sequence[Info]) -> list[DeviceEntity]:
    """All devices that have channels, in order.

    Args:
        devices, channels: from a store's manifest.
    """
    entities: list[DeviceEntity] = []
    names = device_names(devices)
    titles = {str(device["id"]): str(device["name"]) for device in devices}
    for key in dict.fromkeys([*titles, *(str(info["device"]) for info in channels)]):
        own = [info for info in channels if info["device"] == key]
        if not own:
            continue
        title = titles.get(key) or key
        name = names.get(key, key)
        entities.append(DeviceEntity(key, name, title, _curves(name, own), _attitude(name, own), _position(name, own)))
    return entities


def _curves(device: str, channels: Sequence[Info]) -> dict[int, tuple[Curve, ...]]:
    names: dict[int, str] = {info["id"]: _title(info) for info in channels}
    doubled = {name for name in names.values() if list(names.values()).count(name) > 1}
    curves: dict[int, tuple[Curve, ...]] = {}
    for info in channels:
        name = names[info["id"]]
        if name in doubled:  # a layout that changed, or quantities that a device sends twice
            name = f"{name} ({info['name']}, {info['id']})"
        units = [column["unit"] for column in info["columns"]]
        every = tuple(range(len(units)))
        if info["kind"] in ("record", "table") or len(set(units)) > 1:
            labels = [column["name"] for column in info["columns"]]
            curves[info["id"]] = tuple(Curve((device, name, _with_unit(labels[i], units[i])), (i,)) for i in every)
        else:
            curves[info["id"]] = (Curve((device, _with_unit(name, units[0] if units else "")), every),)
    return curves


def _title(info: Info) -> str:
    title = str(info["title"] or info["name"])
    group = str(info["group"])
    return f"{group} {title}" if group and group != title else title


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _attitude(device: str, channels: Sequence[Info]) -> Attitude | None:
    kinds: tuple[Literal["quaternion", "matrix", "euler"], ...] = ("quaternion", "matrix", "euler")
    for kind in kinds:
        for info in channels:
            if info["kind"] != kind or str(info["frame"]).startswith("ECEF"):
                continue
            frame = next((one for one in FRAMES if str(info["frame"]).startswith(one)), "ENU")
            return Attitude(info["id"], kind, frame, (WORLD, device, frame, "body"))
    return None


def _position(device: str, channels: Sequence[Info]) -> PositionEntity | None:
    path = (WORLD, device)
    local: PositionEntity | None = None
    for info in channels:
        names = [str(column["name"]) for column in info["columns"]]
        if info["kind"] == "table" or _NOT_ITS_OWN.search(str(info["title"])):
            continue
        lat, lon, high = _where(names, _LATITUDE), _where(names, _LONGITUDE), _where(names, _HEIGHT)
        if lat >= 0 and lon >= 0:
            height = 0 if high >= 0 else _height(info, channels)
            return PositionEntity(info["id"], "place", (lat, lon, high), height, path, (MAP, device))
        if names == ["north", "east", "down"] and info["unit"] == "m" and local is None:
            local = PositionEntity(info["id"], "local", (0, 1, 2), 0, path)
    return local


def _where(names: Sequence[str], pattern: re.Pattern[str]) -> int:
    return next((i for i, name in enumerate(names) if pattern.match(name)), -1)


def _height(place: Info, channels: Sequence[Info]) -> int:
    """The channel of heights in the same message."""
    for info in channels:
        alone = info["kind"] == "scalar" and info["message"] == place["message"] and info["unit"] == "m"
        if alone and _HEIGHT.match(str(info["name"])):
            return int(info["id"])
    return 0
